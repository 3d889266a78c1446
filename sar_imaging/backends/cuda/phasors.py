# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phases in cycles on the device, float32: what the kernels share."""

from __future__ import annotations

import math

import numpy as np

from .arrays import function

HALF = np.float32(0.5)

# exp(j 2 pi c) for |c| <= 1/2 as minimax polynomials in c^2; rms error 4e-6 (sine), 6e-7 (cosine),
# as on the processor
_S1, _S3, _S5, _S7, _S9 = (np.float32(v) for v in (
    6.2830558, -41.33121428, 81.36681482, -74.47800122, 32.78139356))
_C0, _C2, _C4, _C6, _C8, _C10 = (np.float32(v) for v in (
    0.99999922, -19.73898258, 64.92872795, -85.27240902, 58.79408621, -21.07685034))


@function
def fraction(cycles):
    """Cycles, float64, less whole ones: from -1/2 on, below 1/2."""
    return cycles - math.floor(cycles + 0.5)


@function
def short_fraction(cycles):
    """The same of float32."""
    return cycles - np.float32(math.floor(cycles + HALF))


@function
def phasor(cycles):
    """Cosine and sine of a fraction of a cycle, float32."""
    x = cycles * cycles
    return (_C0 + x * (_C2 + x * (_C4 + x * (_C6 + x * (_C8 + x * _C10)))),
            cycles * (_S1 + x * (_S3 + x * (_S5 + x * (_S7 + x * _S9)))))
