# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Drawings beside an image: its acquisition, its raw pulses, and the projections of a volume."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ...diagnosis.signals import scatter_s
from ...exploitation.bright_cells import BrightCells
from ...geometry.grids import VolumeGrid
from ...signal.pulses import PulseBlock
from ...signal.range_compression import RangeCompressor
from ..plots import MARK

_TRACK, _SCENE, _SIGHT = '#1f5f8b', '#c26b1f', '0.6'


def save_acquisition_png(path: Path | str, track_m: np.ndarray, corners_m: np.ndarray) -> None:
    """Draw where the radar flew and what it imaged.

    Parameters
    ----------
    path : path
        PNG file to write.
    track_m : (P, 3) float64
        Mean phase centres in the order flown, metres.
    corners_m : (4, 3) float64
        Corners of the image, in turn, metres.
    """
    figure = Figure(figsize=(9.0, 4.4), layout='constrained')
    above, beside = figure.subplots(1, 2)
    middle, centre = track_m.mean(axis=0), corners_m.mean(axis=0)
    sight = centre - middle
    away = sight[:2] / max(float(np.linalg.norm(sight[:2])), 1e-9)
    if not away.any():
        away = np.array([1.0, 0.0])
    _draw(above, track_m[:, :2], corners_m[:, :2])
    if len(track_m) > 1:
        above.annotate('', track_m[-1, :2], track_m[-max(2, len(track_m) // 10), :2],
                       arrowprops={'arrowstyle': '-|>', 'color': _TRACK, 'lw': 2})
    above.set(title='from above', xlabel='x (m)', ylabel='y (m)', aspect='equal')
    # heights over the horizontal distance along the line of sight
    section = [np.column_stack([(points[:, :2] - middle[:2]) @ away, points[:, 2]])
               for points in (track_m, corners_m)]
    _draw(beside, *section)
    beside.set(title='along the track', xlabel='distance from the track (m)',
               ylabel='z (m)', aspect='equal')
    for axes in (above, beside):
        axes.margins(0.08)
        axes.grid(True, color='0.9', linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.set_adjustable('datalim')
    above.legend(loc='best', fontsize=8)
    figure.savefig(path, dpi=110)


def _draw(axes: Axes, track: np.ndarray, corners: np.ndarray) -> None:
    centre = corners.mean(axis=0)
    for end in (track[0], track[-1]):
        axes.plot(*np.stack([end, centre]).T, color=_SIGHT, lw=0.8, ls='--')
    axes.add_patch(Polygon(corners, closed=True, facecolor=_SCENE, edgecolor=_SCENE, alpha=0.5,
                           label='image'))
    axes.plot(*corners[[0, 1, 2, 3, 0]].T, color=_SCENE, lw=1.2)
    axes.plot(*track.T, color=_TRACK, lw=2.4, label='phase centres', marker='.', ms=3)


_MOST_PULSES = 1024
_SHOWN_DB = 60.0
_LEAST_MS = 1e-3  # of the axis of times


def save_signal_png(path: Path | str, block: PulseBlock, *, title: str) -> None:
    """Draw what tells faults of a recording to the eye.

    Parameters
    ----------
    path : path
        PNG file to write.
    block : PulseBlock
        Pulses in the order sent.
    title : str
        Over the picture.
    """
    some = block.select(slice(None, None, -(-block.n_pulses // _MOST_PULSES)))
    compressor = RangeCompressor.for_block(some)
    profiles = compressor(some).samples
    radar = compressor.output_radar
    range_m = radar.range_start_m + np.arange(profiles.shape[2]) * radar.sample_spacing_m
    figure = Figure(figsize=(11.0, 7.2), layout='constrained')
    (echoes, values), (times, channels) = figure.subplots(2, 2)
    _echoes(figure, echoes, profiles[:, 0], range_m)
    _values(values, some)
    _times(times, block)
    _channels(channels, profiles, range_m)
    for axes in (values, times, channels):
        axes.grid(True, color='0.9', linewidth=0.6)
        axes.set_axisbelow(True)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)


def _level_db(power: np.ndarray) -> np.ndarray:
    return 10 * np.log10(np.maximum(power / max(float(power.max()), 1e-30), 1e-12))


def _echoes(figure: Figure, axes: Axes, profiles: np.ndarray, range_m: np.ndarray) -> None:
    shown = axes.imshow(_level_db(np.square(np.abs(profiles))), aspect='auto', cmap='viridis',
                        vmin=-_SHOWN_DB, vmax=0.0, interpolation='nearest',
                        extent=(range_m[0], range_m[-1], len(profiles), 0))
    axes.set(title='range profiles of channel 0', xlabel='range (m)', ylabel='pulse')
    figure.colorbar(shown, ax=axes, label='dB')


def _values(axes: Axes, block: PulseBlock) -> None:
    for name, part in (('I', block.samples.real), ('Q', block.samples.imag)):
        if part.any():
            axes.hist(part.ravel()[:2_000_000], bins=201, histtype='step', label=name)
    axes.set(title='values of the samples (piles at the ends: clipping)', xlabel='value',
             ylabel='samples', yscale='log')
    axes.legend(fontsize=8)


def _times(axes: Axes, block: PulseBlock) -> None:
    counter = block.counter.astype(np.int64)
    order = np.argsort(counter, kind='stable')
    counter = counter[order]
    seconds = (block.stamp_ns[order] - block.stamp_ns[order[0]]) * 1e-9
    if len(counter) > 32:
        late = scatter_s(counter, seconds)
        half = (len(counter) - len(late)) // 2
        axes.plot(counter[half:len(counter) - half], 1e3 * late, '.', ms=2)
        limit = max(1.2e3 * float(np.abs(late).max()), _LEAST_MS)
        axes.set_ylim(-limit, limit)
    axes.set(title='stamps less those of their neighbours', xlabel='number of the pulse',
             ylabel='ms')


def _channels(axes: Axes, profiles: np.ndarray, range_m: np.ndarray) -> None:
    power = np.mean(np.square(np.abs(profiles)), axis=0)
    level = _level_db(power)
    for number in range(min(len(level), 16)):
        axes.plot(range_m, level[number], lw=0.9, label=f'channel {number}')
    stays = np.square(np.abs(profiles[:, 0].mean(axis=0)))
    axes.plot(range_m, 10 * np.log10(np.maximum(stays / power.max(), 1e-12)), color='0.6', lw=0.8,
              label='stays, channel 0')
    axes.set(title='mean profiles', xlabel='range (m)', ylabel='dB',
             ylim=(max(float(level.min()), -_SHOWN_DB) - 15, 3))
    axes.legend(fontsize=7, ncols=2)


LEAST_DB, MOST_DB = 10.0, 60.0  # from black to white
LONG_SIDE = 4.0  # inches of the longest side of the volume
_DRAWN = 20_000  # points of the cloud, the brightest
_VIEW_DEG = 22.0, -112.0  # elevation and azimuth from which the cloud is seen


def save_volume_png(path: Path | str, samples: np.ndarray, grid: VolumeGrid, cells: BrightCells,
                    *, threshold_db: float, truth: Sequence[dict[str, Any]] = (),
                    title: str = '') -> None:
    """Draw the largest magnitudes along z, y and x in decibels, and the cloud.

    What is too dark for the cloud is black.

    Parameters
    ----------
    path : path
        PNG file to write.
    samples : (n_z, n_y, n_x) complex64
        Volume, rows and columns along y and x of the frame, as `VolumeGrid.above` builds it.
    grid : VolumeGrid
        Where its cells are.
    cells : BrightCells
        Its cloud.
    threshold_db : float
        Threshold of the cloud, dB above the median.
    truth : sequence of dict
        Scatterers to mark, each with ``position_m`` (x, y, z in metres).
    title : str
        Title line.
    """
    magnitude = np.abs(samples)
    top_db = cells.intensity_db[0] if len(cells.intensity_db) else LEAST_DB + threshold_db
    black_db = -float(np.clip(top_db - threshold_db, LEAST_DB, MOST_DB))
    low, high = (grid.positions(*index) for index in ((0, grid.n_y - 1, 0),
                                                      (grid.n_z - 1, 0, grid.n_x - 1)))
    half = np.abs(grid.steps_m).max(axis=0) / 2
    sides = np.stack([low - half, high + half], axis=1)  # of x, y and z
    extent = (high - low + 2 * half) * LONG_SIDE / (high - low + 2 * half).max()
    figure = Figure(figsize=(extent[0] + max(extent[1], 2.5) + 3.2, extent[1] + extent[2] + 1.8),
                    layout='constrained')
    layout = figure.add_gridspec(2, 2, width_ratios=(extent[0], max(extent[1], 2.5)),
                                 height_ratios=extent[[1, 2]])
    peak = float(magnitude.max()) or 1.0
    panels = ((layout[0, 0], 'from above', 0, 1, magnitude.max(axis=0)[::-1]),
              (layout[1, 0], 'from the front, along y', 0, 2, magnitude.max(axis=1)),
              (layout[1, 1], 'from the side, along x', 1, 2, magnitude.max(axis=2)[:, ::-1]))
    for place, name, across, up, shown in panels:
        axes = figure.add_subplot(place)
        level = 20 * np.log10(np.maximum(shown / peak, 10 ** (black_db / 20)))
        drawn = axes.imshow(level, extent=(*sides[across], *sides[up]), origin='lower',
                            cmap='magma', vmin=black_db, vmax=0.0, interpolation='nearest')
        for scatterer in truth:
            axes.plot(scatterer['position_m'][across], scatterer['position_m'][up], 'o', ms=10,
                      mfc='none', mec=MARK, mew=0.8)
        axes.set(title=name, xlabel=f'{"xyz"[across]} (m)', ylabel=f'{"xyz"[up]} (m)',
                 xlim=sides[across], ylim=sides[up])
    cloud = figure.add_subplot(layout[0, 1], projection='3d')
    points = cells.points_m[:_DRAWN][::-1]  # the brightest drawn last
    cloud.scatter(*points.T, c=cells.intensity_db[:_DRAWN][::-1] - top_db, s=2, cmap='magma',
                  vmin=black_db, vmax=0.0, depthshade=False)
    cloud.set(title=f'{len(cells.points_m)} points', xlim=sides[0], ylim=sides[1], zlim=sides[2],
              box_aspect=extent)
    cloud.view_init(*_VIEW_DEG)
    cloud.tick_params(labelsize=7)
    figure.colorbar(drawn, ax=figure.axes, shrink=0.7, label='dB relative to the brightest cell')
    figure.suptitle(title, fontsize=10)
    figure.savefig(path, dpi=90)
