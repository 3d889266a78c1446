"""Arbitrary points as the pixels of an image: a map, a terrain, or any positions."""

from __future__ import annotations

import functools
import math

import numpy as np

from ..geometry.grids import MapGrid
from . import point_kernels
from .lattice import half_paths, point_lattice, total_db
from .profiles import Profiles
from .range_window import RangeWindow

_ROUNDING_SHARE_DB = 6.0  # rounding inside tiles stays so far below the target
_SAMPLED_STEPS = 1000  # between neighbours, to find their distance
_SAMPLED_PIXELS, _SAMPLED_ROWS = 500, 33


class ImagePoints:
    """Positions of the pixels of an image.

    A pixel with a NaN has no position; nothing is ever added to it.

    Parameters
    ----------
    xs, ys, zs : (K,) float64
        Coordinates, metres.
    strides : sequence of three (int, int)
        Steps of the index in each of the coordinates from row to row and from column to column.
    shape : tuple of int
        Of the image.

    Raises
    ------
    ValueError
        A coordinate is infinite.
    """

    def __init__(self, xs, ys, zs, strides, shape: tuple[int, ...]):
        self.shape = shape
        self._size = (math.prod(shape[:-1]), shape[-1]) if shape else (1, 1)
        self._coordinates, self._strides = (xs, ys, zs), np.array(strides)
        low, high = [], []
        for name, values, stride in zip('xyz', self._coordinates, strides, strict=True):
            values = values[::max(stride[1], 1)]
            low.append(np.fmin.reduce(values))  # without the NaNs
            high.append(np.fmax.reduce(values))
            if math.isinf(low[-1]) or math.isinf(high[-1]):
                raise ValueError(f'{name} of {np.count_nonzero(np.isinf(values))} points is '
                                 'infinite; write NaN where there is no position')
        self._centre = 0.5 * (np.array(low) + np.array(high))
        self._radius = 0.5 * math.dist(low, high)

    @classmethod
    def of_array(cls, points) -> ImagePoints:
        """Points of a (..., 3) float64 array, metres."""
        # Writable, since Numba would compile once more for what is not.
        points = np.require(points, np.float64, ['C', 'W'])
        if points.ndim < 1 or points.shape[-1] != 3 or points.size == 0:
            raise ValueError(f'points.shape={points.shape}; expected (..., 3), x, y and z of at '
                             'least one point in metres')
        n_x = points.shape[-2] if points.ndim > 1 else 1
        flat = points.reshape(-1)
        return cls(flat, flat[1:], flat[2:], [(3 * n_x, 3)] * 3, points.shape[:-1])

    @classmethod
    def of_map(cls, grid: MapGrid, height_m=None) -> ImagePoints:
        """Pixels of a map, at (n_y, n_x) float64 heights, metres, or on its plane."""
        heights, strides = np.array([grid.z_m]), (0, 0)
        if height_m is not None:
            heights = np.require(height_m, np.float64, ['C', 'W'])
            if heights.shape != grid.shape:
                raise ValueError(f'height_m.shape={heights.shape} does not match the grid; '
                                 f'expected {grid.shape}, row 0 at the largest y')
            heights, strides = heights.reshape(-1), (grid.n_x, 1)
        return cls(grid.x_m, grid.y_m, heights, [(0, 1), (1, 0), strides], grid.shape)

    @property
    def empty(self) -> bool:
        """True when no pixel has a position."""
        return not math.isfinite(self._radius)

    def some(self) -> np.ndarray:
        """(S, 3) float64 positions of pixels all over the image, metres."""
        rng = np.random.default_rng(0)
        row, column = (rng.integers(0, n, _SAMPLED_PIXELS) for n in self._size)
        points = np.stack([values[row * stride[0] + column * stride[1]] for values, stride in
                           zip(self._coordinates, self._strides, strict=True)], axis=-1)
        return points[np.isfinite(points).all(axis=1)]

    def bounds(self, tx_m, rx_m) -> tuple[float, float]:
        """Bounds of the half path from phase centres (R, 3), metres."""
        path = 0.5 * sum(np.linalg.norm(self._centre - c, axis=-1) for c in (tx_m, rx_m))
        return float(path.min()) - self._radius, float(path.max()) + self._radius

    def add(self, radar, target_db: float, range_m, samples, tx_m, rx_m, image) -> float:
        """Add rows to an image and return the predicted error, dB.

        Parameters
        ----------
        radar : RadarParameters
            Of the compressed profiles.
        target_db : float
            Wanted error against time-domain correlation, dB.
        range_m : (float, float)
            Bounds of the half path, metres.
        samples : (R, N) complex64
            Profiles of the rows.
        tx_m, rx_m : (R, 3) float64
            Phase centres of the rows, metres.
        image : (N,) float32
            Real and imaginary parts to add to, in turn; changed in place.
        """
        window = RangeWindow.around(radar, samples.shape[1], range_m)
        lattice = point_lattice(radar, window.n_samples, target_db)
        profiles = Profiles(window, lattice, range_m)
        rounding_db = target_db - _ROUNDING_SHARE_DB
        reach = point_kernels.largest_radius(radar.wavelength_m, rounding_db)
        tile, work = self._tile(reach), point_kernels.work_space()
        for rows in profiles.chunks(len(samples)):
            planes = profiles.planes(samples[rows])
            coefficients = np.ascontiguousarray(planes[:, 0].transpose(0, 2, 1))
            point_kernels.project_points(
                coefficients.reshape(-1), coefficients.shape[:2], tx_m[rows], rx_m[rows],
                *self._coordinates, self._strides, self._size, tile, profiles.range_at(0),
                lattice.step_m, profiles.cycles_per_step, profiles.cycles_at(0), reach, image,
                *work)
        some = np.linspace(0, len(tx_m) - 1, min(len(tx_m), _SAMPLED_ROWS)).round().astype(int)
        length = half_paths(tx_m[some], rx_m[some], self.some())[0]
        return total_db(lattice.predicted_error_db, point_kernels.rounding_db(
            radar.wavelength_m, min(reach, self._tile_radius(tile))),
            10 * math.log10(float(window.end_error(length).mean()) + 1e-16))

    def _tile(self, reach: float) -> tuple[int, int]:
        """Largest tile that float32 can do, judged by the distance of neighbours."""
        sides = ((1, 256), (1, 64), (1, 16)) if self._size[0] == 1 else ((16, 16), (8, 8), (4, 4))
        return next((s for s in sides if self._tile_radius(s) < reach), sides[0])

    def _tile_radius(self, sides: tuple[int, int]) -> float:
        return 0.5 * math.hypot(*(n * self._distances[axis] for axis, n in enumerate(sides)))

    @functools.cached_property
    def _distances(self) -> tuple[float, float]:
        return self._neighbour_distance(0), self._neighbour_distance(1)

    def _neighbour_distance(self, axis: int) -> float:
        """Median distance of neighbouring pixels along an axis, metres; 0 where there is none."""
        steps = self._size[axis] - 1
        if steps == 0:
            return 0.0
        rng = np.random.default_rng(0)
        place = [rng.integers(0, n, _SAMPLED_STEPS) for n in self._size]
        place[axis] = rng.integers(0, steps, _SAMPLED_STEPS)
        square = 0.0
        for values, stride in zip(self._coordinates, self._strides, strict=True):
            here = place[0] * stride[0] + place[1] * stride[1]
            square = square + (values[here + stride[axis]] - values[here]) ** 2
        known = square[np.isfinite(square)]
        return math.sqrt(np.median(known)) if known.size else 0.0
