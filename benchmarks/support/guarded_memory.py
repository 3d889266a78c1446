# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Guards around the arrays that compiled loops of the processor write.

Loops that work by addresses are beyond NUMBA_BOUNDSCHECK: what they write behind an array lands in
somebody else's. Here the Python functions that call them get their arrays with known bytes before
and behind, as large as asked for: work space too, which is larger otherwise.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import pkgutil
import sys
import types
from collections.abc import Callable, Iterator

import numpy as np

from sar_imaging import device_arrays
from sar_imaging.backends import cpu
from sar_imaging.backends.cpu.memory import WorkSpace, aligned_empty, aligned_zeros

_GUARD, _BYTE = 4096, 0xA5  # bytes before and behind, and their value
_LINE = 64  # bytes of a line of the cache, at which arrays begin


class Guards:
    """Arrays that were made since the last check."""

    def __init__(self):
        self._known: list[tuple[str, np.ndarray]] = []

    def __getattr__(self, name: str):
        """All else of NumPy: this stands where functions look for `np`."""
        return getattr(np, name)

    def empty(self, shape, dtype=np.float64, **_) -> np.ndarray:
        """As of NumPy, with guards."""
        size = math.prod(np.atleast_1d(shape).tolist()) * np.dtype(dtype).itemsize
        memory = np.empty(size + 2 * _GUARD + _LINE, np.uint8)
        start = -memory.ctypes.data % _LINE
        memory = memory[start:start + size + 2 * _GUARD]
        memory[:_GUARD] = memory[_GUARD + size:] = _BYTE
        caller = sys._getframe(1)
        if caller.f_code is Guards.zeros.__code__:
            caller = caller.f_back
        self._known.append((f'{caller.f_globals["__name__"]}:{caller.f_lineno}', memory))
        return memory[_GUARD:_GUARD + size].view(dtype).reshape(shape)

    def zeros(self, shape, dtype=np.float64, **_) -> np.ndarray:
        """As of NumPy, with guards."""
        array = self.empty(shape, dtype)
        array[...] = 0
        return array

    def broken(self) -> list[str]:
        """Where arrays were made beside which something was written; they are forgotten then."""
        found = [f'{where} {side}' for where, memory in self._known
                 for side, guard in (('before', memory[:_GUARD]), ('behind', memory[-_GUARD:]))
                 if (guard != _BYTE).any()]
        self._known.clear()
        return found


class _Exact:
    """Stands for a `WorkSpace`'s call: buffers are as large as asked for."""

    def __init__(self, guards: Guards):
        self._guards = guards

    def __get__(self, space, _):
        def buffer(name, shape, dtype):
            kept = space._buffers.get(name)
            if kept is None or kept.size != math.prod(shape) or kept.dtype != dtype:
                kept = space._buffers[name] = self._guards.empty((math.prod(shape),), dtype)
                space.layouts.pop(name, None)
            return kept.reshape(shape)
        return buffer


@contextlib.contextmanager
def guarded() -> Iterator[Guards]:
    """Give guards to all arrays that Python functions of `sar_imaging.backends.cpu` make.

    Work space that is older stays as it is: make imagers within.

    Yields
    ------
    Guards
        Whose `broken` tells, after an image, what was written beside arrays.
    """
    guards, undo = Guards(), []
    modules = [device_arrays, *(importlib.import_module(f'{cpu.__name__}.{found.name}')
                                for found in pkgutil.iter_modules(cpu.__path__))]
    names = {module.__name__: {**vars(module), 'np': guards} for module in modules}
    changed: dict[object, Callable] = {}

    def put(owner, name, value):
        undo.append((owner, name, vars(owner)[name]))
        setattr(owner, name, value)

    for module in modules:
        for owner in (module, *(v for v in vars(module).values() if isinstance(v, type))):
            for name, value in list(vars(owner).items()):
                function = value.__func__ if isinstance(value, classmethod) else value
                if isinstance(function, types.FunctionType) and function.__module__ in names:
                    new = changed.get(function) or _with(function, names[function.__module__])
                    changed[function] = new
                    if owner is not module:
                        put(owner, name, new if function is value else classmethod(new))
    changed |= {aligned_empty: guards.empty, aligned_zeros: guards.zeros}  # nothing behind these
    for module in [m for n, m in sys.modules.items() if n.startswith('sar_imaging')]:
        for name, value in list(vars(module).items()):
            if isinstance(value, types.FunctionType) and value in changed:
                put(module, name, changed[value])
    for here in names.values():
        here.update({name: changed[value] for name, value in here.items()
                     if isinstance(value, types.FunctionType) and value in changed})
    put(WorkSpace, '__call__', _Exact(guards))
    try:
        yield guards
    finally:
        for owner, name, value in reversed(undo):
            setattr(owner, name, value)


def _with(function: types.FunctionType, names: dict) -> types.FunctionType:
    """A function for which names are others; loops that it calls stay compiled as they are."""
    new = types.FunctionType(function.__code__, names, function.__name__,
                             function.__defaults__, function.__closure__)
    new.__kwdefaults__ = function.__kwdefaults__
    return new
