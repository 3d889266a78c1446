"""The live system: losses, latency, sustained rates, processor time, endurance, start-up.

Run from the repository root: ``python -m benchmarks.live`` (about ten minutes), and
``python -m benchmarks.live --parts endurance`` (ten minutes more). Real processes over real DDS,
pulses of a simulated flight sent in real time or faster. Linux only.
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

import numba
import numpy as np

from sar_imaging.tools import bag_io
from sar_imaging.tools.node_processes import (
    AFBP_NODES,
    NODES,
    PIPELINE,
    isolated_environment,
    parameters_from_truth,
    pipeline_parameters,
)

from .live_flight import PRF_HZ, PULSES_PER_APERTURE, Flight, grid
from .live_system import System, difference_db
from .machine import machine

STARTUP_BAG = pathlib.Path(__file__).parents[1] / 'bags' / 'spotlight'
RESULTS = pathlib.Path(__file__).parent / 'results' / 'live.json'
# Nodes, and mode of backprojection.
SETUPS = {'separate nodes': (NODES, 'image'), 'sar_pipeline': (PIPELINE, 'image'),
          'separate nodes, AFBP': (AFBP_NODES, 'subapertures'),
          'sar_pipeline, AFBP': (PIPELINE, 'subapertures')}
SIDES = {'flight': 512, 'latency': 1024, 'transport': 16}  # pixels
TRIAL_APERTURES = 5
QUEUE_BLOCKS = 512  # a busy moment of the machine is no loss: half a minute of blocks
RATES = (1, 1.5, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
LATENCY_LIMIT_S = 2.0  # at a rate that can be sustained the queues stay short


def make_system(setup: str, truth: dict, folder: pathlib.Path, n_side: int | None = None,
                *, sliding: bool = False) -> System:
    """System for a recording's truth, or for the flight's scene with so many pixels."""
    if n_side:
        map_grid = grid(n_side)
        truth = truth | {'grid': {'centre_m': list(map_grid.centre_m), 'n_x': n_side,
                                  'n_y': n_side, 'spacing_m': map_grid.spacing_m}}
    names, mode = SETUPS[setup]
    parameters = parameters_from_truth(truth, mode)
    for values in parameters.values():
        values['worker_queue_size'] = QUEUE_BLOCKS
    if sliding:
        parameters['backprojection']['subapertures.sliding'] = True
    if names == PIPELINE:
        parameters = pipeline_parameters(parameters)
    return System(names, parameters, folder)


def whole_apertures(flight: Flight, n_apertures: int):
    """Messages of so many apertures from the beginning."""
    return itertools.takewhile(lambda m: m.first < n_apertures * PULSES_PER_APERTURE,
                               flight.messages())


def run(system: System, messages: list, rate: float) -> dict:
    """Feed messages, wait for all images; what came of it."""
    n_apertures = sum(m.n_pulses for m in messages) // PULSES_PER_APERTURE
    cpu = system.cpu_s()
    seconds = system.feed(messages, rate)
    try:
        system.wait(lambda: len(system.images) >= n_apertures, 'images', patience_s=20.0)
    except TimeoutError:
        pass  # counted below
    used = {name: {kind: after[kind] - cpu[name][kind] for kind in after}
            for name, after in system.cpu_s().items()}
    latency_s = [image.time_s - system.sent_s[image.aperture] for image in system.images]
    n_bytes = sum(len(m.cdr) for m in messages)
    return {'pulses': sum(m.n_pulses for m in messages), 'seconds': round(seconds, 2),
            'pulses_per_s': round(sum(m.n_pulses for m in messages) / seconds, 1),
            'megabytes_per_s': round(n_bytes / 1e6 / seconds, 2),
            'images': len(system.images), 'expected_images': n_apertures,
            'losses': system.losses(),
            'latency_ms': milliseconds(latency_s),
            'processors': {name: {kind: round(value / seconds, 3) for kind, value in u.items()}
                           for name, u in used.items()},
            'memory_mb': {n: round(v, 1) for n, v in system.memory_mb().items()}}


def milliseconds(seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {}
    return {'median': round(1e3 * float(np.median(seconds)), 1),
            'max': round(1e3 * max(seconds), 1)}


def measure_flight(flight: Flight, folder: pathlib.Path) -> dict:
    """The whole flight in real time through each setup, and its images against offline ones."""
    messages = list(flight.messages())
    results, images = {}, {}
    for setup in SETUPS:
        with make_system(setup, flight.truth, folder / setup, SIDES['flight']) as system:
            results[setup] = run(system, messages, rate=1.0)
            images[setup] = system.images
        print(setup, results[setup], flush=True)
    differences = {setup: [] for setup in SETUPS}
    for number, reference in enumerate(flight.offline_images(grid(SIDES['flight']))):
        for setup, received in images.items():
            differences[setup] += [difference_db(image, reference) for image in received
                                   if image.aperture == number]
    for setup, values in differences.items():
        results[setup]['largest_difference_db'] = round(max(values), 1)
    return results


def measure_latency(flight: Flight, folder: pathlib.Path) -> dict:
    """A scene of a million pixels in real time."""
    messages = list(whole_apertures(flight, 4))
    results = {}
    for setup in SETUPS:
        with make_system(setup, flight.truth, folder / setup, SIDES['latency']) as system:
            results[setup] = run(system, messages, rate=1.0)
        print(setup, results[setup], flush=True)
    return results


def measure_sliding(flight: Flight, folder: pathlib.Path) -> dict:
    """An image with every sub-aperture: work and delay of an update."""
    messages = list(whole_apertures(flight, 4))
    setup = 'sar_pipeline, AFBP'
    with make_system(setup, flight.truth, folder, SIDES['flight'], sliding=True) as system:
        system.feed(messages, rate=1.0)
        last_s = system.sent_s[max(system.sent_s)]
        system.wait(lambda: time.monotonic() > last_s + 5.0, 'the last images')
        log = system.nodes.log_file(system.names[0]).read_text()
        work_s = [float(s) for s in re.findall(r'image of .*?; ([\d.e+-]+) s of work', log)]
        result = {'images': len(system.images), 'losses': system.losses(),
                  'fusion_work_ms': milliseconds(work_s[1:]),
                  'last_image_after_last_pulse_ms': round(
                      1e3 * (system.images[-1].time_s - last_s), 1)}
    print('sliding', result, flush=True)
    return {setup: result}


def measure_rate(flight: Flight, folder: pathlib.Path) -> dict:
    """Largest of `RATES` times real time without loss and without growing queues."""
    messages = list(whole_apertures(flight, TRIAL_APERTURES))
    results = {}
    for kind, setup in itertools.product(('flight', 'transport'), SETUPS):
        best = None
        for rate in RATES:
            with make_system(setup, flight.truth, folder / f'{setup}{rate}',
                             SIDES[kind]) as system:
                result = run(system, messages, rate)
            sustained = (not result['losses'] and result['images'] == TRIAL_APERTURES
                         and result['latency_ms']['max'] < 1e3 * LATENCY_LIMIT_S
                         and result['pulses_per_s'] > 0.9 * rate * PRF_HZ)
            print(kind, setup, rate, sustained, result, flush=True)
            if not sustained:
                break
            best = {'rate': rate} | result
        results[f'{setup}, {SIDES[kind]}² pixels'] = best or {'sustained': 'none of the rates'}
    return results


def measure_startup(flight: Flight, folder: pathlib.Path) -> dict:
    """Seconds from starting the processes to the first image of bags/spotlight, caches warm."""
    truth = bag_io.read_truth(STARTUP_BAG)
    messages = [cdr for _, cdr in bag_io.raw_messages(STARTUP_BAG)]
    results = {}
    for setup in SETUPS:
        tries = []
        for _ in range(4):  # the first fills the caches
            with make_system(setup, truth, folder / setup) as system:
                connected_s = time.monotonic() - system.started_s
                for cdr in messages:
                    system.publish(cdr)
                system.wait(lambda s=system: s.images, 'the first image')
                tries.append((system.images[0].time_s - system.started_s, connected_s))
        best = min(tries[1:])
        results[setup] = {'first_image_s': round(best[0], 2), 'connected_s': round(best[1], 2)}
        print(setup, results[setup], flush=True)
    return results


def measure_endurance(flight: Flight, folder: pathlib.Path, *, minutes: float, rate: float,
                      setup: str) -> dict:
    """The flight again and again: memory and latency against time."""
    samples = []
    with make_system(setup, flight.truth, folder, SIDES['flight']) as system:
        begun = time.monotonic()

        def sample():
            now = time.monotonic() - begun
            if not samples or now > samples[-1][0] + 2.0:
                samples.append((now, sum(system.memory_mb().values())))

        def messages():
            for loop in itertools.count():
                for message in flight.messages(loop):
                    offset = loop * flight.truth['n_pulses'] / PRF_HZ
                    if (message.time_s + offset) / rate > 60 * minutes:
                        return
                    yield type(message)(message.time_s + offset, message.cdr, message.first,
                                        message.n_pulses)

        seconds = system.feed(messages(), rate, sample)
        n_whole = len(system.sent_s)
        system.wait(lambda: len(system.images) >= n_whole, 'the last image')
        losses = system.losses()
        latency = [(i.time_s - begun, i.time_s - system.sent_s[i.aperture])
                   for i in system.images if i.aperture in system.sent_s]
    half = [s for s in samples if s[0] > seconds / 4]  # after what is allocated once
    times, memory = np.array(half).T
    arrived, waited = np.array(latency).T
    slope = np.polyfit(times / 60, memory, 1)[0]
    return {'setup': setup, 'rate': rate, 'minutes': round(seconds / 60, 2),
            'pulses_per_s': round(rate * PRF_HZ, 1), 'images': len(latency), 'losses': losses,
            'memory_mb': {'first': round(memory[0], 1), 'last': round(memory[-1], 1),
                          'slope_mb_per_minute': round(float(slope), 3)},
            'latency_ms': milliseconds(waited.tolist()) | {
                'growth_per_minute': round(1e3 * float(np.polyfit(arrived / 60, waited, 1)[0]),
                                           3)}}


PARTS = {'startup': measure_startup, 'flight': measure_flight, 'latency': measure_latency,
         'sliding': measure_sliding, 'rate': measure_rate}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--parts', nargs='+', choices=[*PARTS, 'endurance'], default=list(PARTS))
    parser.add_argument('--minutes', type=float, default=10.0, help='of the endurance run')
    parser.add_argument('--rate', type=float, default=2.0, help='of it, times real time')
    parser.add_argument('--setup', choices=SETUPS, default='sar_pipeline', help='of it')
    parser.add_argument('--bag', type=pathlib.Path, default=pathlib.Path('out/bags/live_flight'))
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--setups', nargs='+', choices=SETUPS, default=list(SETUPS),
                        help='of the other parts')
    arguments = parser.parse_args()
    for setup in set(SETUPS) - {*arguments.setups, arguments.setup}:
        del SETUPS[setup]
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the nodes, too
    os.environ.update(isolated_environment())
    flight = Flight(arguments.bag)
    results = json.loads(arguments.output.read_text()) if arguments.output.exists() else {}
    for part in arguments.parts:
        with tempfile.TemporaryDirectory() as folder:
            if part == 'endurance':
                found = measure_endurance(
                    flight, pathlib.Path(folder), minutes=arguments.minutes, rate=arguments.rate,
                    setup=arguments.setup)
            else:
                found = PARTS[part](flight, pathlib.Path(folder))
        results[part] = {'load': round(os.getloadavg()[0], 1),
                         'results': results.get(part, {}).get('results', {}) | found}
        results['machine'] = machine() | {'numba_threads': numba.get_num_threads()}
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
