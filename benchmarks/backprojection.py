# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact backprojection beside FastSAR 0.1.8: the same phase history, pixels and thread.

Run from the repository root in an environment that has FastSAR
(`benchmarks.support.fastsar_imagers` shows how to make one)::

    build/fastsar/bin/python -m benchmarks.backprojection

Both start from the phase history and deliver complex map images. The programs take turns and the
best of several runs counts. Errors are against float64 time-domain correlation with the exact
two-way path, over the image and over its brightest pixels. With several channels FastSAR gets
the midpoints of transmitter and receiver, which is what its exact former supports.

Images from 0.25 to 16 Mpixel of equally many pulses give the growth law, and the peak memory of
this project's imager is measured for each of them in a process of its own.
"""

from __future__ import annotations

import dataclasses
import json
import os
import pathlib

THREADS = 1
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

RESULTS = pathlib.Path(__file__).parent / 'results' / 'backprojection.json'
ROUNDS = 3
SIDES = (512, 1024, 2048, 4096)
PULSES = {1: 256, 5: 26}  # by channels: pulses of the growth law

RANGES = tuple(Case(range_m, 1024, pulses, channels, spacing)
               for channels, pulses in ((1, 256), (5, 52))
               for range_m, spacing in ((100, 0.05), (1e3, 0.25), (1e4, 0.25), (5e4, 0.25)))
GROWTH = tuple(Case(1e4, side, PULSES[channels], channels, 0.25)
               for channels in PULSES for side in SIDES)
LONG = Case(1e4, 1024, 2048, 1, 0.25)
CASES = tuple(dict.fromkeys((*RANGES, *GROWTH, LONG)))  # some are of both kinds


def measure(case: Case) -> dict:
    """Rates in 1e9 pixel-pulses per second and errors of all programs."""
    block, grid = phase_history(case), case.grid
    compressor = RangeCompressor.for_block(block)
    plan = plan_image(grid, compressor.output_radar, compressor.n_output, method='exact',
                      target_db=-80.0)
    calls = {'ours': lambda: plan(compressor(block)),
             'fastsar_cubic': fastsar_imagers.exact(block, grid, 'cubic'),
             'fastsar_linear': fastsar_imagers.exact(block, grid, 'linear')}
    row = dataclasses.asdict(case)
    for name, call in calls.items():
        error = measure_error(call(), grid, block, fit_scale=True)
        row |= {f'{name}_error_db': round(error.error_db, 1),
                f'{name}_brightest_error_db': round(error.brightest_error_db, 1)}
    seconds = best_seconds(calls, rounds=ROUNDS)
    row |= {f'{name}_rate': round(case.pixel_pulses / s / 1e9, 3) for name, s in seconds.items()}
    return row | {'fastsar_positions': 'midpoints' if case.n_channels > 1 else 'exact',
                  'ours_seconds': round(seconds['ours'], 4),
                  'ours_method': plan.report.plan.method,
                  'ours_predicted_db': round(plan.report.predicted_error_db, 1),
                  'ratio_to_cubic': round(seconds['fastsar_cubic'] / seconds['ours'], 2)}


def report_memory(case: Case) -> None:
    """Peak memory of imaging range profiles, beyond these."""
    block = phase_history(case)
    profiles = RangeCompressor.for_block(block)(block)
    plan = plan_image(case.grid, profiles.radar, profiles.n_samples, method='exact',
                      target_db=-80.0)
    report_peak(lambda: plan(profiles), {'input_mib': round(profiles.samples.nbytes / 2**20, 1)})


def growth(rows: list[dict]) -> dict:
    """Fitted exponent of time in pixels x pulses x channels, by number of channels."""
    laws = {}
    names = [field.name for field in dataclasses.fields(Case)]
    for channels, pulses in PULSES.items():
        law = [(case.pixel_pulses, row['ours_seconds']) for row in rows
               if (case := Case(*(row[name] for name in names))) in GROWTH
               and case.n_channels == channels]
        if len(law) > 1:
            laws[f'{channels} channels, {pulses} pulses'] = fitted_exponent(
                *zip(*law, strict=True))
    return laws


def main() -> None:
    """Measure and write the results, which grow case by case."""
    arguments = parse_arguments(__doc__.split('\n', 1)[0], RESULTS, THREADS)
    if arguments.memory:
        report_memory(arguments.memory)
        return
    arguments.output.parent.mkdir(exist_ok=True)
    rows = []
    for case in tqdm([case for case in CASES if case.n_side <= arguments.largest]):
        rows.append(measure(case))
        if case in GROWTH:
            rows[-1] |= peak_memory('benchmarks.backprojection', case)
        tqdm.write(json.dumps(rows[-1]))
        arguments.output.write_text(json.dumps(
            {'machine': machine(), 'threads': THREADS, 'unit': '1e9 pixel-pulses per second',
             'exponents': growth(rows), 'cases': rows}, indent=1) + '\n')


if __name__ == '__main__':
    main()
