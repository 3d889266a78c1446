"""Plan of images of arbitrary points: a map, a terrain, or any positions."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from ...geometry.grids import MapGrid
from ...signal.radar import RadarParameters
from ..plan import Plan
from ..profiles.range_gate import RangeWindow
from ..profiles.range_resampling import Lattice, half_paths, point_lattice

_ROUNDING_SHARE_DB = 6.0  # rounding inside tiles stays so far below the target
# Rms error of a path in float32 over the radius of its tile; 1.4e-8 to 1.7e-8 were measured
_ROUNDING = 3e-8
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

    Attributes
    ----------
    coordinates, strides, shape :
        As given.
    size : (int, int)
        Rows and columns: the last axis of the image, and all others.

    Raises
    ------
    ValueError
        A coordinate is infinite.
    """

    def __init__(self, xs, ys, zs, strides, shape: tuple[int, ...]):
        self.shape = shape
        self.size = (math.prod(shape[:-1]), shape[-1]) if shape else (1, 1)
        self.coordinates, self.strides = (xs, ys, zs), np.array(strides)
        low, high = [], []
        for name, values, stride in zip('xyz', self.coordinates, strides, strict=True):
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

    def points(self) -> np.ndarray:
        """(..., 3) float64 positions of all pixels, metres."""
        row, column = (v.reshape(self.shape) for v in np.indices(self.size))
        return np.stack([values[row * stride[0] + column * stride[1]] for values, stride in
                         zip(self.coordinates, self.strides, strict=True)], axis=-1)

    def some(self) -> np.ndarray:
        """(S, 3) float64 positions of pixels all over the image, metres."""
        rng = np.random.default_rng(0)
        row, column = (rng.integers(0, n, _SAMPLED_PIXELS) for n in self.size)
        points = np.stack([values[row * stride[0] + column * stride[1]] for values, stride in
                           zip(self.coordinates, self.strides, strict=True)], axis=-1)
        return points[np.isfinite(points).all(axis=1)]

    def bounds(self, tx_m, rx_m) -> tuple[float, float]:
        """Bounds of the half path from phase centres (R, 3), metres."""
        path = 0.5 * sum(np.linalg.norm(self._centre - c, axis=-1) for c in (tx_m, rx_m))
        return float(path.min()) - self._radius, float(path.max()) + self._radius

    def tile(self, reach_m: float) -> tuple[int, int]:
        """Rows and columns of the largest tile within a radius, judged by some neighbours."""
        sides = ((1, 256), (1, 64), (1, 16)) if self.size[0] == 1 else ((16, 16), (8, 8), (4, 4))
        return next((s for s in sides if self.tile_radius(s) < reach_m), sides[0])

    def tile_radius(self, sides: tuple[int, int]) -> float:
        """Radius of a tile of so many rows and columns, metres."""
        return 0.5 * math.hypot(*(n * self._distances[axis] for axis, n in enumerate(sides)))

    @functools.cached_property
    def _distances(self) -> tuple[float, float]:
        return self._neighbour_distance(0), self._neighbour_distance(1)

    def _neighbour_distance(self, axis: int) -> float:
        """Median distance of neighbouring pixels along an axis, metres; 0 where there is none."""
        steps = self.size[axis] - 1
        if steps == 0:
            return 0.0
        rng = np.random.default_rng(0)
        place = [rng.integers(0, n, _SAMPLED_STEPS) for n in self.size]
        place[axis] = rng.integers(0, steps, _SAMPLED_STEPS)
        square = 0.0
        for values, stride in zip(self.coordinates, self.strides, strict=True):
            here = place[0] * stride[0] + place[1] * stride[1]
            square = square + (values[here + stride[axis]] - values[here]) ** 2
        known = square[np.isfinite(square)]
        return math.sqrt(np.median(known)) if known.size else 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class PointPlan(Plan):
    """How rows are added to points.

    Attributes
    ----------
    window : RangeWindow
        Part of the profiles that is needed.
    lattice : Lattice
        How it is resampled.
    range_m : (float, float)
        Bounds of the half path, metres.
    tile : (int, int)
        Rows and columns of the tiles in which points are taken.
    reach_m : float
        Largest radius of a tile whose paths are computed in float32, metres.
    errors_db : mapping of str to float
        Predicted error against time-domain correlation by cause, dB.
    cost : float
        Nanoseconds per pixel.
    """

    window: RangeWindow
    lattice: Lattice
    range_m: tuple[float, float]
    tile: tuple[int, int]
    reach_m: float
    errors_db: Mapping[str, float]
    cost: float


def plan_points(points: ImagePoints, radar: RadarParameters, n_samples: int, tx_m, rx_m,
                range_m: tuple[float, float], target_db: float) -> PointPlan:
    """Plan the image of some points.

    Parameters
    ----------
    points : ImagePoints
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of a profile.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the rows, metres.
    range_m : (float, float)
        Bounds of the half path, metres.
    target_db : float
        Wanted error against time-domain correlation, dB.
    """
    window = RangeWindow.around(radar, n_samples, range_m)
    lattice = point_lattice(radar, window.n_samples, target_db)
    reach_m = largest_radius(radar.wavelength_m, target_db - _ROUNDING_SHARE_DB)
    tile = points.tile(reach_m)
    some = np.linspace(0, len(tx_m) - 1, min(len(tx_m), _SAMPLED_ROWS)).round().astype(int)
    length = half_paths(tx_m[some], rx_m[some], points.some())[0]
    errors = {
        'range profiles': lattice.predicted_error_db,
        'rounded paths': rounding_db(radar.wavelength_m, min(reach_m, points.tile_radius(tile))),
        'ends of profiles': 10 * math.log10(float(window.end_error(length).mean()) + 1e-16)}
    return PointPlan(window, lattice, range_m, tile, reach_m, errors, lattice.cost * len(tx_m))


def largest_radius(wavelength_m: float, error_db: float) -> float:
    """Radius of a tile, metres, at which rounding in float32 causes this error of the image, dB.

    The phase error is ``4 pi / lambda`` times the error of the path.
    """
    return 10 ** (error_db / 20) * wavelength_m / (4 * math.pi * _ROUNDING)


def rounding_db(wavelength_m: float, radius_m: float) -> float:
    """Error of the image by which tiles of a radius, metres, are rounded in float32, dB."""
    return 20 * math.log10(4 * math.pi * _ROUNDING * radius_m / wavelength_m + 1e-12)
