# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The live system: losses, latency, sustained rates, processor time, endurance, start-up.

Run from the repository root: ``python -m benchmarks.live`` (about twelve minutes), then
``python -m benchmarks.live --parts endurance`` (ten minutes more) and, for the tables of
docs/live_performance.md, ``python -m benchmarks.tables``. Real processes over real DDS, pulses of
a simulated flight sent in real time or faster. Results are written one by one; one that fails is
written as failed. Linux only.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import pathlib
import re
import signal
import tempfile
import time
import traceback

import numba
import numpy as np

from sar_imaging.recordings import bag_io
from sar_imaging.tools.node_processes import (
    AFBP_NODES,
    NODES,
    PIPELINE,
    isolated_environment,
    parameters_from_truth,
    pipeline_parameters,
)

from .support.live_flight import PRF_HZ, PULSES_PER_APERTURE, PULSES_PER_MESSAGE, Flight, grid
from .support.live_system import Fed, System, difference_db
from .support.machine import machine

STARTUP_BAG = pathlib.Path(__file__).parents[1] / 'bags' / 'spotlight'
RESULTS = pathlib.Path(__file__).parent / 'results' / 'live.json'
# Nodes, and mode of backprojection.
SETUPS = {'separate nodes': (NODES, 'image'), 'sar_pipeline': (PIPELINE, 'image'),
          'separate nodes, AFBP': (AFBP_NODES, 'subapertures'),
          'sar_pipeline, AFBP': (PIPELINE, 'subapertures')}
_NODE_OF = {'subapertures.': 'backprojection', 'pulses_per_block': 'pulse_buffer'}
SIDES = {'flight': 512, 'million': 1024, 'transport': 16}  # pixels
IMAGES_EVERY = 8  # sub-apertures from one progressive image to the next
STARTUP_TRIES = 3  # the first fills the caches
FLIGHT_APERTURES, SLIDING_APERTURES, SHORT_APERTURES = 15, 6, 3
RATES = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
TRIAL_S = 6.0  # of each rate; what waits at its end would have grown to the limit of latency
LATENCY_LIMIT_S = 0.75
PATIENCE_S = 20.0


def make_system(setup: str, truth: dict, folder: pathlib.Path, n_side: int | None = None,
                *, keep: bool = False, topic: str = 'image_complex', **options) -> System:
    """System for a recording's truth, or for the flight's scene with so many pixels.

    Options are parameters of buffer, backprojection and fusion.
    """
    if n_side:
        map_grid = grid(n_side)
        truth = truth | {'grid': {'centre_m': list(map_grid.centre_m), 'n_x': n_side,
                                  'n_y': n_side, 'spacing_m': map_grid.spacing_m}}
    names, mode = SETUPS[setup]
    parameters = parameters_from_truth(truth, mode)
    for name, value in options.items():
        node = next((node for start, node in _NODE_OF.items() if name.startswith(start)),
                    'afbp_fusion')
        parameters[node][name] = value
    if names == PIPELINE:
        parameters = pipeline_parameters(parameters)
    return System(names, parameters, folder, keep=keep, topic=topic)


def apertures(messages, n_apertures: int):
    """Messages of the next so many apertures."""
    return itertools.islice(messages, n_apertures * PULSES_PER_APERTURE // PULSES_PER_MESSAGE)


def run(system: System, messages, n_apertures: int, rate: float) -> dict:
    """Feed whole apertures, wait for all images; what came of it."""
    cpu = system.cpu_s()
    fed = system.feed(apertures(messages, n_apertures), rate)
    wait_for_images(system, n_apertures)
    delays = [system.delay_s(image, (image.aperture + 1) * PULSES_PER_APERTURE - 1)
              for image in system.images]
    return describe(system, fed, cpu) | {
        'images': len(system.images), 'expected_images': n_apertures,
        'latency_ms': milliseconds(delays)}


def wait_for_images(system: System, n_images: int) -> None:
    """Wait for so many images since feeding began, and not for ever."""
    try:
        system.wait(lambda: len(system.images) >= n_images, 'images', patience_s=PATIENCE_S)
    except TimeoutError:
        pass  # counted by the caller


def describe(system: System, fed: Fed, cpu_before: dict) -> dict:
    """What all parts tell of a run."""
    used = {name: {kind: after[kind] - cpu_before[name][kind] for kind in after}
            for name, after in system.cpu_s().items()}
    return {'pulses': fed.n_pulses, 'seconds': round(fed.seconds, 2),
            'pulses_per_s': round(fed.n_pulses / fed.seconds, 1),
            'megabytes_per_s': round(fed.n_bytes / 1e6 / fed.seconds, 2),
            'losses': system.losses(),
            'processors': {kind: round(sum(u[kind] for u in used.values()) / fed.seconds, 3)
                           for kind in ('transport', 'work')},
            'memory_mb': round(sum(system.memory_mb().values()), 1)}


def milliseconds(seconds: list[float | None]) -> dict[str, float]:
    """Median and largest."""
    known = [s for s in seconds if s is not None]
    if not known:
        return {}
    return {'median': round(1e3 * float(np.median(known)), 1),
            'max': round(1e3 * max(known), 1)}


def measure_startup(setup: str, flight: Flight, folder: pathlib.Path) -> dict:
    """Seconds from starting the processes to the first image of bags/spotlight, caches warm."""
    truth = bag_io.read_truth(STARTUP_BAG)
    messages = [cdr for _, cdr in bag_io.raw_messages(STARTUP_BAG)]
    tries = []
    for number in range(STARTUP_TRIES):
        with make_system(setup, truth, folder / str(number)) as system:
            connected_s = time.monotonic() - system.started_s
            for cdr in messages:
                system.publish(cdr)
            system.wait(lambda s=system: s.images, 'the first image')
            tries.append((system.images[0].time_s - system.started_s, connected_s))
    best = min(tries[1:] or tries)
    return {'first_image_s': round(best[0], 2), 'connected_s': round(best[1], 2)}


def measure_flight(setup: str, flight: Flight, folder: pathlib.Path) -> dict:
    """The whole flight in real time, and its images against exact ones formed offline."""
    side = SIDES['flight']
    with make_system(setup, flight.truth, folder, side, keep=True) as system:
        result = run(system, flight.messages(), FLIGHT_APERTURES, rate=1.0)
        images = list(system.images)
    references = flight.offline_images(grid(side))
    differences = [difference_db(i, references[i.aperture]) for i in images]
    return result | {'largest_difference_db': round(max(differences), 1) if images else None}


def measure_million(setup: str, flight: Flight, folder: pathlib.Path) -> dict:
    """A scene of a million pixels in real time."""
    with make_system(setup, flight.truth, folder, SIDES['million']) as system:
        return run(system, flight.messages(), SHORT_APERTURES, rate=1.0)


def measure_progressive(setup: str, flight: Flight, folder: pathlib.Path) -> dict:
    """Images of a million pixels while an aperture arrives: latency of each and of the last."""
    with make_system(setup, flight.truth, folder, SIDES['million'],
                     images_every=IMAGES_EVERY) as system:
        cpu = system.cpu_s()
        fed = system.feed(apertures(flight.messages(), SHORT_APERTURES), rate=1.0)
        settle(system)
        last = [i.last_so_far for i in system.images]
        delays = [system.delay_s(*pair) for pair in zip(system.images, last, strict=True)]
        final = [(n + 1) % PULSES_PER_APERTURE == 0 for n in last]
        return describe(system, fed, cpu) | {
            'images': len(system.images),
            'progressive_latency_ms': milliseconds(
                [d for d, is_final in zip(delays, final, strict=True) if not is_final]),
            'final_latency_ms': milliseconds(
                [d for d, is_final in zip(delays, final, strict=True) if is_final])}


def measure_sliding(setup: str, flight: Flight, folder: pathlib.Path) -> dict:
    """An image of a million pixels with every sub-aperture: latency and work of an update.

    Received as the grey values that a viewer takes, and as complex values.
    """
    complex_values = slide(setup, flight, folder / 'complex', 'image_complex')
    return slide(setup, flight, folder / 'grey', 'image_quicklook') | {
        'complex_latency_ms': complex_values['latency_ms']}


def slide(setup: str, flight: Flight, folder: pathlib.Path, topic: str) -> dict:
    """A sliding aperture in real time, its images received on one topic."""
    # Longer blocks would hold the last pulses of a window back.
    with make_system(setup, flight.truth, folder, SIDES['million'], topic=topic, **{
            'subapertures.sliding': True, 'pulses_per_block': PULSES_PER_MESSAGE}) as system:
        cpu = system.cpu_s()
        fed = system.feed(apertures(flight.messages(), SLIDING_APERTURES), rate=1.0)
        settle(system)
        log = system.nodes.log_file(system.names[-1]).read_text()
        work_s = [float(s) for s in re.findall(r'image of .*?; ([\d.e+-]+) s of work', log)]
        result = describe(system, fed, cpu)
        n_images = len(system.images)
        return result | {
            'images': n_images,
            'latency_ms': milliseconds([system.delay_s(i, i.last_of_window)
                                        for i in system.images]),
            'fusion_work_ms': milliseconds(work_s[1:]),
            'processor_ms_per_update': round(
                1e3 * result['processors']['work'] * fed.seconds / max(n_images, 1), 1)}


def settle(system: System) -> None:
    """Wait until no image came for some seconds."""
    def quiet():
        newest = system.images[-1].time_s if system.images else 0.0
        return time.monotonic() > max(newest, system.last_sent_s) + 2.0

    system.wait(quiet, 'the last images')


def measure_rate(setup: str, flight: Flight, folder: pathlib.Path, kind: str = 'flight') -> dict:
    """Largest of `RATES` times real time without loss and without growing queues."""
    best: dict = {'rate': None}
    messages = flight.endless()
    with make_system(setup, flight.truth, folder, SIDES[kind]) as system:
        run(system, messages, 1, rate=2.0)  # the first image takes its plan
        for rate in RATES:
            n_apertures = max(2, round(TRIAL_S * rate * PRF_HZ / PULSES_PER_APERTURE))
            result = run(system, messages, n_apertures, rate)
            sustained = (not result['losses'] and result['images'] == n_apertures
                         and result['latency_ms']['max'] < 1e3 * LATENCY_LIMIT_S
                         and result['pulses_per_s'] > 0.9 * rate * PRF_HZ)
            print(f'  {setup}, {kind}: {rate} times real time', sustained, result, flush=True)
            if not sustained:
                return best | {'not_sustained': {'rate': rate} | result}
            best = {'rate': rate} | result
    return best


def measure_transport(setup: str, flight: Flight, folder: pathlib.Path) -> dict:
    """The same with hardly any pixels: what transport alone allows."""
    return measure_rate(setup, flight, folder, 'transport')


def measure_endurance(setup: str, flight: Flight, folder: pathlib.Path, *, minutes: float,
                      rate: float) -> dict:
    """The flight again and again: memory and latency against time."""
    samples: list[tuple[float, float]] = []
    n_apertures = int(60 * minutes * rate * PRF_HZ / PULSES_PER_APERTURE)
    with make_system(setup, flight.truth, folder, SIDES['flight']) as system:
        begun = time.monotonic()

        def sample():
            now = time.monotonic() - begun
            if not samples or now > samples[-1][0] + 2.0:
                samples.append((now, sum(system.memory_mb().values())))

        cpu = system.cpu_s()
        fed = system.feed(apertures(flight.endless(), n_apertures), rate, sample)
        wait_for_images(system, n_apertures)
        delays = [(i.time_s - begun,
                   system.delay_s(i, (i.aperture + 1) * PULSES_PER_APERTURE - 1))
                  for i in system.images]
        result = describe(system, fed, cpu)
    later = [s for s in samples if s[0] > fed.seconds / 4]  # after what is allocated once
    times, memory = np.array(later).T
    arrived, waited = np.array([d for d in delays if d[1] is not None]).T
    return result | {
        'rate': rate, 'minutes': round(fed.seconds / 60, 2), 'images': len(delays),
        'expected_images': n_apertures,
        'memory_mb': {'first': round(float(memory[0]), 1), 'last': round(float(memory[-1]), 1),
                      'slope_mb_per_minute': round(slope_per_minute(times, memory), 3)},
        'latency_ms': milliseconds(waited.tolist()) | {
            'growth_per_minute': round(1e3 * slope_per_minute(arrived, waited), 3)}}


def slope_per_minute(seconds, values) -> float:
    """Of the straight line through values."""
    return float(np.polyfit(seconds / 60, values, 1)[0])


_AFBP = [name for name, (_, mode) in SETUPS.items() if mode == 'subapertures']
_EXACT = [name for name in SETUPS if name not in _AFBP]
# What to call for which setups; the most wanted first.
PARTS = {'startup': (measure_startup, [*SETUPS]), 'flight': (measure_flight, [*SETUPS]),
         'million': (measure_million, ['sar_pipeline', 'sar_pipeline, AFBP']),
         'sliding': (measure_sliding, ['sar_pipeline, AFBP']),
         'progressive': (measure_progressive, _AFBP), 'rate': (measure_rate, [*SETUPS]),
         'transport': (measure_transport, _EXACT)}


class Results:
    """What was measured, written to a file with every result."""

    def __init__(self, path: pathlib.Path):
        self._path = path
        self.values = json.loads(path.read_text()) if path.exists() else {}

    def add(self, part: str, setup: str, result: dict) -> None:
        """Replace a result."""
        self.values.setdefault(part, {})[setup] = result | {'load': round(os.getloadavg()[0], 1)}
        self.values['machine'] = machine() | {'numba_threads': numba.get_num_threads()}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text(json.dumps(self.values, indent=1) + '\n')

    def sustained_rate(self, setup: str) -> float:
        """Largest rate that was sustained; raises ValueError where none is known."""
        rate = self.values.get('rate', {}).get(setup, {}).get('rate')
        if rate is None:
            raise ValueError(f'{self._path} has no sustained rate of {setup}; measure it with '
                             '--parts rate, or give --rate')
        return rate


def measure(part: str, setup: str, flight: Flight, arguments: argparse.Namespace,
            results: Results) -> dict:
    """One result; a failure is one, too."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            if part == 'endurance':
                return measure_endurance(
                    setup, flight, pathlib.Path(folder), minutes=arguments.minutes,
                    rate=arguments.rate or results.sustained_rate(setup))
            return PARTS[part][0](setup, flight, pathlib.Path(folder))
        except Exception as error:  # the other results are worth having
            traceback.print_exc()
            return {'failed': f'{type(error).__name__}: {error}'}


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--parts', nargs='+', choices=[*PARTS, 'endurance'], default=list(PARTS))
    parser.add_argument('--setups', nargs='+', choices=SETUPS,
                        help='only these; sar_pipeline for endurance')
    parser.add_argument('--minutes', type=float, default=10.0, help='of the endurance run')
    parser.add_argument('--rate', type=float,
                        help='of it, times real time; the largest sustained if left out')
    parser.add_argument('--bag', type=pathlib.Path, default=pathlib.Path('out/bags/live_flight'))
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the nodes, too
    os.environ.update(isolated_environment())
    flight = Flight(arguments.bag)
    results = Results(arguments.output)
    for part in arguments.parts:
        if part == 'endurance':
            setups = arguments.setups or ['sar_pipeline']
        else:
            setups = [s for s in PARTS[part][1] if s in (arguments.setups or SETUPS)]
        for setup in setups:
            begun = time.monotonic()
            result = measure(part, setup, flight, arguments, results)
            results.add(part, setup, result)
            print(f'{part}, {setup} ({time.monotonic() - begun:.0f} s):', result, flush=True)


if __name__ == '__main__':
    main()
