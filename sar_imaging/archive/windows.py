# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pixels of the map: windows of its lattice, its tiles, and where on plane or ellipsoid they lie.

Pixel ``(row, column)`` of the lattice lies at ``x = column * spacing`` and ``y = -row * spacing``
of the map's frame: the lattice follows from the frame and the spacing alone, rows run south as
in images, and both numbers may be negative. Tiles are squares of it that begin at multiples of
their size.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.earth import Datum
from ..geometry.grids import MapGrid, TerrainGrid
from .job import Job


@dataclasses.dataclass(frozen=True, order=True)
class Window:
    """Rectangle of pixels of the lattice; the last row and column are not in it.

    Parameters
    ----------
    row0, row1, column0, column1 : int
        First row and the one after the last; columns likewise.

    Raises
    ------
    ValueError
        It has no pixel.
    """

    row0: int
    row1: int
    column0: int
    column1: int

    def __post_init__(self) -> None:
        if self.row1 <= self.row0 or self.column1 <= self.column0:
            raise ValueError(f'rows {self.row0} to {self.row1}, columns {self.column0} to '
                             f'{self.column1}: expected at least one pixel')

    @classmethod
    def around(cls, points_m: ArrayLike, spacing_m: float) -> Window:
        """Smallest window with the points (N, 2 or 3), x and y in the map's frame, metres."""
        points = np.asarray(points_m, np.float64)
        columns, rows = points[:, 0] / spacing_m, -points[:, 1] / spacing_m
        # points on pixels, but for rounding, are those pixels
        return cls(math.floor(rows.min() + 1e-6), math.ceil(rows.max() - 1e-6) + 1,
                   math.floor(columns.min() + 1e-6), math.ceil(columns.max() - 1e-6) + 1)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.row1 - self.row0, self.column1 - self.column0

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return math.prod(self.shape)

    @property
    def as_tuple(self) -> tuple[int, int, int, int]:
        """First row, the one after the last, first column, the one after the last."""
        return dataclasses.astuple(self)

    def grid(self, spacing_m: float, height_m: float = 0.0) -> MapGrid:
        """The same pixels as a map grid in the map's frame."""
        return MapGrid(((self.column0 + self.column1 - 1) / 2 * spacing_m,
                        -(self.row0 + self.row1 - 1) / 2 * spacing_m, height_m),
                       self.column1 - self.column0, self.row1 - self.row0, spacing_m)

    def within(self, other: Window) -> tuple[slice, slice]:
        """Rows and columns of this window in an array of another window's pixels."""
        return (slice(self.row0 - other.row0, self.row1 - other.row0),
                slice(self.column0 - other.column0, self.column1 - other.column0))

    def intersection(self, other: Window) -> Window | None:
        """Pixels that both have, None without any."""
        row0, row1 = max(self.row0, other.row0), min(self.row1, other.row1)
        column0, column1 = max(self.column0, other.column0), min(self.column1, other.column1)
        return Window(row0, row1, column0, column1) if row0 < row1 and column0 < column1 else None

    def holds(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Which pixels, by rows and columns of the lattice, are in it."""
        return ((row >= self.row0) & (row < self.row1)
                & (column >= self.column0) & (column < self.column1))

    def on_tiles(self, tile: int) -> Window:
        """Smallest window of whole tiles around it."""
        return Window(self.row0 // tile * tile, -(-self.row1 // tile) * tile,
                      self.column0 // tile * tile, -(-self.column1 // tile) * tile)

    def tiles(self, tile: int) -> Iterator[Window]:
        """Whole tiles that it touches, row by row."""
        whole = self.on_tiles(tile)
        for row in range(whole.row0, whole.row1, tile):
            for column in range(whole.column0, whole.column1, tile):
                yield Window(row, row + tile, column, column + tile)

    def strips(self, n_rows: int) -> Iterator[Window]:
        """The window in parts of some rows."""
        for row in range(self.row0, self.row1, n_rows):
            yield Window(row, min(row + n_rows, self.row1), self.column0, self.column1)


def union(windows: Iterable[Window]) -> Window:
    """Smallest window around some, at least one."""
    rows0, rows1, columns0, columns1 = zip(*(w.as_tuple for w in windows), strict=True)
    return Window(min(rows0), max(rows1), min(columns0), max(columns1))


def box(points_m: np.ndarray) -> np.ndarray:
    """(4, 2) corners of the rectangle around points (N, 2), counter-clockwise, metres."""
    (x0, y0), (x1, y1) = points_m.min(axis=0), points_m.max(axis=0)
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def inside(corners_m: ArrayLike, x_m: np.ndarray, y_m: np.ndarray, margin_m: float) -> np.ndarray:
    """Which places lie within a convex footprint, or nearer to its edges than a margin.

    Parameters
    ----------
    corners_m : (N, 2) array_like
        Corners, counter-clockwise, metres.
    x_m, y_m : arrays
        Places, broadcast together, metres.
    margin_m : float
        Metres.
    """
    corners = np.array(corners_m, np.float64)
    out = np.ones(np.broadcast_shapes(x_m.shape, y_m.shape), bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        left = (x1 - x0) * (y_m - y0) - (y1 - y0) * (x_m - x0)
        out &= left >= -margin_m * float(np.hypot(x1 - x0, y1 - y0))
    return out


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


def surface_points(job: Job, points_m: ArrayLike) -> np.ndarray:
    """(N, 3) float64 points of the map's surface at (N, 2 or 3) x and y of its frame, metres."""
    x, y = np.asarray(points_m, np.float64)[:, :2].T
    round_earth = job.surface == ELLIPSOID and job.datum is not None
    z = surface_z(x, y, job.datum, job.height_m) if round_earth else np.full(len(x), job.height_m)
    return np.column_stack([x, y, z])


def surface_z(x_m: ArrayLike, y_m: ArrayLike, datum: Datum, height_m: float = 0.0) -> np.ndarray:
    """Height in the frame of places at one height above the ellipsoid through the datum.

    Parameters
    ----------
    x_m, y_m : (...) array_like
        Places in the frame, broadcast together, metres.
    datum : Datum
        Datum of the frame.
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
        Datum of the map's frame.
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

    def positions(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
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
