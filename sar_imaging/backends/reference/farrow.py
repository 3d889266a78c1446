# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Weights of the polynomial interpolators of plans (Farrow 1988)."""

from __future__ import annotations

import numpy as np

from ...planning.interpolators import Interpolator


def neighbours(interpolator: Interpolator, place: np.ndarray, n_samples: int
               ) -> tuple[np.ndarray, np.ndarray]:
    """Samples that are read for some places, and their weights.

    ``s(n + t) = sum_k c_k(t) s[n + first + k]`` with polynomials ``c_k(t) = sum_q w[q, k] t^q``:
    a Farrow structure, whose weights w and error the plan has.

    Parameters
    ----------
    interpolator : Interpolator
        From a plan.
    place : (...) float64
        Places ``n + t`` in samples. Where neighbours are missing, the last place that has all.
    n_samples : int
        Number of samples.

    Returns
    -------
    index : (..., taps) int64
        Indices of the samples.
    weights : (..., taps) float64
    """
    lowest, highest = -interpolator.first, n_samples - interpolator.n_taps - interpolator.first
    place = np.clip(place, lowest, highest + 1)
    n = np.minimum(np.floor(place).astype(int), highest)
    powers = (place - n)[..., None] ** np.arange(len(interpolator.weights))
    index = n[..., None] + interpolator.first + np.arange(interpolator.n_taps)
    return index, powers @ interpolator.weights.astype(np.float64)
