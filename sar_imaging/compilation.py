"""Compiler settings shared by every Numba kernel of the package."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator

import numba
from llvmlite import binding
from numba.core import config, event

# LLVM uses 256-bit vectors on processors with AVX-512 unless told otherwise; the imaging kernels
# run about 1.5 times faster with 512. This must be set before the first function is compiled.
_features = binding.get_host_cpu_features()
if config.CPU_FEATURES is None and config.CPU_NAME is None and _features.get('avx512f'):
    config.CPU_FEATURES = _features.flatten() + ',-prefer-256-bit'

#: Reordering of float operations that keeps NaN and infinity meaningful.
FASTMATH = {'contract', 'reassoc', 'nsz', 'arcp'}

#: The same without reordered sums. Numba runs a parallel function that it has just compiled
#: after fewer passes of the optimiser than one from its cache: reordered sums may differ then.
REPEATABLE = {'contract', 'nsz', 'arcp'}

njit = functools.partial(numba.njit, nogil=True, cache=True, fastmath=FASTMATH)
"""`numba.njit` that releases the GIL, caches on disk and may reassociate sums."""


class _FirstCompilation(event.Listener):
    def __init__(self, tell: Callable[[], object]):
        self._tell = tell
        self._told = False

    def on_start(self, event: event.Event) -> None:
        if not self._told:
            self._told = True
            self._tell()

    def on_end(self, event: event.Event) -> None:
        pass


@contextlib.contextmanager
def announced(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell` when, within a ``with`` block, the first kernel is compiled.

    It is not called where all kernels come from the cache.
    """
    with event.install_listener('numba:compile', _FirstCompilation(tell)):
        yield
