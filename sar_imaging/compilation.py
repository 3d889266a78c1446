# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiler settings shared by every Numba kernel of the package."""

from __future__ import annotations

import contextlib
import copy
import functools
import gc
import inspect
import logging
import os
import re
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, NoReturn

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_OLDEST_NUMBA = (0, 58)
_TELL_EVERY_S = 5.0
# For a function that another process compiles, before it is compiled here, too: large ones take
# ten seconds on a small board, and a process that was stopped would be waited for without end.
_MOST_WAIT_S, _LOOK_EVERY_S = 60.0, 0.02

_logger = logging.getLogger(__name__)


def check_version(version: str) -> None:
    """Refuse a Numba that is too old.

    Raises
    ------
    ImportError
        The version is older than the package was tested with.
    """
    if tuple(map(int, re.findall(r'\d+', version)[:2])) < _OLDEST_NUMBA:
        raise ImportError(
            f'Numba {version} is installed; {".".join(map(str, _OLDEST_NUMBA))} or later is '
            'needed: install it with pip in a virtual environment as docs/install.md shows',
            name='numba')


class MissingNumbaError(ImportError):
    """Numba is missing, or does not work here."""


def require_numba(what: str) -> None:
    """Raise a `MissingNumbaError` that says what needs Numba, unless it works."""
    if MISSING:
        raise MissingNumbaError(f'{what} needs Numba: {MISSING}')


def _refusing(**_: object) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """What stands for `numba.njit`: functions that ask for Numba when they are called."""
    return lambda function: lambda *_, **__: require_numba(function.__module__)


#: Why nothing is compiled, in a sentence; empty where Numba works.
MISSING = ''
try:
    import numba
    from numba.core import caching, codegen, compiler, config, cpu, event

    check_version(numba.__version__)
except ImportError as error:
    MISSING = f'{error}; one command installs it, see docs/install.md'
    numba = SimpleNamespace(njit=_refusing, cfunc=_refusing, prange=range,
                            get_num_threads=lambda: 1, set_num_threads=lambda n: None,
                            threading_layer=lambda: 'workqueue')
    caching, codegen, compiler, cpu = (
        SimpleNamespace(**dict.fromkeys(names, object)) for names in (
            ('IndexDataCacheFile', 'FunctionCache'), ['JITCodeLibrary'], ['Compiler'],
            ['CPUContext']))
    event = SimpleNamespace(Listener=object, Event=object, install_listener=lambda kind, listener:
                            contextlib.nullcontext(listener))
#: What computes images then, and how fast.
SLOWLY = MISSING and ('without Numba images are formed by NumPy, about a thousand times slower: '
                      f'{MISSING}')


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Numba on one thread, as before afterwards."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


#: Reordering of float operations that keeps NaN and infinity meaningful.
FASTMATH = {'contract', 'reassoc', 'nsz', 'arcp'}

#: The same without reordered sums: how LLVM reorders them changes with its version.
DETERMINISTIC = {'contract', 'nsz', 'arcp'}

# LLVM keeps to 256-bit vectors on many processors with AVX-512 unless a function says otherwise;
# the imaging kernels run about 1.5 times faster with 512. Other processors take no notice.
_WIDEST = '"prefer-vector-width"="512"'


class _Library(codegen.JITCodeLibrary):
    """Code that is optimised, and becomes machine code, when somebody asks where it is.

    Numba does so with the body of a parallel loop, with two functions around it, and with the
    function that all of these are linked into, which alone it runs: twice the time.
    """

    _made = False

    def _optimize_final_module(self):
        pass  # later

    def _finalize_final_module(self):
        self._finalized = True

    def optimize(self):
        self._ensure_finalized()
        super()._optimize_final_module()

    def _make(self):
        if not self._made:
            self._made = True
            self.optimize()
            super()._finalize_final_module()

    def get_pointer_to_function(self, name):
        self._make()
        return super().get_pointer_to_function(name)

    def _get_compiled_object(self):
        self._make()
        return super()._get_compiled_object()


def _is_parallel_body(fndesc) -> bool:
    return fndesc.qualname.startswith('__numba_parfor_gufunc')


class _WideContext(cpu.CPUContext):
    for_python = True

    def declare_function(self, module, fndesc):
        function = super().declare_function(module, fndesc)
        set.add(function.attributes, _WIDEST)  # llvmlite knows no attributes with a value
        return function

    def create_cpython_wrapper(self, library, fndesc, env, call_helper, release_gil=False):
        if not _is_parallel_body(fndesc):
            super().create_cpython_wrapper(library, fndesc, env, call_helper, release_gil)

    def get_executable(self, library, fndesc, env):
        if _is_parallel_body(fndesc) or not self.for_python:
            library.optimize()  # alone, where LLVM knows best which arrays do not overlap
            if self.for_python:
                self.environments.append((self.get_env_name(fndesc), env))
            return None
        executable = super().get_executable(library, fndesc, env)
        while self.environments:
            library.codegen.set_env(*self.environments.pop())
        return executable


class _WideCompiler(compiler.Compiler):
    """Numba's compiler; LLVM uses the widest vectors, in these functions alone."""

    def __init__(self, typing_context, target_context, *others):
        super().__init__(typing_context, target_context, *others)
        context = copy.copy(self.state.targetctx)  # as Numba does for its options
        context.__class__, context.environments = _WideContext, []
        context.for_python = not self.state.flags.no_cpython_wrapper
        context._internal_codegen = copy.copy(context._internal_codegen)
        context._internal_codegen._library_class = _Library
        self.state.targetctx = context

    def compile_extra(self, function):
        # Nearly nothing of what Numba makes is garbage: to look for it takes a tenth of the time.
        collected = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(function)
        except BaseException:  # others need not wait for what comes to nothing
            _unlock(function)
            raise
        finally:
            if collected:
                gc.enable()


class _DistinctCompiler(_WideCompiler):
    """The same; LLVM takes the arrays of the arguments for memory that does not overlap."""

    def __init__(self, typing_context, target_context, *others):
        super().__init__(typing_context, target_context, *others)
        self.state.flags.noalias = True


def njit(function: Callable[..., Any] | None = None, *, distinct: bool = False, **options: Any
         ) -> Any:
    """`numba.njit` that releases the GIL, caches on disk and may reassociate sums.

    Arrays of the arguments are taken for memory that does not overlap where they are `distinct`.

    LLVM uses the processor's widest vectors. Other functions that Numba compiles in the process,
    and `numba.config`, stay as they are.
    """
    if function is None:
        return functools.partial(njit, distinct=distinct, **options)
    options = {'nogil': True, 'cache': True, 'fastmath': FASTMATH,
               'no_cfunc_wrapper': True} | options
    compiler_class = _DistinctCompiler if distinct else _WideCompiler
    return _cached(numba.njit(pipeline_class=compiler_class, **options), function)


def kernel_part(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`njit` of a function that compiled functions alone call, such as the body of a loop.

    It becomes machine code within those, not once more by itself, and without what Python calls.
    """
    if function is None:
        return functools.partial(kernel_part, **options)
    compiled = njit(function, no_cpython_wrapper=True, cache=False, **options)
    compiled._insert = lambda *_: None  # Python finds nothing that it could call
    compiled._compile_for_args = functools.partial(_refuse_call, function.__qualname__)
    return compiled


def _refuse_call(name: str, *_: object, **__: object) -> NoReturn:
    raise TypeError(f'{name} is called by compiled functions alone')


def cfunc(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.cfunc` with the same vectors and cache as `njit`."""
    return functools.partial(_cached, numba.cfunc(signature, cache=True,
                                                  pipeline_class=_WideCompiler, **options))


def _cached(decorate: Callable[..., Any], function: Callable[..., Any]) -> Any:
    """Decorate; where Numba has no place for machine code, it is kept in a temporary folder.

    Numba writes it beside the modules or below the home folder, unless NUMBA_CACHE_DIR names a
    folder. Where neither can be written to it refuses to make any function that is to be cached.
    What lies beside the modules is read, too, where it cannot be written to.
    """
    try:
        return _with_installed(decorate(function))
    except RuntimeError as error:
        if 'no locator' not in str(error):
            raise
    given, config.CACHE_DIR = config.CACHE_DIR, _temporary_folder()
    try:
        compiled = decorate(function)  # looks for the folder now, and not later
    finally:
        config.CACHE_DIR = given
    return _with_installed(compiled)


class _CacheFile(caching.IndexDataCacheFile):
    """Reads from two folders, and writes to the first."""

    def load(self, key):
        found = super().load(key)
        if found is None:
            with contextlib.suppress(OSError):  # there is nothing that this user may read
                found = self.installed.load(key)
        return found


class _SharedCache(caching.FunctionCache):
    """Of a function that one process compiles, while others that need it wait for it.

    Numba lets each of them compile it, and take the same name for code of different arguments.
    """

    def load_overload(self, sig, target_context):
        found = super().load_overload(sig, target_context)
        if found is None and self._py_func not in _locks:
            lock = _locked(self, _MOST_WAIT_S)
            if lock is not None:
                _locks[self._py_func] = lock
                found = super().load_overload(sig, target_context)
                if found is not None:
                    _unlock(self._py_func)
        return found

    def save_overload(self, sig, data):
        try:
            with _undisturbed():  # an index without its data would find those of a version before
                super().save_overload(sig, data)
        finally:
            _unlock(self._py_func)


#: Files that are locked while this process compiles functions.
_locks: dict[Any, IO[bytes]] = {}


def _locked(cache: Any, wait_s: float) -> IO[bytes] | None:
    """Lock for a function's cache; None where another process has it, or there can be none."""
    until_s = time.monotonic() + wait_s
    with contextlib.suppress(OSError), contextlib.ExitStack() as opened:
        file = opened.enter_context(open(
            os.path.join(cache.cache_path, f'{cache._impl.filename_base}.lock'), 'wb'))
        while fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                opened.pop_all()
                return file
            except BlockingIOError:
                if time.monotonic() >= until_s:
                    break
            with event.trigger_event('numba:run_pass'):  # may be given up, see `interruptible`
                time.sleep(_LOOK_EVERY_S)
    return None


def _unlock(function: Any) -> None:
    if function in _locks:
        with _locks.pop(function) as file:
            fcntl.flock(file, fcntl.LOCK_UN)  # processes that were forked have it open, too


def shared(kernel: Any) -> bool:
    """Whether other processes find what is compiled of a function, and wait for it."""
    return isinstance(getattr(kernel, '_cache', None), _SharedCache)


def compiled_elsewhere(kernel: Any) -> bool:
    """Whether another process compiles a function, or none can tell."""
    lock = _locked(kernel._cache, 0.0)
    if lock is not None:
        lock.close()
    return lock is None


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Let signals that end a process wait."""
    if not hasattr(signal, 'pthread_sigmask'):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _with_installed(compiled: Any) -> Any:
    """Have a function share its cache, and read what was compiled into the installation, too.

    The installation may be one that it may not write to.
    """
    cache = getattr(compiled, '_cache', None)
    if type(cache) is caching.FunctionCache:
        cache.__class__ = _SharedCache
    file = getattr(cache, '_cache_file', None)
    if file is not None and not config.CACHE_DIR:
        beside = os.path.join(os.path.dirname(inspect.getfile(compiled.__wrapped__)),
                              '__pycache__')
        if beside != file._cache_path:
            file.installed = copy.copy(file)
            file.installed._cache_path = beside
            file.installed._index_path = os.path.join(beside, file._index_name)
            file.__class__ = _CacheFile
    return compiled


@functools.cache
def _temporary_folder() -> str:
    folder = _own_folder()
    warnings.warn(
        f'machine code is kept in {folder}: neither the installation nor the home folder can be '
        'written to; set NUMBA_CACHE_DIR to a folder that survives a restart',
        RuntimeWarning, stacklevel=4)
    return str(folder)


def _own_folder() -> Path:
    """Folder of this user alone: machine code of somebody else is not to be run."""
    folder = Path(tempfile.gettempdir()) / f'sar_imaging-numba-{os.getuid()}'
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()
    if status.st_uid == os.getuid() and not status.st_mode & 0o022 and not folder.is_symlink():
        return folder
    return Path(tempfile.mkdtemp(prefix='sar_imaging-numba-'))


class CompilationInterrupted(Exception):
    """The compilation of kernels was given up because the program is to end."""


class _Interruption(event.Listener):
    def __init__(self, goes_on: Callable[[], bool]):
        self._goes_on = goes_on

    def on_start(self, event: event.Event) -> None:
        if not self._goes_on():
            raise CompilationInterrupted

    def on_end(self, event: event.Event) -> None:
        pass


@contextlib.contextmanager
def interruptible(goes_on: Callable[[], bool]) -> Iterator[None]:
    """Give up compiling kernels, within a ``with`` block, when `goes_on` returns False.

    It is asked before every pass of the compiler, several times a second; all kernels together
    take from half a minute on a desktop to minutes on a small board.

    Raises
    ------
    CompilationInterrupted
        It was given up.
    """
    with event.install_listener('numba:run_pass', _Interruption(goes_on)):
        yield


class _Compilations(event.Listener):
    """Counts compilations, and tells of the first one."""

    def __init__(self, tell: Callable[[], object]):
        self._tell = tell
        self.n = 0

    def on_start(self, event: event.Event) -> None:
        self.n += 1
        if self.n == 1:
            self._tell()

    def on_end(self, event: event.Event) -> None:
        pass


def counted(tell: Callable[[], object] = lambda: None
            ) -> contextlib.AbstractContextManager[_Compilations]:
    """Count the functions that are compiled within a ``with`` block: attribute `n` of its value.

    Functions that come from the cache do not count.

    Parameters
    ----------
    tell : callable
        Called when the first function is compiled.
    """
    return event.install_listener('numba:compile', _Compilations(tell))


class _Announcements(_Compilations):
    def __init__(self) -> None:
        super().__init__(lambda: None)
        self._begun_s = self._due_s = 0.0

    def on_start(self, event: event.Event) -> None:
        super().on_start(event)
        now_s = time.monotonic()
        if self.n == 1:
            self._begun_s = now_s
            _tell('kernels are compiled: 10 to 30 s on a desktop, once on each machine for each '
                  'version; `python -m sar_imaging.tools.compile_kernels` does it beforehand; '
                  f'machine code is kept in {_folder_of(event.data["dispatcher"])}')
        elif now_s >= self._due_s:
            _tell(f'kernels are compiled: {self.n} functions in {now_s - self._begun_s:.0f} s '
                  'so far')
        else:
            return
        self._due_s = now_s + _TELL_EVERY_S

    def end(self) -> None:
        if self.n:
            _tell(f'{self.n} functions were compiled in '
                  f'{time.monotonic() - self._begun_s:.0f} s')


def _tell(text: str) -> None:
    """As a warning, which is shown, to who waits at a terminal or in a notebook."""
    waits = hasattr(sys, 'ps1') or sys.stderr is not None and sys.stderr.isatty()
    _logger.log(logging.WARNING if waits else logging.INFO, text)


def _folder_of(dispatcher: object) -> str:
    folder = config.CACHE_DIR or getattr(getattr(dispatcher, '_cache', None), 'cache_path', None)
    return str(folder or 'this process alone')


@contextlib.contextmanager
def announced() -> Iterator[None]:
    """Say why an image takes so long where kernels are compiled within a ``with`` block.

    Logs of this module tell what happens, how often, where the machine code is kept and how it
    is done beforehand; then, every few seconds, how far it is.
    """
    with event.install_listener('numba:compile', _Announcements()) as announcements:
        try:
            yield
        finally:
            announcements.end()
