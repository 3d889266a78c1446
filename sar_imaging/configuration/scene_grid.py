# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Grid for the image of a recording, chosen from what the recording tells.

- Spacing: half of the finer resolution on the plane, ``c / 2B`` over the cosine of the grazing
  angle across the aperture, and ``lambda / (4 sin(angle / 2))`` along it.
- Footprint: the area that the file names; without one, everything around the middle that all
  range profiles cover and that the distance between pulses leaves unambiguous.
- Both shrink to the memory that is allowed, around the middle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.grids import MapGrid, PlaneGrid
from ..memory import IMAGE_BYTES
from ..signal.radar import RadarParameters

PLANES = ('ground', 'slant')
PIXELS_PER_RESOLUTION = 2.0
PIXEL_BYTES = 5 * IMAGE_BYTES  # the image, what forms it, and what draws and writes it
_SAMPLES_AT_EDGES = 8  # of a profile, whose values depend on samples that nobody has
_TRACK_POINTS = 65
_STEPS = 40  # of bisection
_SMALLEST_PX = 16  # sides of a grid that is worth imaging
_LARGEST_M = 1e6
_Pair = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class GridChoice:
    """A grid, and why it is this one.

    Attributes
    ----------
    grid : MapGrid or PlaneGrid
        Pixels to image.
    plane : str
        ``'ground'`` or ``'slant'``.
    range_resolution_m, azimuth_resolution_m : float
        On the plane, metres, peak to null.
    reasons : tuple of str
        What was chosen, one sentence for each thing, with how to change it.
    """

    grid: MapGrid | PlaneGrid
    plane: str
    range_resolution_m: float
    azimuth_resolution_m: float
    reasons: tuple[str, ...]

    @property
    def spacing_m(self) -> float:
        """Of the pixels, metres."""
        return float(np.linalg.norm(self.grid.steps_m[0]))

    @property
    def size_m(self) -> tuple[float, float]:
        """Length of the rows and of the columns, metres."""
        return ((self.grid.shape[1] - 1) * self.spacing_m,
                (self.grid.shape[0] - 1) * self.spacing_m)


@dataclasses.dataclass(frozen=True, eq=False)
class Coverage:
    """What of the scene the pulses tell something about.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the range profiles.
    n_samples : int
        Their length.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    """

    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray

    @property
    def swath_m(self) -> tuple[float, float]:
        """Ranges that whole profiles cover, metres."""
        step, start = self.radar.sample_spacing_m, self.radar.range_start_m
        edge = min(_SAMPLES_AT_EDGES, (self.n_samples - 1) // 4)
        return (max(0.0, start + edge * step), start + (self.n_samples - 1 - edge) * step)

    @property
    def centres_m(self) -> np.ndarray:
        """(P, C, 3) float64 displaced phase centres, metres."""
        return 0.5 * (self.tx_m + self.rx_m)

    def covers(self, points_m: ArrayLike) -> np.ndarray:
        """(N,) bool which points all profiles cover."""
        index = np.unique(np.linspace(0, len(self.tx_m) - 1, _TRACK_POINTS).astype(int))
        near, far = self.swath_m
        points = np.asarray(points_m, np.float64)[:, None, None]
        half_path = 0.5 * (np.linalg.norm(points - self.tx_m[index], axis=-1)
                           + np.linalg.norm(points - self.rx_m[index], axis=-1))
        return ((half_path >= near) & (half_path <= far)).all(axis=(1, 2))

    def aperture_rad(self, centre_m: ArrayLike) -> float:
        """Angle under which a place sees the phase centres, radians, at most pi."""
        sights = self.centres_m.reshape(-1, 3) - np.asarray(centre_m, float)
        sights = sights / np.maximum(np.linalg.norm(sights, axis=1, keepdims=True), 1e-9)
        mean = sights.mean(axis=0)
        mean = mean / max(np.linalg.norm(mean), 1e-9)
        return float(min(math.pi, 2 * np.arccos(np.clip(sights @ mean, -1, 1)).max()))

    def unambiguous_m(self, centre_m: ArrayLike) -> float:
        """Distance along the track after which a scatterer repeats, metres; infinite for none."""
        steps = np.linalg.norm(np.diff(self.centres_m, axis=0), axis=-1)
        moving = steps[steps > 0]
        if not moving.size:
            return math.inf
        distance = np.linalg.norm(self.centres_m.mean(axis=(0, 1)) - centre_m)
        return float(self.radar.wavelength_m * distance / (2 * np.median(moving)))


def choose_grid(coverage: Coverage, centre_m: ArrayLike, *, plane: str = 'ground',
                area_m: ArrayLike | None = None, size_m: tuple[float, float] | None = None,
                spacing_m: float | None = None, memory_bytes: float = math.inf) -> GridChoice:
    """Choose a grid.

    Parameters
    ----------
    coverage : Coverage
        Coverage of the pulses.
    centre_m : (3,) floats
        Middle of the scene and height of the ground, metres.
    plane : str
        ``'ground'``, a map north-up in the imaging frame, or ``'slant'``, in which pictures look
        as the radar sees.
    area_m : (N, 3) array_like, optional
        Corners of the area that the file names, metres.
    size_m : (2,) floats, optional
        Size asked for instead of the footprint, metres: along x and y of a map, along range and
        track on the slant plane.
    spacing_m : float, optional
        Spacing asked for, metres.
    memory_bytes : float
        That the image and what is made of it may take.

    Returns
    -------
    GridChoice

    Raises
    ------
    ValueError
        The profiles do not cover the middle, a number is not positive, or there is no such plane.
    MemoryError
        The size and spacing asked for do not fit.
    """
    if plane not in PLANES:
        raise ValueError(f'plane={plane!r}; expected one of {", ".join(PLANES)}')
    centre = np.asarray(centre_m, np.float64)
    axes = _plane_axes(coverage, centre, plane)
    range_m, azimuth_m = _resolution(coverage, centre, axes)
    reasons = []
    if spacing_m is None:
        spacing_m = _rounded(min(range_m, azimuth_m) / PIXELS_PER_RESOLUTION)
        reasons.append(f'spacing {spacing_m:g} m: two pixels in a resolution of {range_m:.3g} m '
                       f'in range and {azimuth_m:.3g} m along the track (--spacing changes it)')
    _check_positive(spacing_m=spacing_m)
    asked = size_m is not None
    if size_m is not None:
        _check_positive(**{'size_m[0]': size_m[0], 'size_m[1]': size_m[1]})
    elif area_m is not None:
        size_m = _around(np.asarray(area_m, float), centre, axes)
        size_m, fraction = _covered_part(coverage, centre, axes, size_m)
        reasons.append(f'size {size_m[0]:.4g} m by {size_m[1]:.4g} m: the area that the file '
                       f'names{"" if fraction == 1.0 else ", as far as its profiles cover it"} '
                       '(--size changes it)')
    else:
        size_m = _footprint(coverage, centre, axes)
        reasons.append(f'size {size_m[0]:.4g} m by {size_m[1]:.4g} m around the middle: what the '
                       'profiles cover without ambiguity along the track (--size changes it)')
    size_m = _bounded(size_m, spacing_m, memory_bytes, asked, reasons)
    n_columns, n_rows = (round(size / spacing_m) + 1 for size in size_m)
    if plane == 'ground':
        grid: MapGrid | PlaneGrid = MapGrid(tuple(centre), n_columns, n_rows, spacing_m)
    else:
        grid = PlaneGrid.slant_plane(coverage.centres_m, centre, *size_m, spacing_m)
    return GridChoice(grid, plane, range_m, azimuth_m, tuple(reasons))


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f'{name}={value}; expected a positive number of metres')


def _plane_axes(coverage: Coverage, centre: np.ndarray, plane: str) -> np.ndarray:
    """(2, 3) unit vectors of the columns and of the rows."""
    if plane == 'ground':
        return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    steps = PlaneGrid.slant_plane(coverage.centres_m, centre, 1.0, 1.0, 1.0).steps_m
    return steps[::-1]


def _resolution(coverage: Coverage, centre: np.ndarray, axes: np.ndarray) -> _Pair:
    """Distances from peak to null on the plane, across the track and along it, metres."""
    look = centre - coverage.centres_m.mean(axis=(0, 1))
    distance = np.linalg.norm(look)
    along_plane = float(np.linalg.norm(axes @ look) / distance) if distance > 0 else 0.0
    angle = coverage.aperture_rad(centre)
    # straight below, range tells nothing on the plane; a radar at rest nothing along the track
    range_m = coverage.radar.range_resolution_m / max(along_plane, 1e-2)
    azimuth_m = coverage.radar.wavelength_m / (4 * max(math.sin(angle / 2), 1e-6))
    return range_m, azimuth_m


def _around(area: np.ndarray, centre: np.ndarray, axes: np.ndarray) -> _Pair:
    """Size of the rectangle around the middle that holds an area, metres."""
    along, across = (2 * float(np.abs((area - centre) @ axis).max()) for axis in axes)
    return along, across


def _covered_part(coverage: Coverage, centre: np.ndarray, axes: np.ndarray, size_m: _Pair
                  ) -> tuple[_Pair, float]:
    """Size of the part of an area, around its middle, that all profiles cover, and its share."""
    half = np.array(size_m) / 2
    fraction = 1.0
    if coverage.covers(centre[None]).all():
        fraction = _bisect(lambda s: bool(coverage.covers(_outline(centre, axes, s * half)).all()),
                        1.0)
    return (float(fraction * size_m[0]), float(fraction * size_m[1])), fraction


def _outline(centre: np.ndarray, axes: np.ndarray, half: np.ndarray) -> np.ndarray:
    """(9, 3) middle, corners and middles of the sides of a rectangle, metres."""
    return centre + (np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]) * half) @ axes


def _footprint(coverage: Coverage, centre: np.ndarray, axes: np.ndarray) -> _Pair:
    """Largest rectangle of its proportions around the middle that is covered, metres."""
    if not coverage.covers(centre[None]).all():
        near, far = coverage.swath_m
        distances = np.linalg.norm(coverage.centres_m - centre, axis=-1)
        raise ValueError(f'the middle ({centre[0]:g}, {centre[1]:g}, {centre[2]:g}) m lies '
                         f'{distances.min():.1f} to {distances.max():.1f} m from the phase '
                         f'centres; all profiles cover {near:.1f} to {far:.1f} m: give --centre '
                         'a place in the scene')
    look = centre - coverage.centres_m.mean(axis=(0, 1))
    away = axes @ look
    away = away / max(np.linalg.norm(away), 1e-9) if np.linalg.norm(away) > 1e-9 else [1.0, 0.0]
    away = np.array([away[0], away[1]]) @ axes
    beside = np.cross(np.cross(axes[0], axes[1]), away)
    half_away, half_beside = _reach(coverage, centre, away), _reach(coverage, centre, beside)
    repeats_m = coverage.unambiguous_m(centre)
    half_beside = min(half_beside, repeats_m / 2)
    if coverage.aperture_rad(centre) > math.pi / 2:  # the track runs around the scene
        half_away = min(half_away, repeats_m / 2)
    half = np.array([abs(away @ axis) * half_away + abs(beside @ axis) * half_beside
                     for axis in axes])

    def fits(fraction: float) -> bool:
        points = _outline(centre, axes, fraction * half)
        return bool(coverage.covers(points).all()
                    and (np.abs((points - centre) @ beside) <= half_beside * (1 + 1e-9)).all())

    fraction = _bisect(fits, 1.0)
    return float(2 * fraction * half[0]), float(2 * fraction * half[1])


def _reach(coverage: Coverage, centre: np.ndarray, direction: np.ndarray) -> float:
    """How far along a direction, both ways, all profiles cover, metres."""
    def covered(reach: float) -> bool:
        return bool(coverage.covers(centre + reach * np.array([direction, -direction])).all())

    return _bisect(covered, min(_LARGEST_M, 2 * coverage.swath_m[1]))


def _bisect(fits: Callable[[float], bool], most: float) -> float:
    """Largest number up to `most` that fits, all smaller ones doing so."""
    if fits(most):
        return most
    low, high = 0.0, most
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _bounded(size_m: _Pair, spacing_m: float, memory_bytes: float, asked: bool,
             reasons: list[str]) -> _Pair:
    """Size in whole pixels that the memory allows."""
    least = _SMALLEST_PX * spacing_m
    if not asked:
        size_m = max(size_m[0], least), max(size_m[1], least)
    n_bytes = PIXEL_BYTES * (size_m[0] / spacing_m + 1) * (size_m[1] / spacing_m + 1)
    if n_bytes <= memory_bytes:
        return size_m
    if asked:
        raise MemoryError(
            f'{size_m[0]:g} m by {size_m[1]:g} m at {spacing_m:g} m take {n_bytes / 1e9:.2g} GB, '
            f'{memory_bytes / 1e9:.2g} GB are allowed; ask for a smaller --size or a larger '
            '--spacing, or allow more --memory')
    fraction = math.sqrt(memory_bytes / n_bytes)
    size_m = max(least, fraction * size_m[0]), max(least, fraction * size_m[1])
    reasons.append(f'cut to {size_m[0]:.4g} m by {size_m[1]:.4g} m around the middle, which '
                   f'{memory_bytes / 1e9:.2g} GB hold at this spacing (--memory or --spacing '
                   'changes it)')
    return size_m


def _rounded(value: float) -> float:
    """The number of two digits, 1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6 or 8 of a decade, below."""
    decade = 10.0 ** math.floor(math.log10(value))
    steps = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
    return round(max(s for s in steps if s * decade <= value * (1 + 1e-9)) * decade, 12)
