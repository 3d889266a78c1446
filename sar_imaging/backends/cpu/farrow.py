"""Compiled loop that turns samples of range profiles into polynomials, interval by interval.

The polynomials are those of `planning.interpolators` (Farrow 1988).
"""

from __future__ import annotations

import numpy as np

from ...compilation import njit, numba
from ...planning.interpolators import TAPS


def farrow_coefficients(samples, weights, first, pad, out):
    """Coefficients of every interval of a phase-major lattice.

    Parameters
    ----------
    samples : (2, R, U, n - 2 * pad + 2 * TAPS) float32
        Real and imaginary part of R profiles; sample ``U * (cell - pad) + phase`` stands at
        ``[phase, cell - pad + TAPS]``. Contiguous.
    weights, first : (degree + 1, TAPS) float32, int
        Of `Interpolator`.
    pad : int
        Cells at both ends that are zero.
    out : (R, U, 2 * (degree + 1), n) float32
        Planes of real, then imaginary coefficients of each phase.
    """
    n_phases, length = samples.shape[2:]
    step = np.arange(n_phases)[:, None] + np.arange(TAPS) + first
    start = (step % n_phases) * length + step // n_phases + TAPS
    _weighted_sums(samples.reshape(-1), samples.shape, start, weights, pad, out.shape[3],
                   out.reshape(-1))


@njit(parallel=True)
def _weighted_sums(samples, shape, start, weights, pad, count, out):
    """Echoes and phases in parallel; free of views for the compiler, see `line_kernels`."""
    _, n_echoes, n_phases, length = shape
    n, n_coefficients = np.uint64(count), len(weights)
    ends, inside = np.uint64(pad), np.uint64(count - 2 * pad)
    for task in numba.prange(n_echoes * n_phases):
        echo, phase = task // n_phases, task % n_phases
        for part in range(2):
            base = (part * n_echoes + echo) * n_phases * length
            s0, s1 = np.uint64(base + start[phase, 0]), np.uint64(base + start[phase, 1])
            s2, s3 = np.uint64(base + start[phase, 2]), np.uint64(base + start[phase, 3])
            s4, s5 = np.uint64(base + start[phase, 4]), np.uint64(base + start[phase, 5])
            s6, s7 = np.uint64(base + start[phase, 6]), np.uint64(base + start[phase, 7])
            s8, s9 = np.uint64(base + start[phase, 8]), np.uint64(base + start[phase, 9])
            for q in range(n_coefficients):
                w0, w1, w2, w3 = weights[q, 0], weights[q, 1], weights[q, 2], weights[q, 3]
                w4, w5, w6, w7 = weights[q, 4], weights[q, 5], weights[q, 6], weights[q, 7]
                w8, w9 = weights[q, 8], weights[q, 9]
                to = np.uint64((task * 2 + part) * n_coefficients + q) * n
                for i in range(ends):
                    out[to + i] = 0.0
                    out[to + n - ends + i] = 0.0
                to += ends
                for i in range(inside):
                    out[to + i] = (w0 * samples[s0 + i] + w1 * samples[s1 + i]
                                   + w2 * samples[s2 + i] + w3 * samples[s3 + i]
                                   + w4 * samples[s4 + i] + w5 * samples[s5 + i]
                                   + w6 * samples[s6 + i] + w7 * samples[s7 + i]
                                   + w8 * samples[s8 + i] + w9 * samples[s9 + i])
