# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images where robots are, at three wanted errors, beside FastSAR's cubic former.

Rail, rover, drone and car see a map from 7 to 60 m, and two more from 100 m and 10 km; the radars
of `sar_imaging/config` see theirs, with the bands and the places of those files. Pulses are phase
histories of scatterers all over the map, from which both sides begin. Of exact backprojection,
AFBP and 'auto', and of FastSAR, images are made in turn; times are medians, on one core those of
its processor, on two of the clock. Errors are against time-domain correlation in float64, over
random and the brightest pixels. Run from the repository root, with an interpreter that has FastSAR
where it shall be compared (see `benchmarks.support.fastsar_imagers`)::

    make benchmark-robots
    make benchmark-robots FASTSAR=build/fastsar/bin/python
    python -m benchmarks.robots --table
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import pathlib
import statistics
import time
import warnings
from typing import NamedTuple

import numpy as np
import yaml

from sar_imaging.compilation import numba
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform
from sar_imaging.simulation.scenarios.scenario import START_NS

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'robots.json'
CONFIG = pathlib.Path(__file__).parents[1] / 'sar_imaging' / 'config'
TARGETS_DB, METHODS, CORES = (-80.0, -60.0, -45.0), ('exact', 'afbp', 'auto'), (1, 2)
FASTSAR = 'fastsar, cubic'
_ROUNDS, _SCATTERERS, _SLOW_S = 5, 40, 4.0


class Scene(NamedTuple):
    """A map and the pulses of its scatterers."""

    carrier_hz: float
    bandwidth_hz: float
    side: int
    spacing_m: float
    tx_m: np.ndarray
    rx_m: np.ndarray
    prf_hz: float


def of_numbers(carrier_hz, range_m, side, spacing_m, pulses, receivers, elevation_rad,
               speed_m_per_s) -> Scene:
    """Broadside of a straight track; pixels are half of the resolution in both directions."""
    wavelength_m = SPEED_OF_LIGHT / carrier_hz
    tx = np.zeros((pulses, receivers, 3))
    tx[..., 0] = -range_m * math.cos(elevation_rad)
    tx[..., 2] = range_m * math.sin(elevation_rad)
    tx[..., 1] = (np.linspace(-0.5, 0.5, pulses) * wavelength_m * range_m
                  / (4 * spacing_m))[:, None]
    return Scene(carrier_hz, min(SPEED_OF_LIGHT / (4 * spacing_m), 0.45 * carrier_hz), side,
                 spacing_m, tx, _receivers(tx, wavelength_m / 2),
                 speed_m_per_s / float(tx[1, 0, 1] - tx[0, 0, 1]))


def of_file(name: str) -> Scene:
    """Of an example configuration: an aperture of its radar and platform, and its map."""
    parts = yaml.safe_load((CONFIG / f'{name}.yaml').read_text())
    nodes, checked = parts['/**']['ros__parameters'], parts['/**/check_config']['ros__parameters']
    radar, platform, grid = checked['radar'], checked['platform'], nodes['grid']
    seconds = (np.arange(nodes['pulses_per_aperture'])
               - nodes['pulses_per_aperture'] / 2) / radar['prf_hz']
    centre, velocity = ([platform.get(f'{part}_{axis}', 0.0) for axis in 'xyz']
                        for part in ('centre', 'velocity'))
    tx = np.repeat((centre + np.multiply.outer(seconds, velocity))[:, None], radar['channels'], 1)
    return Scene(radar['carrier_hz'], radar['bandwidth_hz'], round(grid['size_x']
                 / grid['spacing']), grid['spacing'], tx, _receivers(
                     tx, radar.get('channel_spacing_m', 0.0)), radar['prf_hz'])


def _receivers(tx, apart_m: float) -> np.ndarray:
    rx = tx.copy()
    rx[..., 1] += (np.arange(tx.shape[1]) - (tx.shape[1] - 1) / 2) * apart_m
    return rx


#: Carrier, Hz; range, m; pixels of a side and their spacing, m; pulses, receivers, elevation, rad;
#: speed of the platform, m/s.
CASES = {'R1': (78.6e9, 7.0, 300, 0.025, 256, 4, 0.12, 1.0),
         'R2': (78.6e9, 20.0, 800, 0.025, 256, 8, 0.12, 1.0),
         'R3': (4e9, 10.0, 256, 0.044, 380, 1, 0.5, 2.0),
         'R4': (24e9, 60.0, 512, 0.15, 512, 1, 0.1, 5.0),
         '100 m': (10e9, 100.0, 1024, 0.05, 256, 1, 0.0, 5.0),
         '10 km': (10e9, 1e4, 1024, 0.25, 256, 1, 0.0, 50.0),
         '2 km, 128²': (10e9, 2e3, 128, 0.25, 256, 1, 0.0, 20.0),
         '2 km, 512²': (10e9, 2e3, 512, 0.25, 256, 1, 0.0, 20.0)}
FILES = ('automotive_77ghz', 'drone_uwb', 'airborne_x_band')


def simulated(scene: Scene) -> tuple[PulseBlock, MapGrid]:
    """Stepped-frequency pulses of random scatterers, and the map."""
    rng, tx, rx = np.random.default_rng(1), scene.tx_m, scene.rx_m
    side_m, bandwidth = scene.side * scene.spacing_m, scene.bandwidth_hz
    # FastSAR's first pixels lie half of the sides from the origin
    grid = MapGrid((-scene.spacing_m / 2, -scene.spacing_m / 2, 0.0), scene.side, scene.side,
                   scene.spacing_m)
    points = np.c_[(rng.random((_SCATTERERS, 2)) - 0.5) * 0.95 * side_m, np.zeros(_SCATTERERS)]
    amplitude = np.exp(2j * np.pi * rng.random(_SCATTERERS))
    delay = sum(np.linalg.norm(c[:, :, None] - points, axis=-1) for c in (tx, rx)) / SPEED_OF_LIGHT
    reference = 0.5 * (delay.min() + delay.max())
    n = 2 ** math.ceil(math.log2(2.8 * math.sqrt(2) * side_m / SPEED_OF_LIGHT * bandwidth + 30))
    frequency = scene.carrier_hz + (np.arange(n) - (n - 1) / 2) * bandwidth / n
    samples = np.stack([np.exp(-2j * np.pi * np.mod(np.multiply.outer(
        frequency, d - reference), 1.0)) @ amplitude for d in delay.reshape(-1, _SCATTERERS)])
    radar = RadarParameters(scene.carrier_hz, bandwidth, bandwidth, reference,
                            waveform=Waveform.STEPPED_FREQUENCY)
    number = np.arange(len(tx))
    return PulseBlock(radar, False, sent_ns(number, scene.prf_hz), number, samples.reshape(
        *tx.shape[:2], n).astype(np.complex64), tx, rx), grid


def sent_ns(number: np.ndarray, prf_hz: float) -> np.ndarray:
    """When pulses are sent, ns."""
    return START_NS + np.rint(number * (1e9 / prf_hz)).astype(np.int64)


class Work:
    """Something that is done in turn with others, and its times."""

    def __init__(self, call, clock=time.process_time):
        self.call, self._clock, self._seconds = call, clock, []
        self()  # which may compile
        self._seconds.clear()
        self.result = self()

    def __call__(self):
        """Do it once more."""
        begin = self._clock()
        result = self.call()
        self._seconds.append(self._clock() - begin)
        return result

    @property
    def seconds(self) -> float:
        """Median."""
        return statistics.median(self._seconds)

    @property
    def slow(self) -> bool:
        """Once is enough."""
        return bool(self._seconds) and self._seconds[0] > _SLOW_S


def planned(block, grid, method: str, target_db: float):
    """An imager of phase histories with its plan."""
    return plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m, method=method,
                      target_db=target_db, compressed=False)


def measured(block: PulseBlock, grid: MapGrid) -> dict:
    """What each method takes for each error, beside FastSAR where it is installed."""
    pairs = block.tx_m.size // 3 * math.prod(grid.shape)
    plans, images, found, other = {}, {}, {}, None
    numba.set_num_threads(1)
    if importlib.util.find_spec('fastsar') is not None:
        from .support import fastsar_imagers

        other = Work(fastsar_imagers.exact(block, grid, 'cubic'))
    for target_db in TARGETS_DB:
        for method in METHODS:
            key = f'{method}, {target_db:g} dB'
            try:
                plans[key] = Work(lambda m=method, t=target_db: planned(block, grid, m, t),
                                  time.thread_time)  # FastSAR's threads spin on for a while
            except ValueError as refusal:
                found[key] = {'refused': str(refusal)}
                continue
            images[key] = Work(lambda imager=plans[key].result: imager(block))
    rounds = [*plans.values(), *images.values(), *([other] if other else [])]
    for _ in range(_ROUNDS):
        for work in rounds:
            if not work.slow:
                work()
    for key, work in images.items():
        found[key] = described(plans[key], work, pairs)
        found[key] |= checked(work.result, grid, block)
    if other:
        found[FASTSAR] = {'giga_per_s': round(1e-9 * pairs / other.seconds, 3)} | errors_of(
            other.result, grid, block)
        for key in images:
            found[key]['times_fastsar'] = round(other.seconds / images[key].seconds, 1)
    for cores in CORES[1:]:
        numba.set_num_threads(min(cores, numba.config.NUMBA_NUM_THREADS))
        for key, plan in plans.items():
            both = Work(lambda imager=plan.result: imager(block), time.perf_counter)
            for _ in range(_ROUNDS):
                both()
            found[key][f'image_ms_{cores}_cores'] = round(1e3 * both.seconds, 2)
    numba.set_num_threads(1)
    return found


def described(plan: Work, image: Work, pairs: int) -> dict:
    """Rate, share of planning, and the predicted time beside the measured one."""
    report = image.result.report
    return {'plan': str(report.plan), 'giga_per_s': round(1e-9 * pairs / image.seconds, 2),
            'image_ms': round(1e3 * image.seconds, 2), 'plan_ms': round(1e3 * plan.seconds, 2),
            'planning_share': round(plan.seconds / (plan.seconds + image.seconds), 3),
            'images_per_s': round(1 / image.seconds, 1),
            'measured_over_predicted': round(image.seconds / report.seconds, 2)}


def checked(image, grid: MapGrid, block: PulseBlock) -> dict:
    """Predicted and true errors."""
    return {'predicted_db': round(image.report.predicted_error_db, 1)} | errors_of(
        image.samples, grid, block)


def errors_of(samples, grid: MapGrid, block: PulseBlock) -> dict:
    """Of random and the brightest pixels."""
    error = measure_error(samples, grid, block, fit_scale=True, n_pixels=20, n_brightest=15)
    return {'error_db': round(error.error_db, 1),
            'brightest_db': round(error.brightest_error_db, 1)}


def table(results: dict) -> str:
    """Rows for docs/benchmarks.md."""
    rows = ['| case | method | rates at -80, -60, -45 dB | times FastSAR | errors dB | '
            'planning % | images per s | measured / predicted time | two cores |',
            '| --- | --- | --- | --- | --- | --- | --- | --- | --- |']
    for name, found in results['cases'].items():
        for method in METHODS:
            cells = [found[f'{method}, {t:g} dB'] for t in TARGETS_DB]
            if all('refused' in c for c in cells):
                rows.append(f'| {name} | {method} | refused | | | | | | |')
                continue

            def told(key, cells=cells, scale=1):
                return ', '.join('–' if key not in c else f'{scale * c[key]:.3g}' for c in cells)

            faster = ', '.join(format(c['image_ms'] / c['image_ms_2_cores'], '.2g')
                               if 'image_ms_2_cores' in c else '–' for c in cells)
            rows.append(f'| {name} | {method} | {told("giga_per_s")} | {told("times_fastsar")} | '
                        f'{told("error_db")} | {told("planning_share", scale=100)} | '
                        f'{told("images_per_s")} | {told("measured_over_predicted")} | '
                        f'{faster} |')
        if FASTSAR in found:
            rows.append(f'| {name} | FastSAR | {found[FASTSAR]["giga_per_s"]} | 1 | '
                        f'{found[FASTSAR]["error_db"]} | | | | |')
    return '\n'.join(rows)


def scene_of(name: str) -> Scene:
    """Scene of a case or of an example configuration."""
    return of_numbers(*CASES[name]) if name in CASES else of_file(name)


def arguments_of(doc: str) -> argparse.Namespace:
    """Names of cases, the file of results, and whether to print its table."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument('names', nargs='*', metavar='NAME',
                        help=f'some of {", ".join((*CASES, *FILES))}')
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--table', action='store_true', help='print what was measured before')
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - {*CASES, *FILES}:
        parser.error(f'no case {", ".join(sorted(unknown))}')
    arguments.names = arguments.names or (*CASES, *FILES)
    return arguments


def measure_all(arguments: argparse.Namespace, part: str, measure) -> None:
    """Measure the named scenes and write each into a part of the results."""
    known = json.loads(arguments.results.read_text()) if arguments.results.exists() else {}
    found = known.setdefault(part, {})
    for name in arguments.names:
        found[name] = measure(scene_of(name)) | {'load': round(os.getloadavg()[0], 1),
                                                 'machine': machine()['cpu']}
        print(name, json.dumps(found[name]), flush=True)
        arguments.results.write_text(json.dumps(known | {'machine': machine()}, indent=1) + '\n')


def main() -> None:
    """Measure the cases that are named, all if none is."""
    arguments = arguments_of(__doc__)
    if arguments.table:
        print(table(json.loads(arguments.results.read_text())))
        return
    warnings.simplefilter('ignore')  # FastSAR tells of its errors, which are measured
    measure_all(arguments, 'cases', lambda scene: measured(*simulated(scene)))


if __name__ == '__main__':
    main()
