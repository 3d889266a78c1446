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
    n_phases, length = real.shape[1:]
    step = np.arange(n_phases)[:, None] + np.arange(TAPS) + first
    start = (step % n_phases) * length + step // n_phases + TAPS
    _weighted_sums(real.reshape(-1), imag.reshape(-1), real.shape, start, weights, out.shape[3],
                   out.reshape(-1))


@njit(parallel=True)
def _weighted_sums(real, imag, shape, start, weights, count, out):
    """Rows and phases in parallel; free of views for the compiler, see `kernels`."""
    n_rows, n_phases, length = shape
    n = np.uint64(count)
    a0, a1, a2, a3 = weights[0, 0], weights[0, 1], weights[0, 2], weights[0, 3]
    a4, a5, a6, a7 = weights[0, 4], weights[0, 5], weights[0, 6], weights[0, 7]
    b0, b1, b2, b3 = weights[1, 0], weights[1, 1], weights[1, 2], weights[1, 3]
    b4, b5, b6, b7 = weights[1, 4], weights[1, 5], weights[1, 6], weights[1, 7]
    c0, c1, c2, c3 = weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3]
    c4, c5, c6, c7 = weights[2, 4], weights[2, 5], weights[2, 6], weights[2, 7]
    d0, d1, d2, d3 = weights[3, 0], weights[3, 1], weights[3, 2], weights[3, 3]
    d4, d5, d6, d7 = weights[3, 4], weights[3, 5], weights[3, 6], weights[3, 7]
    for task in numba.prange(n_rows * n_phases):
        row, phase = task // n_phases, task % n_phases
        base = row * n_phases * length
        s0, s1 = np.uint64(base + start[phase, 0]), np.uint64(base + start[phase, 1])
        s2, s3 = np.uint64(base + start[phase, 2]), np.uint64(base + start[phase, 3])
        s4, s5 = np.uint64(base + start[phase, 4]), np.uint64(base + start[phase, 5])
        s6, s7 = np.uint64(base + start[phase, 6]), np.uint64(base + start[phase, 7])
        p0 = np.uint64(task * N_PLANES) * n
        p1 = p0 + n
        p2 = p1 + n
        p3 = p2 + n
        for i in range(n):
            v0, v1, v2, v3 = real[s0 + i], real[s1 + i], real[s2 + i], real[s3 + i]
            v4, v5, v6, v7 = real[s4 + i], real[s5 + i], real[s6 + i], real[s7 + i]
            out[p0 + i] = (a0 * v0 + a1 * v1 + a2 * v2 + a3 * v3
                           + a4 * v4 + a5 * v5 + a6 * v6 + a7 * v7)
            out[p1 + i] = (b0 * v0 + b1 * v1 + b2 * v2 + b3 * v3
                           + b4 * v4 + b5 * v5 + b6 * v6 + b7 * v7)
            out[p2 + i] = (c0 * v0 + c1 * v1 + c2 * v2 + c3 * v3
                           + c4 * v4 + c5 * v5 + c6 * v6 + c7 * v7)
            out[p3 + i] = (d0 * v0 + d1 * v1 + d2 * v2 + d3 * v3
                           + d4 * v4 + d5 * v5 + d6 * v6 + d7 * v7)
        p4 = p3 + n
        p5 = p4 + n
        p6 = p5 + n
        p7 = p6 + n
        for i in range(n):
            v0, v1, v2, v3 = imag[s0 + i], imag[s1 + i], imag[s2 + i], imag[s3 + i]
            v4, v5, v6, v7 = imag[s4 + i], imag[s5 + i], imag[s6 + i], imag[s7 + i]
            out[p4 + i] = (a0 * v0 + a1 * v1 + a2 * v2 + a3 * v3
                           + a4 * v4 + a5 * v5 + a6 * v6 + a7 * v7)
            out[p5 + i] = (b0 * v0 + b1 * v1 + b2 * v2 + b3 * v3
                           + b4 * v4 + b5 * v5 + b6 * v6 + b7 * v7)
            out[p6 + i] = (c0 * v0 + c1 * v1 + c2 * v2 + c3 * v3
                           + c4 * v4 + c5 * v5 + c6 * v6 + c7 * v7)
            out[p7 + i] = (d0 * v0 + d1 * v1 + d2 * v2 + d3 * v3
                           + d4 * v4 + d5 * v5 + d6 * v6 + d7 * v7)
