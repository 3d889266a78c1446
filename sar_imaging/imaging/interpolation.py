"""Polynomial interpolation of band-limited range profiles, with its error known beforehand.

A profile sampled ``oversampling`` times above its bandwidth is represented in each interval
between two samples by a polynomial in the fractional position (a Farrow structure); the
coefficients are weighted sums of the neighbouring samples. Weights that minimise the mean squared
error over the band and over the interval follow from one least-squares problem, whose residual is
the predicted error.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from ..compilation import njit, numba

DEGREE = 3
N_PLANES = 2 * (DEGREE + 1)  # real and imaginary part of each coefficient
TAPS = 8


@dataclasses.dataclass(frozen=True)
class Interpolator:
    """Weights that turn samples into cubic polynomials.

    Between samples n and n + 1, ``s(n + t) = sum_q (sum_k weights[q, k] s[n + k + first]) t^q``.
    Profiles use degree 3 and eight neighbours, images more.

    Parameters
    ----------
    weights : (degree + 1, taps) float32
        Weight of each of the neighbouring samples in each coefficient.
    first : int
        Offset of the first neighbour.
    error_db : float
        Mean squared error over band and interval relative to the signal's power, dB.
    """

    weights: np.ndarray
    first: int
    error_db: float


def design_interpolator(oversampling: float, margin: float = 0.0, *, taps: int = TAPS,
                        degree: int = DEGREE) -> Interpolator:
    """Least-squares polynomial interpolator for a band-limited signal.

    Parameters
    ----------
    oversampling : float
        Sample rate over two-sided bandwidth, above 1.
    margin : float
        The polynomial is used for ``-margin <= t <= 1 + margin``, in samples.
    taps, degree : int
        Number of neighbours, even, and degree of the polynomial.

    Returns
    -------
    Interpolator

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
    return _design(math.floor(oversampling * 50) / 50 or oversampling,
                   math.ceil(margin * 100) / 100, taps, degree)


@functools.lru_cache(maxsize=256)
def _design(oversampling, margin, taps, degree):
    x, fw = np.polynomial.legendre.leggauss(48)
    f = x / (2 * oversampling)
    y, tw = np.polynomial.legendre.leggauss(32)
    t = 0.5 + y * (0.5 + margin)
    first = 1 - taps // 2
    samples = np.exp(2j * np.pi * np.outer(f, np.arange(taps) + first))
    powers = (t[:, None] - 0.5) ** np.arange(degree + 1)  # centred: better conditioned
    weight = np.sqrt(fw[:, None] * tw / 4)[..., None]
    model = np.einsum('fk,tq->ftqk', samples, powers).reshape(f.size, t.size, -1) * weight
    wanted = np.exp(2j * np.pi * np.outer(f, t)) * weight[..., 0]
    a, b = (v.reshape(f.size * t.size, -1) for v in (model, wanted))
    a, b = np.concatenate([a.real, a.imag]), np.concatenate([b.real, b.imag])[:, 0]
    solution = np.linalg.lstsq(a, b, rcond=1e-13)[0]
    error = float(np.sum((a @ solution - b) ** 2))
    centred = solution.reshape(degree + 1, taps)
    weights = np.zeros_like(centred)
    for q in range(degree + 1):  # expand (t - 1/2)^q
        for p in range(q + 1):
            weights[p] += math.comb(q, p) * (-0.5) ** (q - p) * centred[q]
    return Interpolator(weights.astype(np.float32), first, 10 * math.log10(error))


@njit(parallel=True)
def polynomial_planes(real, imag, weights, first, out):
    """Coefficients of every interval of a phase-major lattice.

    Parameters
    ----------
    real, imag : (R, U, n + 2 * TAPS) float32
        Samples of R profiles; sample ``U * cell + phase`` stands at ``[phase, cell + TAPS]``.
    weights : (4, 8) float32
        Weights of `Interpolator`.
    first : int
        Offset of the first neighbour.
    out : (R, U, 8, n) float32
        Planes of real, then imaginary coefficients of each phase.
    """
    n_rows, n_phases, length = real.shape
    n = np.uint64(out.shape[3])
    flat_out = out.reshape(-1)
    for row in numba.prange(n_rows):
        start = np.empty(8, np.uint64)
        for phase in range(n_phases):
            for k in range(8):
                step = phase + k + first
                start[k] = np.uint64((row * n_phases + step % n_phases) * length
                                     + step // n_phases + TAPS)
            plane = np.uint64((row * n_phases + phase) * N_PLANES) * n
            _weighted_sums(real.reshape(-1), start, weights, flat_out, plane, n)
            _weighted_sums(imag.reshape(-1), start, weights, flat_out,
                           plane + n + n + n + n, n)


@njit(inline='always')
def _weighted_sums(samples, start, weights, out, plane, n):
    for q in range(4):
        w0, w1, w2, w3 = weights[q, 0], weights[q, 1], weights[q, 2], weights[q, 3]
        w4, w5, w6, w7 = weights[q, 4], weights[q, 5], weights[q, 6], weights[q, 7]
        s0, s1, s2, s3 = start[0], start[1], start[2], start[3]
        s4, s5, s6, s7 = start[4], start[5], start[6], start[7]
        target = plane + np.uint64(q) * n
        for i in range(n):
            out[target + i] = (w0 * samples[s0 + i] + w1 * samples[s1 + i]
                               + w2 * samples[s2 + i] + w3 * samples[s3 + i]
                               + w4 * samples[s4 + i] + w5 * samples[s5 + i]
                               + w6 * samples[s6 + i] + w7 * samples[s7 + i])
