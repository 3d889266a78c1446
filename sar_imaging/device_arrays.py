# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays in the memory of a CUDA device, told from NumPy's without importing anything of CUDA.

They are CuPy's. NumPy's functions that take arrays work on them, on the device; `numpy.asarray`
and the like refuse them, so that no sample crosses the bus by mistake. Annotations call both
`numpy.ndarray`.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np


def on_device(array: object) -> bool:
    """Whether an array lies in the memory of a CUDA device."""
    return hasattr(type(array), '__cuda_array_interface__') and hasattr(type(array), 'get')


def beside(array: np.ndarray, other: object) -> np.ndarray:
    """An array as it lies beside another: copied to the device where that one lies there."""
    if on_device(other) and not on_device(array):
        return np.asarray(array, like=cast(Any, other))
    return array


def alike(array: np.ndarray, other: object) -> np.ndarray:
    """An array where another one lies: on the device or in the memory of the host."""
    return beside(array, other) if on_device(other) else to_host(array)


def contiguous(array: np.ndarray) -> np.ndarray:
    """An array contiguous in C order, where it lies."""
    if on_device(array):
        return array if array.flags.c_contiguous else array.copy()
    return np.ascontiguousarray(array)


def zeros_beside(shape: tuple[int, ...], other: object) -> np.ndarray:
    """Zeros, complex64, on the device where another array lies there; contiguous in C order."""
    return np.zeros(shape, np.complex64, **cast(Any, {'like': other} if on_device(other) else {}))


def to_host(array: Any) -> np.ndarray:
    """An array of the device as a copy of the host, one of the host as it is."""
    return array.get() if on_device(array) else array


def are_finite(samples: np.ndarray) -> bool:
    """Whether no sample, float32 or complex64 of the host or the device, is NaN or infinite.

    One pass over the samples without a temporary, about 10 GB/s on a processor.
    """
    # A sum is finite only if all its terms are; it may overflow, hence a closer look.
    with np.errstate(over='ignore', invalid='ignore'):
        if on_device(samples):
            return bool(np.isfinite(samples.sum().item()) or np.isfinite(samples).all())
        values = np.ascontiguousarray(samples).view(np.float32).ravel()
        return math.isfinite(np.einsum('i->', values)) or bool(np.isfinite(values).all())
