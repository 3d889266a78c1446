# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Latency of images of robots' radars through the nodes, at the radar's own rate.

`sar_pipeline` gets the pulses of a scene of `benchmarks.robots` as messages, aperture after
aperture, as fast as the radar sends them: at the pulse repetition frequency of its file, or what
the speed of its platform asks for. Latency is the time from sending the last pulse of an aperture
to receiving its complex image, over real DDS. Linux only. Run from the repository root::

    python -m benchmarks.robots_live
    python -m benchmarks.robots_live --table
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import math
import os
import pathlib
import tempfile
from collections.abc import Iterator

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.recordings import bag_io
from sar_imaging.signal import PulseBlock
from sar_imaging.tools.node_processes import (
    PIPELINE,
    isolated_environment,
    parameters_from_truth,
    pipeline_parameters,
)

from .robots import Scene, arguments_of, measure_all, sent_ns, simulated
from .support.live_flight import PRF_HZ, PULSES_PER_MESSAGE, Message
from .support.live_system import Received, System

_SECONDS, _LEAST_IMAGES, _PATIENCE_S = 20.0, 8, 5.0


def live(scene: Scene) -> dict:
    """Latency of images through the nodes at the radar's own rate, of `_SECONDS` seconds."""
    block, grid = simulated(scene)
    per_aperture, aperture_s = block.n_pulses, block.n_pulses / scene.prf_hz
    n_images = max(_LEAST_IMAGES, round(_SECONDS / aperture_s))
    with tempfile.TemporaryDirectory() as folder, System(
            PIPELINE, parameters(grid, block), pathlib.Path(folder)) as system:
        for first, count in ((0, 1), (1, n_images)):  # the first image takes its plan
            cpu = system.cpu_s()
            fed = system.feed(messages(block, scene.prf_hz, first, count), 1.0)
            with contextlib.suppress(TimeoutError):  # images that are missing are counted
                system.wait(lambda n=count: len(system.images) >= n, 'images', _PATIENCE_S)
        busy = sum(sum(system.cpu_s()[n].values()) - sum(cpu[n].values()) for n in PIPELINE)
        delays = [system.delay_s(image, (aperture_number(image, scene.prf_hz, per_aperture) + 1)
                                 * per_aperture - 1) for image in system.images]
        p50, p99 = np.percentile([1e3 * d for d in delays], [50, 99]) if delays else (None, None)
        return {'prf_hz': round(scene.prf_hz, 1), 'pulses_per_image': per_aperture,
                'pixels': math.prod(grid.shape), 'images': len(delays), 'expected': n_images,
                'aperture_s': round(aperture_s, 3), 'latency_p50_ms': p50 and round(p50, 1),
                'latency_p99_ms': p99 and round(p99, 1), 'cores': round(busy / fed.seconds, 3),
                'lost': system.losses()}


def aperture_number(image: Received, prf_hz: float, per_aperture: int) -> int:
    """Which aperture an image is of; `middle` counts pulses of the flight's frequency."""
    return int(image.middle / PRF_HZ * prf_hz // per_aperture)


def parameters(grid: MapGrid, block: PulseBlock) -> dict:
    """Parameters of sar_pipeline for a map; equal blocks of about 1 MB, as is best."""
    made = parameters_from_truth({
        'frame': 'map', 'pulses_per_aperture': block.n_pulses, 'grid': {
            'centre_m': grid.centre_m, 'n_x': grid.n_x, 'n_y': grid.n_y,
            'spacing_m': grid.spacing_m}})
    n_blocks = next(n for n in itertools.count(max(1, round(block.samples.nbytes / 1e6)))
                    if block.n_pulses % n == 0)
    made['pulse_buffer']['pulses_per_block'] = block.n_pulses // n_blocks
    del made['backprojection']['target_db']  # as a robot runs it
    return pipeline_parameters(made)


def messages(block: PulseBlock, prf_hz: float, first: int, count: int) -> Iterator[Message]:
    """So many repetitions of an aperture after `first` ones, a few pulses in each message."""
    numbers = np.arange(first * block.n_pulses, (first + count) * block.n_pulses)
    # Messages end where `System` expects it, whatever aperture a pulse belongs to.
    for some in np.split(numbers, np.flatnonzero(numbers % PULSES_PER_MESSAGE == 0)):
        if len(some):
            sent = dataclasses.replace(
                block.select(some % block.n_pulses), counter=some, frame='map',
                stamp_ns=sent_ns(some, prf_hz))
            yield Message(some[-1] / prf_hz, bag_io.serialise(sent), int(some[0]), len(some))


def table(results: dict) -> str:
    """Rows for docs/benchmarks.md."""
    rows = ['| case | pulses per s | pulses per image | pixels | images | latency, median (ms) | '
            '99 % (ms) | cores | lost |',
            '| --- | --- | --- | --- | --- | --- | --- | --- | --- |']
    for name, f in results['live'].items():
        rows.append(f'| {name} | {f["prf_hz"]:g} | {f["pulses_per_image"]} | {f["pixels"]} | '
                    f'{f["images"]} of {f["expected"]} | '
                    f'{f["latency_p50_ms"]} | {f["latency_p99_ms"]} | '
                    f'{f["cores"]} | {sum(f["lost"].values())} |')
    return '\n'.join(rows)


def main() -> None:
    """Measure the cases that are named, all if none is."""
    arguments = arguments_of(__doc__)
    if arguments.table:
        print(table(json.loads(arguments.results.read_text())))
        return
    os.environ.update(isolated_environment())
    measure_all(arguments, 'live', live)


if __name__ == '__main__':
    main()
