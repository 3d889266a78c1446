# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Reproduce the figures and tables of Rosenberg & Gray, Multichannel SAR Imaging.

Run: python -m benchmarks.reproduction.reproduce_multichannel --output out/multichannel
"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

import numba
import numpy as np
from tqdm import tqdm

from benchmarks.support.reporting import run_and_report
from sar_imaging.simulation.scenarios import SCENARIOS

from . import multichannel_figures as figures, multichannel_measurements as measure
from .multichannel_measurements import COMPARISON_RATIO, PATCH_M, PLACEMENTS, RATES_HZ

SPACING_M = 0.05  # of the pixels of images
PAPER = {
    'tdc_islr_db': {'range': -10.49, 'azimuth': -10.53},
    'ratio_for_islr': 'approximately 60',
    'sdr_bumps': 'at each multiple of 25',
    'ratio_for_good_quality': 'at least 100',
    'table_3': {'TDC': 1.5e15, 'wavenumber': 8.7e7, 'BP': 5.2e11},
}
# Parameters of table 3.
TABLE_3 = {'n_samples': 4096, 'n_pulses': 4246, 'n_channels': 5, 'n_pixels': 4096 ** 2,
           'ratio': COMPARISON_RATIO}

_EPILOG = """\
Writes figures 5 to 11 as PNG, one more that explains the bumps of figure 9, and every number,
tables 2 and 3 among them, beside the paper's own as results.json. Each experiment runs at two
sample rates, because the paper states none; docs/reproduce/multichannel.md discusses the results.
Takes about four minutes on one core; NUMBA_NUM_THREADS limits the cores used.
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='reproduce_multichannel', description='Reproduce the figures and tables of '
        'L. Rosenberg and D. Gray, Multichannel SAR Imaging with Backprojection.',
        epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('--output', type=Path, default=Path('out/multichannel'), metavar='FOLDER',
                   help='folder for the figures and results.json (default: %(default)s)')
    p.add_argument('--quick', action='store_true',
                   help='coarser images, and only the ratios shown and around the multiples of '
                        '25: a first look in a fifth of the time')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_and_report(
        arguments.output, lambda folder: reproduce(folder, arguments.quick), summary)


def reproduce(folder: Path, quick: bool) -> dict:
    """Run every experiment, write the figures; returns what goes into results.json.

    Parameters
    ----------
    folder : path
        Folder for the PNG files.
    quick : bool
        Coarser images and fewer ratios.

    Returns
    -------
    dict
        JSON-compatible.
    """
    ratio = measure.ratios(quick)
    spacing = 4 * SPACING_M if quick else SPACING_M
    steps = len(RATES_HZ) * (2 * len(ratio) + len(measure.IMAGERS) + 7) + 4
    with tqdm(total=steps, desc='images', unit='image', disable=None) as bar:
        spread = [measure.measure_point_spread(r, ratio, bar.update) for r in RATES_HZ]
        letters = [measure.form_letter_images(r, 2 * spacing, bar.update) for r in RATES_HZ]
        distortion = [measure.measure_distortion(r, ratio, bar.update) for r in RATES_HZ]
        compared = [measure.compare_imagers(r, spacing, bar.update) for r in RATES_HZ]
        delays = [measure.measure_delays(r, bar.update) for r in RATES_HZ]
        seconds = measure.measure_run_times(RATES_HZ[0], 2 * spacing, bar.update)
    figures.draw_point_spread(folder / 'figure_05.png', spread[0])
    figures.draw_islr(folder / 'figure_06.png', spread)
    figures.draw_letter(folder / 'figure_07.png', letters[0], RATES_HZ[0])
    figures.draw_letter_by_ratio(folder / 'figure_08.png', letters[0], RATES_HZ[0])
    figures.draw_distortion(folder / 'figure_09.png', distortion)
    figures.draw_bumps(folder / 'figure_09_bumps.png', distortion)
    figures.draw_comparison(folder / 'figure_10.png', compared[0])
    figures.draw_slices(folder / 'figure_11.png', compared[0])
    at_rate = {f'{rate / 1e6:.0f} MHz': {
        **_islr_results(s), **_letter_results(images, d), **_comparison_results(c),
        'error_by_interpolator_and_delay_db': _rounded(e, 1)}
        for rate, s, images, d, c, e in zip(RATES_HZ, spread, letters, distortion, compared,
                                            delays, strict=True)}
    return {'paper': PAPER, 'by_sample_rate': at_rate, 'table_3': measure.complexity(**TABLE_3),
            'run_time': _run_time_results(seconds, 2 * spacing), 'quick': quick,
            'machine': f'{platform.machine()}, {numba.get_num_threads()} threads'}


def _rounded(values, digits: int = 3):
    """The same structure with its floats rounded."""
    if isinstance(values, dict):
        return {k: _rounded(v, digits) for k, v in values.items()}
    if isinstance(values, (list, tuple, np.ndarray)):
        return [_rounded(v, digits) for v in values]
    return round(float(values), digits) if isinstance(values, (float, np.floating)) else values


def _islr_results(s: measure.PointSpread) -> dict:
    islr = dict(zip(figures.CUT_NAMES, s.islr_db.T, strict=True))
    return {
        'tdc_islr_db': _rounded(dict(zip(figures.CUT_NAMES, s.tdc_islr_db, strict=True))),
        'ratio_from_which_islr_stays_within_db_of_tdc': {
            str(t): dict(zip(figures.CUT_NAMES, s.ratio_within(t), strict=True))
            for t in (0.5, 0.2)},
        'figure_6': {'ratio': s.ratio.tolist(), 'islr_db': _rounded(islr)}}


def _letter_results(letters: measure.LetterImages, d: measure.Distortion) -> dict:
    bumps = {p: d.bumps_db(p) for p in PLACEMENTS}
    return {
        'figure_8_sdr_db': _rounded(letters.sdr_db),
        'figure_9': {'ratio': d.ratio.tolist(), 'sdr_db': _rounded(d.sdr_db),
                     'mse': {p: [float(f'{v:.4g}') for v in m] for p, m in d.mse.items()},
                     'predicted_sdr_db': _rounded(d.predicted_db)},
        'figure_9_bumps': {p: {
            'at_multiples_of_25_db': _rounded({z: b for z, b in v.items() if z % 25 == 0}),
            'largest_elsewhere_from_45_db': _rounded(max(
                (b for z, b in v.items() if z % 25 and z >= 45), default=None))}
            for p, v in bumps.items()}}


def _comparison_results(c: measure.Comparison) -> dict:
    return {'figures_10_11': _rounded({
        name: {'corner_relative_to_tdc_db': c.corner_db[name],
               'highest_at_opposite_range_edge_db': c.ghost_db[name],
               'sdr_db': c.sdr_db.get(name)} for name in measure.IMAGERS}, 2)}


def _run_time_results(seconds: dict[str, float], spacing_m: float) -> dict:
    scenario = SCENARIOS['psf']()
    n_pixels = int(np.prod([round(2 * p / spacing_m) + 1 for p in PATCH_M]))
    table_2 = measure.complexity(scenario.n_samples, scenario.n_pulses, scenario.n_channels,
                                 n_pixels, COMPARISON_RATIO)
    return {'scenario': 'psf', 'pixels': n_pixels, 'seconds': _rounded(seconds, 4),
            'over_wavenumber': _rounded({k: v / seconds['wavenumber']
                                         for k, v in seconds.items()}, 2),
            'table_2_over_wavenumber': _rounded({k: v / table_2['wavenumber']
                                                 for k, v in table_2.items()}, 1)}


def summary(results: dict) -> str:
    """The main numbers beside the paper's, for people."""
    paper = results['paper']
    lines = [f'{"":44s}{"paper":>18s}' + ''.join(f'{r:>10s}' for r in results['by_sample_rate'])]

    def add(name, expected, *keys):
        values = []
        for found in results['by_sample_rate'].values():
            for key in keys:
                found = found[key]
            values.append(f'{found:10.2f}' if isinstance(found, float) else f'{found!s:>10s}')
        lines.append(f'{name:44s}{expected!s:>18s}' + ''.join(values))

    for cut in figures.CUT_NAMES:
        add(f'TDC, ISLR in {cut} (dB)', paper['tdc_islr_db'][cut], 'tdc_islr_db', cut)
    add('BP, ratio for ISLR within 0.5 dB of TDC', paper['ratio_for_islr'],
        'ratio_from_which_islr_stays_within_db_of_tdc', '0.5', 'azimuth')
    add('BP, bump of the SDR at ratio 75 (dB)', 'a bump', 'figure_9_bumps', PLACEMENTS[0],
        'at_multiples_of_25_db', 75)
    for name in measure.IMAGERS[1:]:
        add(f'{name}: corner to TDC (dB)', '', 'figures_10_11', name,
            'corner_relative_to_tdc_db')
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
