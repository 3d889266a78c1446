# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Layouts of a std_msgs/Float32MultiArray and the checks of all readers, without ROS."""

from __future__ import annotations

import dataclasses
import math
import reprlib
from array import array
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from .errors import WireFormatError

DEFAULT_MAX_ELEMENTS = 2**26  # floats of content: 256 MiB
Dims = Sequence[tuple[str, int, int]]
Data: TypeAlias = 'array[float] | np.ndarray'  # of a message


@dataclasses.dataclass(frozen=True)
class Layout:
    """Dimensions of complex numbers in an array of floats.

    Parameters
    ----------
    labels : tuple of str
        One for each dimension of the array of complex numbers; the dimension ``iq`` follows them.
    content : str
        What the numbers are, for error messages.
    unit : str
        What one message carries, for error messages.
    """

    labels: tuple[str, ...]
    content: str
    unit: str

    def dimensions(self, shape: tuple[int, ...]) -> list[tuple[str, int, int]]:
        """``(label, size, stride)`` of each dimension for an array of this shape.

        A stride is the product of the sizes from its dimension on, in elements, as std_msgs
        defines it.
        """
        sizes = (*(int(n) for n in shape), 2)
        strides = [sizes[-1]]
        for size in sizes[-2::-1]:
            strides.insert(0, strides[0] * size)
        return list(zip((*self.labels, 'iq'), sizes, strides, strict=True))

    def check_size(self, name: str, shape: tuple[int, ...], n_before: int) -> None:
        """Raise WireFormatError when an array is empty or exceeds the layout's 32-bit fields."""
        n_elements = 2 * math.prod(shape)
        if n_elements == 0:
            raise WireFormatError(f'{name}.shape={shape}; expected at least one {self._words()}; '
                                  f'do not send empty {self.unit}s')
        if n_before + n_elements >= 2**32:
            raise WireFormatError(f'{name}.shape={shape} needs {n_before + n_elements} floats; '
                                  f'layout fields hold less than 2**32; send several {self.unit}s')

    def check_dims(self, dims: Dims, max_elements: int) -> tuple[int, ...]:
        """Shape of the array of complex numbers that the dimensions of a message describe.

        Raises
        ------
        WireFormatError
            Labels, sizes or strides are not those of this layout, or there are more than
            `max_elements` floats.
        """
        expected_labels = (*self.labels, 'iq')
        labels = tuple(label for label, _, _ in dims)
        if labels != expected_labels:
            raise WireFormatError(f'layout.dim labels are {reprlib.repr(labels)}; expected '
                                  f'{expected_labels}; see docs/wire_format.md')
        _, sizes, strides = zip(*dims, strict=True)
        if min(sizes) < 1 or sizes[-1] != 2:
            raise WireFormatError(f'layout.dim sizes are {sizes}; expected at least one '
                                  f'{self._words()}, and 2 for iq; do not send empty '
                                  f'{self.unit}s')
        expected = self.dimensions(sizes[:-1])
        n_elements = expected[0][2]
        if n_elements > max_elements:
            raise WireFormatError(f'layout.dim sizes {sizes} mean {n_elements} floats of '
                                  f'{self.content}; accepted are at most {max_elements}; send '
                                  f'smaller {self.unit}s or raise max_elements')
        if strides != tuple(stride for _, _, stride in expected):
            raise WireFormatError(f'layout.dim strides are {strides}; expected '
                                  f'{tuple(s for _, _, s in expected)} for sizes {sizes}: the '
                                  'product of the sizes from each dimension on, in elements')
        return sizes[:-1]

    def check_length(self, values: np.ndarray, shape: tuple[int, ...], data_offset: int) -> None:
        """Raise WireFormatError when there are not as many floats as the layout says."""
        n_elements = self.dimensions(shape)[0][2]
        if values.size != data_offset + n_elements:
            raise WireFormatError(f'len(data)={values.size}; expected {data_offset + n_elements}: '
                                  f'data_offset={data_offset} plus {n_elements} floats of '
                                  f'{self.content}; the message is truncated, extended, or its '
                                  'layout is wrong')

    def read_content(self, values: np.ndarray, shape: tuple[int, ...], data_offset: int,
                     advice: str = '') -> np.ndarray:
        """Complex numbers behind the header, as a view.

        With advice for the sender, numbers that are not finite raise a WireFormatError.
        """
        content = values[data_offset:]
        # One NaN would spread over a whole image. A sum is finite only if all its terms are, and
        # einsum takes it in one pass without a temporary; a sum may overflow, hence a closer look.
        if advice and not np.isfinite(np.einsum('i->', content)):
            check_finite(content, f'{self.content.removesuffix("s")} array', advice)
        return content.view(np.complex64).reshape(shape)

    def _words(self) -> str:
        return f'{", ".join(self.labels[:-1])} and {self.labels[-1]}'


def as_floats(data: Data) -> np.ndarray:
    """Data of a message as a read-only array of floats that shares its memory.

    Raises
    ------
    WireFormatError
        The object has no contiguous buffer of native 32-bit floats.
    """
    try:
        view = memoryview(data)  # type: ignore[arg-type]  # arrays: NumPy says so from 3.12 on
    except TypeError:
        raise WireFormatError(f'data is a {type(data).__name__}; expected contiguous 32-bit '
                              "floats: an array.array('f') or a float32 array") from None
    if view.format != 'f' or view.ndim != 1 or not view.contiguous:
        raise WireFormatError(f'data has format {view.format!r} and shape {view.shape}; expected '
                              "contiguous 32-bit floats in one dimension, format 'f'")
    values = np.asarray(view)
    values.flags.writeable = False
    return values


def check_finite(values: np.ndarray, name: str, advice: str) -> None:
    """Raise WireFormatError when a number is NaN or infinite."""
    finite = np.isfinite(values)
    if not finite.all():
        first = int(np.argmin(finite))
        raise WireFormatError(f'{name} holds {np.count_nonzero(~finite)} numbers that are NaN or '
                              f'infinite, the first at its index {first}; expected finite '
                              f'numbers; {advice}')


def check_magic(values: Sequence[float], magic: int, version: int, content: str) -> None:
    """Raise WireFormatError when the first two floats are not this magic number and version."""
    if values[0] != magic:
        raise WireFormatError(f'data[0]={values[0]}; expected the magic number {magic}; the topic '
                              f'does not carry {content}')
    if values[1] != version:
        raise WireFormatError(f'format version is {values[1]:g}; expected {version}; use the same '
                              'release of msg_conversions on both sides')
