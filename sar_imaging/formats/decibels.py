"""Amplitudes for people to look at: decibels, and eight bits of them."""

from __future__ import annotations

import numpy as np

_BELOW_CLUTTER_DB = 5.0
_LEAST_RANGE_DB, _MOST_RANGE_DB = 30.0, 60.0
_WHITE = 0.999  # of the pixels are darker


def decibels(samples: np.ndarray) -> np.ndarray:
    """float32 amplitude, dB; NaN where a sample is 0 or not finite."""
    power = np.square(samples.real, dtype=np.float64) + np.square(samples.imag, dtype=np.float64)
    known = np.isfinite(power) & (power > 0)
    out = np.full(samples.shape, np.nan, np.float32)
    out[known] = 10 * np.log10(power[known])
    return out


def limits_db(levels_db: np.ndarray) -> tuple[float, float]:
    """What becomes black and what white.

    White is what a thousandth of the pixels exceeds. Black is 5 dB below the median, which is
    the clutter, but 30 to 60 dB below white.

    Returns
    -------
    black, white : float
        dB; -60 and 0 for an image without any known level.
    """
    known = levels_db[np.isfinite(levels_db)]
    if not known.size:
        return -_MOST_RANGE_DB, 0.0
    white = float(np.quantile(known, _WHITE))
    black = float(np.median(known)) - _BELOW_CLUTTER_DB
    return float(np.clip(black, white - _MOST_RANGE_DB, white - _LEAST_RANGE_DB)), white


def grey_levels(levels_db: np.ndarray, black_db: float, white_db: float) -> np.ndarray:
    """uint8 of decibels: 1 for black and less, 255 for white and more, 0 for NaN."""
    scaled = 1 + 254 * (levels_db - black_db) / (white_db - black_db)
    return np.where(np.isfinite(levels_db), np.clip(np.rint(scaled), 1, 255), 0).astype(np.uint8)
