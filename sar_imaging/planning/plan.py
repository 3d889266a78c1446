# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What all plans have in common: predicted error by cause, and comparison by value.

Errors are mean squares relative to the power of the image, in dB. Those of different causes are
independent: they add as powers. Float32 arithmetic leaves some of a target at best.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

SINCOS_ERROR_DB = -108.0  # phasors of the carrier from polynomials, float32 (measured)
ACCUMULATION_ERROR_DB = -112.0  # sums of pulses in float32 (measured)
PASSES_DB = 3.0  # by which one of two passes to a map errs less than both


def total_db(*errors_db: float) -> float:
    """Sum of independent errors and of what float32 arithmetic adds, dB."""
    errors_db = (*errors_db, SINCOS_ERROR_DB, ACCUMULATION_ERROR_DB)
    return 10 * math.log10(sum(10 ** (error / 10) for error in errors_db))


def with_chance(errors_db: Mapping[str, float], more_db: float) -> dict[str, float]:
    """Errors by cause, dB, and that of chance, by which all together grow by `more_db`."""
    chance_db = total_db(*errors_db.values()) + 10 * math.log10(10 ** (more_db / 10) - 1)
    return {**errors_db, 'chance': chance_db}


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


class Plan:
    """A frozen description of what will be computed.

    Plans are equal where all that they hold is, arrays element by element, so that they can be
    compared after a journey to another machine.
    """

    if TYPE_CHECKING:  # dataclasses would take a property for the value of a field
        @property
        def errors_db(self) -> Mapping[str, float]:
            """Predicted error against time-domain correlation by cause, dB."""

    @property
    def predicted_error_db(self) -> float | None:
        """Predicted error against time-domain correlation, dB; None where a cause is NaN."""
        total = total_db(*self.errors_db.values())
        return total if total == total else None

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and _same(self, other)

    __hash__: ClassVar[None]  # type: ignore[assignment]  # as typeshed has it
    __hash__ = None


_BY_IDENTITY: Any = object.__eq__  # as of objects that tell nothing else


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind in 'fc')
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(_same, a, b))
    if dataclasses.is_dataclass(a):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if type(a).__eq__ is _BY_IDENTITY and hasattr(a, '__dict__'):
        return _same(vars(a), vars(b))
    return a == b
