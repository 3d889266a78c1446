# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of `reproduce_multichannel`, numbered as in Rosenberg & Gray."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.support.reporting import decibels, draw_grid
from sar_imaging.geometry import MapGrid
from sar_imaging.simulation.scenarios import RANGE_CENTRE_M, SCENARIOS

from .multichannel_measurements import (
    IMAGERS,
    PATCH_M,
    PLACEMENTS,
    Comparison,
    Distortion,
    LetterImages,
    PointSpread,
)

DPI = 130
FLOOR_DB = -40.0
RATIO_STYLE = {20: ('#b5493a', ':'), 50: ('#3f7fbf', '--'), 80: ('#e0a030', '-.'),
               150: ('black', '-')}
PLACEMENT_STYLE = dict(zip(PLACEMENTS, (('#1f5fa8', '-'), ('#b5493a', '--'), ('#777777', '-')),
                           strict=True))
PLACEMENT_LABEL = dict(zip(PLACEMENTS, (
    'columns 8/25 of a range sample apart, on samples',
    'the same, shifted by 1/50 of a range sample',
    'columns 0.1 m apart'), strict=True))
CUT_NAMES = ('range', 'azimuth')


def _figure(columns: int, *, width: float = 9.0, height: float = 4.0, **options):
    """Figure and its axes in one row."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False, **options)[0]


def _rate(rate_hz: float) -> str:
    return f'{rate_hz / 1e6:.0f} MHz'


def draw_point_spread(path: Path, measured: PointSpread) -> None:
    """Figure 5: range and azimuth slices for some ratios, each to its own maximum."""
    figure, axes = _figure(2, width=10, height=4.2, sharey=True)
    for i, name in enumerate(CUT_NAMES):
        for z, cut in measured.cut.items():
            colour, line = RATIO_STYLE[z]
            axes[i].plot(measured.offset_m[i], decibels(cut[i]), line, color=colour,
                         linewidth=1.2, label=rf'$Z_{{rat}}$ = {z}')
        axes[i].plot(measured.offset_m[i], decibels(measured.tdc_cut[i]), color='#5fb878',
                     linewidth=3.5, alpha=0.55, zorder=1, label='TDC')
        draw_grid(axes[i], xlabel=f'{name} from the scatterer (m)', title=f'{name} slice',
                  xlim=(-PATCH_M[i], PATCH_M[i]), ylim=(FLOOR_DB, 1))
    axes[0].set_ylabel('dB relative to the maximum')
    axes[1].legend(fontsize=8, loc='upper right', framealpha=0.95)
    figure.suptitle(f'Figure 5: BP point spread function, sampled at {_rate(measured.rate_hz)}',
                    fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_islr(path: Path, measured: list[PointSpread]) -> None:
    """Figure 6: ISLR against ratio, one panel for each sample rate."""
    figure, axes = _figure(len(measured), width=10, height=4.0, sharey=True)
    for panel, m in zip(axes, measured, strict=True):
        for i, (name, colour) in enumerate(zip(CUT_NAMES, ('black', '#3f7fbf'), strict=True)):
            panel.plot(m.ratio, m.islr_db[:, i], '-' if i == 0 else '--', color=colour,
                       linewidth=1.2, label=f'{name} slice, BP')
            panel.axhline(m.tdc_islr_db[i], color=colour, linewidth=0.8, linestyle=':',
                          label=f'{name}, TDC: {m.tdc_islr_db[i]:.2f} dB')
        panel.axvline(60, color='#e0a030', linewidth=1, label='60, as in the paper')
        first = m.ratio_within(0.5)[1]
        if first is not None:
            panel.axvline(first, color='#b5493a', linewidth=1, linestyle='-.',
                          label=f'within 0.5 dB of TDC from {first}')
        draw_grid(panel, xlabel=r'zero-padding ratio $Z_{rat}$', title=_rate(m.rate_hz),
                  xlim=(20, 150))
        panel.legend(fontsize=8)
    axes[0].set_ylabel('ISLR (dB)')
    figure.suptitle('Figure 6: integrated sidelobe ratio of BP', fontsize=11)
    figure.savefig(path, dpi=DPI)


def _image(axes, image, grid: MapGrid, *, reference=None, floor_db: float = -30.0, **labels):
    """Magnitude in dB on axes in metres from the middle of the patch."""
    half = grid.spacing_m / 2
    extent = (grid.x_m[0] - half - RANGE_CENTRE_M, grid.x_m[-1] + half - RANGE_CENTRE_M,
              grid.y_m[-1] - half, grid.y_m[0] + half)
    drawn = axes.imshow(decibels(image, reference), extent=extent, aspect='auto', cmap='gray',
                        vmin=floor_db, vmax=0, interpolation='nearest')
    axes.set(xlabel='range \u2212 10 km (m)', **labels)
    return drawn


def draw_letter(path: Path, letter: LetterImages, rate_hz: float) -> None:
    """Figure 7: the scatterers of the letter and their image by TDC."""
    figure, axes = _figure(2, width=7.2, height=5.2, sharey=True)
    scene = np.array([s.position_m for s in SCENARIOS['letter_s']().scatterers])
    axes[0].set_facecolor('black')
    axes[0].plot(scene[:, 0] - RANGE_CENTRE_M, scene[:, 1], 'o', color='white', markersize=2.5)
    axes[0].set(xlabel='range \u2212 10 km (m)', ylabel='azimuth (m)', title='scatterers',
                xlim=(-3.5, 3.5), ylim=(-25, 25))
    drawn = _image(axes[1], letter.tdc, letter.grid, title='TDC')
    figure.colorbar(drawn, ax=axes[1], label='dB relative to the maximum')
    figure.suptitle(f'Figure 7: sample image, sampled at {_rate(rate_hz)}', fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_letter_by_ratio(path: Path, letter: LetterImages, rate_hz: float) -> None:
    """Figure 8: the letter by BP at several ratios, each to its own maximum."""
    figure, axes = _figure(len(letter.image) + 1, width=11, height=4.8, sharey=True)
    for panel, (z, image) in zip(axes, letter.image.items(), strict=False):
        _image(panel, image, letter.grid,
               title=rf'$Z_{{rat}}$ = {z}' f'\nSDR {letter.sdr_db[z]:.1f} dB')
    drawn = _image(axes[-1], letter.tdc, letter.grid, title='TDC\n')
    axes[0].set_ylabel('azimuth (m)')
    figure.colorbar(drawn, ax=axes[-1], label='dB relative to the maximum')
    figure.suptitle(f'Figure 8: BP of the sample image, sampled at {_rate(rate_hz)}', fontsize=11)
    figure.savefig(path, dpi=DPI)


def _mark_multiples(axes) -> None:
    for z in range(25, 151, 25):
        axes.axvline(z, color='#e0a030', linewidth=0.7, alpha=0.7, zorder=0)


def draw_distortion(path: Path, measured: list[Distortion]) -> None:
    """Figure 9: SDR and MSE against ratio, columns on samples."""
    figure, axes = _figure(2, width=10, height=4.2)
    for m, colour in zip(measured, ('#1f5fa8', '0.35'), strict=True):
        label = _rate(m.rate_hz)
        axes[0].plot(m.ratio, m.sdr_db[PLACEMENTS[0]], color=colour, linewidth=1.2, label=label)
        axes[0].plot(m.ratio, m.predicted_db, ':', color=colour, linewidth=1.2,
                     label=f'{label}, predicted of one read')
        axes[1].plot(m.ratio, 10 * np.log10(m.mse[PLACEMENTS[0]]), color=colour, linewidth=1.2,
                     label=label)
    for panel in axes:
        _mark_multiples(panel)
    draw_grid(axes[0], xlabel=r'zero-padding ratio $Z_{rat}$', ylabel='SDR (dB)',
              title='SDR, equation 20', xlim=(20, 150))
    draw_grid(axes[1], xlabel=r'zero-padding ratio $Z_{rat}$', title='MSE, equation 21',
              ylabel="dB relative to the square of TDC's maximum", xlim=(20, 150))
    axes[0].legend(fontsize=8, loc='lower right')
    axes[1].legend(fontsize=8)
    figure.suptitle('Figure 9: distortion of the sample image by BP, pixel columns on samples at '
                    'multiples of 25', fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_bumps(path: Path, measured: list[Distortion]) -> None:
    """Beyond the paper: where the bumps of figure 9 come from."""
    figure, axes = _figure(len(measured), width=10, height=4.2, sharey=True)
    for panel, m in zip(axes, measured, strict=True):
        _mark_multiples(panel)
        for placement in PLACEMENTS:
            colour, line = PLACEMENT_STYLE[placement]
            panel.plot(m.ratio, m.sdr_db[placement], line, color=colour, linewidth=1.2,
                       label=PLACEMENT_LABEL[placement])
        draw_grid(panel, xlabel=r'zero-padding ratio $Z_{rat}$', title=_rate(m.rate_hz),
                  xlim=(20, 150))
    axes[0].set_ylabel('SDR (dB)')
    axes[-1].legend(fontsize=8, loc='lower right')
    figure.suptitle('The bumps of figure 9 follow where pixel columns stand between samples',
                    fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_comparison(path: Path, measured: Comparison) -> None:
    """Figure 10: two scatterers by each imager."""
    figure, axes = _figure(len(IMAGERS), width=11, height=4.8, sharey=True)
    for panel, name in zip(axes, IMAGERS, strict=True):
        drawn = _image(panel, measured.image[name], measured.grid, floor_db=FLOOR_DB,
                       title=name.replace(', ', ',\n') + ('' if ', ' in name else '\n'))
    axes[0].set_ylabel('azimuth (m)')
    figure.colorbar(drawn, ax=axes[-1], label='dB relative to the maximum')
    figure.suptitle('Figure 10: scatterers in the centre and the top right corner of the 6 m x '
                    f'30 m patch, sampled at {_rate(measured.rate_hz)}', fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_slices(path: Path, measured: Comparison) -> None:
    """Figure 11: range slices through both scatterers, each to the centre's level."""
    figure, axes = _figure(2, width=10, height=4.2, sharey=True)
    middle = measured.grid.n_y // 2
    styles = (('#5fb878', '-', 3.5), ('#b5493a', '--', 1.3), ('black', '-.', 1.1),
              ('#3f7fbf', ':', 1.4))
    x = measured.grid.x_m - RANGE_CENTRE_M
    for panel, row, title in ((axes[0], middle, 'through the centre scatterer, y = 0'),
                              (axes[1], 0, 'through the corner scatterer, y = 15 m')):
        for name, (colour, line, width) in zip(IMAGERS, styles, strict=True):
            image = measured.image[name]
            panel.plot(x, decibels(image[row], np.abs(image[middle, image.shape[1] // 2])),
                       line, color=colour, linewidth=width, label=name,
                       alpha=0.55 if name == 'TDC' else 1.0)
        draw_grid(panel, xlabel='range \u2212 10 km (m)', title=title, xlim=(x[0], x[-1]),
                  ylim=(FLOOR_DB, 2))
    axes[0].set_ylabel('dB relative to the centre scatterer')
    axes[1].legend(fontsize=8, loc='upper center')
    figure.suptitle(f'Figure 11: range slices, sampled at {_rate(measured.rate_hz)}', fontsize=11)
    figure.savefig(path, dpi=DPI)
