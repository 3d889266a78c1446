# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Processes that need the same kernel at the same time: one compiles it, the others load it.

Numba looks into its cache, compiles and writes, and keeps no other process from doing the same
meanwhile: three processes of tests and their nodes would each compile for half a minute.
"""

import fcntl
import functools
from pathlib import Path

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher


def compile_once():
    """Let functions with a cache on disk be compiled by one process at a time, from now on."""
    compile_here, held = Dispatcher.compile, set()

    @functools.wraps(compile_here)
    def compile_alone(self, signature):
        folder = self._cache.cache_path
        if folder is None:
            return compile_here(self, signature)
        lock = Path(folder) / f'{self.py_func.__module__}.{self.py_func.__qualname__}.lock'
        with global_compiler_lock:
            if lock in held:  # one that calls itself
                return compile_here(self, signature)
            lock.parent.mkdir(parents=True, exist_ok=True)
            with lock.open('w') as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                held.add(lock)
                try:
                    return compile_here(self, signature)
                finally:
                    held.remove(lock)

    Dispatcher.compile = compile_alone
