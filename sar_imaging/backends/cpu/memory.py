# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Memory that calls share, and how it lies.

Fresh memory for every few profiles or images costs as much as filling it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compilation import njit, numba

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

_LINE, _PAGE = 64, 4096  # bytes of a line of the cache and of a page of memory


def plain(*arrays: np.ndarray) -> Iterator[np.ndarray]:
    """Contiguous arrays that can be written to: kernels would be compiled once more for others.

    Those of messages are read-only, and those of some channels are not contiguous.
    """
    return (np.require(array, requirements=['C', 'W']) for array in arrays)


class WorkSpace:
    """Named buffers, grown when needed and valid until they are asked for again."""

    def __init__(self) -> None:
        self._buffers: dict[str, np.ndarray] = {}
        # what a buffer's contents are, as its writer says
        self.layouts: dict[str, tuple[Any, ...]] = {}

    def __call__(self, name: str, shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
        """Contiguous array of any contents."""
        size = math.prod(shape)
        if name not in self._buffers or self._buffers[name].size < size:
            self._buffers[name] = aligned_empty((size,), dtype)
            self.layouts.pop(name, None)
        return self._buffers[name][:size].reshape(shape)


def aligned_empty(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """Array of any contents in which no vector of a kernel straddles two lines of the cache."""
    return _aligned(np.empty, shape, dtype)


def aligned_zeros(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """The same of zeros; all threads together get them from the system, one takes longer."""
    memory = _aligned(np.zeros, shape, dtype)
    _touch(memory.reshape(-1).view(np.uint8))
    return memory


def _aligned(allocate: Callable[[int, type[np.uint8]], np.ndarray], shape: tuple[int, ...],
             dtype: DTypeLike) -> np.ndarray:
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = allocate(size + _LINE, np.uint8)
    start = -memory.ctypes.data % _LINE
    return memory[start:start + size].view(dtype).reshape(shape)


@njit(parallel=True)
def _touch(zeros):
    for page in numba.prange(len(zeros) // _PAGE):
        zeros[page * _PAGE] = 0
