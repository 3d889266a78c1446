# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of `reproduce_spotlight_letter`, numbered as in Zhang et al. 2014."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from benchmarks.reproduction.letter_scene import (
    PAIR_SEPARATION_M,
    SpotlightExperiment,
)
from benchmarks.support.reporting import decibels, draw_grid
from sar_imaging.geometry import MapGrid
from sar_imaging.quality import crop

from .letter_imagers import COMPARED, CUTS, EXACT
from .letter_measurements import SubsceneImage
from .letter_spectra import Spectra

DPI = 130
FLOOR_DB = -50.0
SCENE_FLOOR_DB = -70.0  # figure 5
POINT_FLOOR_DB = -60.0  # figures 7 and 8: sidelobes of a Hamming window show
POINT_SIZE_M = 1.5  # half of the images of figures 7 and 8
_COLOURS = {'exact': 'black', 'FFBP linear': '#b5493a', 'FFBP cubic': '#e0a030',
            'FFBP knab8': '#5fb878', 'AFBP': '#1f5fa8'}
_LINES = {'16 pulses': '-', '64 pulses': '--'}


def _figure(rows: int, columns: int, *, width: float, height: float, **options):
    """Figure and its axes (rows, columns)."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _image(axes, image, grid: MapGrid, centre_m, *, reference=None, floor_db=FLOOR_DB, **labels):
    """Magnitude in dB; range from left to right, azimuth upwards, metres from `centre_m`."""
    half_x, half_y = (n * grid.spacing_m / 2 for n in (grid.n_x, grid.n_y))
    x, y = (grid.centre_m[i] - centre_m[i] for i in range(2))
    drawn = axes.imshow(decibels(image, reference), cmap='gray', vmin=floor_db, vmax=0,
                        extent=(x - half_x, x + half_x, y - half_y, y + half_y),
                        interpolation='nearest')
    axes.set(**labels)
    return drawn


def shrink(image, n: int = 320) -> np.ndarray:
    """Magnitude of a large image with at most `n` pixels a side, the largest of each tile."""
    tile = max(1, math.ceil(max(image.shape) / n))
    rows, columns = (size // tile for size in image.shape)
    out = np.empty((rows, columns), np.float32)
    for row in range(rows):  # a row at a time: the magnitude of the whole would be large
        part = np.abs(image[row * tile:(row + 1) * tile, :columns * tile])
        out[row] = part.max(axis=0).reshape(columns, tile).max(axis=1)
    return out


def draw_scene(path: Path, images: dict[str, np.ndarray], experiment: SpotlightExperiment
               ) -> None:
    """Figure 5: the whole scene by the imagers that the letter compares, from `shrink`."""
    figure, axes = _figure(len(COMPARED), 1, width=8.0, height=5.6 * len(COMPARED) + 0.5,
                           sharex=True)
    centre = experiment.scene_centre_m
    for panel, name in zip(axes[:, 0], COMPARED, strict=True):
        image = images[name]
        spacing = experiment.scene_m[0] / image.shape[1]
        grid = MapGrid(centre, image.shape[1], image.shape[0], spacing)
        drawn = _image(panel, image, grid, centre, title=name, floor_db=SCENE_FLOOR_DB,
                       ylabel='azimuth (m)')
    axes[-1, 0].set_xlabel(f'range \u2212 {centre[0] / 1e3:.1f} km (m)')
    figure.colorbar(drawn, ax=axes, label='dB relative to the maximum', shrink=0.6)
    figure.suptitle(f'Figure 5: the whole scene, the brightest of every {spacing:.0f} m',
                    fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_subscene(path: Path, images: dict[str, SubsceneImage], grid: MapGrid,
                  experiment: SpotlightExperiment) -> None:
    """Figure 6: the magnified subscene, points 1 to 3 circled."""
    shown = (EXACT, *COMPARED)
    figure, axes = _figure(1, len(shown), width=5.0 * len(shown), height=5.0, sharey=True)
    one, two, three = (np.array(s.position_m[:2]) for s in experiment.scatterers[:3])
    for panel, name in zip(axes[0], shown, strict=True):
        drawn = _image(panel, images[name].image, grid, grid.centre_m, title=name,
                       xlabel='range (m)')
        for label, at in (('1, 2', (one + two) / 2), ('3', three)):
            x, y = at - grid.centre_m[:2]
            panel.add_patch(Circle((x, y), 1.6, fill=False, color='#e0a030', linewidth=1.2))
            panel.annotate(label, (x + 1.4, y + 1.4), color='#e0a030')
    axes[0, 0].set_ylabel('azimuth (m)')
    figure.colorbar(drawn, ax=axes, label='dB relative to the maximum')
    figure.suptitle('Figure 6: the subscene with points 1 to 3, metres from its middle',
                    fontsize=11)
    figure.savefig(path, dpi=DPI)


def _draw_point(path: Path, images: dict[str, SubsceneImage], grid: MapGrid, centre_xy,
                cut_of, title: str, marks=()) -> None:
    """Images of a point by the imagers compared and azimuth cuts, those of `CUTS`."""
    shown = [EXACT, *COMPARED]
    figure = Figure(figsize=(9.6, 8.2), layout='constrained')
    FigureCanvasAgg(figure)
    above, below = figure.subfigures(2, 1)
    panels = above.subplots(1, len(shown), sharey=True)
    for panel, name in zip(panels, shown, strict=True):
        chip, chip_grid = crop(images[name].image, grid, centre_xy, (POINT_SIZE_M,) * 2)
        drawn = _image(panel, chip, chip_grid, centre_xy, title=name, floor_db=POINT_FLOOR_DB,
                       xlabel='range (m)')
    panels[0].set_ylabel('azimuth (m)')
    above.colorbar(drawn, ax=panels, label='dB relative to the maximum', shrink=0.8)
    cuts = below.subplots()
    for name in CUTS:
        kind = next(k for k in _COLOURS if name.startswith(k))
        line = _LINES.get(name.split(', ')[-1], '-')
        cuts.plot(images[name].offset_m, decibels(cut_of(images[name])), line,
                  color=_COLOURS[kind], linewidth=1.0, label=name)
    for x in marks:
        cuts.axvline(x, color='#e0a030', linewidth=0.8, zorder=0)
    draw_grid(cuts, xlabel='azimuth from the middle (m)', ylabel='dB relative to the maximum',
              xlim=(-2.0, 2.0), ylim=(-70, 1))
    cuts.legend(fontsize=8, loc='center left', bbox_to_anchor=(1.01, 0.5))
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_pair(path: Path, images: dict[str, SubsceneImage], grid: MapGrid,
              experiment: SpotlightExperiment) -> None:
    """Figure 7: points 1 and 2, images and azimuth cuts."""
    one, two = (np.array(s.position_m[:2]) for s in experiment.scatterers[:2])
    half = PAIR_SEPARATION_M / 2
    _draw_point(path, images, grid, (one + two) / 2, lambda m: m.pair_cut,
                'Figure 7: points 1 and 2, 0.15 m apart, and their azimuth response',
                marks=(-half, half))


def draw_single(path: Path, images: dict[str, SubsceneImage], grid: MapGrid,
                experiment: SpotlightExperiment) -> None:
    """Figure 8: point 3, images and azimuth cuts."""
    _draw_point(path, images, grid, np.array(experiment.scatterers[2].position_m[:2]),
                lambda m: m.single, 'Figure 8: point 3 and its azimuth response')


def draw_line_spectra(path: Path, spectra: Spectra) -> None:
    """Figure 3: angular spectrum of one sub-aperture, folded and in its place."""
    figure, axes = _figure(2, 1, width=8.0, height=5.0)
    column = int(np.argmin(np.abs(spectra.frequency_hz)))
    fused = spectra.fused[:, column]
    top = fused.max()
    panel = axes[0, 0]
    panel.plot(spectra.coarse_m, decibels(spectra.coarse[:, column], top), color='#b5493a',
               linewidth=1.1)
    draw_grid(panel, title='of one sub-aperture image, as its transform gives it', ylim=(-50, 3),
              xlim=(spectra.coarse_m[0], spectra.coarse_m[-1]), ylabel='dB')
    panel = axes[1, 0]
    panel.plot(spectra.track_m, decibels(fused, top), color='0.65', linewidth=0.8,
               label='fused')
    panel.plot(spectra.track_m, decibels(spectra.placed[:, column], top), color='#b5493a',
               linewidth=1.1, label='the sub-aperture in its place')
    panel.axvspan(*spectra.subaperture_m, color='#e0a030', alpha=0.35,
                  label='where its pulses were')
    draw_grid(panel, title='of all', xlabel=r'$-K_\alpha / K_{rc}$: position along the track (m)',
              ylim=(-50, 3), ylabel='dB', xlim=(spectra.track_m[0], spectra.track_m[-1]))
    panel.legend(fontsize=8, loc='lower left')
    figure.suptitle('Figure 3: angular spectra at the carrier', fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_plane_spectra(path: Path, spectra: Spectra) -> None:
    """Figure 4: 2-D spectra of one sub-aperture, folded and in its place, and of all."""
    figure, axes = _figure(1, 3, width=12.0, height=4.6)
    f = spectra.frequency_hz
    panels = (('one sub-aperture, as its transform gives it', spectra.coarse, spectra.coarse_m),
              ('the same in its place', spectra.placed, spectra.track_m),
              ('all', spectra.fused, spectra.track_m))
    top = spectra.fused.max()
    for panel, (title, magnitude, track) in zip(axes[0], panels, strict=True):
        drawn = panel.imshow(decibels(magnitude.T, top), origin='lower', aspect='auto',
                             cmap='gray', vmin=-50, vmax=0, interpolation='nearest',
                             extent=(track[0], track[-1], f[0] / 1e6, f[-1] / 1e6))
        panel.set(title=title, xlabel=r'$-K_\alpha / K_{rc}$ (m)')
    band = spectra.bandwidth_hz / 2 * np.array([-1.0, 1.0])
    for x in spectra.subaperture_m:
        axes[0, 1].plot(x * (1 + band / spectra.carrier_hz), band / 1e6, color='#e0a030',
                        linewidth=1.0)
    for x in (-spectra.aperture_m / 2, spectra.aperture_m / 2):
        axes[0, 2].plot(x * (1 + band / spectra.carrier_hz), band / 1e6, color='#e0a030',
                        linewidth=1.0)
    axes[0, 0].set_ylabel('frequency \u2212 carrier (MHz)')
    figure.colorbar(drawn, ax=axes, label='dB relative to the maximum')
    figure.suptitle('Figure 4: two-dimensional spectra; lines: k x for the ends of the '
                    'sub-aperture and of the aperture', fontsize=11)
    figure.savefig(path, dpi=DPI)
