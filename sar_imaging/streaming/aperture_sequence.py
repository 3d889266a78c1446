"""Assign pulses to apertures by their counters: what the live imagers have in common."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ..signal.pulses import PulseBlock
from ..signal.pulses.sequence import (
    COUNTER_MASK,
    EventSource,
    RestartDetector,
    counter_distance,
    describe_counters,
    describe_range,
)


@dataclasses.dataclass
class ApertureStatistics:
    """Counts of what an imager did; pulses unless the name says otherwise."""

    imaged: int = 0
    duplicate: int = 0
    late: int = 0
    restarts: int = 0
    images: int = 0
    apertures_dropped: int = 0


class Aperture:
    """An aperture being filled: which of its pulses came, and when they were sent.

    Parameters
    ----------
    number : int
        ``counter // length`` of its pulses.
    length : int
        Pulses of an aperture.
    """

    def __init__(self, number: int, length: int):
        self.number = number
        self.first = number * length
        # The last aperture before the 32 bit wrap-around of the counter is shorter.
        self.seen = np.zeros(min(length, COUNTER_MASK + 1 - self.first), bool)
        self.stamp_ns = np.zeros(len(self.seen), np.int64)

    @property
    def complete(self) -> bool:
        """True when the last pulse came."""
        return bool(self.seen[-1])

    def position(self, block: PulseBlock) -> np.ndarray:
        """(P,) int64 place of each pulse in the aperture."""
        return block.counter.astype(np.int64) - self.first

    def new_pulses(self, block: PulseBlock) -> PulseBlock:
        """Pulses that did not come yet, each once, in their order."""
        position, first_rows = np.unique(self.position(block), return_index=True)
        rows = np.sort(first_rows[~self.seen[position]])
        return block if len(rows) == block.n_pulses else block.select(rows)

    def mark(self, block: PulseBlock) -> None:
        """Take note that pulses came."""
        position = self.position(block)
        self.seen[position] = True
        self.stamp_ns[position] = block.stamp_ns

    def centre_ns(self, part: slice = slice(None)) -> int:
        """Time of the middle of the aperture or a part, by the line through its pulses' ends."""
        seen = self.seen[part]
        first, last = np.flatnonzero(seen)[[0, -1]]
        start, end = (int(self.stamp_ns[part][i]) for i in (first, last))
        if first == last:
            return start
        middle = (len(seen) - 1) / 2
        return start + round((end - start) * ((middle - first) / (last - first)))


class ApertureSequence(EventSource):
    """Sort arriving pulses into apertures and say when these begin and end.

    Pulses with the same ``counter // pulses_per_aperture`` belong to one aperture. It is closed
    when its last pulse came, when a pulse of a later aperture came, or by `flush`. Each pulse is
    used once. Apertures that were skipped count as dropped. Counters that begin anew, because a
    recording loops or the radar restarted, close the aperture and begin another.

    A subclass has its own kind of `Aperture` and does the work in `_configure`, `_begin`, `_fill`
    and `_finish`; what the latter two return is handed on by `add` and `flush`.

    Parameters
    ----------
    pulses_per_aperture : int
        Length of an aperture in pulses.
    statistics : ApertureStatistics
        To count in.

    Attributes
    ----------
    statistics : ApertureStatistics
        What happened so far.

    Raises
    ------
    ValueError
        The length is not positive.
    """

    def __init__(self, pulses_per_aperture: int, statistics: ApertureStatistics):
        if pulses_per_aperture < 1:
            raise ValueError(f'pulses_per_aperture={pulses_per_aperture}; expected at least one')
        super().__init__()
        self.statistics = statistics
        self._length = pulses_per_aperture
        self._plan: Any = None
        self._example: PulseBlock | None = None
        self._detector = RestartDetector(window=0)
        self._begin_sequence()

    def _configure(self, block: PulseBlock) -> Any:
        """What blocks of this configuration need, later ``self._plan``; nothing else changes."""
        raise NotImplementedError

    def _begin(self, number: int) -> Aperture:
        """An empty aperture."""
        raise NotImplementedError

    def _fill(self, aperture: Any, block: PulseBlock) -> list:
        """Use pulses of an aperture that did not come before; errors leave them unused."""
        raise NotImplementedError

    def _finish(self, aperture: Any) -> list:
        """Close an aperture."""
        raise NotImplementedError

    def _begin_sequence(self) -> None:
        self._open: Any = None
        self._closed: int | None = None  # number of the last closed aperture
        self._late: list[int] = []  # counters since the last aperture was closed

    @property
    def filling(self) -> int | None:
        """Number of the aperture being filled, None when there is none."""
        return None if self._open is None else self._open.number

    def add(self, block: PulseBlock) -> list:
        """Add range profiles and return what became complete.

        Parameters
        ----------
        block : PulseBlock
            Compressed, with positions.

        Raises
        ------
        ValueError
            The block is not compressed or has no positions, or the plan cannot be made for it.
        """
        if not block.compressed:
            raise ValueError('block holds raw pulses; expected range profiles, send them through '
                             'range compression first')
        if not block.has_positions:
            raise ValueError('block has no phase centres; backprojection needs the transmit and '
                             'receive position of every pulse')
        results = self._prepare(block)
        verdict = self._detector.submit(block)
        results += [result for b in verdict.late for result in self._accumulate(b)]
        return results + self._accept(verdict)

    def flush(self) -> list:
        """Close the aperture being filled; nothing more is expected for now."""
        results = self._accept(self._detector.flush())
        results += self._close()
        self._report_late()
        return results

    def reset(self) -> int:
        """Forget the aperture being filled and the sequence; returns the pulses so dropped."""
        dropped = self._detector.held_pulses
        if self._open is not None:
            dropped += int(np.count_nonzero(self._open.seen))
        self._report_late()
        self._detector.reset()
        self._begin_sequence()
        return dropped

    def _prepare(self, block: PulseBlock) -> list:
        """Close what belongs to an old configuration and get ready for a new one."""
        if self._example is not None and block.matches(self._example):
            return []
        plan, results = self._configure(block), []
        if self._example is not None:
            results = self.flush()
            self._report('configuration', 'radar parameters or samples changed; '
                         'a new aperture begins')
            self._detector.reset()
            self._begin_sequence()
        self._plan, self._example = plan, block
        return results

    def _accept(self, verdict) -> list:
        results = []
        if verdict.restarted:
            results += self._close()
            self.statistics.restarts += 1
            self._report('restart', 'pulse counter jumped back to '
                         f'{int(verdict.accepted[0].counter[0])}; the radar restarted or the '
                         'recording loops, a new aperture begins')
            self._begin_sequence()
        for block in verdict.accepted:
            results += self._accumulate(block)
        return results

    def _accumulate(self, block: PulseBlock) -> list:
        results = []
        numbers = block.counter // np.uint32(self._length)
        edges = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), block.n_pulses]
        for start, end in zip(edges[:-1], edges[1:], strict=True):
            piece = block if end - start == block.n_pulses else block.select(slice(start, end))
            results += self._add_to_aperture(int(numbers[start]), piece)
        return results

    def _add_to_aperture(self, number: int, block: PulseBlock) -> list:
        current = self._closed if self._open is None else self._open.number
        later = current is None or self._is_later(number, current)
        if not later and (self._open is None or number != current):
            self._count_late(block)
            return []
        results = []
        if later:
            results += self._close()
            self._report_late()
            self._report_skipped(number, current)
            self._open = self._begin(number)
        new = self._open.new_pulses(block)
        if new.n_pulses:
            results += self._fill(self._open, new)
        if new.n_pulses < block.n_pulses:
            self.statistics.duplicate += block.n_pulses - new.n_pulses
            self._report('duplicate', f'dropped {block.n_pulses - new.n_pulses} pulses that '
                         f'aperture {number} has already')
        return results + self._close() if self._open.complete else results

    def _count_late(self, block: PulseBlock) -> None:
        self.statistics.late += block.n_pulses
        self._late += block.counter.tolist()

    def _is_later(self, number: int, than: int) -> bool:
        """Order of aperture numbers, across the wrap-around of the counter they come from."""
        return int(counter_distance(number * self._length, than * self._length)) > 0

    def _close(self) -> list:
        aperture, self._open = self._open, None
        if aperture is None:
            return []
        self._closed = aperture.number
        return self._finish(aperture)

    def _report_skipped(self, number: int, after: int | None) -> None:
        """Report apertures between two of which no pulse came, as while a stage was down."""
        if after is None:
            return
        n_apertures = -(-(COUNTER_MASK + 1) // self._length)  # until the counter wraps around
        skipped = (number - after) % n_apertures - 1
        if skipped > 0:
            self.statistics.apertures_dropped += skipped
            last = (number - 1) % n_apertures
            self._report('aperture', f'no pulse came of apertures '
                         f'{describe_range((after + 1) % n_apertures, last)} ({skipped})')

    def _report_late(self) -> None:
        if self._late:
            late, self._late = self._late, []
            self._report('late', 'dropped pulses of an aperture that was closed before: '
                         f'{describe_counters(sorted(late))}')
