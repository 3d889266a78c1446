# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Decide what an overloaded stage leaves out: whole apertures, or single blocks."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .health import Cause, Tally
from .inlet import Inlet
from .worker import Worker

APERTURES, BLOCKS = 'drop_apertures', 'drop_blocks'
POLICIES = (APERTURES, BLOCKS)
FAULTS = ('blocks_dropped', 'apertures_skipped', 'apertures_too_old', 'pulses_too_old')
_HOLD_S = 2.0  # that a stage counts as behind, at least, after it left something out
# Shares of the limit: what is predicted at most of an aperture that begins, up to which growth
# counts in that, and what one may have waited that begins after another was left out.
_READY, _ALONE, _FRESH = 0.9, 0.75, 0.25
# How much longer than an aperture before the blocks wait where the work is slower than the input,
# in apertures and in seconds, and for which share of an aperture at least.
_GROWING, _GROWING_S, _LASTING = 0.05, 0.01, 0.75
_ADMISSION_FILL = 0.5  # a new aperture begins only when the queue has come down so far


@dataclasses.dataclass
class _Verdict:
    """What was decided about an aperture, and how long its items waited."""

    left_out: bool
    waited_s: float  # of its first item
    furthest: float = 0.0  # end of what came of it, 0 to 1
    places: list[float] = dataclasses.field(default_factory=list)  # of its items, 0 to 1
    waits_s: list[float] = dataclasses.field(default_factory=list)


class AgeLimit:
    """Leaves out apertures that wait too long, so that a stage that fell behind catches up.

    The age of an image is how long its first item waits, and by how much the waiting grows until
    it is done; the latter is taken from the aperture before. An aperture is left out as a whole,
    the oldest first, when its first item comes to its turn and the sum exceeds the limit. Where
    the growth alone does, an aperture begins that hardly waited: its image is too old, and the
    youngest that can be had. One underway is given up where the waiting of an item, and its growth
    over what is left of the aperture, exceed the limit, as after a moment in which the machine was
    busy otherwise. So a stage that keeps up loses nothing, and one that does not has images.

    All methods are called in the worker's thread.

    Parameters
    ----------
    inlet : Inlet
        How to read the items.
    skip : callable
        Called with the number of each aperture that is left out.

    Attributes
    ----------
    aperture_s : float
        How long an aperture lasts, as its stamps say or as its items come, whichever is longer;
        infinite while that is not known.
    growing : bool
        Whether the items of most of an aperture waited longer than those of the one before.
    """

    LEAST_S = 0.3  # by default; a machine is busy otherwise for moments
    _APERTURES = 2.0  # by default
    _REMEMBERED = 8  # apertures, for items that come late

    def __init__(self, inlet: Inlet, skip: Callable[[int], None]):
        self._inlet, self._skip = inlet, skip
        self._verdicts: dict[int, _Verdict] = {}
        self._current: _Verdict | None = None
        self._done: _Verdict | None = None  # the latest one that was worked on
        self._behind = False  # the latest aperture was left out
        self._growth_s = 0.0  # of the waiting during the latest aperture that was worked on
        self._start: tuple[int, int, float] | None = None  # counter, stamp, reception
        self._grows_since: int | None = None  # counter
        self.aperture_s, self.growing = math.inf, False

    def limit_s(self, wanted_s: float) -> float:
        """The limit: what is wanted, or for 0 two apertures."""
        return wanted_s or max(self._APERTURES * self.aperture_s, self.LEAST_S)

    def admit(self, item: Any, received_s: float, now_s: float, wanted_s: float
              ) -> tuple[Any, list[int], Any]:
        """Decide about an item whose turn has come.

        Parameters
        ----------
        item
            Of the kind that the inlet reads.
        received_s, now_s : float
            When it came, and the time now, on the same steady clock.
        wanted_s : float
            The limit; 0 for the default.

        Returns
        -------
        kept : item or None
            What is to be worked on.
        begun : list of int
            Apertures that are left out from here on.
        dropped : item or None
            What belongs to apertures left out.
        """
        self._pace(item, received_s)
        waited_s, limit_s, begun = now_s - received_s, self.limit_s(wanted_s), []
        numbers = self._inlet.apertures(item)
        place = self._inlet.extent(item)[0] if numbers[0] == numbers[-1] else 0.0
        for number in dict.fromkeys(numbers.tolist()):
            if self._begins(number, item):
                left_out = self._judge_new(number, waited_s, limit_s)
            else:
                left_out = self._judge_again(self._verdicts[number], place, waited_s, limit_s)
            if left_out:
                begun.append(number)
                self._skip(number)
        if self._verdicts[int(numbers[-1])] is self._current:
            self._compare(item, place, waited_s)
        kept, dropped = self._inlet.split(item, np.array(
            [not self._verdicts[number].left_out for number in numbers.tolist()]))
        return kept, begun, dropped

    def _begins(self, number: int, item: Any) -> bool:
        """Whether an aperture begins: with a new number, or as the loop of a recording."""
        verdict = self._verdicts.get(number)
        if verdict is None:
            return True
        first, last = self._inlet.extent(item)
        if first > last:  # the item goes on into the next aperture
            return False
        before, verdict.furthest = verdict.furthest, max(verdict.furthest, last)
        return first < before - 0.5

    def _judge_new(self, number: int, waited_s: float, limit_s: float) -> bool:
        # Without places it was that of a wrong counter, within a block.
        if self._current is not None and not self._current.left_out and self._current.places:
            self._growth_s = waited_s - self._current.waited_s
            self._done = self._current
        growth_s = min(max(self._growth_s, 0.0), _ALONE * limit_s)
        left_out = (waited_s + growth_s > _READY * limit_s
                    or self._behind and waited_s > _FRESH * limit_s)
        self._behind = left_out
        self._verdicts.pop(number, None)
        self._current = self._verdicts[number] = _Verdict(left_out, waited_s)
        while len(self._verdicts) > self._REMEMBERED:
            del self._verdicts[next(iter(self._verdicts))]
        return left_out

    def _judge_again(self, verdict: _Verdict, place: float, waited_s: float,
                     limit_s: float) -> bool:
        rest_s = 0.0
        if verdict is self._current and self._done is not None:
            rest_s = max(self._growth_s + self._done.waited_s - self._before(place), 0.0)
        if verdict.left_out or waited_s + rest_s <= limit_s or self._growth_s > limit_s:
            return False
        verdict.left_out, self._growth_s = True, waited_s + rest_s
        self._behind = True
        return True

    def _before(self, place: float) -> float:
        """How long items at a place waited in the latest aperture that was worked on."""
        return float(np.interp(place, self._done.places, self._done.waits_s))

    def _compare(self, item: Any, place: float, waited_s: float) -> None:
        """Note how long an item waited, beside that at its place in the aperture before."""
        current, counter = self._current, self._inlet.counters(item)[0]
        if not current.places or place > current.places[-1]:
            current.places.append(place)
            current.waits_s.append(waited_s)
        grows = (self._done is not None and waited_s - self._before(place)
                 > max(_GROWING * self.aperture_s, _GROWING_S))
        if not grows or self._grows_since is None or counter < self._grows_since:
            self._grows_since = counter if grows else None
        self.growing = grows and (counter - self._grows_since
                                  >= _LASTING * self._inlet.pulses_per_aperture(item))

    def _pace(self, item: Any, received_s: float) -> None:
        counter, stamp_ns = self._inlet.counters(item)[0], self._inlet.stamp_ns(item)
        if self._start is None or not 0 < counter - self._start[0]:
            self._start = counter, stamp_ns, received_s
            return
        n_apertures = (counter - self._start[0]) / self._inlet.pulses_per_aperture(item)
        seconds = max(1e-9 * (stamp_ns - self._start[1]), received_s - self._start[2])
        if seconds > 0.0 and n_apertures < self._REMEMBERED:  # else the counter is wrong
            self.aperture_s = seconds / n_apertures
        if n_apertures >= 1.0:
            self._start = counter, stamp_ns, received_s


class Load(Worker):
    """The worker of a stage, which leaves out what it cannot keep up with and tells of it.

    With `APERTURES`, an item that finds the queue full means that its whole aperture is left
    out: what waits of it leaves the queue, what still comes of it stays outside, and `skip` tells
    the steps to forget what they have of it. The next aperture is let in when the queue is at
    most half full. So some apertures are complete and the others are missing, instead of all
    having holes. With `BLOCKS` the item alone stays outside. What has waited for too long when
    its turn comes is left out by `AgeLimit`.

    Parameters
    ----------
    work : callable
        Called in the worker's thread with each item that was let in, what of it is to be worked
        on, None for nothing, and when it came.
    inlet : Inlet
        How to read the items.
    parameters : mapping
        Current values, with `overload`, `max_age_s` and those of the queue.
    health : Tally
        Counters, with `FAULTS` and ``oldest_seconds``, and log.
    skip : callable
        Called in the worker's thread, in the order of the items, with the number of an aperture
        that is left out, and with None when the next one begins.
    **options
        Of `Worker`.

    Attributes
    ----------
    skipped : int or None
        Number of the aperture that is left out at the moment.
    """

    def __init__(self, work: Callable[[Any, Any, float], None], inlet: Inlet,
                 parameters: Mapping[str, Any], health: Tally,
                 skip: Callable[[int | None], None], **options: Any) -> None:
        super().__init__(lambda entry: work(entry[0], self._in_time(*entry), entry[1]),
                         capacity=parameters['worker_queue_size'],
                         max_bytes=int(1e6 * parameters['worker_queue_megabytes']), **options)
        self._inlet, self._parameters, self._health, self._skip = inlet, parameters, health, skip
        self._policy = parameters['overload']
        self.skipped: int | None = None
        self._furthest = 0.0  # end of what came of the aperture left out, 0 to 1
        self._ages = AgeLimit(inlet, skip)
        self._behind_until_s = 0.0

    @property
    def _limit_s(self) -> float:
        return self._ages.limit_s(self._parameters['max_age_s'])

    def offer(self, item: Any, received_s: float) -> list[Any]:
        """Queue an item with the time at which it came, unless the queue is full.

        Returns the items dropped for its sake, itself included.

        Parts of items that belong to an aperture left out are dropped with it.
        """
        before = self.skipped
        if not (dropped := self._let_in(item, received_s)):
            return dropped
        self._health.count('blocks_dropped', len(dropped))
        if self.skipped is None:
            what = f'dropped {self._inlet.describe(dropped[-1])}'
        elif self.skipped != before:
            self._health.count('apertures_skipped')
            what = f'aperture {self.skipped} is left out'
        else:
            return dropped  # more of the aperture that the log has told of
        self._health.warning(f'{what}: {self.waiting} blocks wait already; the work is '
                             'slower than the input')
        return dropped

    def _let_in(self, item: Any, received_s: float) -> list[Any]:
        if self._policy == BLOCKS:
            return [] if self._enqueue(item, received_s) else [item]
        if self.skipped is not None and self._began_anew(item):
            self._resume()
        kept, dropped = self._split(item)
        if kept is None:
            return dropped
        if self.skipped is not None:
            if self.fill > _ADMISSION_FILL:
                return dropped + self._leave_out(kept, received_s)
            self._resume()
        if self._enqueue(kept, received_s):
            return dropped
        return dropped + self._leave_out(kept, received_s)

    def _enqueue(self, item: Any, received_s: float) -> bool:
        return self.put((item, received_s), self._inlet.n_bytes(item))

    def _began_anew(self, item: Any) -> bool:
        """Whether a recording loops or the radar restarted within the aperture left out."""
        if (self._inlet.apertures(item) != self.skipped).any():
            return False
        before, (first, last) = self._furthest, self._inlet.extent(item)
        self._furthest = max(before, last)
        return first < before - 0.5  # blocks that come late are not so far behind

    def _resume(self) -> None:
        self.skipped = None
        self.call(lambda: self._skip(None))

    def _leave_out(self, item: Any, received_s: float) -> list[Any]:
        """Leave out the aperture that an item ends in."""
        aperture = int(self._inlet.apertures(item)[-1])
        self.skipped, self._furthest = aperture, self._inlet.extent(item)[1]
        waiting = self.clear(
            lambda entry: bool((self._inlet.apertures(entry[0]) == aperture).all()))
        kept, outside = self._split(item)
        if kept is not None and not self._enqueue(kept, received_s):  # of the aperture before
            outside = [item]
        self.call(lambda: self._skip(aperture))
        return [i for i, _ in waiting] + outside

    def _split(self, item: Any) -> tuple[Any, list[Any]]:
        """What is not of the aperture left out, and what is."""
        if self.skipped is None:
            return item, []
        kept, outside = self._inlet.split(item, self._inlet.apertures(item) != self.skipped)
        return kept, [] if outside is None else [outside]

    def _in_time(self, item: Any, received_s: float) -> Any:
        """What of an item does not come too late, None for nothing."""
        now = time.monotonic()
        kept, begun, dropped = self._ages.admit(item, received_s, now,
                                                self._parameters['max_age_s'])
        if self._ages.growing:
            self._behind_until_s = max(self._behind_until_s, now + _HOLD_S)
        if dropped is not None:
            self._behind_until_s = now + max(self._limit_s, _HOLD_S)
            self._health.count('pulses_too_old', dropped.n_pulses)
        for aperture in begun:
            self._health.count('apertures_too_old')
            self._health.warning(
                f'aperture {aperture} is left out: its blocks wait for {now - received_s:.2g} s, '
                f'its image would be older than max_age_s={self._limit_s:.2g}; the work is slower '
                'than the input')
        return kept

    def look(self) -> bool:
        """State whether the work falls behind; True when that begins."""
        oldest, now = self.oldest, time.monotonic()
        waits_s = now - oldest[1] if oldest is not None else 0.0
        self._health.set('oldest_seconds', waits_s)
        text = ''
        if waits_s > 0.5 * self._ages.limit_s(0.0) or now < self._behind_until_s:
            text = (f'falling behind: blocks wait for {waits_s:.2g} s, the work is slower than '
                    f'the input; images older than max_age_s={self._limit_s:.2g} are left out')
        return self._health.cause(Cause.BEHIND, text)
