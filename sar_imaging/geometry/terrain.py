# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Read terrain heights from a file and interpolate them to the pixels of a map.

The file is NumPy's ``.npz`` with three arrays: ``x_m`` (N,) and ``y_m`` (M,), both strictly
ascending or descending, and ``height_m`` (M, N), all in the imaging frame in metres. Any elevation
model can be written so in a few lines, without a library for geodata on the robot; what a ROS map
offers instead (nav_msgs/OccupancyGrid) has 101 levels and none of them is a height.
"""

from __future__ import annotations

import dataclasses
import os
import pathlib

import numpy as np

from ..files import reading, replacing
from ..numpy_files import open_npz
from .grids import MapGrid

_NAMES = ('x_m', 'y_m', 'height_m')


@dataclasses.dataclass(frozen=True)
class Terrain:
    """Heights on a rectangular raster, linear between its points.

    Parameters
    ----------
    x_m : (N,) float64
        Columns of the raster, strictly monotonic, imaging frame, metres.
    y_m : (M,) float64
        Its rows, strictly monotonic, metres.
    height_m : (M, N) float64
        Heights, metres; NaN where they are not known.

    Raises
    ------
    ValueError
        Shapes disagree, coordinates are not monotonic, or no height is known.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry import MapGrid
    >>> from sar_imaging.geometry.terrain import Terrain
    >>> slope = Terrain(np.array([0.0, 100.0]), np.array([0.0, 50.0]),
    ...                 np.array([[0.0, 10.0], [0.0, 10.0]]))
    >>> slope.heights(MapGrid((50.0, 25.0, 0.0), 3, 1, 20.0)).round(6).tolist()
    [[3.0, 5.0, 7.0]]
    """

    x_m: np.ndarray
    y_m: np.ndarray
    height_m: np.ndarray

    def __post_init__(self) -> None:
        for name in _NAMES:
            value = np.asarray(getattr(self, name))
            if value.dtype.kind not in 'iuf':
                raise ValueError(f'{name} has dtype {value.dtype}; expected real numbers')
            object.__setattr__(self, name, value.astype(float))
        for name in ('x_m', 'y_m'):
            steps = np.diff(getattr(self, name)) if getattr(self, name).ndim == 1 else np.array([])
            if not (len(steps) and np.isfinite(steps).all()
                    and ((steps > 0).all() or (steps < 0).all())):
                raise ValueError(f'{name} of shape {getattr(self, name).shape} must be two or '
                                 'more finite numbers, ascending or descending')
        if self.height_m.shape != (len(self.y_m), len(self.x_m)):
            raise ValueError(f'height_m.shape={self.height_m.shape}; expected '
                             f'{(len(self.y_m), len(self.x_m))}, one row for each of y_m')
        if np.isinf(self.height_m).any() or np.isnan(self.height_m).all():
            raise ValueError('height_m holds infinities, or nothing but NaN; expected heights in '
                             'metres, NaN where one is not known')

    @classmethod
    def load(cls, path: pathlib.Path | str) -> Terrain:
        """Terrain of a file.

        Raises
        ------
        ValueError
            The file does not exist, is no ``.npz``, or its arrays are not as described.
        """
        if not os.path.lexists(path):
            raise ValueError(f'terrain {path} does not exist')
        with reading(path, 'terrain'), open_npz(pathlib.Path(path)) as arrays:
            missing = [name for name in _NAMES if name not in arrays.names]
            if missing:
                raise ValueError(f'it has no {" and no ".join(missing)}; expected the arrays '
                                 f'{", ".join(_NAMES)}')
            return cls(*(arrays[name] for name in _NAMES))

    def save(self, path: pathlib.Path | str) -> None:
        """Write the file that `load` reads; the name should end in ``.npz``."""
        with replacing(path) as part, open(part, 'wb') as file:
            np.savez_compressed(file, **{name: getattr(self, name) for name in _NAMES})

    def heights(self, grid: MapGrid) -> np.ndarray:
        """Heights at the pixels of a map.

        Parameters
        ----------
        grid : MapGrid
            Its own height does not matter.

        Returns
        -------
        (n_y, n_x) float64
            Metres, row 0 at the largest y; NaN outside the raster and next to unknown heights:
            no pixel for `sar_imaging.plan_image`.

        Raises
        ------
        ValueError
            No pixel has a height.
        """
        row, down = _places(self.y_m, grid.y_m)
        column, right = _places(self.x_m, grid.x_m)
        out = np.zeros(grid.shape)
        for step_y, weight_y in ((0, 1 - down), (1, down)):
            for step_x, weight_x in ((0, 1 - right), (1, right)):
                weight = weight_y[:, None] * weight_x
                heights = self.height_m[np.ix_(row + step_y, column + step_x)]
                # A neighbour of no weight does not count, be its height known or not.
                out += np.where(weight == 0.0, 0.0, weight * heights)
        if np.isnan(out).all():
            raise ValueError(
                f'the terrain covers x {self.x_m.min():g} to {self.x_m.max():g} m and y '
                f'{self.y_m.min():g} to {self.y_m.max():g} m; none of its known heights lies in '
                f'the grid of x {grid.x_m[0]:g} to {grid.x_m[-1]:g} m, y {grid.y_m[-1]:g} to '
                f'{grid.y_m[0]:g} m')
        return out


def _places(raster_m: np.ndarray, wanted_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the raster's point before each wanted one and the share of the next, NaN outside.

    Points on the outermost line of the raster belong to it, up to rounding.
    """
    ascending = raster_m if raster_m[0] < raster_m[-1] else raster_m[::-1]
    place = np.interp(wanted_m, ascending, np.arange(len(ascending)))
    slack = 1e-9 * np.ptp(ascending)
    inside = (wanted_m >= ascending[0] - slack) & (wanted_m <= ascending[-1] + slack)
    if ascending is not raster_m:
        place = len(ascending) - 1 - place
    before = np.clip(place.astype(int), 0, len(ascending) - 2)
    return before, np.where(inside, place - before, np.nan)
