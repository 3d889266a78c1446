"""How errors of an image add up, and what float32 arithmetic leaves of a target at best.

Errors are mean squares relative to the power of the image, in dB. Those of different causes are
independent: they add as powers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

SINCOS_ERROR_DB = -108.0  # phasors of the carrier from polynomials, float32 (measured)
ACCUMULATION_ERROR_DB = -112.0  # sums of pulses in float32 (measured)
PASSES_DB = 3.0  # by which one of two passes to a map errs less than both


def total_db(*errors_db: float) -> float:
    """Sum of independent errors and of what float32 arithmetic adds, dB."""
    errors_db = (*errors_db, SINCOS_ERROR_DB, ACCUMULATION_ERROR_DB)
    return 10 * math.log10(sum(10 ** (error / 10) for error in errors_db))


def remaining_db(target_db: float, *errors_db: float) -> float:
    """What independent errors leave of a target, dB."""
    return 10 * math.log10(10 ** (target_db / 10) - sum(10 ** (error / 10) for error in errors_db))


def error_budget(target_db: float, shares: Mapping[str, float]) -> dict[str, float]:
    """Largest error of each cause, dB: `shares` tell by how much less than all it may err, dB."""
    return {cause: target_db - share for cause, share in shares.items()}


#: Of exact backprojection: half of the target goes to reading the profiles, which takes the time.
EXACT_SHARES = MappingProxyType({'range profiles': 3.0, 'polar to map': 5.0,
                                 'azimuth upsampling': 8.0, 'rounded paths': 6.0,
                                 'illumination': 9.0})
#: Of AFBP, whose fusion gets what is left.
AFBP_SHARES = MappingProxyType({'sub-aperture images': 6.0, 'polar to map': 5.0,
                                'illumination': 7.0})
#: Of AFBP while pulses arrive: phase gradient autofocus does better on finer lines.
LIVE_SHARES = MappingProxyType({'sub-aperture images': 6.0, 'polar to map': 10.0})
