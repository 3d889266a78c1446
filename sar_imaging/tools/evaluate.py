# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Replay a recording through the running nodes and measure the image they make.

Run: python -m sar_imaging.tools.evaluate bags/spotlight --output out/demo --launch-nodes
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tqdm import tqdm

from sar_imaging.files import check_target, filling, write_json
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality import ScattererQuality, measure_scatterer

from ..recordings.bag_io import pose_messages, raw_messages
from ..recordings.recording import RecordedAperture, Recording, read_recording
from .arguments import add_aperture, add_output, positive
from .evaluation import examination, node_launch
from .evaluation.examination import summary
from .evaluation.node_launch import plan_launch
from .evaluation.observer import Observer, ReceivedImage
from .evaluation.replay import Published, Replayer
from .node_processes import (
    MODES,
    NO_LOG_FILES,
    PIPELINE,
    NodeProcesses,
    isolated_environment,
    node_names,
)
from .plots import save_image_png
from .program import command_parser, main_of

PRODUCTS = ('image.npy', 'image.png', 'quality.json')
START_TIMEOUT_S = 900.0  # compiling on a busy machine; a node that ends is noticed at once

_EPILOG = """\
Writes image.npy (complex64, row 0 is the largest y), image.png and quality.json into the output
folder. docs/evaluate.md explains every figure. Exit status: 0 when the image came and was
measured, 1 with a reason when not, 3 when it looks like noise or shows a mistake, which is named.

  python -m sar_imaging.tools.evaluate bags/spotlight --output out/demo --launch-nodes
  python -m sar_imaging.tools.evaluate bags/psf --output out/psf      (nodes run already)
  python -m sar_imaging.tools.evaluate out/bags/my_radar --output out/my_radar --launch-nodes \\
      --config my_radar.yaml -p grid.spacing:=0.1
"""


DOUBTFUL_STATUS = 3


class EvaluationError(RuntimeError):
    """The image did not come, or cannot be evaluated."""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('evaluate', 'Replay a recording of radar pulses through the nodes over '
                       'real DDS, wait for the image and measure it.', _EPILOG)
    p.add_argument('bag', type=Path, help='rosbag2 folder with the topic /pulses')
    add_output(p)
    p.add_argument('--launch-nodes', action='store_true',
                   help="start the nodes for this run, with the recording's own grid and aperture")
    node_launch.add_arguments(p)
    p.add_argument('--mode', choices=MODES, help='of backprojection: exact images, or '
                   'sub-apertures joined by afbp_fusion (default: as configured, else '
                   f'{MODES[0]})')
    p.add_argument('--pipeline', action='store_true',
                   help='through sar_pipeline instead of separate nodes')
    p.add_argument('--namespace', type=_namespace, default='', metavar='NAME',
                   help='namespace of the nodes, such as radar1 (default: none)')
    add_aperture(p)
    p.add_argument('--rate', type=positive(float), metavar='FACTOR',
                   help='follow the recording times, so many times as fast; 1 is real time '
                        '(default: as fast as the nodes work without loss)')
    p.add_argument('--timeout', type=positive(float), default=60.0, metavar='SECONDS',
                   help='longest wait for running nodes, for the image after the last pulse, '
                        'and for the search for mistakes after it (default: %(default)g)')
    return p


def _namespace(text: str) -> str:
    name = text.strip('/')
    if name and not re.fullmatch(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', name, re.ASCII):
        raise argparse.ArgumentTypeError(f'{text} is not a namespace such as radar1')
    return name


def run(arguments: argparse.Namespace) -> int:
    """Evaluate as the command line asks; returns the exit status."""
    if not arguments.launch_nodes and (arguments.config or arguments.params or arguments.values):
        parser().error('--config, --params and -p tell parameters of nodes that --launch-nodes '
                       'starts; those that run already keep theirs')
    recording = read_recording(arguments.bag)
    if recording.phase_centre_m is None:
        raise EvaluationError(f'{arguments.bag} has pulses without phase centres and no poses to '
                              'tell them; the nodes cannot image them')
    output = _prepared(arguments.output)
    with contextlib.ExitStack() as stack:
        check, names, own_grid = _nothing, None, True
        if arguments.launch_nodes:
            launch = plan_launch(arguments, recording.truth)
            names, own_grid = launch.nodes, launch.own
            environment = isolated_environment()
            os.environ.update(environment)  # for this process, before its middleware starts
            check = stack.enter_context(NodeProcesses(
                launch.parameters, output / 'log', environment, namespace=arguments.namespace,
                arguments=dict.fromkeys(names, launch.arguments), nodes=names,
                files=launch.files)).check
        names = names or node_names(arguments.mode or MODES[0], pipeline=arguments.pipeline)
        result = _replay(recording, arguments, names, check)
    grid = _checked_grid(recording, result.grid, result.received, own_grid)
    quality = _measure(recording, result, grid)
    with filling(output) as folder:
        np.save(folder / 'image.npy', result.received.image)
        save_image_png(folder / 'image.png', result.received.image, grid,
                       truth=(recording.truth or {}).get('scatterers', ()),
                       title=_title(recording, result))
        write_json(folder / 'quality.json', quality)
    print(summary(quality))
    print(f'written: {", ".join(str(output / name) for name in PRODUCTS)}')
    return DOUBTFUL_STATUS if examination.doubtful(quality['focus']) else 0


def _prepared(output: Path) -> Path:
    """Output folder without results of an earlier run, which could pass for those of this one."""
    if output.exists() and not output.is_dir():
        raise EvaluationError(f'--output {output} is not a folder; choose another')
    output.mkdir(parents=True, exist_ok=True)
    for name in PRODUCTS:
        check_target(output / name)
        (output / name).unlink(missing_ok=True)
    return output


def _nothing() -> None:
    """Check of nodes that somebody else looks after."""


@dataclasses.dataclass(frozen=True)
class _Result:
    """What a replay gave."""

    aperture: RecordedAperture
    pulses_per_aperture: int
    received: ReceivedImage
    seconds: float
    grid: MapGrid
    counters: dict[str, dict[str, int]]
    predicted_error_db: float | None
    autofocus: dict[str, Any] | None


def _replay(recording: Recording, arguments: argparse.Namespace, names: Sequence[str],
            check: Callable[[], None]) -> _Result:
    """Replay the recording and wait for the image."""
    with _spinning_node(arguments.namespace) as (node, executor):
        observer = Observer(node, executor, names, past=arguments.launch_nodes,
                            tell=lambda line: tqdm.write(line, file=sys.stderr))
        replayer = Replayer(node, executor, check=check, imager=(
            PIPELINE[0] if arguments.pipeline else 'backprojection'))
        timeout_s = START_TIMEOUT_S if arguments.launch_nodes else arguments.timeout
        print('waiting for the nodes ...', file=sys.stderr)
        observer.wait_for_nodes(timeout_s, check)
        replayer.wait_for_subscriber(timeout_s)
        length = observer.pulses_per_aperture(timeout_s, check)
        aperture = recording.aperture(length, arguments.aperture)
        observer.expect(aperture.first_ns, aperture.last_ns)
        replayer.check = check = functools.partial(_check_rejections, observer, check)
        with tqdm(total=recording.n_messages, unit='message', desc='replaying') as bar:
            sent_s = _send(recording, aperture, replayer, arguments.rate, bar)
            _await_image(observer, aperture, arguments.timeout, check, bar)
        counters = _await_counters(observer, arguments.timeout, check)
        image, grid = observer.image, observer.grid
        assert image is not None and grid is not None  # which were waited for
        return _Result(aperture, length, image, image.received_s - sent_s, grid, counters,
                       _predicted_error_db(observer, counters),
                       observer.autofocus.get(aperture.number))


@contextlib.contextmanager
def _spinning_node(namespace: str) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Node of this program and its executor; both end with the block."""
    rclpy.init(args=list(NO_LOG_FILES),
               signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    with contextlib.ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        node = rclpy.create_node('evaluate', namespace=namespace)
        stack.callback(node.destroy_node)
        executor = SingleThreadedExecutor()
        stack.callback(executor.shutdown)
        executor.add_node(node)
        yield node, executor


def _await_counters(observer: Observer, timeout_s: float, check: Callable[[], None]
                    ) -> dict[str, dict[str, int]]:
    """Counters that include the last pulse and the image, after the search for mistakes."""
    now = time.monotonic()
    for name in observer.stages:
        observer.status_after(name, now, now + 5.0, check)
    # an image is published before it is counted
    while not _imagers(observer.counted()) and time.monotonic() < now + 5.0:
        observer.spin(check)
    while observer.diagnosing and time.monotonic() < now + timeout_s:
        observer.spin(check)
    return observer.counted()


def _imagers(counters: dict[str, dict[str, int]]) -> list[str]:
    """Nodes that published images."""
    return [name for name in counters if counters[name].get('images_published')]


def _predicted_error_db(observer: Observer, counters: dict[str, dict[str, int]]) -> float | None:
    """Of the latest image, as the node says that formed it."""
    imagers = _imagers(counters)
    return observer.figure(imagers[-1], 'predicted_error_db') if imagers else None


def _send(recording: Recording, aperture: RecordedAperture, replayer: Replayer, rate: float | None,
          bar: tqdm) -> float:
    """Publish all messages; return when the last one of the aperture went out."""
    sent_s = math.nan

    def on_published(message: Published) -> None:
        nonlocal sent_s
        bar.update()
        if message.index == aperture.last_message:
            sent_s = message.time_s

    replayer.replay(raw_messages(recording.path), poses=pose_messages(recording.path), rate=rate,
                    on_published=on_published)
    return sent_s


def _check_rejections(observer: Observer, check: Callable[[], None]) -> None:
    """Check the nodes, and end at once when one of them refuses everything."""
    check()
    if reason := observer.refusal():
        raise EvaluationError(reason)


def _await_image(observer: Observer, aperture: RecordedAperture, timeout_s: float,
                 check: Callable[[], None], bar: tqdm) -> None:
    bar.set_description('waiting for the image')
    deadline = time.monotonic() + timeout_s
    while observer.image is None or observer.grid is None:
        if reason := observer.refusal(sent_all=True) or observer.refused(aperture.number):
            raise EvaluationError(f'{reason}; the nodes report:\n{observer.report()}')
        if time.monotonic() > deadline:
            others = f', but {observer.n_images} of other apertures' if observer.n_images else ''
            raise EvaluationError(f'no image of aperture {aperture.number} came within '
                                  f'{timeout_s:g} s{others}; the nodes report:\n'
                                  f'{observer.report()}')
        observer.spin(check)
    bar.set_description('image received')


def _checked_grid(recording: Recording, grid: MapGrid, received: ReceivedImage,
                  own: bool) -> MapGrid:
    """Grid of the image; where it may be the nodes' own, another one is but a warning."""
    if received.image.shape != grid.shape:
        raise EvaluationError(f'image of {received.image.shape} pixels, but map_metadata says '
                              f'{grid.shape}; several backprojection nodes may be running')
    expected = recording.grid
    if expected is None or _same(grid, expected):
        return grid if expected is None else expected
    message = f'the nodes image {grid}, the recording proposes {expected}'
    if not own:
        raise EvaluationError(message)
    print(f'warning: {message}', file=sys.stderr)
    return grid


def _same(a: MapGrid, b: MapGrid) -> bool:
    tolerance = 1e-3 * b.spacing_m
    return (a.shape == b.shape and np.allclose(a.centre_m, b.centre_m, rtol=0, atol=tolerance)
            and math.isclose(a.spacing_m, b.spacing_m, rel_tol=1e-6))


def _measure(recording: Recording, result: _Result, grid: MapGrid) -> dict[str, Any]:
    """Contents of quality.json."""
    truth = recording.truth or {}
    buffer, entry = result.counters['pulse_buffer'], next(iter(result.counters))
    scatterers = [_measure_one(recording, result, grid, s) for s in truth.get('scatterers', ())]
    return {
        'scatterers': [q.as_json() | _on_the_earth(recording.datum, q, grid) for q in scatterers],
        'pulses_received': buffer.get('pulses_received'),
        'pulses_missing': buffer.get('pulses_missing'),
        'blocks_rejected': result.counters[entry].get('blocks_rejected'),
        'seconds_last_pulse_to_image': round(result.seconds, 4),
        'focus': examination.examine(recording, result.aperture.number,
                                     result.pulses_per_aperture, result.received.image, grid,
                                     result.autofocus),
        'autofocus': result.autofocus,
        'predicted_error_db': result.predicted_error_db,
        'recording': str(recording.path),
        'aperture': result.aperture.number,
        'pulses_per_aperture': result.pulses_per_aperture,
        'pulses_in_aperture': result.aperture.n_pulses,
        'image_stamp_ns': result.received.stamp_ns,
        'grid': dataclasses.asdict(grid),
        'nodes': result.counters,
    }


def _on_the_earth(datum: Datum | None, scatterer: ScattererQuality, grid: MapGrid
                  ) -> dict[str, Any]:
    """Latitude and longitude of a peak, where the recording says where its frame stands."""
    if datum is None or not math.isfinite(scatterer.peak_x_m):
        return {}
    place = datum.to_geographic([scatterer.peak_x_m, scatterer.peak_y_m, grid.centre_m[2]])
    return dict(zip(('peak_latitude_deg', 'peak_longitude_deg', 'peak_height_m'),
                    map(float, place), strict=True))


def _measure_one(recording: Recording, result: _Result, grid: MapGrid,
                 scatterer: dict[str, Any]) -> ScattererQuality:
    assert recording.truth is not None  # whose scatterers are measured
    half_width = recording.truth['cut_half_width_m']
    return measure_scatterer(
        result.received.image, grid, scatterer['position_m'],
        aperture_centre_m=recording.phase_centre_at(result.received.stamp_ns),
        wavenumber_rad_per_m=recording.radar.wavenumber_rad_per_m,
        cut_half_width_range_m=half_width['range'],
        cut_half_width_azimuth_m=half_width['azimuth'], name=scatterer['name'],
        neighbours_m=[s['position_m'] for s in recording.truth['scatterers']
                      if s is not scatterer])


def _title(recording: Recording, result: _Result) -> str:
    name = (recording.truth or {}).get('scenario', recording.path.name)
    radar = recording.radar
    return (f'{name}: aperture {result.aperture.number}, {result.aperture.n_pulses} pulses, '
            f'{radar.carrier_hz / 1e9:.4g} GHz, {radar.bandwidth_hz / 1e6:.4g} MHz')


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
