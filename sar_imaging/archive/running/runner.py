"""Runs pieces on Dask from the client: few at a time, each when what it needs is there.

Pieces come in the order in which they were given. Local workers that died while they started are
replaced, which Dask's nannies do not.
"""

from __future__ import annotations

import heapq
import queue
import time
import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from .cluster import cannot_import, dask
from .records import Records, fingerprint
from .summary import Loss, Progress, Summary
from .worker import Outcome, Task, died, run_piece


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
