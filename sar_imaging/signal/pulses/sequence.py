# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulse counters: wrap-around, ranges as text, restarts and late pulses, events for the log."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from .block import PulseBlock

COUNTER_MASK = 0xFFFF_FFFF


@dataclasses.dataclass(frozen=True)
class StreamEvent:
    """Something about the pulse stream that a person should read.

    Parameters
    ----------
    kind : str
        ``start``, ``missing``, ``duplicate``, ``late``, ``corrupt``, ``restart``,
        ``configuration`` or ``aperture``.
    text : str
        The log line.
    """

    kind: str
    text: str


class EventSource:
    """What has something to tell about its stream: events wait here until they are taken."""

    def __init__(self) -> None:
        self._events: list[StreamEvent] = []

    def take_events(self) -> list[StreamEvent]:
        """Events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def _report(self, kind: str, text: str) -> None:
        self._events.append(StreamEvent(kind, text))


def counter_distance(counter: ArrayLike, reference: int) -> np.ndarray:
    """Signed distance of pulse counters from a reference, across the 32 bit wrap-around.

    Parameters
    ----------
    counter : (P,) uint32 or int
        Pulse counters.
    reference : int
        Counter to measure from; only its lowest 32 bits count.

    Returns
    -------
    (P,) int64
        Distance in pulses, in ``[-2**31, 2**31)``.
    """
    difference = np.asarray(counter, np.int64) - (int(reference) & COUNTER_MASK)
    return (difference + 2**31) % 2**32 - 2**31


def describe_counters(counters: Iterable[int], limit: int = 6) -> str:
    """Pulse counters as ranges, such as ``'120..144, 150 (26)'``; long lists are shortened."""
    ranges: list[list[int]] = []
    total = 0
    for counter in counters:
        total += 1
        if ranges and counter == ranges[-1][1] + 1:
            ranges[-1][1] = counter
        else:
            ranges.append([counter, counter])
    text = ', '.join(describe_range(*r) for r in ranges[:limit])
    return f'{text}{", ..." if len(ranges) > limit else ""} ({total})'


def describe_range(first: int, last: int) -> str:
    """Inclusive range of counters as text, wrapped to 32 bits."""
    first, last = first & COUNTER_MASK, last & COUNTER_MASK
    return f'{first}' if first == last else f'{first}..{last}'


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What `RestartDetector` decided about the blocks it was given so far.

    Parameters
    ----------
    late : list of PulseBlock
        Blocks of the old sequence that turned out to be stragglers.
    restarted : bool
        The counter sequence began anew with the first block of `accepted`.
    accepted : list of PulseBlock
        Blocks to be processed now, in order.
    """

    late: list[PulseBlock]
    restarted: bool
    accepted: list[PulseBlock]


class RestartDetector:
    """Tell a restarted radar or a looping recording from blocks that merely come late.

    A block whose counters all lie more than `window` pulses behind the newest one is

    - a restart at once when it was transmitted after the newest pulse: only a new sequence
      has old counters and new times;
    - suspect when it was also transmitted earlier. It is held until the next block: another one
      that continues it means that the recording loops, anything else that it was a straggler.

    Parameters
    ----------
    window : int
        Distance in pulses up to which blocks may arrive out of order.
    """

    def __init__(self, window: int):
        self._window = window
        self.reset()

    def reset(self) -> None:
        """Forget the sequence; the next block begins a new one."""
        self._newest: int | None = None
        self._newest_ns = 0
        self._suspect: PulseBlock | None = None

    @property
    def held_pulses(self) -> int:
        """Number of pulses in the suspect block."""
        return 0 if self._suspect is None else self._suspect.n_pulses

    def submit(self, block: PulseBlock) -> Verdict:
        """Decide about a block of at least one pulse and about the one held before it."""
        if self._newest is None:
            return self._accept(Verdict([], False, [block]))
        behind = -int(counter_distance(block.counter, self._newest).max())
        held, self._suspect = self._suspect, None
        if behind > 0 and block.stamp_ns.min() > self._newest_ns:
            return self._restart([held] if held else [], [block])
        if behind <= self._window:
            return self._accept(Verdict([held] if held else [], False, [block]))
        if held is not None and self._continues(held, block):
            return self._restart([], [held, block])
        self._suspect = block
        return Verdict([held] if held else [], False, [])

    def flush(self) -> Verdict:
        """Decide about a held block when nothing follows: a new sequence has begun."""
        held, self._suspect = self._suspect, None
        return self._restart([], [held]) if held else Verdict([], False, [])

    @staticmethod
    def _continues(first: PulseBlock, second: PulseBlock) -> bool:
        ahead = counter_distance(second.counter, int(first.counter[-1])).min()
        return ahead > 0 and second.stamp_ns.min() >= first.stamp_ns.max()

    def _restart(self, late: list[PulseBlock], blocks: list[PulseBlock]) -> Verdict:
        self.reset()
        return self._accept(Verdict(late, True, blocks))

    def _accept(self, verdict: Verdict) -> Verdict:
        for block in verdict.accepted:
            if self._newest is None:
                self._newest, self._newest_ns = int(block.counter[0]), int(block.stamp_ns[0])
            ahead = int(counter_distance(block.counter, self._newest).max())
            self._newest += max(ahead, 0)
            self._newest_ns = max(self._newest_ns, int(block.stamp_ns.max()))
        return verdict
