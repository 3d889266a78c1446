# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polynomial interpolation of band-limited range profiles, with its error known beforehand.

A profile sampled ``oversampling`` times above its bandwidth is represented in each interval
between two samples by a polynomial in the fractional position (Farrow 1988); the coefficients are
weighted sums of the neighbouring samples. Weights that minimise the mean squared error over the
band and over the interval follow from one least-squares problem, whose residual is the predicted
error.

Where the spectrum is at hand before the samples are, each frequency may be multiplied by a gain
that makes up for what the interpolation takes from it: the deapodisation of gridding (O'Sullivan
1985; Jackson 1991; Fessler and Sutton 2003). Less than half the taps make the same error then.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

LINE_DEGREE, POINT_DEGREE = 4, 3  # of profiles read along image lines and point by point
TAPS = 10
# Polynomials made for a little more than their interval err evenly over it, not at its ends: all
# ranges of an image may lie at the same place between samples.
LEAST_MARGIN = 0.03
_NODES = 12  # of the quadrature over band and interval: the error holds to 0.001 dB
_ROUNDS = 40  # of weights and gains in turn
_GAIN_STEP = 1e-3  # cycles per sample, for derivatives
_OVERSAMPLING_STEP, _MOST_OVERSAMPLING = 0.02, 4.0  # to choose from
_DRIFTS = 9  # of a table of errors
#: Of chirps, radians by square samples: from those that change errors by 0.1 dB to those that no
#: sampling is chosen for. Between them amplitudes of errors, which grow as the first to fourth
#: power, are read from 0.1 dB too low to 1 dB too high.
_CHIRPS = np.append(0.0, 1e-3 * 2.0 ** (0.5 * np.arange(15)))
_CHIRP_FREQUENCIES = 513
_COARSER = 4  # frequencies at which errors are computed than those of tables


NOT_READ = 3  # pixels of the margin of a polar grid


def margin(taps: int) -> int:
    """Pixels that a polar grid must reach beyond a map on all sides."""
    return taps // 2 + 2 + NOT_READ


@dataclasses.dataclass(frozen=True)
class Interpolator:
    """Weights that turn samples into polynomials.

    Between samples n and n + 1, ``s(n + t) = sum_q (sum_k weights[q, k] s[n + k + first]) t^q``.

    Parameters
    ----------
    weights, first : (degree + 1, taps) float32, int
        Weight of each neighbouring sample in each coefficient, and offset of the first one.
    error_db : float
        Mean squared error over band and interval relative to the signal's power, dB.
    oversampling : float
        Sample rate over two-sided bandwidth that it is for.
    deapodised : bool
        The spectrum of the samples was multiplied by `gain`.
    margin : float
        Samples beyond the interval for which the polynomials are made, too.
    """

    weights: np.ndarray
    first: int
    error_db: float
    oversampling: float
    deapodised: bool = False
    margin: float = 0.0

    @property
    def n_planes(self) -> int:
        """Real and imaginary parts of the coefficients of an interval."""
        return 2 * len(self.weights)

    @property
    def n_taps(self) -> int:
        """Number of neighbours."""
        return self.weights.shape[1]

    @functools.cached_property
    def centred(self) -> np.ndarray:
        """(degree + 1, taps) float32 weights by powers of ``t - 1/2``.

        Taps that mirror each other have the same even ones and opposite odd ones.
        """
        return _shifted(self.weights.astype(np.float64), 0.5).astype(np.float32)

    def gain(self, frequency: ArrayLike) -> np.ndarray:
        """(F,) by what spectra of samples are to be multiplied for the least error in the band.

        Of frequencies (F,) from -0.5 to 0.5 cycles per sample. Nearly 1 unless the interpolator
        was designed with ``deapodised=True``. Smooth, also beyond the band.
        """
        return np.exp(np.interp(np.abs(frequency), _frequencies(), self._log_gain))

    def error_at(self, frequency: float | np.ndarray) -> np.ndarray:
        """(...) mean squared error over the interval, relative to power, of frequencies (...).

        Cycles per sample; 2 where one is beyond what samples can hold.
        """
        last = len(self._errors) - 1
        place = np.abs(frequency)
        place *= 2 * (last - 1)
        place += 0.5
        place = np.minimum(place, last)
        return self._errors.take(place.astype(np.intp))

    def error_of_chirps(self, frequency: np.ndarray, chirp: np.ndarray) -> np.ndarray:
        """(K, ...) as `error_at`, of tones whose phase also bends by ``chirp n^2`` at sample n.

        `chirp` is (...), radians; 2 where one is beyond what is known.
        """
        chirp = np.abs(chirp)
        if not chirp.max() > _CHIRPS[1]:
            return self.error_at(frequency)
        upper = np.clip(np.searchsorted(_CHIRPS, chirp), 1, len(_CHIRPS) - 1)
        below, above = np.square(_CHIRPS).take([upper - 1, upper])
        share = (chirp * chirp - below) / (above - below)
        place = np.abs(frequency)
        place *= 2 * (_CHIRP_FREQUENCIES - 1)
        place += 0.5
        place = np.minimum(place, _CHIRP_FREQUENCIES).astype(np.intp)
        place += (upper - 1) * (_CHIRP_FREQUENCIES + 1)
        errors = self._chirp_errors.ravel()
        root = errors.take(place) * (1 - share)
        place += _CHIRP_FREQUENCIES + 1
        root += errors.take(place) * share
        root *= root
        root[..., share > 1] = 2.0
        return root

    def mean_error_db(self, frequency: np.ndarray, weight: np.ndarray) -> float:
        """Mean error of K wavenumbers, R echoes and S places, dB.

        Frequencies are (K, R, S), cycles per sample, weights of the echoes (R,), or (W, R) for
        the worst of W cases.
        """
        error = self.error_at(frequency).mean(axis=(0, 2))
        return 10 * math.log10(float((weight @ error / weight.sum(axis=-1)).max()) + 1e-16)

    def error_with_drift(self, drift: float | np.ndarray) -> np.ndarray:
        """(...) mean squared error where positions begin anywhere and drift evenly.

        Over the band, relative to the signal's power; `drift`, (...), is the furthest in either
        direction, samples, up to `margin`.
        """
        errors, last = self._drift_errors, len(self._drift_errors) - 1
        if not last:
            return np.broadcast_to(errors[0], np.shape(drift))
        place = np.minimum(np.multiply(drift, last / self.margin), last)
        below = np.minimum(place.astype(np.intp), last - 1)
        return errors.take(below) + (place - below) * np.diff(errors).take(below)

    @functools.cached_property
    def _drift_errors(self) -> np.ndarray:
        """From no drift to `margin`."""
        x, weight = _nodes()
        drifts = np.linspace(0, self.margin, _DRIFTS if self.margin else 1)
        position = 0.5 + 0.5 * x + np.multiply.outer(drifts, x)[..., None]
        frequency = 0.5 / self.oversampling * (0.5 + 0.5 * x)
        read, wanted = self._read(frequency, position.ravel())
        error = weight @ np.sum((read - wanted) ** 2, axis=0)
        return error.reshape(position.shape) @ weight @ weight / 8

    @functools.cached_property
    def _log_gain(self) -> np.ndarray:
        """Of `_frequencies`."""
        frequency, edge = _frequencies(), 0.5 / self.oversampling
        gain = _best_gain(*self._read(np.minimum(frequency, edge)), _nodes()[1])
        # The best gain has sharp features beyond the band, which would spread what tapers do far
        # over the image: it goes on as it ends, and levels off towards half a cycle.
        ends = edge - _GAIN_STEP * np.arange(3)
        ends = np.log(_best_gain(*self._read(ends), _nodes()[1]))
        width = 0.5 - edge
        slope = (1.5 * ends[0] - 2 * ends[1] + 0.5 * ends[2]) * width / _GAIN_STEP
        bend = (ends[0] - 2 * ends[1] + ends[2]) * (width / _GAIN_STEP) ** 2
        x = np.maximum((frequency - edge) / width, 0.0)
        return (np.log(gain) + slope * (x - x ** 3 + x ** 4 / 2)
                + bend * (x ** 2 / 2 - 2 * x ** 3 / 3 + x ** 4 / 4))

    @functools.cached_property
    def _errors(self) -> np.ndarray:
        """Of `_frequencies`, and of what is beyond."""
        some = _frequencies()[::_COARSER]
        read, wanted = self._read(some)
        if self.deapodised:
            read *= np.exp(self._log_gain[::_COARSER])[:, None]
        error = np.sum((read - wanted) ** 2, axis=0) @ (0.5 * _nodes()[1])
        return np.append(np.interp(_frequencies(), some, error), 2.0)

    @functools.cached_property
    def _chirp_errors(self) -> np.ndarray:
        """Roots, of `_CHIRPS` by frequencies from 0 to half a cycle, and of what is beyond."""
        frequency, half = np.linspace(0, 0.5, _CHIRP_FREQUENCIES)[:, None], 0.5 * _nodes()[0]
        place = np.arange(self.n_taps) + self.first - 0.5  # from the middle of the interval
        by_position = self.weights.T @ (0.5 + half) ** np.arange(len(self.weights))[:, None]
        errors = np.full((len(_CHIRPS), _CHIRP_FREQUENCIES + 1), 2.0)
        turns = [np.exp(2j * np.pi * frequency * at) for at in (place, half)]
        for number, chirp in enumerate(_CHIRPS):
            samples, wanted = (turn * np.exp(1j * chirp * at ** 2) for turn, at in zip(
                turns, (place, half), strict=True))
            errors[number, :-1] = np.abs(samples @ by_position - wanted) ** 2 @ (
                0.5 * _nodes()[1])
        return np.sqrt(errors)

    def _read(self, frequency: np.ndarray, position: np.ndarray | None = None
              ) -> tuple[np.ndarray, np.ndarray]:
        """Tones as read at positions, those of the quadrature if left out, and as they are.

        Real and imaginary parts, (2, F, T), seen from the middle of the interval.
        """
        x = _nodes()[0] if position is None else 2 * position - 1
        by_position = self.weights.T @ (0.5 + 0.5 * x) ** np.arange(len(self.weights))[:, None]
        if position is None:  # nodes lie in pairs, too
            wanted = np.exp(1j * np.pi * np.outer(frequency, x[_NODES // 2:]))
            wanted = np.concatenate([wanted[:, ::-1].conj(), wanted], axis=1)
        else:
            wanted = np.exp(1j * np.pi * np.outer(frequency, x))
        # From the middle of the interval taps lie in pairs, of opposite phase.
        step, half = np.exp(2j * np.pi * frequency), np.exp(1j * np.pi * frequency)
        after = [half]
        for _ in range(self.n_taps // 2 - 1):
            after.append(after[-1] * step)
        taps = np.stack([*np.conj(after[::-1]), *after], axis=-1)
        return _real_imag(taps) @ by_position, _real_imag(wanted)


def design_interpolator(oversampling: float, margin: float = 0.0, *, taps: int = TAPS,
                        degree: int = POINT_DEGREE, deapodised: bool = False) -> Interpolator:
    """Least-squares polynomial interpolator for a band-limited signal.

    Parameters
    ----------
    oversampling, margin, deapodised :
        As of `Interpolator`; oversampling above 1, a margin of 0 or more.
    taps, degree : int
        Number of neighbours, even, and degree of the polynomial.

    Raises
    ------
    ValueError
        The signal is not sampled above its bandwidth, or the margin is negative.
    """
    if not oversampling > 1:
        raise ValueError(f'oversampling={oversampling}; the profile must be sampled above its '
                         'bandwidth')
    if margin < 0:
        raise ValueError(f'margin={margin} must not be negative')
    # Rounding against the safe side makes the cache useful for the values that geometry yields.
    return _design(math.floor(50 * oversampling + 1e-6) / 50,
                   math.ceil(margin * 100) / 100, taps, degree, deapodised)


@functools.lru_cache(maxsize=256)
def _design(oversampling: float, margin: float, taps: int, degree: int, deapodised: bool
            ) -> Interpolator:
    # Real weights are as good at negative frequencies as at positive ones.
    x, fw = _nodes()
    f = (1 + x) / (4 * oversampling)
    t = 0.5 + x * (0.5 + margin)
    first = 1 - taps // 2
    weight = np.sqrt(fw / 2)
    powers = (t[:, None] - 0.5) ** np.arange(degree + 1)  # centred: better conditioned
    place = np.arange(taps) + first
    samples, wanted = (np.exp(2j * np.pi * np.outer(f, v)) for v in (place, t))
    gain = _first_gain(samples, place, t, oversampling) if deapodised else np.ones(_NODES)
    samples, wanted = _real_imag(samples), _real_imag(wanted)
    weighted = (wanted * weight[:, None]).reshape(2 * _NODES, -1)
    to_powers = np.linalg.pinv(powers * weight[:, None], rcond=1e-13) * weight
    for _ in range(_ROUNDS if deapodised else 1):
        # The model is a product of functions of frequency and of position: one problem after the
        # other
        by_position = np.linalg.lstsq(
            (samples * (gain * weight)[:, None]).reshape(2 * _NODES, -1), weighted, rcond=1e-13)[0]
        centred = to_powers @ by_position.T
        read = samples @ (powers @ centred).T
        if deapodised:
            gain = _best_gain(read, wanted, fw)
    error = np.sum((gain[:, None] * read - wanted) ** 2, axis=0)
    return Interpolator(_shifted(centred, -0.5).astype(np.float32), first,
                        10 * math.log10(weight ** 2 @ error @ weight ** 2), oversampling,
                        deapodised, margin)


@functools.cache
def _frequencies() -> np.ndarray:
    """Of tables, cycles per sample: reading gains linearly adds 1e-6."""
    return np.linspace(0, 0.5, 4097)


@functools.cache
def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """Nodes from -1 to 1, and weights, of the quadrature."""
    return np.polynomial.legendre.leggauss(_NODES)


def _real_imag(values: np.ndarray) -> np.ndarray:
    """Real and imaginary parts, (2, ...)."""
    return np.stack([values.real, values.imag])


def _first_gain(samples: np.ndarray, place: np.ndarray, t: np.ndarray, oversampling: float
                ) -> np.ndarray:
    """To start from: that of a Kaiser-Bessel window, which rolls off most steeply."""
    taps = len(place)
    beta = np.pi * taps * (1 - 0.5 / oversampling)
    u = 2 * (t - place[:, None]) / taps
    window = np.where(np.abs(u) < 1, np.i0(beta * np.sqrt(np.maximum(1 - u ** 2, 0))), 0.0)
    return 1 / np.abs(samples @ window).mean(axis=1)


def _best_gain(read: np.ndarray, wanted: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Real gains, by frequency, with which values read are nearest to those wanted."""
    along, squared = (np.einsum('pft,pft,t->f', read, v, weight) for v in (wanted, read))
    return along / squared


def _shifted(weights: np.ndarray, shift: float) -> np.ndarray:
    """Coefficients of p(t + shift) by powers of t, given those of p(t)."""
    result = np.zeros_like(weights)
    for q in range(len(weights)):
        for p in range(q + 1):
            result[p] += math.comb(q, p) * shift ** (q - p) * weights[q]
    return result


OVERSAMPLING = np.arange(1.1, _MOST_OVERSAMPLING, _OVERSAMPLING_STEP)
ERRORS = Path(__file__).parent / 'interpolator_errors.json'  # benchmarks/interpolator_errors.py
_ROUNDED_DB = 0.01  # of what is kept


@functools.cache
def known_errors() -> dict[str, dict[str, list[Any]]]:
    """Errors of many interpolators, dB: designing them takes seconds.

    ``'lines'`` by taps: of degree 5 for oversampling 1.1, 1.12 and so on. ``'profiles'`` by
    degree: of 10 taps for oversampling from 1.3 in steps of 0.1, and each for margins from 0.03 in
    steps of 0.05.
    """
    return json.loads(ERRORS.read_text())


def least_oversampling(error_db: float, taps: int, degree: int) -> float:
    """The coarsest sampling at which an interpolator reaches an error, dB; inf for none."""
    first = _first_sufficient(error_db, taps, degree)
    return float(OVERSAMPLING[first]) if first < len(OVERSAMPLING) else math.inf


def _first_sufficient(error_db: float, taps: int = TAPS, degree: int = POINT_DEGREE,
                      deapodised: bool = False) -> int:
    """Number of an oversampling before which none suffices; 0 where nothing is known."""
    known = known_errors()['lines'].get(str(taps)) if degree == 5 and not deapodised else None
    return 0 if known is None else next(
        (n for n, db in enumerate(known) if db <= error_db + _ROUNDED_DB), len(known))


def sufficient_interpolators(error_db: float, **kind: Any) -> Iterator[Interpolator]:
    """Interpolators that reach an error, dB, from that for the coarsest sampling on.

    `kind` is as of `design_interpolator`.
    """
    for oversampling in OVERSAMPLING[_first_sufficient(error_db, **kind):]:
        found = design_interpolator(oversampling, **kind)
        if found.error_db <= error_db:
            yield found


def fitting_interpolator(frequency: np.ndarray, weight: np.ndarray, half: float, wanted_db: float,
                         **kind: Any) -> tuple[Interpolator | None, float]:
    """Interpolator for the coarsest sampling that reads frequencies well, and its mean error, dB.

    `frequency` and `weight` as of `Interpolator.mean_error_db`, but radians per unit of place:
    samples lie ``pi / oversampling`` over the highest, `half`, apart. None where no sampling will
    do.
    """
    half = max(half, 1e-12)
    for found in sufficient_interpolators(wanted_db, **kind):
        error_db = found.mean_error_db(frequency / (2 * half * found.oversampling), weight)
        if error_db <= wanted_db:  # much of the power may lie where the band ends
            return found, error_db
    return None, math.inf
