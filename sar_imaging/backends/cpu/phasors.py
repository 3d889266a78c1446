# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phases in cycles, float32: what the compiled loops share."""

from __future__ import annotations

import numpy as np

from ...compilation import njit

# exp(j 2 pi c) for |c| <= 1/2 as minimax polynomials in c^2, highest power first; rms error 4e-6
# (sine), 6e-7 (cosine)
SINES = tuple(np.float32(v) for v in (
    32.78139356, -74.47800122, 81.36681482, -41.33121428, 6.2830558))
COSINES = tuple(np.float32(v) for v in (
    -21.07685034, 58.79408621, -85.27240902, 64.92872795, -19.73898258, 0.99999922))
_S9, _S7, _S5, _S3, _S1 = SINES
_C10, _C8, _C6, _C4, _C2, _C0 = COSINES


@njit(inline='always')
def fraction(cycles):
    """Cycles less whole ones."""
    return cycles - np.rint(cycles)


@njit(inline='always')
def sin_cycles(c, x):
    """Sine of a fraction of a cycle whose square is x."""
    return c * (_S1 + x * (_S3 + x * (_S5 + x * (_S7 + x * _S9))))


@njit(inline='always')
def cos_cycles(x):
    """Cosine of a fraction of a cycle whose square is x."""
    return _C0 + x * (_C2 + x * (_C4 + x * (_C6 + x * (_C8 + x * _C10))))
