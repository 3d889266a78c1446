# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Grids: the positions of pixels on a map, a plane, in a volume, on terrain or anywhere."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from .track import main_axis

_ROBERTS = 1.1347241384015194  # root of x^6 = x + 1: his sequence in five dimensions


@runtime_checkable
class Grid(Protocol):
    """Where the pixels of an image are: all that imaging in general needs to know of a grid.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry import Grid, MapGrid, PointGrid
    >>> def highest(grid: Grid) -> float:
    ...     return float(grid.points()[..., 2].max())
    >>> highest(MapGrid((0.0, 0.0, 2.0), 8, 8, 1.0))
    2.0
    >>> highest(PointGrid(np.array([[0.0, 0.0, 1.0], [5.0, 0.0, 7.0]])))
    7.0
    """

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of images."""

    def positions(self, *index: Any, **named: Any) -> np.ndarray:
        """(..., 3) float64 positions of some pixels in the imaging frame, metres.

        One integer array for each axis of the image, broadcast together.
        """

    def points(self) -> np.ndarray:
        """``(*shape, 3)`` float64 positions of all pixels in the imaging frame, metres."""


@runtime_checkable
class EvenGrid(Grid, Protocol):
    """Grid whose pixels lie at equal steps along two axes or three: an image has straight lines.

    Pixel ``[i, j, ...]`` lies at ``origin_m + i * steps_m[0] + j * steps_m[1] + ...``.
    """

    @property
    def origin_m(self) -> tuple[float, float, float]:
        """Position of the pixel whose numbers are all 0, metres."""

    @property
    def steps_m(self) -> np.ndarray:
        """(A, 3) float64 step of the position along each axis of the image, metres."""


def even_positions(grid: EvenGrid, *index: ArrayLike) -> np.ndarray:
    """(..., 3) float64 positions of some pixels of a grid with equal steps, metres."""
    return sum((np.multiply.outer(np.asarray(i, float), step)
                for i, step in zip(index, grid.steps_m, strict=True)), np.array(grid.origin_m))


def spread_evenly(first: int, n: int) -> np.ndarray:
    """(5, n) numbers from 0 to 1 that fill space evenly, from one of Roberts' sequence on.

    For an echo, up to three axes of an image, and one thing more.
    """
    step = _ROBERTS ** -np.arange(1, 6)
    return (0.5 + np.multiply.outer(step, np.arange(first + 1, first + n + 1))) % 1.0


def below(place: np.ndarray, size: int) -> np.ndarray:
    """(n,) int64 whole numbers below a size, of places from 0 to it."""
    return np.minimum(place.astype(np.int64), size - 1)


@dataclasses.dataclass(frozen=True)
class MapGrid:
    """North-up grid of square pixels on a horizontal plane.

    Images on it have shape ``(n_y, n_x)``: row 0 is the largest y, column 0 the smallest x.

    Parameters
    ----------
    centre_m : (3,) floats
        Middle of the grid (x, y) and height of its plane (z) in the imaging frame, metres.
    n_x, n_y : int
        Pixels along x and y.
    spacing_m : float
        Pixel spacing along both axes, metres.

    Raises
    ------
    ValueError
        A number of pixels or the spacing is not positive, or a value is not finite.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> grid = MapGrid((100.0, 0.0, 0.0), n_x=5, n_y=3, spacing_m=0.5)
    >>> grid.shape
    (3, 5)
    >>> grid.positions(0, 0).tolist()  # the north-western pixel
    [99.0, 0.5, 0.0]
    >>> row, column = grid.to_pixels(100.25, 0.0)
    >>> print(f'row {row:.1f}, column {column:.1f}')
    row 1.0, column 2.5
    """

    centre_m: tuple[float, float, float]
    n_x: int
    n_y: int
    spacing_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, 'centre_m', tuple(float(v) for v in self.centre_m))
        if len(self.centre_m) != 3 or not all(map(math.isfinite, self.centre_m)):
            raise ValueError(f'centre_m={self.centre_m}; expected three finite numbers')
        if self.n_x < 1 or self.n_y < 1:
            raise ValueError(f'n_x={self.n_x}, n_y={self.n_y}; expected at least one pixel each')
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0):
            raise ValueError(f'spacing_m={self.spacing_m} must be positive and finite')

    @classmethod
    def from_size(cls, centre_m: tuple[float, float, float], size_x_m: float, size_y_m: float,
                  spacing_m: float) -> MapGrid:
        """Grid whose pixel centres cover ``size_x_m`` by ``size_y_m``, edges included, metres."""
        if not (math.isfinite(spacing_m) and spacing_m > 0):
            raise ValueError(f'spacing_m={spacing_m} must be positive and finite')
        return cls(centre_m, round(size_x_m / spacing_m) + 1, round(size_y_m / spacing_m) + 1,
                   spacing_m)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape ``(n_y, n_x)``."""
        return (self.n_y, self.n_x)

    @property
    def x_m(self) -> np.ndarray:
        """(n_x,) float64 x of the columns, ascending, metres."""
        return self.centre_m[0] + (np.arange(self.n_x) - (self.n_x - 1) / 2) * self.spacing_m

    @property
    def y_m(self) -> np.ndarray:
        """(n_y,) float64 y of the rows, descending, metres."""
        return self.centre_m[1] - (np.arange(self.n_y) - (self.n_y - 1) / 2) * self.spacing_m

    @property
    def z_m(self) -> float:
        """Height of the plane, metres."""
        return self.centre_m[2]

    @property
    def origin_m(self) -> tuple[float, float, float]:
        """Position of pixel ``[0, 0]``, metres."""
        return (float(self.x_m[0]), float(self.y_m[0]), self.z_m)

    @property
    def steps_m(self) -> np.ndarray:
        """(2, 3) float64 step of the position from row to row, and from column to column."""
        return np.array([[0.0, -self.spacing_m, 0.0], [self.spacing_m, 0.0, 0.0]])

    def positions(self, row: int | np.ndarray, column: int | np.ndarray) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        x, y, z = np.broadcast_arrays(self.x_m[column], self.y_m[row], self.z_m)
        return np.stack([x, y, z], axis=-1)

    def points(self) -> np.ndarray:
        """(n_y, n_x, 3) float64 pixel positions, metres."""
        out = np.empty((*self.shape, 3))
        out[..., 0] = self.x_m
        out[..., 1] = self.y_m[:, None]
        out[..., 2] = self.z_m
        return out

    def check_image(self, image: np.ndarray) -> None:
        """Raise ValueError when an image does not have the shape of the grid."""
        if image.shape != self.shape:
            raise ValueError(f'image.shape={image.shape} does not match grid.shape={self.shape}')

    def to_pixels(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Fractional ``(row, column)`` of positions in metres."""
        row = (self.y_m[0] - np.asarray(y_m, float)) / self.spacing_m
        column = (np.asarray(x_m, float) - self.x_m[0]) / self.spacing_m
        return row, column


_LEAST_SINE = 1e-6  # between the steps of a grid: below it they span no plane or volume


@dataclasses.dataclass(frozen=True)
class PlaneGrid:
    """Pixels at equal steps on a plane of any orientation.

    Images on it have shape ``(n_v, n_u)``: pixel ``[row, column]`` lies at ``origin_m + column *
    step_u_m + row * step_v_m``. The constructors put row 0 at the top of walls and sections and at
    the end of the track on a slant plane, column 0 to the left or nearest to the radar: pictures
    that are drawn from row 0 down look as an observer sees the plane.

    Parameters
    ----------
    origin_m : (3,) floats
        Pixel ``[0, 0]`` in the imaging frame, metres.
    step_u_m, step_v_m : (3,) floats
        From a pixel to that of the next column, and to that of the next row, metres.
    n_u, n_v : int
        Columns and rows.

    Raises
    ------
    ValueError
        A value is not finite, a number of pixels is not positive, or the steps are parallel.

    Examples
    --------
    >>> from sar_imaging.geometry import PlaneGrid
    >>> wall = PlaneGrid.wall((0.0, 3.0, 1.0), normal=(0.0, -1.0), width_m=2.0,
    ...                       height_m=1.0, spacing_m=0.5)
    >>> wall.shape
    (3, 5)
    >>> wall.positions(0, 0).tolist()  # top left, as the radar south of it sees it
    [-1.0, 3.0, 1.5]
    """

    origin_m: tuple[float, float, float]
    step_u_m: tuple[float, float, float]
    step_v_m: tuple[float, float, float]
    n_u: int
    n_v: int

    def __post_init__(self) -> None:
        for name in ('origin_m', 'step_u_m', 'step_v_m'):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        _check_count(n_u=self.n_u, n_v=self.n_v)
        _check_steps(step_u_m=self.step_u_m, step_v_m=self.step_v_m)

    @classmethod
    def vertical_section(cls, foot_m: np.ndarray, direction: ArrayLike, length_m: float,
                         low_m: float, high_m: float, spacing_m: float) -> PlaneGrid:
        """Vertical section along a horizontal direction, such as that of the look.

        Parameters
        ----------
        foot_m : (2,) floats
            Where it begins (x, y), metres: column 0.
        direction : (2,) floats
            Where it goes from there (x, y), of any length.
        length_m : float
            How far, metres.
        low_m, high_m : float
            Lowest and highest z, metres; row 0 is the highest.
        spacing_m : float
            Spacing of the pixels along both axes, metres.
        """
        x, y = _direction('direction', direction, 2)
        n_u, n_v = (_pixels(*side, spacing_m) for side in (('length_m', length_m),
                                                           ('high_m - low_m', high_m - low_m)))
        return cls((*foot_m, high_m), (spacing_m * x, spacing_m * y, 0.0), (0.0, 0.0, -spacing_m),
                   n_u, n_v)

    @classmethod
    def wall(cls, centre_m: ArrayLike, normal: ArrayLike, width_m: float, height_m: float,
             spacing_m: float) -> PlaneGrid:
        """Vertical plane across the line of sight.

        Parameters
        ----------
        centre_m : (3,) floats
            Middle of the wall, metres.
        normal : (2,) floats
            Horizontal direction (x, y), of any length, from the wall to who looks at it. Columns
            run to the right as they see it.
        width_m, height_m : float
            Size, metres; row 0 is the highest.
        spacing_m : float
            Spacing of the pixels along both axes, metres.
        """
        x, y = _direction('normal', normal, 2)
        return cls._around(centre_m, (-y, x, 0.0), (0.0, 0.0, -1.0), ('width_m', width_m),
                           ('height_m', height_m), spacing_m)

    @classmethod
    def slant_plane(cls, track_m: ArrayLike, centre_m: ArrayLike, range_size_m: float,
                    track_size_m: float, spacing_m: float) -> PlaneGrid:
        """Plane through a track and the middle of the scene, in which radar pictures lie.

        Parameters
        ----------
        track_m : (..., 3) array_like
            Phase centres in the order of the flight, metres; the straight line that fits them
            best is in the plane.
        centre_m : (3,) floats
            Middle of the scene, metres: middle of the grid.
        range_size_m, track_size_m : float
            Size across the track (columns, away from it) and along it (row 0 is where the flight
            ends), metres.
        spacing_m : float
            Spacing of the pixels along both axes, metres.

        Raises
        ------
        ValueError
            The track is a point, or the scene lies on its line.
        """
        track = np.asarray(track_m, float).reshape(-1, 3)
        middle = track.mean(axis=0)
        axes, extent = main_axis(track)
        if not extent[0] > 0:
            raise ValueError('track_m has one place only; expected phase centres along a track')
        along = axes[0] * math.copysign(1.0, (track[-1] - track[0]) @ axes[0])
        look = _vector('centre_m', centre_m) - middle
        across = look - (look @ along) * along
        if not np.linalg.norm(across) > _LEAST_SINE * np.linalg.norm(look):
            raise ValueError(f'centre_m={_vector("centre_m", centre_m)} lies on the line of the '
                             'track; expected a scene beside it')
        return cls._around(centre_m, across / np.linalg.norm(across), -along,
                           ('range_size_m', range_size_m), ('track_size_m', track_size_m),
                           spacing_m)

    @classmethod
    def _around(cls, centre_m: ArrayLike, u: ArrayLike, v: ArrayLike, width: tuple[str, float],
                height: tuple[str, float], spacing_m: float) -> PlaneGrid:
        n_u, n_v = _pixels(*width, spacing_m), _pixels(*height, spacing_m)
        step_u, step_v = spacing_m * np.asarray(u), spacing_m * np.asarray(v)
        origin = _vector('centre_m', centre_m) - 0.5 * ((n_u - 1) * step_u + (n_v - 1) * step_v)
        return cls(tuple(origin), tuple(step_u), tuple(step_v), n_u, n_v)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape ``(n_v, n_u)``."""
        return (self.n_v, self.n_u)

    @property
    def steps_m(self) -> np.ndarray:
        """(2, 3) float64 step of the position along each axis of the image, metres."""
        return np.array([self.step_v_m, self.step_u_m])

    def positions(self, row: ArrayLike, column: ArrayLike) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        return even_positions(self, row, column)

    def points(self) -> np.ndarray:
        """(n_v, n_u, 3) float64 positions of all pixels, metres."""
        return self.positions(*np.ogrid[:self.n_v, :self.n_u])


@dataclasses.dataclass(frozen=True)
class VolumeGrid:
    """Voxels at equal steps along three directions.

    Images on it have shape ``(n_z, n_y, n_x)``: voxel ``[i, j, k]`` lies at ``origin_m + k *
    step_x_m + j * step_y_m + i * step_z_m``. The steps may point anywhere; `above` builds volumes
    whose slices are maps.

    Parameters
    ----------
    origin_m : (3,) floats
        Voxel ``[0, 0, 0]`` in the imaging frame, metres.
    step_x_m, step_y_m, step_z_m : (3,) floats
        From a voxel to the next one along the last, the middle and the first axis of the image,
        metres.
    n_x, n_y, n_z : int
        Voxels along these.

    Raises
    ------
    ValueError
        A value is not finite, a number of voxels is not positive, or the steps lie in a plane.

    Examples
    --------
    >>> from sar_imaging.geometry import MapGrid, VolumeGrid
    >>> ground = MapGrid((50.0, 0.0, 0.0), 8, 4, 0.5)
    >>> volume = VolumeGrid.above(ground, height_m=3.0, spacing_m=1.0)
    >>> volume.shape
    (4, 4, 8)
    >>> volume.slice(3).points()[..., 2].max().item()  # the highest layer, metres
    3.0
    """

    origin_m: tuple[float, float, float]
    step_x_m: tuple[float, float, float]
    step_y_m: tuple[float, float, float]
    step_z_m: tuple[float, float, float]
    n_x: int
    n_y: int
    n_z: int

    def __post_init__(self) -> None:
        for name in ('origin_m', 'step_x_m', 'step_y_m', 'step_z_m'):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        _check_count(n_x=self.n_x, n_y=self.n_y, n_z=self.n_z)
        _check_steps(step_x_m=self.step_x_m, step_y_m=self.step_y_m, step_z_m=self.step_z_m)

    @classmethod
    def above(cls, ground: MapGrid, height_m: float,
              spacing_m: float | None = None) -> VolumeGrid:
        """Maps one above the other, the lowest first.

        Parameters
        ----------
        ground : MapGrid
            The lowest: rows from the largest y down, columns from the smallest x.
        height_m : float
            From the lowest to the highest, metres.
        spacing_m : float, optional
            Spacing of the maps, metres; that of the pixels unless told.
        """
        step = ground.spacing_m if spacing_m is None else spacing_m
        return cls(ground.origin_m, tuple(ground.steps_m[1]), tuple(ground.steps_m[0]),
                   (0.0, 0.0, step), ground.n_x, ground.n_y, _pixels('height_m', height_m, step))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Image shape ``(n_z, n_y, n_x)``."""
        return (self.n_z, self.n_y, self.n_x)

    @property
    def steps_m(self) -> np.ndarray:
        """(3, 3) float64 step of the position along each axis of the image, metres."""
        return np.array([self.step_z_m, self.step_y_m, self.step_x_m])

    def slice(self, number: int) -> PlaneGrid:
        """Plane of the voxels ``[number, :, :]``."""
        return PlaneGrid(tuple(self.positions(number, 0, 0)), self.step_x_m, self.step_y_m,
                         self.n_x, self.n_y)

    def positions(self, layer: ArrayLike, row: ArrayLike, column: ArrayLike) -> np.ndarray:
        """(..., 3) float64 positions of some voxels, by broadcast numbers, metres."""
        return even_positions(self, layer, row, column)

    def points(self) -> np.ndarray:
        """(n_z, n_y, n_x, 3) float64 positions of all voxels, metres."""
        return self.positions(*np.ogrid[:self.n_z, :self.n_y, :self.n_x])


def _vector(name: str, value: Any) -> tuple[float, ...]:
    numbers = np.asarray(value, float)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ValueError(f'{name}={value}; expected three finite numbers: x, y and z in metres')
    return tuple(numbers.tolist())


def _direction(name: str, value: Any, n: int) -> np.ndarray:
    """Unit vector."""
    numbers = np.asarray(value, float)
    if numbers.shape != (n,) or not np.isfinite(numbers).all() or not numbers.any():
        raise ValueError(f'{name}={value}; expected {n} finite numbers that are not all 0: '
                         'the direction in x and y')
    return numbers / np.linalg.norm(numbers)


def _pixels(name: str, size_m: float, spacing_m: float) -> int:
    """Pixels whose centres cover a length, edges included."""
    if not (math.isfinite(spacing_m) and spacing_m > 0):
        raise ValueError(f'spacing_m={spacing_m} must be positive and finite')
    if not (math.isfinite(size_m) and size_m >= 0):
        raise ValueError(f'{name}={size_m}; expected a finite length in metres, not negative')
    return round(size_m / spacing_m) + 1


def _check_count(**counts: int) -> None:
    if min(counts.values()) < 1:
        raise ValueError(', '.join(f'{name}={n}' for name, n in counts.items())
                         + '; expected at least one pixel each')


def _check_steps(**steps: tuple[float, float, float]) -> None:
    """Refuse steps that span no plane or volume."""
    vectors = np.array(list(steps.values()))
    lengths = np.linalg.norm(vectors, axis=1)
    extent = math.sqrt(max(np.linalg.det(vectors @ vectors.T), 0.0))
    if not extent > _LEAST_SINE * functools.reduce(float.__mul__, lengths.tolist()):
        text = ', '.join(f'{name}={value}' for name, value in steps.items())
        raise ValueError(f'{text}; expected steps in metres that are not 0 and span a '
                         f'{"plane" if len(steps) == 2 else "volume"}')


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

    def __post_init__(self) -> None:
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

    def positions(self, row: int | np.ndarray, column: int | np.ndarray) -> np.ndarray:
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

    def __post_init__(self) -> None:
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

    def positions(self, *index: np.ndarray) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        return self.points_m[index]

    def points(self) -> np.ndarray:
        """(..., 3) float64 positions of all pixels, metres."""
        return self.points_m


def as_grid(grid: Grid | ArrayLike, height_m: ArrayLike | None = None) -> Grid:
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
        return TerrainGrid(grid, np.asarray(height_m))
    if isinstance(grid, MapGrid | Grid):  # maps are told quickly
        return grid
    return PointGrid(np.asarray(grid))


def as_even(grid: Grid) -> MapGrid | PlaneGrid | VolumeGrid | None:
    """A grid with equal steps as one of these: one's own as the plane or volume that it is.

    None where steps are not equal, or along another number of axes.
    """
    if isinstance(grid, MapGrid | PlaneGrid | VolumeGrid):
        return grid
    if not isinstance(grid, EvenGrid):
        return None
    steps, counts = [tuple(step) for step in grid.steps_m[::-1]], grid.shape[::-1]
    kinds: dict[int, type[PlaneGrid] | type[VolumeGrid]] = {2: PlaneGrid, 3: VolumeGrid}
    kind: Any = kinds.get(len(counts))
    return kind and kind(grid.origin_m, *steps, *counts)


def _check_infinite(name: str, values: np.ndarray) -> None:
    if np.isinf(values).any():
        raise ValueError(f'{name} of {np.count_nonzero(np.isinf(values))} points is infinite; '
                         'write NaN where there is no position')
