# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pieces on Dask's workers, a piece for each thread, each when what it needs is there.

Dask places the pieces, tries them again when their worker dies or a file has trouble, and asks
again for answers that went with their worker. It knows neither what an earlier run finished nor
which pieces may lack some of what they need: a piece is submitted when its needs are settled. So
a million pieces need no graph of a million, none waits on a worker that another one kills, and
of those that can be computed the earlier in the list goes first.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import graphlib
import heapq
import os
import queue
import resource
import signal
import socket
import sys
import threading
import time
import traceback
import uuid
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from tqdm import tqdm

import sar_imaging

from .cluster import cannot_import, dask, one_line, trouble_of_worker
from .division import duration
from .records import RECORDS, Records, fingerprint

# ------------------------------------------------------------------ on a worker

_LIMIT = resource.getrlimit(resource.RLIMIT_DATA)  # of this process, before its first piece
_FULL = {errno.ENOSPC: 'no space is left', errno.EDQUOT: 'the quota is used up',
         errno.EFBIG: 'a file would be larger than allowed'}


@contextlib.contextmanager
def bounded(n_bytes: int | None) -> Iterator[None]:
    """Let allocations beyond a bound fail with MemoryError.

    Dask's nanny looks at the memory of a worker now and then, and kills it: the piece would be
    tried again, in vain. Here the operating system refuses the allocation (RLIMIT_DATA), and the
    piece can say so.

    Parameters
    ----------
    n_bytes : int or None
        Bound on the private writable memory of this process; None leaves it as it is.
    """
    if n_bytes is not None:
        known = [limit for limit in _LIMIT if limit != resource.RLIM_INFINITY]
        resource.setrlimit(resource.RLIMIT_DATA, (min([n_bytes, *known]), _LIMIT[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, _LIMIT)


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        Path('/proc/self/clear_refs').write_text('5')


def _peak_bytes() -> int:
    """Largest resident memory since `_forget_peak`; of this process where that cannot be."""
    try:
        lines = Path('/proc/self/status').read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith('VmHWM'))
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a piece went.

    Attributes
    ----------
    state : str
        'done'; 'lost', for good; 'stop', no piece would go better: the disk is full, or a worker
        lacks something.
    reason : str
        Reason of what is not done, one line.
    record : dict or None
        Record of what is done.
    where : str
        Last lines of the traceback of an error.
    """

    state: str
    reason: str = ''
    record: dict[str, Any] | None = None
    where: str = ''


class PassingTrouble(RuntimeError):
    """Trouble with files or the network: Dask tries the piece again."""


def run_piece(piece: Any, mark: str, *, compute: Callable[[Any, Path], Any], output: Path,
              run: str, memory_bytes: int | None, version: str) -> Outcome:
    """Compute a piece on a worker, unless its record says that it is finished.

    Errors return as values: those of Python do not always survive the way through Dask, and only
    the worker sees what caused them.

    Parameters
    ----------
    piece : dataclass
        Has a `key`; `compute` knows the rest.
    mark : str
        Fingerprint of the piece.
    compute : callable
        ``compute(piece, output)``, a function of a module; returns a dataclass or a mapping of
        what JSON can hold. Its `files`, where there are any, are names relative to `output`.
    output : path
        Output folder of the job, which every worker sees under the same name.
    run : str
        Name of this run of the job.
    memory_bytes : int or None
        What a piece may take.
    version : str
        Version of this package at the job's own process.

    Raises
    ------
    PassingTrouble
        It may go better another time.
    """
    if trouble := trouble_of_worker(output / RECORDS, version, memory_bytes):
        return Outcome('stop', f'the worker on {socket.gethostname()} {trouble}')
    try:
        return Outcome('done', record=_recorded(piece, mark, compute, output, run, memory_bytes))
    except Exception as error:
        return _classified(error, memory_bytes)


def _recorded(piece: Any, mark: str, compute: Callable[[Any, Path], Any], output: Path, run: str,
              memory_bytes: int | None) -> dict[str, Any]:
    """Record of a piece, which is computed where there is none."""
    records, worker = Records(output), dask().get_worker()
    record = records.read(piece.key, mark)
    if record is not None:  # its worker died after it, or lost its connection
        return record
    records.forget(piece.key)
    begin = time.perf_counter()
    _forget_peak()
    with bounded(memory_bytes and memory_bytes * worker.state.nthreads):
        result = compute(piece, output)
    seconds, peak = time.perf_counter() - begin, _peak_bytes()
    told = dataclasses.asdict(result) if dataclasses.is_dataclass(result) else dict(result or {})
    return records.write(piece.key, mark, result=told, seconds=round(seconds, 4),
                         peak_bytes=peak, worker=worker.address, pid=os.getpid(), run=run)


def _classified(error: Exception, memory_bytes: int | None) -> Outcome:
    """What an error means for the piece and for the job.

    'stop' for a full disk and for a missing library; 'lost' for what the same data would raise
    again; other trouble of the operating system is raised as PassingTrouble.
    """
    where, chain = _where(error), list(_chain(error))
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
        raise PassingTrouble(one_line(error)) from error
    return Outcome('lost', one_line(error), where=where)


def _where(error: BaseException) -> str:
    return ''.join(traceback.format_exception(error)[-4:])


def _chain(error: BaseException | None) -> Iterator[BaseException]:
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


# ------------------------------------------------------------------ at the job's own process

ALL_DONE, REFUSED, WITH_LOSSES, INTERRUPTED = 0, 1, 3, 130


@dataclasses.dataclass(frozen=True)
class Loss:
    """A piece that is not there.

    Attributes
    ----------
    key : str
        The piece.
    reason : str
        One line.
    where : str
        Last lines of the traceback, where there was one.
    """

    key: str
    reason: str
    where: str = ''


@dataclasses.dataclass(frozen=True)
class RunSummary:
    """What `run_pieces` did.

    Attributes
    ----------
    n_pieces : int
        Number of pieces of the job.
    n_computed : int
        Computed in this run.
    n_found : int
        Finished by an earlier run.
    losses : tuple of Loss
        In the order of the pieces.
    stopped : str
        Why the job stopped before its end, one line; '' when it did not.
    interrupted : bool
        Ctrl-C.
    seconds : float
        Seconds of this run, on the clock.
    computing_seconds : float
        Seconds of all pieces of this run, on their workers.
    peak_bytes : int
        Largest resident memory of a worker.
    peak_key : str
        The piece that took it.
    """

    n_pieces: int
    n_computed: int
    n_found: int
    losses: tuple[Loss, ...]
    stopped: str = ''
    interrupted: bool = False
    seconds: float = 0.0
    computing_seconds: float = 0.0
    peak_bytes: int = 0
    peak_key: str = ''

    @property
    def exit_status(self) -> int:
        """0 all is done, 3 with losses, 1 stopped, 130 interrupted by Ctrl-C."""
        if self.interrupted:
            return INTERRUPTED
        if self.stopped:
            return REFUSED
        return WITH_LOSSES if self.losses else ALL_DONE

    def as_json(self) -> dict[str, Any]:
        """For summary.json."""
        return {**dataclasses.asdict(self), 'exit_status': self.exit_status}

    def __add__(self, other: RunSummary) -> RunSummary:
        """Two stages of a job as one."""
        larger = max(self, other, key=lambda summary: summary.peak_bytes)
        return RunSummary(
            self.n_pieces + other.n_pieces, self.n_computed + other.n_computed,
            self.n_found + other.n_found, self.losses + other.losses,
            self.stopped or other.stopped, self.interrupted or other.interrupted,
            self.seconds + other.seconds, self.computing_seconds + other.computing_seconds,
            larger.peak_bytes, larger.peak_key)

    def told(self, output: Path) -> str:
        """For people: every loss with its reason, and how to go on."""
        done = self.n_computed + self.n_found
        before = f', {self.n_found} of them by an earlier run' if self.n_found else ''
        lines = [f'{done} of {self.n_pieces} pieces done{before}, {len(self.losses)} lost, in '
                 f'{duration(self.seconds)}; results in {output}']
        if self.peak_bytes:
            lines.append(f'largest memory of a worker: {self.peak_bytes / 1e9:.2f} GB '
                         f'({self.peak_key})')
        return '\n'.join([*lines, *self.troubles()])

    def troubles(self) -> list[str]:
        """Every loss with its reason, and what stopped the job, a line each."""
        lines = [f'lost: {loss.key}: {loss.reason}' for loss in self.losses]
        if self.interrupted:
            lines.append('interrupted; the same command goes on where it stopped')
        elif self.stopped:
            lines.append(f'stopped: {self.stopped}')
        return lines


# A bar over the seconds predicted for all that this run computes: tqdm tells what the rest takes.
_BAR = dict(disable=None, dynamic_ncols=True,
            bar_format='{l_bar}{bar}| {elapsed}, {remaining} left{postfix}')
_LOOK_SECONDS = 1.0  # how often workers are counted
_WAIT_SECONDS = 600.0  # how long a job waits for workers when there are none
_ANSWER_SECONDS = 10.0  # how long an answer may take from its worker
_GOES_ON = 'start the job again: it goes on where it stopped'


def run_pieces(pieces: Sequence[Any], compute: Callable[[Any, Path], Any], client: Any,
               output: Path, *, retries: int = 2, memory_bytes: int | None = None,
               may_lack: Callable[[Any, Sequence[str]], bool] = lambda piece, lost: False,
               on_result: Callable[[Any, dict[str, Any]], None] | None = None) -> RunSummary:
    """Compute the pieces that have no record yet, on the workers of a Dask client.

    Parameters
    ----------
    pieces : sequence of Piece
        See `pieces.Piece`; keys are unique.
    compute : callable
        ``compute(piece, output)``, a function of a module, see `run_piece`.
    client : distributed.Client
        Whose workers see `output`.
    output : path
        Output folder of the job.
    retries : int
        How often a piece is tried again whose worker died, or whose files had trouble.
    memory_bytes : int, optional
        Bound of a worker.
    may_lack : callable
        ``may_lack(piece, lost)``: whether a piece is computed without needs that are lost.
    on_result : callable, optional
        ``on_result(piece, result)`` for each finished piece, of earlier runs too, in any order.

    Returns
    -------
    RunSummary
        Ctrl-C ends up there, too.

    Raises
    ------
    ValueError
        Keys occur twice, or a piece needs one that does not exist, or itself.
    """
    run = _Run(pieces, client, output, retries, may_lack, on_result)
    run.task = dict(compute=compute, output=output, run=uuid.uuid4().hex,
                    memory_bytes=memory_bytes, version=sar_imaging.__version__)
    return run.go()


def _ordered(pieces: Sequence[Any]) -> graphlib.TopologicalSorter[int]:
    """Indices of the pieces, each after those of its needs."""
    indices = {piece.key: index for index, piece in enumerate(pieces)}
    if len(indices) < len(pieces):
        twice = next(p.key for i, p in enumerate(pieces) if indices[p.key] != i)
        raise ValueError(f'two pieces are called {twice!r}; keys must be unique')
    order: graphlib.TopologicalSorter[int] = graphlib.TopologicalSorter()
    for index, piece in enumerate(pieces):
        for key in piece.needs:
            if key not in indices:
                raise ValueError(f'{piece.key!r} needs {key!r}, which is not among the pieces')
        order.add(index, *(indices[key] for key in piece.needs))
    try:
        order.prepare()
    except graphlib.CycleError as error:
        raise ValueError(f'{pieces[error.args[1][0]].key!r} needs itself, directly or through '
                         'others') from error
    return order


@contextlib.contextmanager
def _ctrl_c() -> Iterator[threading.Event]:
    """Event that the first Ctrl-C sets; the next one raises KeyboardInterrupt, as ever.

    Raised at once it is lost where Python is just deleting an object, such as a future of Dask.
    """
    pressed, before = threading.Event(), signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield pressed
        return

    def press(number: int, frame: FrameType | None) -> None:
        if pressed.is_set():
            before(number, frame)
        pressed.set()

    signal.signal(signal.SIGINT, press)
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)


class _Run:
    """State of one call of `run_pieces`; only the thread that called it changes it."""

    def __init__(self, pieces: Sequence[Any], client: Any, output: Path, retries: int,
                 may_lack: Callable[[Any, Sequence[str]], bool],
                 on_result: Callable[[Any, dict[str, Any]], None] | None) -> None:
        self.order = _ordered(pieces)
        self.ready: list[int] = []
        self.pieces, self.client, self.records = pieces, client, Records(output)
        self.retries, self.may_lack, self.on_result = retries, may_lack, on_result
        self.task: dict[str, Any] = {}
        self.marks: dict[str, str | None] = {}  # of finished pieces; None of lost ones
        self.losses: dict[int, Loss] = {}
        self.futures: dict[Any, tuple[int, str]] = {}  # indices and fingerprints of pieces
        self.answers = dask().as_completed(loop=client.loop, raise_errors=False)
        self.n_computed = self.n_found = 0
        self.stopped, self.computing_seconds, self.peak = '', 0.0, (0, '')
        self.n_threads, self.looked, self.threads_seen = 0, -1e9, time.monotonic()

    def go(self) -> RunSummary:
        begin, interrupted = time.monotonic(), False
        (self.records.output / RECORDS).mkdir(exist_ok=True)
        self.client.run_on_scheduler(_let_die(self.retries))
        self.bar = tqdm(total=sum(piece.seconds for piece in self.pieces), **_BAR)
        try:
            with _ctrl_c() as pressed:
                while not self.stopped and not pressed.is_set() and self.order.is_active():
                    self.look()
                    self.submit()
                    self.take_answers()
            interrupted = pressed.is_set()
        except KeyboardInterrupt:
            interrupted = True
        finally:
            self.bar.close()
            if self.futures and self.client.status == 'running':
                # what runs is recorded by its worker, if it ends
                self.client.cancel(list(self.futures), force=True)
        losses = tuple(self.losses[i] for i in sorted(self.losses))
        return RunSummary(len(self.pieces), self.n_computed, self.n_found, losses, self.stopped,
                       interrupted, time.monotonic() - begin, self.computing_seconds, *self.peak)

    def look(self) -> None:
        """Count the threads of all workers, now and then."""
        now = time.monotonic()
        if now - self.looked < _LOOK_SECONDS:
            return
        self.looked = now
        if self.client.status != 'running':
            self.stop(f'the scheduler has gone; {_GOES_ON}')
            return
        try:
            self.n_threads = sum(self.client.nthreads().values())
        except OSError as error:
            self.stop(f'the scheduler does not answer ({error}); {_GOES_ON}')
            return
        if self.n_threads:
            self.threads_seen = now
        elif now - self.threads_seen > _WAIT_SECONDS:
            self.stop(f'there was no worker for {_WAIT_SECONDS / 60:g} minutes; start workers and '
                      'the job again: it goes on where it stopped')
        self.bar.set_postfix_str(f'{len(self.marks)} of {len(self.pieces)} pieces, '
                                 + (f'{len(self.losses)} lost' if self.n_threads else
                                    'waiting for workers'))

    def submit(self) -> None:
        """Give every thread a piece, the first of those that can be computed before others."""
        while len(self.futures) < max(self.n_threads, 1) and not self.stopped:
            for index in self.order.get_ready():
                heapq.heappush(self.ready, index)
            if not self.ready:
                return
            self.consider(heapq.heappop(self.ready))

    def consider(self, index: int) -> None:
        """Submit a piece whose needs are settled, unless it is finished or cannot be computed."""
        piece = self.pieces[index]
        needs = {key: self.marks[key] for key in piece.needs}
        lost = [key for key in piece.needs if needs[key] is None]
        if lost and not self.may_lack(piece, lost):
            more = f' and {len(lost) - 1} more, which are lost' if lost[1:] else ', which is lost'
            self.settle(index, Outcome('lost', f'needs {lost[0]}{more}'))
            return
        mark = fingerprint(piece, needs)
        record = self.records.read(piece.key, mark)
        if record is not None:
            self.settle(index, Outcome('done', record=record))
            return
        # Dask's dashboard groups tasks by the first entry. The last one keeps jobs apart, for a
        # scheduler takes tasks of one key for one, whoever sent them.
        future = self.client.submit(
            run_piece, piece, mark, key=(piece.KIND, piece.key, self.task['run'][:8]),
            priority=-index, retries=self.retries, **self.task)
        self.futures[future] = index, mark
        self.answers.add(future)

    def take_answers(self) -> None:
        """Wait for an answer for a while, and take all that came meanwhile."""
        if not self.futures:
            return
        with contextlib.suppress(queue.Empty):
            first = self.answers.queue.get(timeout=_LOOK_SECONDS)  # the iterator has no timeout
            for future in (first, *self.answers.next_batch(block=False)):
                index, mark = self.futures[future]
                outcome = self.outcome(self.pieces[index], mark, future)
                if outcome is None:
                    self.answers.add(future)
                else:
                    del self.futures[future]
                    self.settle(index, outcome)

    def outcome(self, piece: Any, mark: str, future: Any) -> Outcome | None:
        """What became of a piece; its record tells sooner than its worker could.

        None where the answer has gone with its worker: Dask then computes the piece again.
        """
        record = self.records.read(piece.key, mark) if future.status == 'finished' else None
        if record is not None:
            return Outcome('done', record=record)
        try:
            return future.result(timeout=_ANSWER_SECONDS)
        except dask().TimeoutError:
            return None
        except CancelledError:
            return Outcome('stop', f'the scheduler has gone, or dropped the piece {piece.key}; '
                           f'{_GOES_ON}')
        except dask().KilledWorker:
            return Outcome('lost', f'its worker died {self.retries + 1} times while computing '
                           'it; memory beyond the bound of a worker is the usual cause, the log '
                           'of the worker tells')
        except PassingTrouble as error:
            return Outcome('lost', str(error), where=_where(error))
        except Exception as error:
            if cannot_import(error):
                return Outcome('stop', f'a worker cannot load what it should run ({error}); '
                               'install this version of sar_imaging and its extra `archive` on '
                               'all of them')
            return Outcome('lost', one_line(error), where=_where(error))

    def settle(self, index: int, outcome: Outcome) -> None:
        """Keep what became of a piece: what waited for it alone is ready."""
        if outcome.state == 'stop':
            self.stop(outcome.reason)
            return
        piece = self.pieces[index]
        if outcome.state == 'done':
            self.finish(piece, outcome.record)
        else:
            self.marks[piece.key] = None
            self.losses[index] = Loss(piece.key, outcome.reason, outcome.where)
            self.bar.total -= piece.seconds
        self.order.done(index)

    def finish(self, piece: Any, record: dict[str, Any]) -> None:
        self.marks[piece.key] = record['fingerprint']
        fresh = record['run'] == self.task['run']
        self.n_computed += fresh
        self.n_found += not fresh
        if fresh:
            self.computing_seconds += record['seconds']
            self.peak = max(self.peak, (record['peak_bytes'], piece.key))
            self.bar.update(piece.seconds)
        else:
            self.bar.total -= piece.seconds
        if self.on_result is not None:
            self.on_result(piece, record['result'])

    def stop(self, reason: str) -> None:
        self.stopped = self.stopped or reason


def _let_die(retries: int) -> Callable[[Any], None]:
    """Function for the scheduler: how often workers may die of a piece before it is lost."""
    # nested, it travels as code: a scheduler needs no sar_imaging
    def let_die(dask_scheduler: Any) -> None:
        dask_scheduler.allowed_failures = retries
    return let_die
