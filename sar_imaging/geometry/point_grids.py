"""Grids with pixels at any positions: on terrain, or point by point."""

from __future__ import annotations

import dataclasses

import numpy as np

from .grids import Grid, MapGrid


@dataclasses.dataclass(frozen=True, eq=False)
class TerrainGrid:
    """Pixels of a map at heights of their own.

    Parameters
    ----------
    map_grid : MapGrid
        Where the pixels are in x and y; its height does not matter.
    height_m : (n_y, n_x) array_like
        Height of each pixel in the imaging frame, metres; row 0 at the largest y. NaN where it is
        not known: no pixel, to which nothing is added.

    Raises
    ------
    ValueError
        The heights do not have the shape of the map, or one is infinite.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry import MapGrid, TerrainGrid
    >>> flat = MapGrid((100.0, 0.0, 0.0), 4, 3, 1.0)
    >>> hill = TerrainGrid(flat, height_m=np.full(flat.shape, 12.5))
    >>> hill.positions(0, 0).tolist()
    [98.5, 1.0, 12.5]
    """

    map_grid: MapGrid
    height_m: np.ndarray

    def __post_init__(self):
        heights = np.require(self.height_m, np.float64, ['C', 'W'])
        if heights.shape != self.shape:
            raise ValueError(f'height_m.shape={heights.shape} does not match the grid; '
                             f'expected {self.shape}, row 0 at the largest y')
        object.__setattr__(self, 'height_m', heights)
        _check_infinite('z', heights)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape ``(n_y, n_x)``."""
        return self.map_grid.shape

    def positions(self, row, column) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        out = self.map_grid.positions(row, column)
        out[..., 2] = self.height_m[row, column]
        return out

    def points(self) -> np.ndarray:
        """(n_y, n_x, 3) float64 positions of all pixels, metres."""
        out = self.map_grid.points()
        out[..., 2] = self.height_m
        return out


@dataclasses.dataclass(frozen=True, eq=False)
class PointGrid:
    """Pixels at any positions, in an array of any shape; the image has the same.

    Parameters
    ----------
    points_m : (..., 3) array_like
        Positions in the imaging frame, metres, float64. A position with a NaN is no pixel, to
        which nothing is added.

    Raises
    ------
    ValueError
        It is no such array, or a coordinate is infinite.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry import PointGrid
    >>> angle = np.linspace(0.0, np.pi, 5)
    >>> arc = PointGrid(np.stack([20 * np.cos(angle), 20 * np.sin(angle), 0 * angle], axis=-1))
    >>> arc.shape
    (5,)
    >>> arc.positions(2).round(6).tolist()
    [0.0, 20.0, 0.0]
    """

    points_m: np.ndarray

    def __post_init__(self):
        # Writable, since Numba would compile once more for what is not.
        points = np.require(self.points_m, np.float64, ['C', 'W'])
        if points.ndim < 1 or points.shape[-1] != 3 or points.size == 0:
            raise ValueError(f'points.shape={points.shape}; expected (..., 3), x, y and z of at '
                             'least one point in metres')
        object.__setattr__(self, 'points_m', points)
        for name, values in zip('xyz', np.moveaxis(points, -1, 0), strict=True):
            _check_infinite(name, values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of positions."""
        return self.points_m.shape[:-1]

    def positions(self, *index) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        return self.points_m[index]

    def points(self) -> np.ndarray:
        """(..., 3) float64 positions of all pixels, metres."""
        return self.points_m


def as_grid(grid: Grid | np.ndarray, height_m=None) -> Grid:
    """Grid of what users pass for one: itself, positions (..., 3), or a map and its heights.

    Raises
    ------
    ValueError
        Positions or heights are no such arrays, or heights come without a map.
    """
    if height_m is not None:
        if not isinstance(grid, MapGrid):
            raise ValueError(f'height_m goes with a MapGrid, not with {type(grid).__name__}; '
                             'other grids have their own z')
        return TerrainGrid(grid, height_m)
    return grid if isinstance(grid, MapGrid | Grid) else PointGrid(grid)  # maps are told quickly


def _check_infinite(name: str, values: np.ndarray) -> None:
    if np.isinf(values).any():
        raise ValueError(f'{name} of {np.count_nonzero(np.isinf(values))} points is infinite; '
                         'write NaN where there is no position')
