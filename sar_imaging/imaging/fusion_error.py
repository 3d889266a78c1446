"""Error of band-limited interpolation between a coarse and a fine grid by their spectra.

Fusing spectra interpolates each sub-aperture image with the period of the whole grid, although the
image is not periodic. It is therefore extended by guard cells over which a taper takes it to zero;
what the taper's spectrum carries beyond the spare band is aliased. Both grids being regular, the
error of a complex exponential follows from a small computation instead of a formula.
"""

from __future__ import annotations

import functools
import math

import numpy as np

_N_FREQUENCIES = 65  # from -pi to pi per cell
_N_POSITIONS = 97
_CELLS = (16, 24, 32, 48, 64, 96, 128, 192, 256)  # lengths that are tabulated


def edge_taper(n: int, n_guard: float, beta: float) -> np.ndarray:
    """Taper of a grid: 1 inside, smoothly to 0 over the guard cells at both ends.

    Parameters
    ----------
    n : int
        Cells of the grid.
    n_guard : float
        Cells over which the taper rises.
    beta : float
        Shape: the rise is the integral of a Kaiser window.

    Returns
    -------
    (n,) float64
    """
    t = np.linspace(-1, 1, 2001)
    rise = np.cumsum(np.i0(beta * np.sqrt(1 - t ** 2)))
    rise /= rise[-1]
    cell = np.arange(n)
    up = np.interp((cell + 0.5) / n_guard * 2 - 1, t, rise, 0.0, 1.0)
    down = np.interp((n - cell - 0.5) / n_guard * 2 - 1, t, rise, 0.0, 1.0)
    return up * down


@functools.lru_cache(maxsize=512)
def error_table(n: int, n_guard: float, beta: float) -> np.ndarray:
    """Squared error of interpolated exponentials.

    Parameters
    ----------
    n : int
        Cells of the coarse grid.
    n_guard : float
        Guard cells at each end.
    beta : float
        Shape of the taper.

    Returns
    -------
    (positions, frequencies) float64
        Positions evenly from one guard to the other, frequencies evenly from -pi to pi per cell.
    """
    position = np.linspace(n_guard - 0.5, n - n_guard - 0.5, _N_POSITIONS)
    frequency = np.linspace(-np.pi, np.pi, _N_FREQUENCIES)
    cell = np.arange(n)
    # sum of exp(j 2 pi m y / n) / n over the n bins m of the transform; never at y = 0 exactly
    y = np.subtract.outer(position + 1e-9, cell) * (np.pi / n)
    number = cell - n // 2
    dirichlet = np.exp(1j * y * (2 * number[0] + n - 1)) * np.sin(n * y) / (n * np.sin(y))
    coarse = edge_taper(n, n_guard, beta)[:, None] * np.exp(1j * np.outer(cell, frequency))
    return np.abs(dirichlet @ coarse - np.exp(1j * np.outer(position, frequency))) ** 2


def mean_error(n: int, n_guard: float, beta: float, frequency, position=None) -> float:
    """Mean squared error of exponentials, relative to their power.

    Parameters
    ----------
    n, n_guard, beta :
        As for `error_table`.
    frequency : array_like
        Frequencies, radians per cell, relative to the middle of the band.
    position : array_like, optional
        Where each occurs, 0 to 1 from guard to guard; everywhere if left out.

    Returns
    -------
    float
        2, as if nothing fitted, where a frequency lies beyond the band.
    """
    frequency = np.abs(np.asarray(frequency, float).ravel())
    if frequency.size == 0 or frequency.max() > np.pi:
        return 2.0
    # The errors are those of the edges, whose share falls with the length of the grid.
    cells = max(c for c in _CELLS if c <= n or c == _CELLS[0])
    cells = max(cells, math.ceil(2 * n_guard) + 2)
    table = error_table(cells, n_guard, beta) * (cells / n)
    column = frequency / np.pi * ((_N_FREQUENCIES - 1) / 2) + (_N_FREQUENCIES - 1) / 2
    upper = np.ceil(column).astype(int)
    if position is None:
        return float(table.mean(axis=0)[upper].mean())
    row = np.rint(np.asarray(position, float).ravel() * (_N_POSITIONS - 1)).astype(int)
    near = np.clip(row[:, None] + np.arange(-8, 9), 0, _N_POSITIONS - 1)
    return float(table[near, upper[:, None]].mean())


def taper_shape(n_guard: float, oversampling: float) -> float:
    """Shape of the taper with about the least error (fitted to `error_table`)."""
    return max(0.5, 1.5 * n_guard * (1 - 1 / oversampling))
