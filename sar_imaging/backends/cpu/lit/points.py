"""Amplitudes of echoes at the knots of tiles of points, of many echoes at a time.

Neighbouring tiles share the knots between them. Offsets from the phase centres are float64, what
follows from them float32.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....compilation import njit, numba
from ....geometry.illumination import Illumination
from ....planning.exact.lit_points import knot_numbers
from ....planning.exact.points import ImagePoints

_ZERO, _ONE = np.float32(0), np.float32(1)


class PointEchoes(NamedTuple):
    """An `Illumination` as loops over echoes take it: each number of all R echoes in turn.

    Parameters
    ----------
    centre : (3 R,) float64
        Where echoes are seen from, metres.
    axes : (9 R,) float32
        The antenna's right, boresight and up at each.
    table : (K,) float32
        Two-way amplitude by the sine of the azimuth, then by that of the elevation.
    place : (6,) float32
        Sine at the first point, points per unit of it and number of the last, of azimuth and of
        elevation.
    """

    centre: np.ndarray
    axes: np.ndarray
    table: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, illumination: Illumination) -> PointEchoes:
        """Arrays of an illumination."""
        cuts = illumination.pattern.azimuth, illumination.pattern.elevation
        return cls(np.ascontiguousarray(illumination.centre_m.T).reshape(-1),
                   illumination.axes.transpose(1, 2, 0).astype(np.float32).reshape(-1),
                   np.concatenate([cut.amplitude for cut in cuts]).astype(np.float32),
                   np.array([[cut.start, 1 / cut.step, len(cut.amplitude) - 1] for cut in cuts],
                            np.float32).reshape(-1))


class TileKnots:
    """Knots of the tiles of some points.

    Parameters
    ----------
    points : ImagePoints
        One part of an image.
    tile, degree : (int, int)
        Rows and columns of a tile, and degree of the interpolation along them.

    Attributes
    ----------
    line : int
        Knots of a row.
    unknown : (K,) uint8
        1 where one has no position.
    """

    def __init__(self, points: ImagePoints, tile: tuple[int, int], degree: tuple[int, int]):
        rows, columns = (knot_numbers(*sizes) for sizes in zip(points.size, tile, degree,
                                                               strict=True))
        self._positions = points.positions(rows[:, None], columns).reshape(-1)
        self.line = len(columns)
        self.unknown = np.isnan(self._positions.reshape(-1, 3)).any(axis=1).view(np.uint8)

    def amplitudes(self, echoes: PointEchoes) -> np.ndarray:
        """(K R,) float32 amplitudes at each knot of each echo in turn."""
        out = np.empty(len(self.unknown) * (len(echoes.centre) // 3), np.float32)
        _light_knots(*echoes, self._positions, out)
        return out


@njit(inline='always')
def amplitude_of(centre, axes, table, place, echo, x, y, z):
    """Two-way amplitude of an echo towards a point, metres; without branches, for vectors."""
    right, ahead, up = _in_axes(centre, axes, echo, x, y, z)
    within = ahead * ahead + up * up
    azimuth = _at_sine(table, np.int32(0), place[0], place[1], place[2],
                       right / np.sqrt(right * right + within))
    elevation = _at_sine(table, np.int32(place[2]) + np.int32(1), place[3], place[4], place[5],
                         up / np.sqrt(within))
    return azimuth * elevation if ahead > _ZERO else _ZERO


@njit(inline='always')
def dark_sphere(centre, axes, ends, echo, x, y, z, radius):
    """1 where an echo lights nothing within a radius of a position, metres.

    How far a point lies beyond an end of the pattern, ``d a - sine |d|`` in azimuth, changes by at
    most ``1 + sine`` times the radius. `ends` are those of `LitEchoes`.
    """
    right, ahead, up = _in_axes(centre, axes, echo, x, y, z)
    distance = np.sqrt(right * right + ahead * ahead + up * up)
    if (right - ends[0] * distance > (1.0 + abs(ends[0])) * radius
            or ends[1] * distance - right > (1.0 + abs(ends[1])) * radius
            or up * ends[2] - ahead * ends[3] > radius
            or ahead * ends[5] - up * ends[4] > radius or ahead < -radius):
        return 1
    return 0


@njit(inline='always')
def _in_axes(centre, axes, echo, x, y, z):
    """What of a point, metres, lies to the right, ahead and up."""
    n, two, three = np.uint64(len(centre) // 3), np.uint64(2), np.uint64(3)
    dx, dy, dz = (np.float32(x - centre[echo]), np.float32(y - centre[n + echo]),
                  np.float32(z - centre[two * n + echo]))
    a, b = three * n + echo, np.uint64(6) * n + echo
    return (dx * axes[echo] + dy * axes[n + echo] + dz * axes[two * n + echo],
            dx * axes[a] + dy * axes[n + a] + dz * axes[two * n + a],
            dx * axes[b] + dy * axes[n + b] + dz * axes[two * n + b])


@njit(inline='always')
def _at_sine(table, first, start, per_sine, last, sine):
    place = (sine - start) * per_sine
    inside = _ONE if place >= _ZERO else _ZERO
    inside = inside if place <= last else _ZERO
    place = place if place > _ZERO else _ZERO
    place = place if place < last else last
    before = place if place < last - _ONE else last - _ONE
    point = np.int32(before)
    low, high = table[np.uint64(first + point)], table[np.uint64(first + point + np.int32(1))]
    return inside * (low + (place - np.float32(point)) * (high - low))


@njit(parallel=True, error_model='numpy')
def _light_knots(centre, axes, table, place, positions, out):
    """Numba knows that arrays do not overlap only where they are no parts of a tuple."""
    n_echoes = np.uint64(len(centre) // 3)
    for knot in numba.prange(len(positions) // 3):
        x, y, z = positions[3 * knot], positions[3 * knot + 1], positions[3 * knot + 2]
        to = np.uint64(knot) * n_echoes
        for echo in range(n_echoes):
            out[to + echo] = amplitude_of(centre, axes, table, place, echo, x, y, z)
