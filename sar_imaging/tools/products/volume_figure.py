"""Picture of a volume: three maximum projections and its bright cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sar_imaging.exploitation.bright_cells import BrightCells
from sar_imaging.geometry.grids import VolumeGrid

from ..plots import MARK

LEAST_DB, MOST_DB = 10.0, 60.0  # from black to white
LONG_SIDE = 4.0  # inches of the longest side of the volume
_DRAWN = 20_000  # points of the cloud, the brightest
_VIEW_DEG = 22.0, -112.0  # elevation and azimuth from which the cloud is seen


def save_volume_png(path: Path | str, samples: np.ndarray, grid: VolumeGrid, cells: BrightCells,
                    *, threshold_db: float, truth: Sequence[dict] = (), title: str = '') -> None:
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
        Of the cloud, dB above the median.
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
    FigureCanvasAgg(figure)
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
