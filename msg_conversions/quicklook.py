# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Amplitudes as grey levels for people to look at."""

from __future__ import annotations

import math

import numpy as np

MAX_DYNAMIC_RANGE_DB = 200.0
ANCHORS = CLUTTER, PEAK = ('clutter', 'peak')  # what the brightness of a quicklook refers to
FLOOR_DB = 10.0  # below the median, where a quicklook is black: 7 % of speckle lie lower
_MOST_FOR_MEDIAN = 2**18  # pixels; of larger images every k-th, good to 0.01 dB


def quicklook(amplitude: np.ndarray, dynamic_range_db: float, anchor: str = PEAK) -> np.ndarray:
    """Amplitude in dB, mapped linearly to 0..255.

    Anchored at the peak, the brightest pixel decides about all others, and beside a corner
    reflector clutter is black. Anchored at the clutter, whose level is the median, clutter is dark
    grey beside whatever else there is.

    Parameters
    ----------
    amplitude : (n_y, n_x) float
        Linear amplitude, finite, not negative.
    dynamic_range_db : float
        From what becomes 0 to what becomes 255 and more; dB, above 0, at most 200.
    anchor : str
        ``'peak'``: the maximum becomes 255. ``'clutter'``: what is `FLOOR_DB` below the median of
        the pixels that are not zero becomes 0, and the maximum 255 where it is nearer than
        `dynamic_range_db`.

    Returns
    -------
    (n_y, n_x) uint8
        All zeros where the image is all zeros.

    Raises
    ------
    ValueError
        The image is empty, its maximum is not finite, the dynamic range is out of bounds, or the
        anchor is unknown.
    """
    if anchor not in ANCHORS:
        raise ValueError(f'anchor={anchor!r} is unknown; use one of {", ".join(ANCHORS)}')
    amplitude = np.asarray(amplitude, np.float32)
    if not 0 < dynamic_range_db <= MAX_DYNAMIC_RANGE_DB:
        raise ValueError(f'dynamic_range_db={dynamic_range_db}; expected above 0 and at most '
                         f'{MAX_DYNAMIC_RANGE_DB:g}; 40 to 80 suits most scenes')
    if amplitude.size == 0:
        raise ValueError(f'amplitude.shape={amplitude.shape} is empty; expected at least one '
                         'pixel')
    peak = amplitude.max()
    if not np.isfinite(peak):
        raise ValueError(f'largest amplitude is {peak}; expected finite amplitudes; check the '
                         'samples that the image was formed from')
    if peak <= 0:
        return np.zeros(amplitude.shape, np.uint8)
    white_db = 0.0  # over the peak
    if anchor == CLUTTER:
        floor_db = _median_db(amplitude, peak) - FLOOR_DB
        white_db = min(0.0, floor_db + dynamic_range_db)
        dynamic_range_db = white_db - floor_db
    levels = np.maximum(amplitude / peak, np.float32(10 ** ((white_db - dynamic_range_db) / 20)))
    np.log10(levels, out=levels)
    levels *= 255 * 20 / dynamic_range_db
    levels += 255 * (1 - white_db / dynamic_range_db)
    np.minimum(levels, 255, out=levels)
    return np.rint(levels, out=levels).astype(np.uint8)


def _median_db(amplitude: np.ndarray, peak: np.floating) -> float:
    """Median of the amplitudes that are not zero over the largest one, dB, no less than -250."""
    some = amplitude.ravel()[::-(-amplitude.size // _MOST_FOR_MEDIAN)]
    if not (some > 0).any():
        some = amplitude
    median = np.median(some[some > 0].astype(np.float64))  # a mean of two: no overflow
    return max(20 * math.log10(median / float(peak)), -250.0)
