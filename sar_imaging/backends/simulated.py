# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Stand-in for CuPy's arrays where Numba simulates a device: as strict as they are.

NumPy's functions work on it, as on CuPy's arrays; what would copy samples of a device to the host
by mistake, or mix arrays of both, is an error here as it is there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import DTypeLike


class SimulatedArray(np.lib.mixins.NDArrayOperatorsMixin):
    """Array of a simulated device.

    Parameters
    ----------
    values : array
        What it holds; the kernels of the simulator work on it.
    """

    __cuda_array_interface__ = property(lambda self: self.values.__array_interface__)

    def __init__(self, values: np.ndarray):
        self.values = values

    def get(self) -> np.ndarray:
        """Copy in the memory of the host."""
        return self.values.copy()

    def item(self) -> Any:
        """The only element as a number of Python."""
        return self.values.item()

    def __len__(self) -> int:
        return len(self.values)

    def __float__(self) -> float:
        return float(self.values)

    def __bool__(self) -> bool:
        return bool(self.values)

    def __getitem__(self, index: Any) -> Any:
        return _given(self.values[_taken(index)])

    def __setitem__(self, index: Any, value: Any) -> None:
        self.values[_taken(index)] = _taken(value)

    def __getattr__(self, name: str) -> Any:
        if name.startswith('__') or name == 'values':  # copies and pickles look for such
            raise AttributeError(name)
        found = getattr(self.values, name)
        if not callable(found):
            return _given(found)
        return functools.wraps(found)(lambda *arguments, **options: _given(
            found(*_taken(arguments), **options)))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NoReturn:
        raise TypeError('Implicit conversion to a NumPy array is not allowed. Please use `.get()` '
                        'to construct a NumPy array explicitly.')

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        with np.errstate(all='ignore'):  # a device does not warn
            return _given(getattr(ufunc, method)(*_taken(inputs), **_taken(options)))

    def __array_function__(self, function: Callable[..., Any], types: Iterable[type],
                           arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
        made = function.__name__ in ('asarray', 'zeros', 'empty')  # from arrays of the host
        take: Callable[[Any], Any] = (lambda value: value) if made else _taken
        options = {name: value for name, value in options.items() if name != 'like'}
        with np.errstate(all='ignore'):
            return _given(function(*take(arguments), **take(options)))


def _given(found: Any) -> Any:
    """What a function found, on the device."""
    if isinstance(found, np.ndarray | np.generic):
        return SimulatedArray(np.asarray(found))
    return type(found)(map(_given, found)) if type(found) in (tuple, list) and found and (
        isinstance(found[0], np.ndarray)) else found


def _taken(given: Any) -> Any:
    """What a function is given, as the simulator has it; arrays of the host are refused."""
    if isinstance(given, SimulatedArray):
        return given.values
    if isinstance(given, np.ndarray) and given.ndim:
        raise TypeError(f'Unsupported type {np.ndarray}')
    if isinstance(given, dict):
        return {name: _taken(value) for name, value in given.items()}
    return type(given)(map(_taken, given)) if type(given) in (tuple, list) else given
