"""Error of band-limited interpolation between a coarse and a fine grid by their spectra.

Fusing spectra interpolates each sub-aperture image with the period of the whole grid, although the
image is not periodic. It is therefore extended by guard cells over which a taper takes it to zero;
what the taper's spectrum carries beyond the spare band is aliased. Both grids being regular, the
error of a complex exponential follows from a small computation instead of a formula.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

_N_FREQUENCIES = 129  # from -pi to pi per cell
_N_POSITIONS = 97
_CELLS_BETWEEN = 48  # the guards, in a table: errors are those of the edges


@dataclasses.dataclass(frozen=True)
class Coverage:
    """What of a fused polar image is wanted.

    Attributes
    ----------
    along_alpha, along_range : (B,) float64
        Density of wanted pixels from the first line, or range, to the last, of mean one.
    """

    along_alpha: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(1))
    along_range: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(1))

    @property
    def range_margins(self) -> tuple[float, float]:
        """Shares of the ranges, the first and the last, that are not wanted."""
        n, wanted = len(self.along_range), np.flatnonzero(self.along_range)
        return wanted[0] / n, 1 - (wanted[-1] + 1) / n


EVERYTHING = Coverage()


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


def mean_error(n: int, n_guard: float, beta: float, frequency, position=None,
               density=(1.0,)) -> float:
    """Mean squared error of exponentials, relative to their power.

    Parameters
    ----------
    n, n_guard, beta :
        As for `error_table`.
    frequency : (..., S) array_like
        Frequencies, radians per cell, relative to the middle of the band.
    position : (S,) array_like, optional
        Where they occur, 0 to 1 from guard to guard; everywhere if left out.
    density : (B,) array_like
        Of the cells that should be, from guard to guard and of mean one.

    Returns
    -------
    float
        2, as if nothing fitted, where a frequency lies beyond the band.
    """
    frequency = np.abs(np.asarray(frequency, float))
    if frequency.size == 0 or frequency.max() > np.pi:
        return 2.0
    cells = min(n, math.ceil(2 * n_guard) + _CELLS_BETWEEN)
    between = cells - 2 * n_guard
    table = error_table(cells, n_guard, beta)
    column = np.rint((frequency / np.pi + 1) * ((_N_FREQUENCIES - 1) / 2)).astype(int)
    row = np.linspace(0, 1, _N_POSITIONS)
    if position is None:
        error = table @ _shares(column)
    else:
        column = column.reshape(-1, column.shape[-1])
        places, group = np.unique(np.asarray(position, float), return_inverse=True)
        by_place = np.stack([table @ _shares(column[:, group == g]) for g in range(len(places))])
        nearest = np.abs(np.subtract.outer(places, row)).argmin(axis=0)
        error = by_place[nearest, np.arange(_N_POSITIONS)]
    # The edges' share of the grid falls with its length.
    edge = between / (n - 2 * n_guard)
    place = np.where(row < 0.5, row * edge, 1 - (1 - row) * edge)
    share = np.interp(place, (np.arange(len(density)) + 0.5) / len(density), density)
    return float((error * share).sum() / _N_POSITIONS * edge)


def _shares(column) -> np.ndarray:
    """How often each column of an error table occurs."""
    return np.bincount(column.ravel(), minlength=_N_FREQUENCIES) / column.size


def taper_shape(n_guard: float, oversampling: float) -> float:
    """Shape of the taper with about the least error (fitted to `error_table`)."""
    return max(0.5, 1.5 * n_guard * (1 - 1 / oversampling))
