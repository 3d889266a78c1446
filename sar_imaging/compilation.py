"""Compiler settings shared by every Numba kernel of the package."""

from __future__ import annotations

import functools

import numba
from llvmlite import binding
from numba.core import config

# LLVM uses 256-bit vectors on processors with AVX-512 unless told otherwise; the imaging kernels
# run about 1.5 times faster with 512. This must be set before the first function is compiled.
_features = binding.get_host_cpu_features()
if config.CPU_FEATURES is None and config.CPU_NAME is None and _features.get('avx512f'):
    config.CPU_FEATURES = _features.flatten() + ',-prefer-256-bit'

#: Reordering of float operations that keeps NaN and infinity meaningful.
FASTMATH = {'contract', 'reassoc', 'nsz', 'arcp'}

njit = functools.partial(numba.njit, nogil=True, cache=True, fastmath=FASTMATH)
"""`numba.njit` that releases the GIL, caches on disk and may reassociate sums."""
