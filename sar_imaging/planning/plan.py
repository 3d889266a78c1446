"""What all plans have in common: predicted error by cause, and comparison by value."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from .error_budget import total_db


class Plan:
    """A frozen description of what will be computed.

    Plans are equal where all that they hold is, arrays element by element, so that they can be
    compared after a journey to another machine.
    """

    errors_db: Mapping[str, float]

    @property
    def predicted_error_db(self) -> float | None:
        """Predicted error against time-domain correlation, dB; None where a cause is NaN."""
        total = total_db(*self.errors_db.values())
        return total if total == total else None

    def __eq__(self, other) -> bool:
        return type(self) is type(other) and _same(self, other)

    __hash__ = None


def _same(a, b) -> bool:
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
    if type(a).__eq__ is object.__eq__ and hasattr(a, '__dict__'):
        return _same(vars(a), vars(b))
    return a == b
