# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP beside exact backprojection, FFBP and FastSAR 0.1.8's FFBP, on the same phase history.

Run from the repository root in an environment that has FastSAR
(`benchmarks.support.fastsar_imagers` shows how to make one)::

    build/fastsar/bin/python -m benchmarks.afbp

Three comparisons, all with two threads, maps as output, and errors against float64 time-domain
correlation of the phase history, over the image and over its brightest pixels:

- `imagers`: AFBP, FFBP with sub-apertures of the same length, and exact backprojection, from
  range profiles to the map;
- `fastsar`: AFBP and FastSAR, from the phase history to the map;
- `growth`: how the times of `fastsar` at 10 km grow with the number of pixels, where pulses grow
  with the side of the image, and AFBP's peak memory beside the size of the fused spectrum.

Plans are made outside the timed part, by all programs, and their times stated. A geometry that
AFBP refuses is reported with its reason.
"""

from __future__ import annotations

import dataclasses
import json
import os
import pathlib
import time

THREADS = 2
os.environ['OMP_NUM_THREADS'] = str(THREADS)  # read when FastSAR loads its library
os.environ['OPENBLAS_NUM_THREADS'] = str(THREADS)
os.environ.setdefault('JAX_PLATFORMS', 'cpu')

from tqdm import tqdm  # noqa: E402

from sar_imaging.imaging.imager import plan_image  # noqa: E402
from sar_imaging.quality.verification import measure_error  # noqa: E402
from sar_imaging.signal.range_compression import RangeCompressor  # noqa: E402

from .support import fastsar_imagers  # noqa: E402
from .support.machine import machine  # noqa: E402
from .support.measuring import (  # noqa: E402
    best_seconds,
    fitted_exponent,
    parse_arguments,
    peak_memory,
    report_peak,
)
from .support.scenes import Case, phase_history  # noqa: E402

RESULTS = pathlib.Path(__file__).parent / 'results' / 'afbp.json'
SPACING_M = 0.125  # 600 MHz and a resolution of 0.25 m
SIDES = (1024, 2048, 4096, 8192)
GROWTH_RANGE_M = 10e3
TARGET_DB = -56.0  # at which no image is less exact than FastSAR's

IMAGERS = tuple(Case(range_m, 2048, 2048, 1, SPACING_M) for range_m in (1e3, 10e3))
SUBAPERTURES = (16, 64)  # pulses
# A map of 1 km at 1 km lies half beside the radar; all others are ahead of it.
FASTSAR = tuple(Case(range_m, side, side, 1, SPACING_M)
                for range_m in (1e3, 5e3, 10e3) for side in SIDES
                if side * SPACING_M < 0.6 * range_m)


def planned(make):
    """What `make()` plans, and how long it took."""
    started = time.perf_counter()
    plan = make()
    return plan, round(time.perf_counter() - started, 3)


def described(image, case: Case, block) -> dict:
    """Errors of an image."""
    error = measure_error(image, case.grid, block, fit_scale=True)
    return {'error_db': round(error.error_db, 1),
            'brightest_error_db': round(error.brightest_error_db, 1)}


def compare_imagers(case: Case) -> dict:
    """Our own imagers from range profiles to the map."""
    block = phase_history(case)
    profiles = RangeCompressor.for_block(block)(block)
    radar, n, where = profiles.radar, profiles.n_samples, (profiles.tx_m, profiles.rx_m)
    exact = plan_image(case.grid, radar, n, method='exact', target_db=-80.0)
    imagers = {'exact': {'plan_s': 0.0}}
    calls = {'exact': lambda: exact(profiles)}
    for length in SUBAPERTURES:
        for method, own in (('afbp', {}), ('ffbp', {'merge_factor': 2})):
            name = f'{method}_{length}'
            imager, plan_s = planned(lambda m=method, n_pulses=length, o=own: plan_image(
                case.grid, radar, n, *where, method=m, target_db=-50.0,
                pulses_per_subaperture=n_pulses, **o))
            imagers[name] = {'plan_s': plan_s}
            calls[name] = lambda imager=imager: imager(profiles)
            if imager.report.predicted_error_db is not None:
                imagers[name]['predicted_db'] = round(imager.report.predicted_error_db, 1)
    for name, call in calls.items():
        imagers[name] |= described(call(), case, block)
    imagers['exact']['predicted_db'] = round(exact.report.predicted_error_db, 1)
    for name, seconds in best_seconds(calls, rounds=2).items():
        imagers[name]['seconds'] = round(seconds, 4)
    return dataclasses.asdict(case) | {'imagers': imagers}


def compare_fastsar(case: Case) -> dict:
    """AFBP and FastSAR's FFBP from phase history to map."""
    block = phase_history(case)
    imager, plan_s = planned(lambda: plan_image(case.grid, block.radar, block.n_samples,
                                                block.tx_m, block.rx_m, method='afbp',
                                                compressed=False, target_db=TARGET_DB))
    (peer, predicted_db), peer_plan_s = planned(
        lambda: fastsar_imagers.factorised(block, case.grid))
    calls = {'afbp': lambda: imager(block), 'fastsar': peer}
    row = dataclasses.asdict(case) | {
        'afbp': {'plan_s': plan_s, 'predicted_db': round(imager.report.predicted_error_db, 1)},
        'fastsar': {'plan_s': peer_plan_s, 'predicted_db': round(predicted_db, 1)}}
    for name, call in calls.items():
        row[name] |= described(call(), case, block)
    seconds = best_seconds(calls, rounds=2 if case.n_side > 4096 else 3)
    for name, value in seconds.items():
        row[name] |= {'seconds': round(value, 4),
                      'equivalent_rate': round(case.pixel_pulses / value / 1e9, 2)}
    return row | {'ratio': round(seconds['fastsar'] / seconds['afbp'], 2)}


def report_memory(case: Case) -> None:
    """Peak memory of imaging phase histories, beyond these, and size of the fused spectrum."""
    block = phase_history(case)
    imager = plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                        method='afbp', compressed=False, target_db=TARGET_DB)
    fused = imager.report.plan.subapertures.fusion_grid
    report_peak(lambda: imager(block),
                {'input_mib': round(block.samples.nbytes / 2**20, 1),
                 'spectrum_mib': round(
                     8 * fused.n_fine * len(fused.range_wavenumbers) / 2**20, 1)})


def growth(rows: list[dict]) -> dict:
    """Fitted exponents of time in pixels at one range."""
    rows = [row for row in rows if row['range_m'] == GROWTH_RANGE_M and 'refused' not in row]
    if len(rows) < 2:
        return {}
    pixels = [row['n_side'] ** 2 for row in rows]
    return {name: fitted_exponent(pixels, [row[name]['seconds'] for row in rows])
            for name in ('afbp', 'fastsar')}


def main() -> None:
    """Measure and write the results, which grow case by case."""
    arguments = parse_arguments(__doc__.split('\n', 1)[0], RESULTS, THREADS)
    if arguments.memory:
        report_memory(arguments.memory)
        return
    arguments.output.parent.mkdir(exist_ok=True)
    results = {'machine': machine(), 'threads': THREADS, 'exponents': {}, 'imagers': [],
               'fastsar': []}
    work = [(name, case) for name, cases in (('imagers', IMAGERS), ('fastsar', FASTSAR))
            for case in cases if case.n_side <= arguments.largest]
    for name, case in tqdm(work):
        try:
            row = {'imagers': compare_imagers, 'fastsar': compare_fastsar}[name](case)
        except ValueError as refusal:
            row = dataclasses.asdict(case) | {'refused': str(refusal)}
        if name == 'fastsar' and case.range_m == GROWTH_RANGE_M and 'refused' not in row:
            row |= peak_memory('benchmarks.afbp', case)
        results[name].append(row)
        results['exponents'] = growth(results['fastsar'])
        tqdm.write(json.dumps(row))
        arguments.output.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
