"""Two-way amplitude of echoes towards points, compiled; see `geometry.illumination`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...compilation import DETERMINISTIC, njit
from ...geometry.illumination import Illumination


class LitEchoes(NamedTuple):
    """An `Illumination` as compiled loops take it.

    Parameters
    ----------
    centre : (R, 3) float64
        Where echoes are seen from, metres.
    axes : (R, 3, 3) float64
        The antenna's right, boresight and up at each, as rows.
    azimuth, elevation : (K,) float64
        Two-way amplitude by the sine of the angle.
    place : (4,) float64
        Sine at the first point, and points per unit of it, of azimuth and of elevation.
    """

    centre: np.ndarray
    axes: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, illumination: Illumination) -> LitEchoes:
        """Arrays of an illumination."""
        azimuth, elevation = illumination.pattern.azimuth, illumination.pattern.elevation
        return cls(np.ascontiguousarray(illumination.centre_m),
                   np.ascontiguousarray(illumination.axes), azimuth.amplitude,
                   elevation.amplitude, np.array([azimuth.start, 1 / azimuth.step,
                                                  elevation.start, 1 / elevation.step]))

    @property
    def ends(self) -> np.ndarray:
        """(6,) float64 sines of azimuth, last and first; cosine and sine of both elevations."""
        first, per_sine, low, per_low = self.place
        last = first + (len(self.azimuth) - 1) / per_sine
        low, high = max(low, -1.0), min(low + (len(self.elevation) - 1) / per_low, 1.0)
        return np.array([last, first, math.sqrt(1 - high * high), high,
                         math.sqrt(1 - low * low), low])

    @classmethod
    def everything(cls) -> LitEchoes:
        """For echoes that light all points alike: no arrays, which loops do not read."""
        one = np.ones(1)
        return cls(np.zeros((0, 3)), np.zeros((0, 3, 3)), one, one, np.zeros(4))


@njit(inline='always')
def two_way_amplitude(lit, echo, x, y, z):
    """Amplitude of an echo towards a point, metres."""
    x, y, z = x - lit.centre[echo, 0], y - lit.centre[echo, 1], z - lit.centre[echo, 2]
    axes = lit.axes
    right = x * axes[echo, 0, 0] + y * axes[echo, 0, 1] + z * axes[echo, 0, 2]
    ahead = x * axes[echo, 1, 0] + y * axes[echo, 1, 1] + z * axes[echo, 1, 2]
    up = x * axes[echo, 2, 0] + y * axes[echo, 2, 1] + z * axes[echo, 2, 2]
    return _in_axes(lit.azimuth, lit.elevation, lit.place, right, ahead, up)


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def two_way_amplitudes(lit, echo, positions, out):
    """Amplitudes of an echo towards points (3, N), metres, into `out`, (N,)."""
    # What does not change is read beforehand: what is written might be the same memory.
    centre_x, centre_y, centre_z = lit.centre[echo]
    (rx, ry, rz), (bx, by, bz), (ux, uy, uz) = lit.axes[echo]
    azimuth, elevation = lit.azimuth, lit.elevation
    start, per_sine, low, per_low = lit.place
    place = start, per_sine, low, per_low
    for i in range(len(out)):
        x, y, z = (positions[0, i] - centre_x, positions[1, i] - centre_y,
                   positions[2, i] - centre_z)
        out[i] = _in_axes(azimuth, elevation, place, x * rx + y * ry + z * rz,
                          x * bx + y * by + z * bz, x * ux + y * uy + z * uz)


@njit(inline='always')
def _in_axes(azimuth, elevation, place, right, ahead, up):
    """Amplitude towards an offset in the antenna's axes, metres."""
    within = ahead * ahead + up * up
    # Without branches, for the compiler's vectors; NaN, of no position, is not ahead either.
    inside = 1.0 if ahead > 0.0 else 0.0
    across = _at_sine(azimuth, place[0], place[1], right / np.sqrt(right * right + within))
    above = _at_sine(elevation, place[2], place[3], up / np.sqrt(within))
    return inside * across * above if inside > 0.0 else 0.0


@njit(inline='always')
def _at_sine(table, start, per_sine, sine):
    last = len(table) - 1.0
    sine = sine if sine < 1.0 else 1.0
    place = ((sine if sine > -1.0 else -1.0) - start) * per_sine
    inside = 1.0 if place >= 0.0 else 0.0
    inside = inside if place <= last else 0.0
    place = place if place > 0.0 else 0.0
    place = place if place < last else last
    before = place if place < last - 1.0 else last - 1.0
    point = np.int64(before)
    low, high = table[np.uint64(point)], table[np.uint64(point + 1)]
    return inside * (low + (place - point) * (high - low))
