# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Error of band-limited interpolation between a coarse and a fine grid by their spectra.

Fusing spectra interpolates each sub-aperture image with the period of the whole grid, although the
image is not periodic. It is therefore extended by guard cells over which a taper takes it to zero;
what the taper's spectrum carries beyond the spare band is aliased. Both grids being regular, the
error of a complex exponential follows from the taper's transform.

A map is read from the fine grid by an interpolator for which the spectrum was deapodised. The
correction mixes neighbouring lines, near the guards with some that the taper has changed.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .interpolators import Interpolator, design_interpolator

TAPERS_NEEDED = 0.5  # of what tapers add to a band, what is beyond is faint enough to fold
_TAPER_LOBES = 4  # times the inverse of the guards' length
# Times the root of the ranges: narrower guards widen the tapers' spectrum, and the fused one
_RANGE_GUARD = 1.2


def guard_taper(n: int, n_guard: float, beta: float) -> np.ndarray:
    """Taper of a periodic grid: 1 from cell n_guard to n - n_guard, smoothly to 0 at 0 and n.

    (n,) float64. The rise is the integral of a Kaiser window of shape `beta`: its square root is
    the Kaiser-Bessel-derived window that filter banks know.
    """
    t, rise = _kaiser_rise(beta)
    cell = np.arange(n)
    up, down = (np.interp(v / n_guard * 2 - 1, t, rise, 0.0, 1.0) for v in (cell, n - cell))
    return up * down


@functools.lru_cache(maxsize=64)
def _kaiser_rise(beta: float) -> tuple[np.ndarray, np.ndarray]:
    """Places from -1 to 1, and the integral of a Kaiser window up to there, 0 to 1."""
    t = np.linspace(-1, 1, 2001)
    half = np.i0(beta * np.sqrt(1 - t[:1001] ** 2))  # it is symmetric
    rise = np.cumsum(np.concatenate([half, half[-2::-1]]))
    return t, rise / rise[-1]


def cosine_fall(place: np.ndarray) -> np.ndarray:
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


_STEPS_PER_BIN = 4
_LEAST = 1e-30  # of an error
_FINER = 2  # samples of the taper in a cell: its spectrum is wanted beyond the cells' own
_LEAST_PLACES = 8  # of a table; one in each cell where that is more
_CELLS_BETWEEN = 64  # the guards, in a table: errors are those of the edges
TONES = 16  # cycles per line, 0 to 0.5, of a table of errors
_BETWEEN = 4  # places between two lines


@dataclasses.dataclass(frozen=True)
class PixelDensity:
    """What of a fused polar image is wanted.

    Attributes
    ----------
    along_alpha, along_range : (B,) float64
        Density of wanted pixels from the first line, or range, to the last, of mean one.
    between : Interpolator or None
        By which a map is read between lines, with the spectrum deapodised for it; None where the
        polar image itself is wanted.
    tones : (TONES,) float64
        Share of the power by cycles per line of the fused image, equal steps from 0 to 0.5.
    """

    along_alpha: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(1))
    along_range: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(1))
    between: Interpolator | None = None
    tones: np.ndarray = dataclasses.field(default_factory=lambda: np.full(TONES, 1 / TONES))

    @property
    def range_margins(self) -> tuple[float, float]:
        """Shares of the ranges, the first and the last, that are not wanted."""
        n, wanted = len(self.along_range), np.flatnonzero(self.along_range)
        return wanted[0] / n, 1 - (wanted[-1] + 1) / n

    @property
    def wanted_ranges(self) -> float:
        """Share of the ranges that are wanted, from the first to the last of them."""
        return 1 - sum(self.range_margins)


EVERYTHING = PixelDensity()


def aliasing_error(n: int, n_guard: float, beta: float, frequency: ArrayLike,
                   place: ArrayLike | None = None, density: ArrayLike = (1.0,)) -> np.ndarray:
    """Mean squared errors of interpolated exponentials, relative to their power.

    The coarse grid holds n bins, those between ``-(n // 2)`` and ``n - n // 2 - 1``. With the
    taper's transform W, the tapered exponential of frequency f has the spectrum ``W(b - f)``. What
    it has in bins b beyond an end is missing, and appears n bins away:
    ``e(c) = 2 |sum_b W(b - f) exp(j 2 pi b c / n)|^2`` at cell c on average over places between
    cells, for both ends of the band. The mean is over cells, by density.

    Where frequencies differ from place to place, those at the guards count: it is the tapers that
    widen the spectrum. Cut off at the band's end, what a taper at the cell t adds falls off as
    ``1 / sin(pi (c - t) / n)``, which tells the shares of both guards in the error at c.

    All are 2, as if nothing fitted, where a frequency lies beyond the band.

    Parameters
    ----------
    n, n_guard, beta :
        As for `guard_taper`, of the coarse grid.
    frequency : (..., S) array_like
        Frequencies, bins of the transform of n cells from the middle of the band.
    place : (S,) array_like, optional
        Where they occur, 0 to 1 from guard to guard; everywhere if left out. Only the outermost
        ones count.
    density : (B,) array_like
        Density of the cells that should be right, from guard to guard and of mean one.

    Returns
    -------
    (...) float64
    """
    frequency = np.atleast_1d(np.asarray(frequency, float))
    shape, n_samples = frequency.shape[:-1], frequency.shape[-1]
    if frequency.size == 0 or np.abs(frequency).max() > n / 2:
        return np.full(shape, 2.0)
    cells = min(n, math.ceil(2 * n_guard) + _CELLS_BETWEEN)
    cells -= (n - cells) % 2  # even bands lack the highest bin
    edge = (cells - 2 * n_guard) / (n - 2 * n_guard)
    where = _on_grid(_places(cells, n_guard), edge)
    share = density_at(where, density)
    if not share.any():
        return np.zeros(shape)
    table = _error_table(cells, n_guard, beta)
    weight = edge / len(where) * share[None]
    group = np.zeros(n_samples, np.intp)
    if place is not None:
        place = np.asarray(place)
        cell = n_guard + where * (n - 2 * n_guard)
        to_first, to_last = (np.sin(np.pi / n * (cell - taper)) ** 2
                             for taper in (n_guard / 2, n - n_guard / 2))
        weight = weight * np.stack([to_last, to_first]) / (to_first + to_last)
        ends = np.min(place), np.max(place)
        some = np.flatnonzero((place == ends[0]) | (place == ends[1]))
        frequency, group = frequency[..., some], np.searchsorted(ends, place[some])
    by_place = _stretched(weight @ table, n)
    # Of both ends: the other one lies n + 1 bins from the first.
    last = by_place.shape[1] - 1
    by_place = by_place + by_place[:, np.minimum(last + 1 - np.arange(last + 1), last)]
    step = np.rint((n - n // 2 - frequency) * _STEPS_PER_BIN).astype(np.intp)
    error = by_place.take(step + group * (last + 1))
    return error @ (1 / np.bincount(group))[group]


def _stretched(table: np.ndarray, n: int) -> np.ndarray:
    """Errors by distance in bins of n cells from those in bins of fewer.

    Bins apart shrink, but not shares of a bin: from one to the next errors swing as the tails of
    both guards add or cancel.
    """
    part = np.arange(_STEPS_PER_BIN) / _STEPS_PER_BIN
    table = np.log(table.reshape(len(table), -1, _STEPS_PER_BIN) + _LEAST)
    cells = table.shape[1]
    whole = np.maximum((np.arange(n + 1)[:, None] + part) * (cells / n) - part, 0.0)
    below, number = np.minimum(whole.astype(np.intp), cells - 2), np.arange(_STEPS_PER_BIN)
    share = np.minimum(whole - below, 1.0)
    return np.exp(table[:, below, number] * (1 - share) + table[:, below + 1, number] * share
                  ).reshape(len(table), -1)


def density_at(where: np.ndarray, density: ArrayLike, beyond: float | None = None) -> np.ndarray:
    """(...) density of what is wanted at places (...), 0 to 1 from guard to guard.

    `density`, (B,), tells it for equal shares of that; `beyond` is the value before the middle of
    the first and after that of the last, theirs if left out.
    """
    density = np.asarray(density)
    middle = (np.arange(len(density)) + 0.5) / len(density)
    return np.interp(where, middle, density, beyond, beyond)


def _on_grid(place: np.ndarray, edge: float) -> np.ndarray:
    """Places of a table, 0 to 1, on a grid whose edges it stands for: `edge` is its share."""
    return np.where(place < 0.5, place * edge, 1 - (1 - place) * edge)


def _places(n: int, n_guard: float) -> np.ndarray:
    """Places of a table of errors, evenly from one guard, 0, to the other, 1."""
    n_places = max(math.ceil(n - 2 * n_guard), _LEAST_PLACES)
    return (np.arange(n_places) + 0.5) / n_places


@functools.lru_cache(maxsize=32)
def _error_table(n: int, n_guard: float, beta: float) -> np.ndarray:
    """(places, distances) squared error of an exponential by its spectrum beyond a band's end.

    See `aliasing_error`; distances are those from the frequency to the first bin beyond the band,
    0 to n in steps of 1 / `_STEPS_PER_BIN`.
    """
    spectrum = np.fft.fft(guard_taper(_FINER * n, _FINER * n_guard, beta),
                          _FINER * n * _STEPS_PER_BIN)[:n * _STEPS_PER_BIN] / (_FINER * n)
    position = n_guard + _places(n, n_guard) * (n - 2 * n_guard)
    turn = np.exp(2j * np.pi / n * np.outer(position, np.arange(n)))
    terms = turn[:, :, None] * spectrum.reshape(n, _STEPS_PER_BIN)
    beyond = np.cumsum(terms[:, ::-1], axis=1)[:, ::-1].reshape(len(position), -1)
    return 2 * (beyond.real ** 2 + beyond.imag ** 2)


def correction_error(coverage: PixelDensity, n: int, n_guard: float, beta: float) -> float:
    """Mean squared error on a map because its correction mixes tapered lines with wanted ones.

    Relative to the power of the image; 0 where no map is read. `coverage` tells which lines are
    wanted, how they are read, and the frequencies of the image; the others are those of
    `aliasing_error`, for the lines of the fused grid.
    """
    if coverage.between is None:
        return 0.0
    lines = min(n, math.ceil(2 * n_guard) + _CELLS_BETWEEN)
    between = coverage.between
    table = _correction_table(between.oversampling, between.n_taps, len(between.weights) - 1,
                              lines, n_guard, beta)
    edge = (lines - 2 * n_guard) / (n - 2 * n_guard)
    place = (np.arange(lines) - n_guard) / (lines - 2 * n_guard)
    share = density_at(_on_grid(place, edge), coverage.along_alpha, beyond=0.0)
    return float(coverage.tones @ table @ share) / (n - 2 * n_guard)


@functools.lru_cache(maxsize=64)
def _correction_table(oversampling: float, taps: int, degree: int, n: int, n_guard: float,
                      beta: float) -> np.ndarray:
    """(TONES, n) mean squared error of tones by the line before the place that is read."""
    between = design_interpolator(oversampling, taps=taps, degree=degree, deapodised=True)
    line, cycles = np.arange(n), 0.5 * (np.arange(TONES) + 0.5) / TONES
    tones = np.exp(2j * np.pi * np.outer(cycles, line))
    # what is read less what would be if all lines were right
    mixed = np.fft.ifft(between.gain(np.fft.fftfreq(n))
                        * np.fft.fft(guard_taper(n, n_guard, beta) * tones))
    mixed -= between.gain(cycles)[:, None] * tones
    powers = ((np.arange(_BETWEEN) + 0.5) / _BETWEEN)[:, None] ** np.arange(len(between.weights))
    neighbours = (line[:, None] + between.first + np.arange(between.n_taps)) % n
    read = mixed[:, neighbours] @ (powers @ between.weights).T
    return (read.real ** 2 + read.imag ** 2).mean(axis=-1)


def taper_shape(n_guard: float | np.ndarray, oversampling: float | np.ndarray) -> Any:
    """Shape of the taper with about the least error (fitted to `aliasing_error`)."""
    return np.maximum(0.5, 1.5 * n_guard * (1 - 1 / oversampling))
