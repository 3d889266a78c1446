"""Decide what an overloaded stage leaves out: whole apertures, or single blocks."""

from __future__ import annotations

from collections.abc import Callable

from .inlet import Inlet
from .worker import Worker

APERTURES, BLOCKS = 'drop_apertures', 'drop_blocks'
POLICIES = (APERTURES, BLOCKS)
_ADMISSION_FILL = 0.5  # a new aperture begins only when the queue has come down so far


class Gate:
    """Lets items into a worker's queue and decides what stays outside.

    With `APERTURES`, an item that finds the queue full means that its whole aperture is left
    out: what waits of it leaves the queue, what still comes of it stays outside, and `skip` tells
    the steps to forget what they have of it. The next aperture is let in when the queue is at
    most half full. So some apertures are complete and the others are missing, instead of all
    having holes. With `BLOCKS` the item alone stays outside.

    Parameters
    ----------
    worker : Worker
        Whose queue it is.
    inlet : Inlet
        How to read the items.
    policy : str
        `APERTURES` or `BLOCKS`.
    skip : callable
        Called in the worker's thread, in the order of the items, with the number of an aperture
        that is left out, and with None when the next one begins.
    """

    def __init__(self, worker: Worker, inlet: Inlet, policy: str,
                 skip: Callable[[int | None], None]):
        self._worker = worker
        self._inlet = inlet
        self._policy = policy
        self._skip = skip
        self._skipped: int | None = None
        self._furthest = 0.0  # end of what came of the aperture left out, 0 to 1

    @property
    def skipped(self) -> int | None:
        """Number of the aperture that is left out at the moment."""
        return self._skipped

    def put(self, item, received_s: float) -> list:
        """Offer an item to the queue, as ``(item, received_s)``.

        Returns the items dropped for its sake, itself included.

        Parts of items that belong to an aperture left out are dropped with it.
        """
        if self._policy == BLOCKS:
            return [] if self._enqueue(item, received_s) else [item]
        if self._skipped is not None and self._began_anew(item):
            self._resume()
        kept, dropped = self._split(item)
        if kept is None:
            return dropped
        if self._skipped is not None:
            if self._worker.fill > _ADMISSION_FILL:
                return dropped + self._leave_out(kept, received_s)
            self._resume()
        if self._enqueue(kept, received_s):
            return dropped
        return dropped + self._leave_out(kept, received_s)

    def _enqueue(self, item, received_s: float) -> bool:
        return self._worker.put((item, received_s), self._inlet.n_bytes(item))

    def _began_anew(self, item) -> bool:
        """Whether a recording loops or the radar restarted within the aperture left out."""
        if (self._inlet.apertures(item) != self._skipped).any():
            return False
        before, (first, last) = self._furthest, self._inlet.extent(item)
        self._furthest = max(before, last)
        return first < before - 0.5  # blocks that come late are not so far behind

    def _resume(self) -> None:
        self._skipped = None
        self._worker.call(lambda: self._skip(None))

    def _leave_out(self, item, received_s: float) -> list:
        """Leave out the aperture that an item ends in."""
        aperture = int(self._inlet.apertures(item)[-1])
        self._skipped, self._furthest = aperture, self._inlet.extent(item)[1]
        waiting = self._worker.clear(
            lambda entry: bool((self._inlet.apertures(entry[0]) == aperture).all()))
        kept, own = self._split(item)
        if kept is not None and not self._enqueue(kept, received_s):  # of the aperture before
            own = [item]
        self._worker.call(lambda: self._skip(aperture))
        return [i for i, _ in waiting] + own

    def _split(self, item) -> tuple[object | None, list]:
        """What is not of the aperture left out, and what is."""
        if self._skipped is None:
            return item, []
        outside = self._inlet.apertures(item) == self._skipped
        if outside.all():
            return None, [item]
        if not outside.any():
            return item, []
        return self._inlet.select(item, ~outside), [self._inlet.select(item, outside)]
