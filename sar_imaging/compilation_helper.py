# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A second process that compiles some kernels of a job while this one compiles the others.

Numba compiles one function at a time. The helper is a Python of its own, which is started when
the first kernel of a job is compiled, and ended with the job. It goes through the job without
computing anything, takes note of the kernels that are called, and compiles them from the last one
on. Machine code passes by Numba's cache: who needs a kernel that the other one compiles waits for
it, see `compilation`. Where no helper can be started, or it fails, nothing else changes.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

from . import compilation
from .memory import available_bytes

_LEAST_BYTES = 1 << 30  # available where a helper is started, which takes 200 MB
_MOST_JOB_BYTES = 64 << 20  # of terrain, say, whose positions are part of a plan
_MOST_CALLS = 1000  # of kernels that are known already, after which a job is taken to have no more
_LOAD = Path('/proc/loadavg')
_LOOKS, _LOOK_EVERY_S = 3, 0.01
_END_S = 5.0
_PROGRAM = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from sar_imaging.compilation_helper import help_parent
help_parent()
"""


@contextlib.contextmanager
def helped(job: Callable[[], object]) -> Iterator[None]:
    """Have a helper compile the last ones of the kernels that a ``with`` block compiles.

    Parameters
    ----------
    job : callable
        Calls the same kernels in the same order; pickled. In the helper kernels do nothing and
        return None, and what the job raises ends it.
    """
    with compilation.event.install_listener('numba:compile', _Starter(job)) as starter:
        try:
            yield
        finally:
            starter.end()


class _Starter(compilation.event.Listener):
    """Starts a helper when the first kernel is compiled, one at a time in a process."""

    _latest: _Starter | None = None

    def __init__(self, job: Callable[[], object]):
        self._job = job
        self._helper: subprocess.Popen[bytes] | None = None

    def on_start(self, event: Any) -> None:
        if _Starter._latest is None and compilation.shared(event.data['dispatcher']):
            _Starter._latest = self
            self._helper = _started(self._job)

    def on_end(self, event: Any) -> None:
        pass

    def end(self) -> None:
        if _Starter._latest is self:
            _Starter._latest = None
        if self._helper is not None:
            self._helper.terminate()
            try:
                self._helper.wait(_END_S)
            except subprocess.TimeoutExpired:  # it was stopped
                self._helper.kill()
                self._helper.wait()


def _may_start() -> bool:
    """Whether there is a processor that is free, memory, and a Python, not another program."""
    return (os.name == 'posix' and not getattr(sys, 'frozen', False)
            and 1 < compilation.config.NUMBA_NUM_THREADS >= _n_running()
            and Path(sys.executable or '').name.startswith('python')
            and available_bytes() > _LEAST_BYTES)


def _n_running() -> int:
    """Threads that want a processor, this one among them: the least of some looks."""
    looks: list[int] = []
    while len(looks) < _LOOKS and _LOAD.exists():  # on Linux
        looks.append(int(_LOAD.read_text().split()[3].partition('/')[0]))
        time.sleep(_LOOK_EVERY_S)
    return min(looks, default=1)


def _started(job: Callable[[], object]) -> subprocess.Popen[bytes] | None:
    folder = compilation.config.CACHE_DIR  # which a program may have chosen
    environment = os.environ | ({'NUMBA_CACHE_DIR': folder} if folder else {})
    # errors of many kinds: a job that cannot be pickled, no room for it, no more processes
    with contextlib.suppress(Exception), tempfile.TemporaryFile() as file:
        if not _may_start():
            return None
        for part in (sys.path, os.getpid(), job):
            pickle.dump(part, _Short(file))
        file.seek(0)
        return subprocess.Popen([sys.executable, '-c', _PROGRAM], stdin=file, env=environment,
                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return None


class _Short:
    """File that refuses long objects before it writes them."""

    def __init__(self, file: IO[bytes]):
        self._file = file

    def write(self, data: Any) -> int:
        if self._file.tell() + memoryview(data).nbytes > _MOST_JOB_BYTES:
            raise ValueError('too long for a job')
        return self._file.write(data)


def help_parent() -> None:
    """Compile the kernels of the job that the standard input has, while the parent lives."""
    compilation.cfunc = lambda *_, **__: lambda function: SimpleNamespace(address=0)  # it does
    parent, job = (pickle.load(sys.stdin.buffer) for _ in range(2))
    for kernel, types in reversed(_kernels_of(job)):
        if os.getppid() != parent:
            return
        if not compilation.compiled_elsewhere(kernel):
            kernel.compile(types)


def _kernels_of(job: Callable[[], object]) -> list[tuple[Any, tuple[Any, ...]]]:
    """Kernels that a job calls, with the types of their arguments, in order."""
    from numba.core.dispatcher import Dispatcher

    found: dict[tuple[Any, tuple[Any, ...]], int] = {}
    numbers = itertools.count()

    def note(kernel: Any, *arguments: Any) -> None:
        number, types = next(numbers), tuple(map(kernel.typeof_pyval, arguments))
        if compilation.shared(kernel):
            found.setdefault((kernel, types), number)
        if number - next(reversed(found.values()), 0) > _MOST_CALLS:
            raise _NothingNewError

    Dispatcher.__call__ = note
    with contextlib.suppress(Exception):
        job()
    del Dispatcher.__call__
    return list(found)


class _NothingNewError(Exception):
    """A job calls the same kernels again and again."""
