# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""One worker thread behind a bounded queue, so that callbacks stay short; others beside it."""

from __future__ import annotations

import collections
import concurrent.futures
import dataclasses
import os
import sys
import threading
from collections.abc import Callable
from typing import Any

from ...compilation import numba

_BACKGROUND_NICE = 10
_aside: set[threading.Thread] = set()


@dataclasses.dataclass(frozen=True)
class _Call:
    """A function to call between two items."""

    function: Callable[[], object]
    future: concurrent.futures.Future[Any]

    def run(self) -> None:
        if self.future.set_running_or_notify_cancel():
            try:
                self.future.set_result(self.function())
            except Exception as error:
                self.future.set_exception(error)


class Worker:
    """Work on items in the order they came, in a thread of its own.

    Parameters
    ----------
    work : callable
        Called with each item in the worker's thread.
    capacity : int
        Largest number of waiting items; more are refused.
    max_bytes : int
        Largest memory of waiting items; more are refused, but for one that waits alone.
    on_error : callable
        Called with the exception when `work` or `on_idle` raised one; the thread goes on.
    on_idle : callable or None
        Called in the worker's thread when no item waits and `idle_s()` has come down to zero.
    idle_s : callable or None
        Returns the seconds until then; None when there is nothing to be idle about.
    name : str
        Name of the thread.
    background : bool
        Whether other threads come first: the priority of this one is low.
    """

    def __init__(self, work: Callable[[object], None], *, capacity: int,
                 on_error: Callable[[Exception], None], max_bytes: int = 2**63,
                 on_idle: Callable[[], None] | None = None,
                 idle_s: Callable[[], float | None] = lambda: None, name: str = 'worker',
                 background: bool = False):
        self._work = work
        self._capacity = capacity
        self._max_bytes = max_bytes
        self._on_error = on_error
        self._on_idle = on_idle
        self._idle_s = idle_s
        self._background = background
        # calls, and items with their bytes
        self._items: collections.deque[Any] = collections.deque()
        self._n_items = self._n_bytes = 0
        self._in_work: object | None = None
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def put(self, item: Any, n_bytes: int = 0) -> bool:
        """Add an item; False when the queue is full and the item was not taken."""
        with self._changed:
            if self._n_items and (self._n_items >= self._capacity
                                  or self._n_bytes + n_bytes > self._max_bytes):
                return False
            self._items.append((item, n_bytes))
            self._n_items += 1
            self._n_bytes += n_bytes
            self._changed.notify()
        return True

    def call(self, function: Callable[[], object]) -> concurrent.futures.Future[Any]:
        """Call a function in the worker's thread, once what waits now is done.

        Its result or exception goes into the future, which is cancelled when the worker stops
        before.
        """
        call = _Call(function, concurrent.futures.Future())
        with self._changed:
            if self._stopping:
                call.future.cancel()
            else:
                self._items.append(call)
                self._changed.notify()
        return call.future

    @property
    def waiting(self) -> int:
        """Number of items in the queue."""
        return self._n_items

    @property
    def oldest(self) -> object | None:
        """The item in work, or else the one that waits longest; None when there is none."""
        with self._changed:
            if self._in_work is not None:
                return self._in_work
            return next((e[0] for e in self._items if not isinstance(e, _Call)), None)

    @property
    def working(self) -> bool:
        """True while the thread lives; after `stop`, when its patience was too short."""
        return self._thread.is_alive()

    @property
    def fill(self) -> float:
        """How full the queue is, 0 to 1, by number or by memory."""
        return max(self._n_items / self._capacity, min(self._n_bytes / self._max_bytes, 1.0))

    def clear(self, which: Callable[[Any], bool] = lambda item: True) -> list[Any]:
        """Discard the items that wait and return them, or some of them; calls stay."""
        removed: list[Any] = []
        kept: collections.deque[Any] = collections.deque()
        with self._changed:
            for queued in self._items:
                if isinstance(queued, _Call) or not which(queued[0]):
                    kept.append(queued)
                else:
                    removed.append(self._leave(queued))
            self._items = kept
        return removed

    def stop(self, patience_s: float | None = None) -> list[Any]:
        """Finish the item in work, join the thread and return the items that were not begun.

        Parameters
        ----------
        patience_s : float, optional
            How long the item in work may take; after that the thread goes on, see `working`. By
            default as long as it needs.
        """
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(patience_s)
        left = self.clear()
        for call in self._items:
            call.future.cancel()
        self._items.clear()
        return left

    def _leave(self, queued: Any) -> Any:
        """Item of an entry that leaves the queue."""
        item, n_bytes = queued
        self._n_items -= 1
        self._n_bytes -= n_bytes
        return item

    def _run(self) -> None:
        if self._background:
            _step_back()
        while True:
            with self._changed:
                if not self._items and not self._stopping:
                    self._changed.wait(self._idle_s())
                if self._stopping:
                    return
                queued = self._items.popleft() if self._items else None
                self._in_work = self._leave(queued) if isinstance(queued, tuple) else None
            if isinstance(queued, _Call):
                queued.run()
            elif queued is not None:
                self._guarded(self._work, self._in_work)
                self._in_work = None
            elif (remaining := self._idle_s()) is not None and remaining <= 0.0:
                self._guarded(self._on_idle)

    def _guarded(self, function: Callable[..., Any], *arguments: object) -> None:
        try:
            function(*arguments)
        except Exception as error:  # whatever one block does, the thread lives on
            self._on_error(error)


def _step_back() -> None:
    """Give the thread that calls this a low priority."""
    if sys.platform == 'linux':  # elsewhere the priority is that of the whole process
        thread = os.PRIO_PROCESS, threading.get_native_id()
        os.setpriority(*thread, max(os.getpriority(*thread), _BACKGROUND_NICE))


def aside(work: Callable[[], None], name: str) -> None:
    """Do what nobody waits for in a thread of its own, with low priority and on one processor.

    Where Numba's threads bear no second caller (its layer ``workqueue``), it is done at once.

    Parameters
    ----------
    work : callable
        Raises nothing.
    name : str
        Name of the thread.
    """
    def run() -> None:
        _step_back()
        numba.set_num_threads(1)
        work()

    if numba.threading_layer() == 'workqueue':
        work()
        return
    _aside.difference_update([thread for thread in _aside if not thread.is_alive()])
    _aside.add(thread := threading.Thread(target=run, name=name))
    thread.start()


def works_aside() -> bool:
    """Whether something that was begun by `aside` goes on."""
    return any(thread.is_alive() for thread in _aside)
