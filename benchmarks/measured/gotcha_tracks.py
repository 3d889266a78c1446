# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Corrected tracks of the measured Gotcha recording, whose positions are made wrong.

Run: python -m benchmarks.measured.gotcha_tracks FOLDER --seed 7

Each half of the aperture images four patches of 50 m with positions that are wrong by smooth
random errors of up to 15 to 50 mm, which autofocus is told to expect. The recorded positions serve
as the truth: they focus the images. Told is the error in the middle of the aperture along the line
of sight, before and after, and how many times the standard deviation it is by the covariance's
narrowest axis.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.measured.focus_gotcha import read_profiles
from benchmarks.support.machine import machine
from sar_imaging.autofocus.corrected_track import corrected_track
from sar_imaging.autofocus.live import live_autofocus
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock

RESULTS = Path(__file__).parents[1] / 'results' / 'gotcha_tracks.json'
EXPECTED_M, POSITION_STD_M = 0.05, 1e-4
_CENTRES_M = (-25.0, 25.0)
_ERRORS = 2  # of each patch and half


def rows(profiles: PulseBlock, rng: np.random.Generator) -> Iterator[dict]:
    """One of each half of the aperture, patch and random error."""
    n = profiles.n_pulses // 2
    for half in range(2):
        block = profiles.select(slice(half * n, (half + 1) * n))
        for x in _CENTRES_M:
            for y in _CENTRES_M:
                grid = MapGrid.from_size((x, y, 0.0), 50.0, 50.0, 0.2)
                for _ in range(_ERRORS):
                    yield {'half': half, 'patch_m': [x, y]} | measure(block, grid, rng)


def measure(block: PulseBlock, grid: MapGrid, rng: np.random.Generator) -> dict:
    """One random error: what autofocus says, and the error along the line of sight."""
    shapes = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, block.n_pulses), 5)[:, 1:]
    error_m = shapes @ rng.standard_normal((5, 3))
    error_m *= EXPECTED_M * rng.uniform(0.3, 1.0) / np.abs(error_m).max()
    wrong = dataclasses.replace(block, tx_m=block.tx_m + error_m[:, None],
                                rx_m=block.rx_m + error_m[:, None])
    autofocus = live_autofocus(grid, track_error_m=EXPECTED_M)
    result = autofocus.process(wrong)
    out = {'claimed': result.report.success, 'refused': ''}
    try:
        track = corrected_track(result, autofocus.model(wrong), grid,
                                position_std_m=POSITION_STD_M)
    except ValueError as error:
        return out | {'refused': str(error)}
    middle = block.n_pulses // 2
    sight = block.tx_m[middle, 0] - grid.centre_m
    sight /= np.linalg.norm(sight)
    left_m = track.position_m[middle] - block.tx_m[middle, 0]
    std_m, axes = np.linalg.eigh(track.covariance_m2[middle])
    std_m = np.sqrt(std_m)
    return out | {
        'sight_error_mm': [round(1e3 * float(e @ sight), 3) for e in (error_m[middle], left_m)],
        'std_mm': np.round(1e3 * std_m, 3).tolist(),
        'narrowest_to_sight': round(abs(float(axes[:, 0] @ sight)), 5),
        'normalised': round(float(axes[:, 0] @ left_m / std_m[0]), 3)}


def summary(found: list[dict]) -> dict:
    """Root mean squares, of all that are claimed and of all that are used."""
    out = {'trials': len(found)}
    for name, some in (('claimed', [r for r in found if r['claimed'] and not r['refused']]),
                       ('used', [r for r in found if not r['refused']])):
        if some:
            errors = np.sqrt(np.mean([np.square(r['sight_error_mm']) for r in some], axis=0))
            out[name] = {
                'tracks': len(some), 'sight_error_mm': np.round(errors, 2).tolist(),
                'std_mm': round(float(np.median([r['std_mm'][0] for r in some])), 2),
                'across_mm': round(float(np.median([r['std_mm'][1] for r in some])), 1),
                'nees': round(float(np.mean(np.square([r['normalised'] for r in some]))), 2),
                'worst': max(abs(r['normalised']) for r in some)}
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('folder', type=Path, help='folder with the .mat files of one pass')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--output', type=Path, default=RESULTS)
    arguments = parser.parse_args(argv)
    found = list(rows(read_profiles(arguments.folder), np.random.default_rng(arguments.seed)))
    results = {'machine': machine(), 'seed': arguments.seed, 'summary': summary(found),
               'trials': found}
    arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
