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
class PolynomialInterpolator:
    """Weights that turn samples into cubic polynomials.

    Between samples n and n + 1, ``s(n + t) = sum_q (sum_k weights[q, k] s[n + k + first]) t^q``.

    Parameters
    ----------
    weights : (4, 8) float32
        Weight of each of the eight neighbouring samples in each coefficient.
    first : int
        Offset of the first neighbour.
    error_db : float
        Mean squared error over band and interval relative to the signal's power, dB.
    """

    weights: np.ndarray
    first: int
    error_db: float


def design_interpolator(oversampling: float, margin: float = 0.0) -> PolynomialInterpolator:
    """Least-squares cubic interpolator for a band-limited signal.

    Parameters
    ----------
    oversampling : float
        Sample rate over two-sided bandwidth, above 1.
    margin : float
        The polynomial is used for ``-margin <= t <= 1 + margin``, in samples.

    Returns
    -------
    PolynomialInterpolator

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
                   math.ceil(margin * 100) / 100)


@functools.lru_cache(maxsize=256)
def _design(oversampling, margin):
    x, fw = np.polynomial.legendre.leggauss(48)
    f = x / (2 * oversampling)
    y, tw = np.polynomial.legendre.leggauss(32)
    t = 0.5 + y * (0.5 + margin)
    first = 1 - TAPS // 2
    samples = np.exp(2j * np.pi * np.outer(f, np.arange(TAPS) + first))
    powers = (t[:, None] - 0.5) ** np.arange(DEGREE + 1)  # centred: better conditioned
    weight = np.sqrt(fw[:, None] * tw / 4)[..., None]
    model = np.einsum('fk,tq->ftqk', samples, powers).reshape(f.size, t.size, -1) * weight
    wanted = np.exp(2j * np.pi * np.outer(f, t)) * weight[..., 0]
    a, b = (v.reshape(f.size * t.size, -1) for v in (model, wanted))
    a, b = np.concatenate([a.real, a.imag]), np.concatenate([b.real, b.imag])[:, 0]
    solution = np.linalg.lstsq(a, b, rcond=1e-13)[0]
    error = float(np.sum((a @ solution - b) ** 2))
    centred = solution.reshape(DEGREE + 1, TAPS)
    weights = np.zeros_like(centred)
    for q in range(DEGREE + 1):  # expand (t - 1/2)^q
        for p in range(q + 1):
            weights[p] += math.comb(q, p) * (-0.5) ** (q - p) * centred[q]
    return PolynomialInterpolator(weights.astype(np.float32), first, 10 * math.log10(error))


@njit(parallel=True)
def polynomial_planes(dense, first_cell, weights, first, out):
    """Coefficients of every interval of a phase-major lattice.

    Parameters
    ----------
    dense : (R, U, n) complex64
        Samples of R profiles; sample ``U * cell + phase`` stands at ``[phase, cell]``.
    first_cell : int
        Lattice cell that becomes cell 0 of the output (may lie outside the lattice).
    weights : (4, 8) float32
        Weights of `PolynomialInterpolator`.
    first : int
        Offset of the first neighbour.
    out : (R, U, 8, m) float32
        Planes of real, then imaginary coefficients of each phase; zero outside the profile.
    """
    n_rows, n_phases, n = dense.shape
    n_taps = weights.shape[1]
    for row in numba.prange(n_rows):
        for phase in range(n_phases):
            planes = out[row, phase]
            planes[:] = 0.0
            for k in range(n_taps):
                step = phase + k + first
                source = dense[row, step % n_phases]
                shift = first_cell + step // n_phases
                lo = max(0, -shift)
                hi = min(planes.shape[1], n - shift)
                for q in range(weights.shape[0]):
                    w = weights[q, k]
                    for cell in range(lo, hi):
                        planes[q, cell] += w * source[cell + shift].real
                        planes[q + 4, cell] += w * source[cell + shift].imag
