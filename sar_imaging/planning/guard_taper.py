"""Tapers: over the guards of a periodic grid, and beyond the edge of a band."""

from __future__ import annotations

import numpy as np


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
