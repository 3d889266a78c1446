# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar image grids around an aperture, in range and direction cosine along the track."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .grids import MapGrid


@dataclasses.dataclass(frozen=True)
class PolarGrid:
    """Pixels by range and direction cosine on a plane: unified polar coordinates.

    See Zhang et al., figure 2b.

    A point is given by its distance r from the origin and by ``alpha``, the cosine of the angle
    between the direction to it and the track. Images on the grid have shape
    ``(n_alpha, n_range)``, both coordinates ascending.

    Parameters
    ----------
    origin_m : (3,) floats
        Aperture centre in the imaging frame, metres.
    track : (2,) floats
        Horizontal unit vector along the track.
    side : int
        +1 when the plane is seen to the left of the track direction, -1 to the right.
    z_m : float
        Height of the plane, metres.
    range_start_m, range_spacing_m : float
        First range and spacing, metres.
    alpha_start, alpha_spacing : float
        First direction cosine and spacing.
    n_range, n_alpha : int
        Number of ranges and of directions.

    Raises
    ------
    ValueError
        The nearest pixel would lie above the plane, a size or spacing is not positive, a number
        is not finite, the track no unit vector, or the side another.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry import PolarGrid
    >>> polar = PolarGrid(origin_m=(0.0, 0.0, 0.0), track=(0.0, 1.0), side=-1, z_m=0.0,
    ...                   range_start_m=90.0, range_spacing_m=0.5, n_range=41,
    ...                   alpha_start=-0.1, alpha_spacing=0.05, n_alpha=5)
    >>> polar.shape
    (5, 41)
    >>> polar.positions(2, 20).round(6).tolist()  # 100 m to the right of the track
    [100.0, 0.0, 0.0]
    >>> range_m, alpha = polar.from_map(80.0, 60.0)
    >>> print(f'{range_m:.1f} m, direction cosine {alpha:.1f}')
    100.0 m, direction cosine 0.6
    """

    origin_m: tuple[float, float, float]
    track: tuple[float, float]
    side: int
    z_m: float
    range_start_m: float
    range_spacing_m: float
    n_range: int
    alpha_start: float
    alpha_spacing: float
    n_alpha: int

    def __post_init__(self) -> None:
        numbers = (*self.origin_m, *self.track, self.z_m, self.range_start_m,
                   self.range_spacing_m, self.alpha_start, self.alpha_spacing)
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f'{self} holds numbers that are NaN or infinite')
        if self.range_spacing_m <= 0 or self.alpha_spacing <= 0:
            raise ValueError(f'range_spacing_m={self.range_spacing_m}, alpha_spacing='
                             f'{self.alpha_spacing}; expected positive spacings: both axes ascend')
        if abs(math.hypot(*self.track) - 1) > 1e-9:
            raise ValueError(f'track={self.track} is no unit vector; divide it by its length')
        if self.side not in (-1, 1):
            raise ValueError(f'side={self.side}; expected +1 (left of the track) or -1 (right)')
        if self.n_range < 1 or self.n_alpha < 1:
            raise ValueError(f'n_range={self.n_range}, n_alpha={self.n_alpha}; expected at least '
                             'one each')
        steepest = max(abs(self.alpha_start),
                       abs(self.alpha_start + (self.n_alpha - 1) * self.alpha_spacing))
        reach = self.range_start_m * math.sqrt(max(0.0, 1 - steepest ** 2))
        if self.range_start_m <= 0 or reach <= abs(self.height_m):
            raise ValueError(f'range_start_m={self.range_start_m} at alpha={steepest:.4f} does '
                             f'not reach the plane {self.height_m} m below; start further out')

    @property
    def height_m(self) -> float:
        """Height of the origin above the plane, metres."""
        return self.origin_m[2] - self.z_m

    @property
    def range_m(self) -> np.ndarray:
        """(n_range,) float64 distances from the origin, metres."""
        return self.range_start_m + np.arange(self.n_range) * self.range_spacing_m

    @property
    def alpha(self) -> np.ndarray:
        """(n_alpha,) float64 direction cosines."""
        return self.alpha_start + np.arange(self.n_alpha) * self.alpha_spacing

    @property
    def across(self) -> tuple[float, float]:
        """Horizontal unit vector from the track into the scene."""
        return -self.side * self.track[1], self.side * self.track[0]

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape ``(n_alpha, n_range)``."""
        return (self.n_alpha, self.n_range)

    def positions(self, row: ArrayLike, column: ArrayLike) -> np.ndarray:
        """(..., 3) float64 positions by broadcast numbers of pixels, whole or not, metres."""
        return self.at(self.range_start_m + np.asarray(column) * self.range_spacing_m,
                       self.alpha_start + np.asarray(row) * self.alpha_spacing)

    def sampled(self, n_range: int, n_alpha: int) -> tuple[np.ndarray, np.ndarray]:
        """Ranges and directions of some pixels from edge to edge, (S,) float64 each.

        `n_range` times `n_alpha` of them, direction by direction.
        """
        r, alpha = (np.linspace(start, start + (n - 1) * spacing, n_samples)
                    for start, spacing, n, n_samples in (
                        (self.range_start_m, self.range_spacing_m, self.n_range, n_range),
                        (self.alpha_start, self.alpha_spacing, self.n_alpha, n_alpha)))
        return np.tile(r, n_alpha), np.repeat(alpha, n_range)

    def points(self) -> np.ndarray:
        """(n_alpha, n_range, 3) float64 positions of all pixels, metres."""
        return self.positions(*np.ogrid[:self.n_alpha, :self.n_range])

    def at(self, range_m: ArrayLike, alpha: ArrayLike) -> np.ndarray:
        """(..., 3) float64 positions by range, metres, and direction, broadcast together."""
        r, a = np.broadcast_arrays(np.asarray(range_m, float), np.asarray(alpha, float))
        return self._along_and_beside(
            r * a, np.sqrt(r ** 2 * (1 - a ** 2) - self.height_m ** 2)) + [
                *self.origin_m[:2], self.z_m]

    def _along_and_beside(self, along: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """(..., 3) vectors along the track and across it."""
        u, v = np.array([*self.track, 0.0]), np.array([*self.across, 0.0])
        return along[..., None] * u + beside[..., None] * v

    def lines(self, range_m: ArrayLike, alpha: ArrayLike) -> tuple[np.ndarray, ...]:
        """Positions and their first to fourth derivative by range.

        Parameters
        ----------
        range_m, alpha : array_like
            Coordinates, broadcast together.

        Returns
        -------
        position, first, second, third, fourth : (..., 3) float64
            Metres, 1, 1/m, 1/m^2 and 1/m^3.
        """
        r, a = np.broadcast_arrays(np.asarray(range_m, float), np.asarray(alpha, float))
        squeeze = 1 - a ** 2
        ground = np.sqrt(r ** 2 * squeeze - self.height_m ** 2)
        # Leibniz' rule for ground^2 = r^2 (1 - alpha^2) - height^2
        g1 = r * squeeze / ground
        g2 = (squeeze - g1 ** 2) / ground
        g3 = -3 * g1 * g2 / ground
        g4 = -(4 * g1 * g3 + 3 * g2 ** 2) / ground
        vector, zero = self._along_and_beside, np.zeros_like(r)
        position = vector(r * a, ground) + [*self.origin_m[:2], self.z_m]
        return position, vector(a, g1), vector(zero, g2), vector(zero, g3), vector(zero, g4)

    def locate(self, pixel: float | np.ndarray, line: float | np.ndarray) -> list[np.ndarray]:
        """Positions and their first to fourth derivative by the pixel number, metres.

        (..., 3) float64 each, of numbers of the range and of the direction, broadcast together,
        whole or not.
        """
        derivatives = self.lines(self.range_start_m + self.range_spacing_m * pixel,
                                 self.alpha_start + self.alpha_spacing * line)
        return [d * self.range_spacing_m ** order for order, d in enumerate(derivatives)]

    def by_direction(self, range_m: ArrayLike, alpha: ArrayLike) -> np.ndarray:
        """(..., 3) float64 derivative of the position by alpha, metres."""
        r, a = np.broadcast_arrays(np.asarray(range_m, float), np.asarray(alpha, float))
        ground = np.sqrt(r ** 2 * (1 - a ** 2) - self.height_m ** 2)
        u, v = np.array([*self.track, 0.0]), np.array([*self.across, 0.0])
        return np.multiply.outer(r, u) - np.multiply.outer(r ** 2 * a / ground, v)

    def from_map(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Range in metres and direction cosine of positions on the plane."""
        dx, dy = np.asarray(x_m) - self.origin_m[0], np.asarray(y_m) - self.origin_m[1]
        r = np.sqrt(dx ** 2 + dy ** 2 + self.height_m ** 2)
        return r, (dx * self.track[0] + dy * self.track[1]) / r


EDGE_SAMPLES = 65  # per edge of the map


def edge_positions(grid: MapGrid, origin_m: Sequence[float] | np.ndarray,
                   track: Sequence[float] | np.ndarray, axis: int, reach_m: float
                   ) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and directions of a map's edges.

    A row of the map that slants across the ranges leaves its directions on the way to the ranges
    beyond it that its last pixels are interpolated from.

    Parameters
    ----------
    grid : MapGrid
        Map.
    origin_m : (3,) floats
        Origin of the polar coordinates, metres.
    track : (2,) floats
        Horizontal unit vector from which directions are measured.
    axis : int
        Map axis that follows range.
    reach_m : float
        How far beyond a pixel its row is read along range, metres.

    Returns
    -------
    range_m : (E,) float64
        Distances of points on the edges from the origin, metres.
    alpha : (3, E) float64
        Direction cosines of the row at the nearest range that is read, at the point itself and at
        the furthest.
    """
    x = np.linspace(grid.x_m[0], grid.x_m[-1], EDGE_SAMPLES) - origin_m[0]
    y = np.linspace(grid.y_m[0], grid.y_m[-1], EDGE_SAMPLES) - origin_m[1]
    pairs = [(x, end) for end in y[[0, -1]]] + [(end, y) for end in x[[0, -1]]]
    edges = np.concatenate([np.stack(np.broadcast_arrays(*pair), axis=-1) for pair in pairs])
    height2 = (origin_m[2] - grid.z_m) ** 2
    range_m = np.sqrt((edges ** 2).sum(axis=1) + height2)
    read = range_m + reach_m * np.array([[-1.0], [0.0], [1.0]])
    row = edges[:, 1 - axis]
    ahead = np.sqrt(np.maximum(read ** 2 - row ** 2 - height2, 0.0))
    ahead = np.copysign(ahead, edges[:, axis])
    return range_m, (ahead * track[axis] + row * track[1 - axis]) / read
