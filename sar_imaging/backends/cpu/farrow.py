"""Compiled loop that turns samples of range profiles into polynomials, interval by interval.

The polynomials are those of `planning.interpolators` (Farrow 1988).
"""

from __future__ import annotations

import numpy as np

from ...compilation import njit, numba
from ...planning.interpolators import TAPS


def farrow_coefficients(real, imag, weights, first, pad, out):
    """Coefficients of every interval of a phase-major lattice.

    Parameters
    ----------
    real, imag : (R, U, n - 2 * pad + 2 * TAPS) float32
        Samples of R profiles; sample ``U * (cell - pad) + phase`` stands at
        ``[phase, cell - pad + TAPS]``.
    weights : (degree + 1, TAPS) float32
        Weights of `Interpolator`.
    first : int
        Offset of the first neighbour.
    pad : int
        Cells at both ends that are zero.
    out : (R, U, 2 * (degree + 1), n) float32
        Planes of real, then imaginary coefficients of each phase.
    """
    n_phases, length = real.shape[1:]
    step = np.arange(n_phases)[:, None] + np.arange(TAPS) + first
    start = (step % n_phases) * length + step // n_phases + TAPS
    _weighted_sums(real.reshape(-1), imag.reshape(-1), real.shape, start, weights, pad,
                   out.shape[3], out.reshape(-1))


@njit(parallel=True)
def _weighted_sums(real, imag, shape, start, weights, pad, count, out):
    """Rows and phases in parallel; free of views for the compiler, see `kernels`."""
    n_rows, n_phases, length = shape
    n, n_coefficients = np.uint64(count), len(weights)
    ends, inside = np.uint64(pad), np.uint64(count - 2 * pad)
    for task in numba.prange(n_rows * n_phases):
        row, phase = task // n_phases, task % n_phases
        base = row * n_phases * length
        s0, s1 = np.uint64(base + start[phase, 0]), np.uint64(base + start[phase, 1])
        s2, s3 = np.uint64(base + start[phase, 2]), np.uint64(base + start[phase, 3])
        s4, s5 = np.uint64(base + start[phase, 4]), np.uint64(base + start[phase, 5])
        s6, s7 = np.uint64(base + start[phase, 6]), np.uint64(base + start[phase, 7])
        s8, s9 = np.uint64(base + start[phase, 8]), np.uint64(base + start[phase, 9])
        for plane in range(2 * n_coefficients):
            to = np.uint64(task * 2 * n_coefficients + plane) * n
            for i in range(ends):
                out[to + i] = 0.0
                out[to + n - ends + i] = 0.0
        for q in range(n_coefficients):
            w0, w1, w2, w3 = weights[q, 0], weights[q, 1], weights[q, 2], weights[q, 3]
            w4, w5, w6, w7 = weights[q, 4], weights[q, 5], weights[q, 6], weights[q, 7]
            w8, w9 = weights[q, 8], weights[q, 9]
            to = np.uint64(task * 2 * n_coefficients + q) * n + ends
            for i in range(inside):
                out[to + i] = (w0 * real[s0 + i] + w1 * real[s1 + i] + w2 * real[s2 + i]
                               + w3 * real[s3 + i] + w4 * real[s4 + i] + w5 * real[s5 + i]
                               + w6 * real[s6 + i] + w7 * real[s7 + i] + w8 * real[s8 + i]
                               + w9 * real[s9 + i])
            to += np.uint64(n_coefficients) * n
            for i in range(inside):
                out[to + i] = (w0 * imag[s0 + i] + w1 * imag[s1 + i] + w2 * imag[s2 + i]
                               + w3 * imag[s3 + i] + w4 * imag[s4 + i] + w5 * imag[s5 + i]
                               + w6 * imag[s6 + i] + w7 * imag[s7 + i] + w8 * imag[s8 + i]
                               + w9 * imag[s9 + i])
