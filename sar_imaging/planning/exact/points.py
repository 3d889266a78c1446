# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plan of images of arbitrary points: a map, a terrain, or any positions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...geometry.grids import (
    EvenGrid,
    Grid,
    MapGrid,
    PlaneGrid,
    PointGrid,
    TerrainGrid,
    VolumeGrid,
    as_even,
)
from ...geometry.half_paths import half_paths
from ..echo_power import echo_cells
from ..plan import EXACT_SHARES, Plan, error_budget
from ..profiles import (
    PhaseHistory,
    RangeGate,
    RangeResampling,
    mean_db,
    plan_point_resampling,
    some_pixels,
)

if TYPE_CHECKING:
    from ...geometry.illumination import Illumination
    from ...signal.radar import RadarParameters
    from .illumination import PointAmplitudes

# Rms error of a path in float32 over the radius of its tile; 1.4e-8 to 1.7e-8 were measured
_ROUNDING = 3e-8
_SAMPLED_STEPS = 1000  # between neighbours, to find their distance
_SAMPLED_PIXELS, _SAMPLED_ECHOES = 500, 33
_COORDINATE_BYTES = 8  # float64
TILE_SIDE = 256  # of the longest tile
_SIDES = ((1, 256), (1, 64), (1, 16)), ((16, 16), (8, 8), (4, 4))  # of rows, and of images


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
        Shape of the image.

    Attributes
    ----------
    size : (int, int)
        Rows and columns: the last axis of the image, and all others.
    """

    def __init__(self, xs: np.ndarray, ys: np.ndarray, zs: np.ndarray,
                 strides: Sequence[tuple[int, int]], shape: tuple[int, ...]):
        self.shape = shape
        self.size = (math.prod(shape[:-1]), shape[-1]) if shape else (1, 1)
        self.coordinates, self.strides = (xs, ys, zs), np.array(strides)
        some = [values[::max(stride[1], 1)]
                for values, stride in zip(self.coordinates, strides, strict=True)]
        # of extremes without the NaNs
        low, high = (np.array([reduce(v) for v in some])
                     for reduce in (np.fmin.reduce, np.fmax.reduce))
        self._centre, self._radius = 0.5 * (low + high), 0.5 * math.dist(low, high)

    @classmethod
    def of_grid(cls, grid: Grid) -> ImagePoints:
        """Pixels of any grid but a volume."""
        if isinstance(grid, MapGrid):
            return cls(grid.x_m, grid.y_m, np.array([grid.z_m]), [(0, 1), (1, 0), (0, 0)],
                       grid.shape)
        if isinstance(grid, TerrainGrid):
            ground = grid.map_grid
            return cls(ground.x_m, ground.y_m, grid.height_m.reshape(-1),
                       [(0, 1), (1, 0), (ground.n_x, 1)], grid.shape)
        if isinstance(grid, PlaneGrid):
            return cls._of_plane(grid)
        points = (grid if isinstance(grid, PointGrid) else PointGrid(grid.points())).points_m
        n_x = points.shape[-2] if points.ndim > 1 else 1
        flat = points.reshape(-1)
        return cls(flat, flat[1:], flat[2:], [(3 * n_x, 3)] * 3, points.shape[:-1])

    @classmethod
    def _of_plane(cls, plane: PlaneGrid) -> ImagePoints:
        """Pixels of a plane; coordinates that only change along one axis take no more memory."""
        coordinates, strides = [], []
        for start, u, v in zip(plane.origin_m, plane.step_u_m, plane.step_v_m, strict=True):
            column = u * np.arange(plane.n_u if u else 1)
            row = v * np.arange(plane.n_v if v else 1)
            coordinates.append((start + row[:, None] + column).reshape(-1))
            strides.append((len(column) if v else 0, 1 if u else 0))
        x, y, z = coordinates
        return cls(x, y, z, strides, plane.shape)

    @property
    def empty(self) -> bool:
        """True when no pixel has a position."""
        return not math.isfinite(self._radius)

    def positions(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        return np.stack([values[row * stride[0] + column * stride[1]] for values, stride in
                         zip(self.coordinates, self.strides, strict=True)], axis=-1)

    def points(self) -> np.ndarray:
        """(..., 3) float64 positions of all pixels, metres."""
        return self.positions(*(v.reshape(self.shape) for v in np.indices(self.size)))

    def some(self, n: int = _SAMPLED_PIXELS) -> np.ndarray:
        """(n or fewer, 3) float64 positions of pixels all over the image, metres."""
        points = self.positions(*draw(self.size, n))
        return points[np.isfinite(points).all(axis=1)]

    def bounds(self, tx_m: np.ndarray, rx_m: np.ndarray) -> tuple[float, float]:
        """Bounds of the half path from phase centres (R, 3), metres."""
        path = 0.5 * sum(np.linalg.norm(self._centre - c, axis=-1) for c in (tx_m, rx_m))
        return float(path.min()) - self._radius, float(path.max()) + self._radius

    def tile(self, reach_m: float) -> tuple[tuple[int, int], float]:
        """Rows and columns of the largest tile within a radius, and its radius, metres.

        Judged by the distances of some neighbours.
        """
        distances = [self._neighbour_distance(axis) for axis in (0, 1)]
        sides = _SIDES[self.size[0] > 1]
        tiles = [(s, 0.5 * math.hypot(*(n * d for n, d in zip(s, distances, strict=True))))
                 for s in sides]
        return next((tile for tile in tiles if tile[1] < reach_m), tiles[0])

    def _neighbour_distance(self, axis: int) -> float:
        """Median distance of neighbouring pixels along an axis, metres; 0 where there is none."""
        steps = self.size[axis] - 1
        if steps == 0:
            return 0.0
        rng = np.random.default_rng(0)
        place = [rng.integers(0, n, _SAMPLED_STEPS) for n in self.size]
        place[axis] = rng.integers(0, steps, _SAMPLED_STEPS)
        there = [p + (n == axis) for n, p in enumerate(place)]
        square = sum(((self.positions(*there) - self.positions(*place)) ** 2).T)
        known = square[np.isfinite(square)]
        return math.sqrt(np.median(known)) if known.size else 0.0


def draw(shape: Sequence[int], n: int) -> list[np.ndarray]:
    """Numbers of n pixels all over an image along each of its axes, (n,) int64 each."""
    rng = np.random.default_rng(0)
    return [rng.integers(0, size, n) for size in shape]


def pixels_of(grid: Grid) -> MapGrid | PlaneGrid | VolumeGrid | ImagePoints:
    """Pixels of any grid, as exact images have them."""
    return as_even(grid) or ImagePoints.of_grid(grid)


def some_of(pixels: EvenGrid | ImagePoints) -> np.ndarray:
    """(S, 3) float64 positions all over an image, metres."""
    return pixels.some() if isinstance(pixels, ImagePoints) else some_pixels(pixels)


def extent(grid: EvenGrid | ImagePoints) -> tuple[np.ndarray, np.ndarray]:
    """Middle of an image, (3,), and its two longest sides, (2, 3), metres."""
    if isinstance(grid, ImagePoints):
        some = grid.some()
        centre, sides = some.mean(axis=0), np.diag(np.ptp(some, axis=0))
    else:
        shape = np.array(grid.shape)
        centre = grid.origin_m + shape / 2 @ grid.steps_m
        sides = grid.steps_m * shape[:, None]
    return centre, sides[np.argsort(np.linalg.norm(sides, axis=1))[-2:]]


def resolved_cells(grid: EvenGrid | ImagePoints, tx_m: np.ndarray, rx_m: np.ndarray,
                   radar: RadarParameters) -> float:
    """Number of resolution cells in an image of echoes from (R, 3), metres; pixels at most."""
    return min(echo_cells(tx_m, rx_m, *extent(grid), radar), math.prod(grid.shape))


@dataclasses.dataclass(frozen=True, eq=False)
class PointPlan(Plan):
    """How echoes are added to points.

    Attributes
    ----------
    tile : (int, int)
        Rows and columns of the tiles in which points are taken.
    reach_m : float
        Largest radius of a tile whose paths are computed in float32, metres.
    cost : float
        Nanoseconds per pixel.
    amplitudes : PointAmplitudes or None
        How amplitudes are found; None where all pixels are lit alike.
    """

    window: RangeGate | PhaseHistory
    resampling: RangeResampling
    range_m: tuple[float, float]
    tile: tuple[int, int]
    reach_m: float
    errors_db: Mapping[str, float]
    cost: float
    amplitudes: PointAmplitudes | None = None

    method = 'points'

    def operations(self, grid: ImagePoints | EvenGrid, n_echoes: int) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        share = 1.0 if self.amplitudes is None else self.amplitudes.share * self.amplitudes.dearer
        return {'image': 1,
                **self.resampling.operations(n_echoes, math.prod(grid.shape) * share)}

    def n_bytes(self, grid: ImagePoints | EvenGrid) -> int:
        """Memory that adding the echoes takes besides the image, bytes."""
        *layers, n_y, n_x = (1, 1, *grid.shape)
        n_bytes = 0 if self.amplitudes is None else self.amplitudes.n_bytes((n_y, n_x), self.tile)
        return coordinate_bytes(grid) + math.prod(layers) * n_bytes

    def __str__(self) -> str:
        return 'pulses are added point by point'


def coordinate_bytes(grid: ImagePoints | EvenGrid) -> int:
    """Memory of `image_layers`: coordinates that change along two axes of an image, bytes."""
    oblique = 0 if isinstance(grid, ImagePoints) else int(np.all(grid.steps_m[-2:], axis=0).sum())
    return oblique * _COORDINATE_BYTES * math.prod(grid.shape)


def image_layers(grid: ImagePoints | EvenGrid) -> list[ImagePoints]:
    """Pixels of a grid, one part of the image after the other: the layers of a volume."""
    if isinstance(grid, ImagePoints):
        return [grid]
    if isinstance(grid, VolumeGrid):
        return [ImagePoints.of_grid(grid.slice(layer)) for layer in range(grid.n_z)]
    return [ImagePoints.of_grid(grid)]


def point_operations(grid: EvenGrid, window: RangeGate | PhaseHistory, n_echoes: int,
                     target_db: float) -> dict[str, float]:
    """How often the image of a grid point by point does the operations of `CostModel`."""
    resampling = plan_point_resampling(window, target_db)
    return {'image': 1, **resampling.operations(n_echoes, math.prod(grid.shape))}


def plan_even_points(grid: MapGrid | PlaneGrid | VolumeGrid, window: RangeGate | PhaseHistory,
                     tx_m: np.ndarray, rx_m: np.ndarray, range_m: tuple[float, float],
                     target_db: float, illumination: Illumination | None = None) -> PointPlan:
    """Plan the image of a map, plane or volume point by point; others as of `plan_points`."""
    if isinstance(grid, MapGrid):
        return plan_points(ImagePoints.of_grid(grid), window, tx_m, rx_m, range_m, target_db,
                           illumination=illumination)
    first, middle = (grid.slice(0), grid.slice(grid.n_z // 2)) if isinstance(
        grid, VolumeGrid) else (grid, grid)
    corner = dataclasses.replace(first, n_u=min(first.n_u, TILE_SIDE),
                                 n_v=min(first.n_v, TILE_SIDE))
    return plan_points(ImagePoints.of_grid(corner), window, tx_m, rx_m, range_m, target_db,
                       some_m=grid.positions(*draw(grid.shape, _SAMPLED_PIXELS)),
                       illumination=illumination, positions=middle.positions,
                       shape=middle.shape)


def plan_points(points: ImagePoints, window: RangeGate | PhaseHistory, tx_m: np.ndarray,
                rx_m: np.ndarray, range_m: tuple[float, float], target_db: float,
                some_m: np.ndarray | None = None, illumination: Illumination | None = None,
                positions: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
                shape: tuple[int, int] | None = None) -> PointPlan:
    """Plan the image of some points.

    Parameters
    ----------
    points : ImagePoints
        Where the pixels are, or some neighbours among them.
    window : RangeGate or PhaseHistory
        What is needed of the profiles.
    tx_m, rx_m, target_db :
        As for `plan_backprojection`.
    range_m : (float, float)
        Least and largest half path that is read, metres.
    some_m : (S, 3) float64, optional
        Positions all over the image, metres; those of `points` unless told.
    illumination : Illumination, optional
        Illumination of the echoes.
    positions, shape : callable, (int, int)
        Positions of pixels by row and column, and how many there are; of `points` unless told.
    """
    radar, resampling = window.radar, plan_point_resampling(window, target_db)
    # Rounding a tile's paths in float32 errs the more the larger it is.
    rounded_db = error_budget(target_db, EXACT_SHARES)['rounded paths']
    rounding_per_m = radar.wavenumber_rad_per_m * _ROUNDING
    reach_m = 10 ** (rounded_db / 20) / rounding_per_m
    tile, radius_m = points.tile(reach_m)
    some = np.linspace(0, len(tx_m) - 1, min(len(tx_m), _SAMPLED_ECHOES)).round().astype(int)
    cost, amplitudes, oversampling = resampling.cost, None, resampling.oversampling(radar)
    errors = {
        'range profiles': resampling.predicted_error_db,
        'rounded paths': 20 * math.log10(rounding_per_m * min(reach_m, radius_m) + 1e-12)}
    if illumination is None:
        length = half_paths(tx_m[some], rx_m[some], points.some() if some_m is None else some_m)[0]
        errors['ends of profiles'] = mean_db(window.end_error(length, oversampling),
                                             window.predictable(length).all(axis=0))
    else:
        from .illumination import plan_point_amplitudes

        tile, amplitudes, pairs = plan_point_amplitudes(
            illumination, positions or points.positions, shape or points.size,
            [side for side in _SIDES[points.size[0] > 1] if side <= tile],
            error_budget(target_db, EXACT_SHARES)['illumination'])
        errors |= {'ends of profiles': pairs.ends_db(window, oversampling, tx_m, rx_m),
                   'illumination': amplitudes.predicted_error_db}
        cost *= amplitudes.share * amplitudes.dearer
    return PointPlan(window, resampling, range_m, tile, reach_m, errors, cost * len(tx_m),
                     amplitudes)
