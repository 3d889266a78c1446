"""One worker thread behind a bounded queue: callbacks stay short, nothing waits unseen."""

from __future__ import annotations

import collections
import concurrent.futures
import dataclasses
import threading
import time
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class _Call:
    """A function to call between two items."""

    function: Callable[[], object]
    future: concurrent.futures.Future

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
    on_error : callable
        Called with the exception when `work` or `on_idle` raised one; the thread goes on.
    on_idle : callable or None
        Called in the worker's thread, once, when no item came for `idle_s()` seconds.
    idle_s : callable or None
        Returns that time, seconds.
    name : str
        Name of the thread.
    """

    def __init__(self, work: Callable[[object], None], *, capacity: int,
                 on_error: Callable[[Exception], None],
                 on_idle: Callable[[], None] | None = None,
                 idle_s: Callable[[], float] | None = None, name: str = 'worker'):
        self._work = work
        self._capacity = capacity
        self._on_error = on_error
        self._on_idle = on_idle
        self._idle_s = idle_s
        self._items: collections.deque = collections.deque()
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def put(self, item) -> bool:
        """Add an item; False when the queue is full and the item was not taken."""
        with self._changed:
            if len(self._items) >= self._capacity:
                return False
            self._items.append(item)
            self._changed.notify()
        return True

    def call(self, function: Callable[[], object]) -> concurrent.futures.Future:
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
        return len(self._items)

    def clear(self) -> list:
        """Discard the items that wait and return them; calls stay."""
        with self._changed:
            items = [i for i in self._items if not isinstance(i, _Call)]
            self._items = collections.deque(i for i in self._items if isinstance(i, _Call))
        return items

    def stop(self) -> list:
        """Finish the item in work, join the thread and return the items that were not begun."""
        with self._changed:
            self._stopping = True
            left = list(self._items)
            self._items.clear()
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join()
        for call in left:
            if isinstance(call, _Call):
                call.future.cancel()
        return [item for item in left if not isinstance(item, _Call)]

    def _run(self) -> None:
        idle_since: float | None = None  # None when there is nothing to be idle about
        while True:
            with self._changed:
                if not self._items and not self._stopping:
                    self._changed.wait(self._remaining(idle_since))
                if self._stopping:
                    return
                item = self._items.popleft() if self._items else None
            if isinstance(item, _Call):
                item.run()
            elif item is not None:
                self._guarded(self._work, item)
                idle_since = time.monotonic()
            elif idle_since is not None and self._remaining(idle_since) == 0.0:
                self._guarded(self._on_idle)
                idle_since = None

    def _remaining(self, idle_since: float | None) -> float | None:
        """Seconds until `on_idle` is due; None waits for the next item."""
        if idle_since is None or self._on_idle is None:
            return None
        return max(0.0, idle_since + self._idle_s() - time.monotonic())

    def _guarded(self, function: Callable, *arguments) -> None:
        try:
            function(*arguments)
        except Exception as error:  # whatever one block does, the thread lives on
            self._on_error(error)
