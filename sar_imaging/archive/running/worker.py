"""What a worker does with a piece: look for its record, compute, write the record.

Errors return as values: those of Python do not always survive the way through Dask, and only the
worker sees what caused them. The operating system keeps a bound of the worker's memory.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import os
import resource
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import sar_imaging

from ...formats.extras import require
from .records import Records

_LOCK = threading.Lock()
_RUNNING = [0]  # pieces in this process, and the limit before the first
_BEFORE: list[tuple[int, int]] = []


@contextlib.contextmanager
def bounded(n_bytes: int | None) -> Iterator[None]:
    """Let allocations beyond a bound fail with MemoryError.

    Dask's nanny looks at the memory of a worker ten times a second and kills it. Until then a
    single large array may pass the bound; and the piece would be tried again, in vain. Here the
    operating system refuses the allocation (RLIMIT_DATA), and the piece can say so.

    Parameters
    ----------
    n_bytes : int or None
        Bound on the private writable memory of this process; None leaves it as it is.
    """
    if n_bytes is None:
        yield
        return
    with _LOCK:
        if not _RUNNING[0]:
            soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
            _BEFORE[:] = [(soft, hard)]
            known = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
            resource.setrlimit(resource.RLIMIT_DATA, (min([n_bytes, *known]), hard))
        _RUNNING[0] += 1
    try:
        yield
    finally:
        with _LOCK:
            _RUNNING[0] -= 1
            if not _RUNNING[0]:
                resource.setrlimit(resource.RLIMIT_DATA, _BEFORE.pop())


class Peak:
    """Largest resident memory of this process while the `with` statement lasts.

    Attributes
    ----------
    n_bytes : int
        After the statement. Where the kernel cannot forget an earlier peak (Linux alone can), the
        largest since the process began.
    """

    n_bytes = 0

    def __enter__(self) -> Peak:
        with contextlib.suppress(OSError):
            Path('/proc/self/clear_refs').write_text('5')
        return self

    def __exit__(self, *exception) -> None:
        self.n_bytes = _peak_bytes()


def _peak_bytes() -> int:
    try:
        lines = Path('/proc/self/status').read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith('VmHWM'))
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


_FULL = {errno.ENOSPC: 'no space is left', errno.EDQUOT: 'the quota is used up',
         errno.EFBIG: 'a file would be larger than allowed'}


@dataclasses.dataclass(frozen=True)
class Task:
    """A piece and what a worker needs to know beside it.

    Attributes
    ----------
    piece : dataclass
        Has a `key`; `compute` knows the rest.
    compute : callable
        ``compute(piece, output)``, a function of a module; returns a dataclass or a mapping of
        what JSON can hold. Its `files`, where there are any, are names relative to `output`.
    output : path
        Output folder of the job, which every worker sees under the same name.
    mark : str
        Fingerprint of the piece.
    run : str
        Name of this run of the job.
    retries : int
        How often a piece is tried again.
    memory_bytes : int or None
        Bound of a worker.
    version : str
        Version of this package at the job's own process.
    """

    piece: Any
    compute: Callable[[Any, Path], Any]
    output: Path
    mark: str
    run: str
    retries: int
    memory_bytes: int | None = None
    version: str = sar_imaging.__version__


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a piece went.

    Attributes
    ----------
    state : str
        'done'; 'lost', for good; 'again', may go better another time; 'free', its worker died
        before it began; 'stop', no piece would go better: the disk is full, or a worker lacks
        something.
    reason : str
        Of what is not done, one line.
    record : dict or None
        Of what is done.
    where : str
        Last lines of the traceback of an error.
    """

    state: str
    reason: str = ''
    record: dict | None = None
    where: str = ''


def run_piece(task: Task) -> Outcome:
    """Compute a piece in this process, unless its record says that it is finished."""
    records = Records(task.output)
    trouble = _trouble_with_this_machine(task, records)
    if trouble:
        return Outcome('stop', trouble)
    try:
        return _run(task, records)
    except Exception as error:
        return classify(error, task.memory_bytes)


def _trouble_with_this_machine(task: Task, records: Records) -> str:
    if task.version != sar_imaging.__version__:
        return (f'the worker on {socket.gethostname()} has sar_imaging {sar_imaging.__version__}, '
                f'the job {task.version}; install the same version on both')
    if not records.ready():
        return (f'the worker on {socket.gethostname()} does not see {task.output}; the output '
                'folder must be shared by all workers under the same name')
    return ''


def _run(task: Task, records: Records) -> Outcome:
    key = task.piece.key
    record = records.read(key, task.mark)
    if record is not None:  # a worker that died after it, or lost its connection
        records.finish(key)
        return Outcome('done', record=record)
    starts = records.start(key, task.run)
    if starts > task.retries + 1:
        return Outcome('lost', died(starts - 1))
    begin = time.perf_counter()
    with Peak() as peak, bounded(_bound_bytes(task.memory_bytes)):
        result = task.compute(task.piece, task.output)
    seconds = time.perf_counter() - begin
    told = dataclasses.asdict(result) if dataclasses.is_dataclass(result) else dict(result or {})
    record = records.write(key, task.mark, result=told, seconds=round(seconds, 4),
                           peak_bytes=peak.n_bytes, worker=_worker(), pid=os.getpid(),
                           run=task.run)
    records.finish(key)
    return Outcome('done', record=record)


def _bound_bytes(n_bytes: int | None) -> int | None:
    """Bound of this process, which may compute several pieces at a time."""
    if n_bytes is None:
        return None
    return n_bytes * _n_threads()


def _n_threads() -> int:
    worker = _dask_worker()
    return 1 if worker is None else worker.state.nthreads


def _worker() -> str:
    worker = _dask_worker()
    return socket.gethostname() if worker is None else worker.address


def _dask_worker():
    """Dask's worker that runs this function, or None."""
    try:
        return require('distributed', 'an archive', extra='archive').get_worker()
    except ValueError:
        return None


def died(times: int) -> str:
    """The reason of a piece whose workers died."""
    return (f'its worker died {times} times while computing it; memory beyond the bound of a '
            'worker is the usual cause, the log of the worker tells')


def classify(error: Exception, memory_bytes: int | None) -> Outcome:
    """What an error means for the piece and for the job.

    Parameters
    ----------
    error : Exception
        What `compute` raised.
    memory_bytes : int or None
        Bound of a worker.

    Returns
    -------
    Outcome
        'stop' for a full disk and for a missing library; 'again' for other trouble of the
        operating system; 'lost' for all else, which the same data would raise again.
    """
    where = ''.join(traceback.format_exception(error)[-4:])
    chain = list(_chain(error))
    full = next((text for e in chain if (text := _full(e))), '')
    if full:
        return Outcome('stop', full, where=where)
    if any(isinstance(e, MemoryError) for e in chain):
        bound = '' if memory_bytes is None else f' within {memory_bytes / 1e9:.3g} GB of a worker'
        return Outcome('lost', f'its memory did not suffice{bound}: {one_line(error)}',
                       where=where)
    if isinstance(error, ImportError):
        return Outcome('stop', f'on {socket.gethostname()}, {sys.executable}: {one_line(error)}',
                       where=where)
    if isinstance(error, OSError):
        return Outcome('again', one_line(error), where=where)
    return Outcome('lost', one_line(error), where=where)


def _chain(error: BaseException | None):
    """An error and what caused it."""
    seen = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__


def _full(error: BaseException) -> str:
    """Why nothing more can be written, or ''."""
    code = error.errno if isinstance(error, OSError) else None
    if code is None and 'no space left on device' in str(error).lower():  # of C libraries
        code = errno.ENOSPC
    if code not in _FULL:
        return ''
    name = getattr(error, 'filename', None)
    return (f'{_FULL[code]}{f" for {name}" if name else ""}; make room and start the job again: '
            'it goes on where it stopped')


def one_line(error: BaseException) -> str:
    """Text of an error in one line; its type where it is no error about data or files."""
    text = ' '.join(str(error).split())
    plain = isinstance(error, (OSError, MemoryError)) or type(error).__module__.startswith('sar_')
    return text if plain and text else f'{type(error).__name__}: {text}'
