# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Encode doubles, nanoseconds and integers in float32 fields without loss of precision.

A float32 holds 24 significant bits: 128 s of a present-day time in seconds, half a metre of a
position at Earth radius. A value therefore travels as the sum of two floats, high and low, or
as 16-bit limbs, each a whole number that a float32 holds exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .errors import WireFormatError

LIMB = 1 << 16
NANOSECONDS_PER_SECOND = 1e9
MAX_OFFSET_NS = 1 << 48  # 78 hours: up to here `join_nanoseconds` returns every nanosecond


def split_double(values: ArrayLike) -> np.ndarray:
    """Split doubles into pairs of floats whose sum keeps 48 significant bits.

    The relative error is at most ``2**-48`` for magnitudes above ``1e-30``. Splitting a joined
    value again returns it unchanged, so that values do not drift from stage to stage.

    Parameters
    ----------
    values : (...) float64
        Finite numbers.

    Returns
    -------
    (..., 2) float32
        High and low part.

    Raises
    ------
    WireFormatError
        A value exceeds the range of float32, about 3.4e38.
    """
    values = np.asarray(values, np.float64)
    with np.errstate(over='ignore', invalid='ignore'):
        high = values.astype(np.float32)
        rounded = high + (values - high).astype(np.float32).astype(np.float64)
        # Rounding the low part may have made a tie for the high part: splitting the rounded
        # value settles it, and makes the split a fixed point of split and join.
        pairs = np.empty((*values.shape, 2), np.float32)
        pairs[..., 0] = rounded
        pairs[..., 1] = rounded - pairs[..., 0]
    if not np.isfinite(pairs).all():
        raise WireFormatError(f'largest magnitude {np.max(np.abs(values))} does not fit; expected '
                              'finite numbers below 3.4e38; give the value in its SI unit')
    return pairs


def join_double(pairs: np.ndarray) -> np.ndarray:
    """Sum of high and low parts: (..., 2) float32 to (...) float64, without rounding."""
    return pairs[..., 0].astype(np.float64) + pairs[..., 1]


def split_nanoseconds(offset_ns: np.ndarray) -> np.ndarray:
    """Split whole nanoseconds into pairs of floats in seconds.

    A float times 1e9 is exact in float64 (24 + 21 bits), hence the remainder after the high part
    is exact too, and the low part rounds by less than half a nanosecond up to `MAX_OFFSET_NS`.

    Parameters
    ----------
    offset_ns : (...) int64
        Offsets, nanoseconds, at most `MAX_OFFSET_NS` in magnitude.

    Returns
    -------
    (..., 2) float32
        High and low part, seconds.
    """
    offset = np.asarray(offset_ns).astype(np.float64)
    pairs = np.empty((*offset.shape, 2), np.float32)
    pairs[..., 0] = offset / NANOSECONDS_PER_SECOND
    remainder = offset - pairs[..., 0].astype(np.float64) * NANOSECONDS_PER_SECOND
    pairs[..., 1] = remainder / NANOSECONDS_PER_SECOND
    return pairs


def join_nanoseconds(pairs: np.ndarray) -> np.ndarray:
    """Whole nanoseconds, as (...) float64, of (..., 2) float32 pairs in seconds."""
    nanoseconds = pairs.astype(np.float64) * NANOSECONDS_PER_SECOND  # exact: 24 + 21 bits
    return np.rint(nanoseconds[..., 0] + nanoseconds[..., 1])


def split_limbs(value: int, n_limbs: int) -> list[int]:
    """16-bit limbs of an integer, least significant first, two's complement when negative."""
    return [(value >> 16 * i) & (LIMB - 1) for i in range(n_limbs)]


def join_int64(limbs: np.ndarray) -> int:
    """Signed integer of four limbs, least significant first."""
    value = sum(int(limb) << 16 * i for i, limb in enumerate(limbs))
    return value - (1 << 64) if value >= 1 << 63 else value


def are_limbs(values: np.ndarray) -> bool:
    """True when every value is a whole number of 0 to 65535."""
    return bool(((values >= 0) & (values < LIMB) & (values == np.floor(values))).all())
