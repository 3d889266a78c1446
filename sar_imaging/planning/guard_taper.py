"""Tapers: over the guards of a periodic grid, how wide these are, and beyond a band's edge."""

from __future__ import annotations

import math

import numpy as np

TAPERS_NEEDED = 0.5  # of what tapers add to a band, what is beyond is faint enough to fold
_TAPER_LOBES = 4  # times the inverse of the guards' length
# Times the root of the ranges: narrower guards widen the tapers' spectrum, and the fused one
_RANGE_GUARD = 1.2


def guard_taper(n: int, n_guard: float, beta: float) -> np.ndarray:
    """Taper of a periodic grid: 1 from cell n_guard to n - n_guard, smoothly to 0 at 0 and n.

    (n,) float64. The rise is the integral of a Kaiser window of shape `beta`: its square root is
    the Kaiser-Bessel-derived window that filter banks know.
    """
    t = np.linspace(-1, 1, 2001)
    rise = np.cumsum(np.i0(beta * np.sqrt(1 - t ** 2)))
    rise /= rise[-1]
    cell = np.arange(n)
    up, down = (np.interp(v / n_guard * 2 - 1, t, rise, 0.0, 1.0) for v in (cell, n - cell))
    return up * down


def cosine_fall(place) -> np.ndarray:
    """Fall from 1 at place 0 and before it to 0 at place 1 and beyond, as a squared cosine."""
    return np.cos(0.5 * np.pi * np.clip(place, 0, 1)) ** 2


def usual_guard(n_range: int) -> int:
    """Ranges of each guard where the geometry does not need more, nor leaves less."""
    return math.ceil(_RANGE_GUARD * math.sqrt(n_range))


def used_share(half_range: float, spacing_m: float, n_range: int, tapers: float = 1.0) -> float:
    """Share of a sampling along range that a sub-aperture image needs.

    Above 1 where the ranges do not hold the band: frequencies up to `half_range`, rad/m relative
    to the carrier's, and `tapers` times what tapers over usual guards of `n_range` ranges add.
    """
    band = half_range + tapers * taper_band(usual_guard(n_range) * spacing_m)
    return spacing_m / math.pi * band


def taper_band(guard_m: float) -> float:
    """By how much tapers over the guards widen a band along range on either side, rad/m."""
    return _TAPER_LOBES * 2 * math.pi / guard_m
