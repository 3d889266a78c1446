# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Gaussian random numbers that are the same on every machine and with every version of NumPy.

NumPy keeps the raw stream of a bit generator for ever, but not that of `Generator.normal`; a
recording that must be reproducible bit for bit therefore makes its own from the raw stream.
"""

from __future__ import annotations

import numpy as np


def complex_gaussian(seed: int, stream: int, n: int) -> np.ndarray:
    """Circular complex Gaussian numbers by the transformation of Box and Muller.

    Parameters
    ----------
    seed : int
        Seed, not negative.
    stream : int
        Number of an independent stream of that seed, not negative, such as the pulse's.
    n : int
        How many.

    Returns
    -------
    (n,) complex128
        Mean zero, variance one (a half in the real and in the imaginary part).
    """
    bits = np.random.PCG64(np.random.SeedSequence([seed, stream]))
    # 53 bits, moved off zero by half a step for the logarithm.
    uniform = ((bits.random_raw(2 * n) >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53
    radius = np.sqrt(-np.log(uniform[::2]))
    angle = 2 * np.pi * uniform[1::2]
    return radius * (np.cos(angle) + 1j * np.sin(angle))


def gaussian(seed: int, stream: int, n: int) -> np.ndarray:
    """``(n,)`` float64 Gaussian numbers of mean zero and variance one, see `complex_gaussian`."""
    return complex_gaussian(seed, stream, n).real * np.sqrt(2.0)
