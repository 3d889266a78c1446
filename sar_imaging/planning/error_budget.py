"""How errors of an image add up, and what float32 arithmetic leaves of a target at best.

Errors are mean squares relative to the power of the image, in dB. Those of different causes are
independent: they add as powers.
"""

from __future__ import annotations

import math

SINCOS_ERROR_DB = -108.0  # phasors of the carrier from polynomials, float32 (measured)
ACCUMULATION_ERROR_DB = -112.0  # sums of pulses in float32 (measured)


def total_db(*parts_db: float) -> float:
    """Sum of independent errors and of what float32 arithmetic adds, dB."""
    parts = (*parts_db, SINCOS_ERROR_DB, ACCUMULATION_ERROR_DB)
    return 10 * math.log10(sum(10 ** (p / 10) for p in parts))


def remaining_db(target_db: float, *parts_db: float) -> float:
    """What independent errors leave of a target, dB."""
    return 10 * math.log10(10 ** (target_db / 10) - sum(10 ** (p / 10) for p in parts_db))
