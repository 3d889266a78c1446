"""Objects that NumPy and arithmetic take for the array of samples that they hold."""

from __future__ import annotations

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin


class HeldSamples(NDArrayOperatorsMixin):
    """Base of what holds `samples`: operators and functions of NumPy act on them, and give arrays.

    ``held /= n`` changes the samples in place.
    """

    __hash__ = object.__hash__  # each is itself, whatever == says of its samples

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.array(self.samples, dtype=dtype, copy=bool(copy) or (
            dtype is not None and np.dtype(dtype) != self.samples.dtype))

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **options):
        if out is not None:
            options['out'] = tuple(map(_samples, out))
        result = getattr(ufunc, method)(*map(_samples, inputs), **options)
        return result if out is None else out[0] if len(out) == 1 else out


def _samples(value):
    return value.samples if isinstance(value, HeldSamples) else value
