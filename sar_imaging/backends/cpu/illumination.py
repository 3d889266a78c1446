"""Two-way amplitude of echoes towards points, compiled; see `geometry.illumination`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compilation import njit
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

    @classmethod
    def everything(cls) -> LitEchoes:
        """For echoes that light all points alike: no arrays, which loops do not read."""
        one = np.ones(1)
        return cls(np.zeros((0, 3)), np.zeros((0, 3, 3)), one, one, np.zeros(4))


@njit(inline='always')
def two_way_amplitude(lit, row, x, y, z):
    """Amplitude of an echo towards a point, metres."""
    x, y, z = x - lit.centre[row, 0], y - lit.centre[row, 1], z - lit.centre[row, 2]
    axes = lit.axes
    right = x * axes[row, 0, 0] + y * axes[row, 0, 1] + z * axes[row, 0, 2]
    ahead = x * axes[row, 1, 0] + y * axes[row, 1, 1] + z * axes[row, 1, 2]
    up = x * axes[row, 2, 0] + y * axes[row, 2, 1] + z * axes[row, 2, 2]
    if ahead <= 0.0:
        return 0.0
    within = ahead * ahead + up * up
    place = lit.place
    value = _at_sine(lit.azimuth, place[0], place[1], right / np.sqrt(right * right + within))
    if value > 0.0:
        value *= _at_sine(lit.elevation, place[2], place[3], up / np.sqrt(within))
    return value


@njit(inline='always')
def _at_sine(table, start, per_sine, sine):
    last = len(table) - 1
    place = (min(max(sine, -1.0), 1.0) - start) * per_sine
    if place < 0.0 or place > last:
        return 0.0
    point = min(int(place), last - 1)
    return table[point] + (place - point) * (table[point + 1] - table[point])
