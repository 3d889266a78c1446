"""Where the pixels of a window are: on the plane of the map, or on the ellipsoid below it."""

from __future__ import annotations

import dataclasses

import numpy as np

from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid, TerrainGrid

from ..jobs import Job, Window

ELLIPSOID = 'ellipsoid'
_ROUNDS = 4  # that find the surface; each gains three digits or more
_ROWS_AT_ONCE = 64


def window_grid(window: Window, job: Job) -> MapGrid | TerrainGrid:
    """Grid of a window's pixels in the map's frame.

    Pixels keep their x and y. On the ellipsoid, they have the height of the job above the
    ellipsoid through the datum.
    """
    surface = lattice_grid(window, job)
    if isinstance(surface, MapGrid):
        return surface
    grid = surface.map_grid
    height = np.empty(grid.shape)
    for first in range(0, grid.n_y, _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        height[rows] = surface_z(grid.x_m, grid.y_m[rows, None], job.datum, job.height_m)
    return TerrainGrid(grid, height)


def surface_z(x_m, y_m, datum: Datum, height_m: float = 0.0) -> np.ndarray:
    """Height in the frame of places at one height above the ellipsoid through the datum.

    Parameters
    ----------
    x_m, y_m : (...) array_like
        Places in the frame, broadcast together, metres.
    datum : Datum
        Of the frame.
    height_m : float
        Above the ellipsoid through the frame's origin, metres.

    Returns
    -------
    (...) float64
        z in the frame, metres.
    """
    x, y = np.broadcast_arrays(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64))
    points = np.stack([x, y, np.full(x.shape, float(height_m))], axis=-1)
    wanted = datum.height_m + height_m
    for _ in range(_ROUNDS):
        _, _, height = datum.to_geographic(points)
        points[..., 2] += wanted - height
    return points[..., 2]


@dataclasses.dataclass(frozen=True)
class SurfaceGrid:
    """Pixels at a height above the ellipsoid, computed when they are asked for.

    Parameters
    ----------
    map_grid : MapGrid
        Where the pixels are in x and y.
    datum : Datum
        Of the map's frame.
    height_m : float
        Above the ellipsoid through the frame's origin, metres.
    """

    map_grid: MapGrid
    datum: Datum
    height_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape ``(n_y, n_x)``."""
        return self.map_grid.shape

    def positions(self, row, column) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        out = self.map_grid.positions(row, column)
        out[..., 2] = surface_z(out[..., 0], out[..., 1], self.datum, self.height_m)
        return out

    def points(self) -> np.ndarray:
        """(n_y, n_x, 3) float64 positions of all pixels, metres."""
        rows, columns = self.shape
        return self.positions(np.arange(rows)[:, None], np.arange(columns))


def lattice_grid(window: Window, job: Job) -> MapGrid | SurfaceGrid:
    """The same pixels as `window_grid`, without memory for each."""
    grid = window.grid(job.spacing_m, job.height_m)
    if job.surface != ELLIPSOID or job.datum is None:
        return grid
    return SurfaceGrid(grid, job.datum, job.height_m)
