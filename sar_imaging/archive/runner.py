"""Pieces on Dask's workers: each when what it needs is there, few at a time.

Pieces come in the order in which they were given.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import heapq
import os
import queue
import resource
import socket
import sys
import threading
import time
import traceback
import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

import sar_imaging

from ..formats.extras import require
from .cluster import cannot_import, dask
from .records import Records, fingerprint

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
class Summary:
    """What `run_pieces` did.

    Attributes
    ----------
    n_pieces : int
        Of the job.
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
        Of this run, on the clock.
    computing_seconds : float
        Of all pieces of this run, on their workers.
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

    def as_json(self) -> dict:
        """For summary.json."""
        return {**dataclasses.asdict(self), 'exit_status': self.exit_status}

    def __add__(self, other: Summary) -> Summary:
        """Two stages of a job as one."""
        larger = max(self, other, key=lambda summary: summary.peak_bytes)
        return Summary(
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


def duration(seconds: float) -> str:
    """A time as people say it: '40 s', '12 min', '3.5 h', '2.1 days'."""
    for unit, name, most in ((1, 's', 120), (60, 'min', 7200), (3600, 'h', 172800)):
        if seconds < most:
            return f'{seconds / unit:.3g} {name}'
    return f'{seconds / 86400:.3g} days'


class Progress:
    """A bar for a job's pieces; silent where the output is no terminal.

    Parameters
    ----------
    n_pieces : int
        Of the job.
    predicted_seconds : float
        Of all pieces together, on one worker.
    """

    def __init__(self, n_pieces: int, predicted_seconds: float):
        self._left = predicted_seconds
        self._predicted = self._measured = 0.0
        self._losses = 0
        self._bar = tqdm(total=n_pieces, unit='piece', disable=None, dynamic_ncols=True,
                         bar_format='{l_bar}{bar}| {n_fmt}/{total_fmt} pieces, {elapsed}'
                                    '{postfix}')

    def done(self, predicted_seconds: float, seconds: float | None = None) -> None:
        """A piece is finished; `seconds` None: by an earlier run."""
        self._left -= predicted_seconds
        if seconds is not None:
            self._predicted += predicted_seconds
            self._measured += seconds
        self._bar.update()

    def lost(self, predicted_seconds: float) -> None:
        """A piece is lost."""
        self._left -= predicted_seconds
        self._losses += 1
        self._bar.update()

    def show(self, n_threads: int) -> None:
        """Tell how long it takes with so many threads of workers."""
        if not n_threads:
            told = 'waiting for workers'
        else:
            told = f'{duration(max(self.seconds_left(n_threads), 0))} left'
        self._bar.set_postfix_str(f'{told}, {self._losses} lost', refresh=False)
        self._bar.refresh()

    def seconds_left(self, n_threads: int) -> float:
        """Predicted from the pieces to come, corrected by what those until now took."""
        pace = self._measured / self._predicted if self._predicted else 1.0
        return self._left * pace / n_threads

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.close()


class Order:
    """Pieces that wait for others.

    Parameters
    ----------
    pieces : sequence
        With `key` and `needs`.

    Attributes
    ----------
    ready : list of int
        A heap (heapq) of indices of pieces whose needs are settled, less those taken from it.

    Raises
    ------
    ValueError
        Keys occur twice, or a piece needs one that does not exist, or itself.
    """

    def __init__(self, pieces: Sequence[Any]):
        indices = {piece.key: index for index, piece in enumerate(pieces)}
        if len(indices) < len(pieces):
            twice = next(p.key for i, p in enumerate(pieces) if indices[p.key] != i)
            raise ValueError(f'two pieces are called {twice!r}; keys must be unique')
        self._missing = [len(set(piece.needs)) for piece in pieces]
        self._dependents: dict[int, list[int]] = defaultdict(list)
        for index, piece in enumerate(pieces):
            for key in dict.fromkeys(piece.needs):
                if key not in indices:
                    raise ValueError(f'{piece.key!r} needs {key!r}, which is not among the pieces')
                self._dependents[indices[key]].append(index)
        self.ready = [index for index, missing in enumerate(self._missing) if not missing]
        self._check_circles(pieces)

    def settled(self, index: int) -> None:
        """A piece is finished or lost: what waited for it alone is ready."""
        for other in self._dependents.pop(index, ()):
            self._missing[other] -= 1
            if not self._missing[other]:
                heapq.heappush(self.ready, other)

    def _check_circles(self, pieces: Sequence[Any]) -> None:
        missing, ready = list(self._missing), list(self.ready)
        for index in ready:  # grows meanwhile
            for other in self._dependents.get(index, ()):
                missing[other] -= 1
                if not missing[other]:
                    ready.append(other)
        if len(ready) < len(pieces):
            name = next(piece.key for piece, left in zip(pieces, missing, strict=True)
                        if left)
            raise ValueError(f'{name!r} needs itself, directly or through others')


_LOOKS = 4  # without a process: a nanny that starts one needs less than a second


class Upkeep:
    """Keeps the number of this machine's workers as it was in the beginning.

    Parameters
    ----------
    client : distributed.Client
        Clusters that are not of this machine keep themselves.
    """

    def __init__(self, client):
        cluster = client.cluster
        local = cluster is not None and type(cluster).__name__ == 'LocalCluster'
        self._cluster = cluster if local else None
        self._n_workers = len(cluster.worker_spec) if local else 0
        self._dead: Counter = Counter()

    def look(self) -> None:
        """Replace workers that have had no process for some looks; call it every second."""
        if self._cluster is None:
            return
        nannies = list(self._cluster.workers.items())  # workers of this process have no pid
        dead = [name for name, nanny in nannies if getattr(nanny, 'pid', 0) is None]
        self._dead = Counter({name: self._dead[name] + 1 for name in dead})
        gone = [name for name, looks in self._dead.items() if looks >= _LOOKS]
        if gone:
            self._cluster.sync(self._cluster.scale_down, gone)
        if len(self._cluster.worker_spec) < self._n_workers:
            self._cluster.scale(self._n_workers)


IN_FLIGHT = 3  # pieces for each thread of a worker: one runs, the others wait beside it
_LOOK_SECONDS = 1.0  # how often workers are counted
_WAIT_SECONDS = 600.0  # how long a job waits for workers when there are none
_ANSWER_SECONDS = 10.0  # how long an answer may take from its worker
_MOST_RESUBMISSIONS = 100  # of a piece whose workers die before they start it


def run_pieces(pieces: Sequence[Any], compute: Callable[[Any, Path], Any], client, output: Path,
               *, retries: int = 2, memory_bytes: int | None = None,
               may_lack: Callable[[Any, Sequence[str]], bool] = lambda piece, lost: False,
               on_result: Callable[[Any, dict], None] | None = None) -> Summary:
    """Compute the pieces that have no record yet, on the workers of a Dask client.

    The scheduler never holds more than a few pieces for each worker: a million need no graph of a
    million. Of the pieces that can be computed, the earlier in `pieces` goes first.

    Parameters
    ----------
    pieces : sequence of Piece
        See `jobs.pieces.Piece`; keys are unique.
    compute : callable
        ``compute(piece, output)``, a function of a module, see `Task`.
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
    Summary
        Ctrl-C ends up there, too.

    Raises
    ------
    ValueError
        Keys occur twice, or a piece needs one that does not exist, or itself.
    """
    run = _Run(pieces, client, output, may_lack, on_result)
    run.task = dict(compute=compute, output=output, run=uuid.uuid4().hex, retries=retries,
                    memory_bytes=memory_bytes)
    return run.go()


class _Run:
    """State of one call of `run_pieces`; only the thread that called it changes it."""

    def __init__(self, pieces, client, output, may_lack, on_result):
        self.order, self.upkeep = Order(pieces), Upkeep(client)
        self.pieces, self.client, self.records = pieces, client, Records(output)
        self.may_lack, self.on_result = may_lack, on_result
        self.task: dict[str, Any] = {}
        self.marks: dict[str, str | None] = {}  # of finished pieces; None of lost ones
        self.losses: dict[int, Loss] = {}
        self.tries: Counter[int] = Counter()  # beside the first
        self.troubles: Counter[int] = Counter()  # those of which were no deaths of workers
        self.futures: dict[Any, int] = {}
        self.answers: queue.SimpleQueue = queue.SimpleQueue()
        self.n_computed = self.n_found = 0
        self.stopped, self.computing_seconds, self.peak = '', 0.0, (0, '')
        self.n_threads, self.looked, self.threads_seen = 0, -1e9, time.monotonic()

    def go(self) -> Summary:
        begin, interrupted = time.monotonic(), False
        self.records.prepare()
        self.progress = Progress(len(self.pieces), sum(p.seconds for p in self.pieces))
        try:
            while not self.stopped and (self.order.ready or self.futures):
                self.look()
                self.submit()
                if self.futures:
                    self.take_answers()
        except KeyboardInterrupt:
            interrupted = True
        finally:
            self.progress.close()
            self.drop_futures()
        worst = [self.losses[i] for i in sorted(self.losses)]
        return Summary(len(self.pieces), self.n_computed, self.n_found, tuple(worst), self.stopped,
                       interrupted, time.monotonic() - begin, self.computing_seconds, *self.peak)

    def look(self) -> None:
        """Count the threads of all workers, now and then."""
        now = time.monotonic()
        if now - self.looked < _LOOK_SECONDS:
            return
        self.looked = now
        self.upkeep.look()
        if self.client.status != 'running':
            self.stop('the scheduler has gone; start the job again: it goes on where it stopped')
            return
        try:
            self.n_threads = sum(self.client.nthreads().values())
        except OSError as error:
            self.stop(f'the scheduler does not answer ({error}); start the job again: it goes on '
                      'where it stopped')
            return
        if self.n_threads:
            self.threads_seen = now
        elif now - self.threads_seen > _WAIT_SECONDS:
            self.stop(f'there was no worker for {_WAIT_SECONDS / 60:g} minutes; start workers and '
                      'the job again: it goes on where it stopped')
        self.progress.show(self.n_threads)

    def submit(self) -> None:
        """Give the workers pieces, the first of those that can be computed before others."""
        most = IN_FLIGHT * max(self.n_threads, 1)
        while self.order.ready and len(self.futures) < most and not self.stopped:
            self.consider(heapq.heappop(self.order.ready))

    def consider(self, index: int) -> None:
        """Submit a piece whose needs are settled, unless it is finished or cannot be computed."""
        piece = self.pieces[index]
        lost = [key for key in piece.needs if self.marks[key] is None]
        if lost and not self.may_lack(piece, lost):
            more = f' and {len(lost) - 1} more, which are lost' if lost[1:] else ', which is lost'
            self.lose(index, Outcome('lost', f'needs {lost[0]}{more}'))
            return
        mark = fingerprint(piece, {key: self.marks[key] for key in piece.needs})
        record = self.records.read(piece.key, mark)
        if record is not None:
            self.finish(index, Outcome('done', record=record))
            return
        self.records.forget(piece.key)
        self.send(index, mark)

    def send(self, index: int, mark: str) -> None:
        piece, number = self.pieces[index], self.tries[index]
        again = f', again ({number})' if number else ''
        # Dask's dashboard groups tasks by the first entry. The last one keeps jobs apart, for a
        # scheduler takes tasks of one key for one, whoever sent them.
        future = self.client.submit(
            run_piece, Task(piece=piece, mark=mark, **self.task),
            key=(piece.KIND, piece.key + again, self.task['run'][:8]),
            priority=-index)
        self.expect(index, future)

    def expect(self, index: int, future) -> None:
        self.futures[future] = index
        future.add_done_callback(self.answers.put)

    def take_answers(self) -> None:
        """Wait for an answer, and take all that came meanwhile."""
        try:
            future = self.answers.get(timeout=_LOOK_SECONDS)
        except queue.Empty:
            return
        while future is not None:
            index = self.futures.pop(future, None)
            outcome = None if index is None else self.outcome(index, future)
            if outcome is not None:
                self.settle(index, outcome)
            elif index is not None:
                self.expect(index, future)
            future = None if self.answers.empty() else self.answers.get()

    def outcome(self, index: int, future) -> Outcome | None:
        """What became of a piece; the end of its worker and of the scheduler among others.

        None where the answer has gone with its worker: Dask then computes the piece again. Nobody
        waits for that here, for it is `look` that replaces workers.
        """
        try:
            return self.answered(index, future)
        except dask().TimeoutError:
            return None

    def answered(self, index: int, future) -> Outcome | None:
        if future.status == 'finished':
            return future.result(timeout=_ANSWER_SECONDS)
        if future.status == 'cancelled':
            return Outcome('stop', 'the scheduler has gone, or dropped the piece '
                           f'{self.pieces[index].key}; start the job again: it goes on where it '
                           'stopped')
        if future.status != 'error':
            return None
        error = future.exception(timeout=_ANSWER_SECONDS)
        if isinstance(error, dask().KilledWorker):
            return self.after_death(index)
        if cannot_import(error):
            return Outcome('stop', f'a worker cannot load what it should run ({error}); install '
                           'this version of sar_imaging and its extra `archive` on all of them')
        return Outcome('again', f'{type(error).__name__}: {" ".join(str(error).split())}')

    def after_death(self, index: int) -> Outcome:
        """Lost if workers died of this piece too often; the others merely waited there."""
        key = self.pieces[index].key
        starts = self.records.starts(key, self.task['run'])
        if starts > self.task['retries']:
            return Outcome('lost', died(starts))
        if self.tries[index] >= _MOST_RESUBMISSIONS:
            return Outcome('lost', f'{_MOST_RESUBMISSIONS} workers died before they started it')
        return Outcome('free')

    def settle(self, index: int, outcome: Outcome) -> None:
        """Keep what became of a piece, or send it again."""
        if outcome.state == 'done':
            self.finish(index, outcome)
        elif outcome.state == 'stop':
            self.stop(outcome.reason)
        elif outcome.state == 'free' or self.troubles[index] < self.task['retries'] and (
                outcome.state == 'again'):
            self.tries[index] += 1
            self.troubles[index] += outcome.state == 'again'
            piece = self.pieces[index]
            self.send(index, fingerprint(piece, {key: self.marks[key] for key in piece.needs}))
        else:
            self.lose(index, outcome)

    def finish(self, index: int, outcome: Outcome) -> None:
        piece, record = self.pieces[index], outcome.record
        self.marks[piece.key] = record['fingerprint']
        fresh = record['run'] == self.task['run']
        self.n_computed += fresh
        self.n_found += not fresh
        if fresh:
            self.computing_seconds += record['seconds']
            self.peak = max(self.peak, (record['peak_bytes'], piece.key))
        self.progress.done(piece.seconds, record['seconds'] if fresh else None)
        if self.on_result is not None:
            self.on_result(piece, record['result'])
        self.order.settled(index)

    def lose(self, index: int, outcome: Outcome) -> None:
        piece = self.pieces[index]
        self.marks[piece.key] = None
        self.records.forget(piece.key)
        self.losses[index] = Loss(piece.key, outcome.reason, outcome.where)
        self.progress.lost(piece.seconds)
        self.order.settled(index)

    def stop(self, reason: str) -> None:
        self.stopped = self.stopped or reason

    def drop_futures(self) -> None:
        """Take back what was not begun; what runs is recorded by its worker, if it ends."""
        if self.futures and self.client.status == 'running':
            self.client.cancel(list(self.futures), force=True)
        self.futures.clear()
