# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Objects that NumPy and arithmetic take for the array of samples that they hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin


class HeldSamples(NDArrayOperatorsMixin):
    """Base of what holds `samples`: operators, indices and functions of NumPy act on them.

    They give arrays; ``held /= n`` and ``held[i] = n`` change the samples in place.
    """

    samples: np.ndarray

    __hash__ = object.__hash__  # each is itself, whatever == says of its samples

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.samples, dtype=dtype, copy=bool(copy) or (
            dtype is not None and np.dtype(dtype) != self.samples.dtype))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None,
                        **options: Any) -> Any:
        if out is not None:
            options['out'] = tuple(map(_samples, out))
        result = getattr(ufunc, method)(*map(_samples, inputs), **options)
        return result if out is None else out[0] if len(out) == 1 else out

    def __getitem__(self, index: Any) -> Any:
        return self.samples[index]

    def __setitem__(self, index: Any, value: Any) -> None:
        self.samples[index] = _samples(value)

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the samples."""
        return self.samples.shape

    @property
    def ndim(self) -> int:
        """Number of axes of the samples."""
        return self.samples.ndim

    @property
    def size(self) -> int:
        """Number of samples."""
        return self.samples.size

    @property
    def dtype(self) -> np.dtype:
        """Of the samples."""
        return self.samples.dtype

    @property
    def real(self) -> np.ndarray:
        """Real parts of the samples."""
        return self.samples.real

    @property
    def imag(self) -> np.ndarray:
        """Imaginary parts of the samples."""
        return self.samples.imag


def _samples(value: Any) -> Any:
    return value.samples if isinstance(value, HeldSamples) else value
