# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Assign pulses to apertures by their counters, and keep them until an aperture is full."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...geometry.illumination import Pointing
from .block import PulseBlock
from .sequence import (
    COUNTER_MASK,
    EventSource,
    RestartDetector,
    counter_distance,
    describe_counters,
    describe_range,
)

_SAME_PLACE = 0.1  # of an aperture, within which a leg begins where another did


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

    @property
    def known(self) -> np.ndarray:
        """(K,) int64 counters of the pulses that came, ascending."""
        return self.first + np.flatnonzero(self.seen)

    @property
    def missing(self) -> np.ndarray:
        """(M,) int64 counters of the others, ascending."""
        return self.first + np.flatnonzero(~self.seen)

    def position(self, block: PulseBlock) -> np.ndarray:
        """(P,) int64 place of each pulse in the aperture."""
        return block.counter.astype(np.int64) - self.first

    def new_pulses(self, block: PulseBlock) -> PulseBlock:
        """Pulses that did not come yet, each once, in their order."""
        position, first_rows = np.unique(self.position(block), return_index=True)
        rows = np.sort(first_rows[~self.seen[position]])
        return block if len(rows) == block.n_pulses else block.select(rows)

    def keep(self, block: PulseBlock) -> None:
        """Take note that pulses came that did not before."""
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


class AperturePulses(Aperture):
    """An aperture that keeps its pulses, so that its sub-apertures can be imaged again.

    Parameters
    ----------
    number, length, example :
        As for `Aperture`, and any block of the same configuration.
    memory : list of array
        Samples of apertures that are no longer needed, to be used again; taken from.

    Attributes
    ----------
    next : int
        First pulse of those that may still come.
    looks : (2, P, 3) float64 or None
        Boresight and up of the pulses, where they tell these.
    """

    def __init__(self, number: int, length: int, example: PulseBlock, memory: list[Any]):
        super().__init__(number, length)
        self._radar = example.radar
        n, channels, samples = len(self.seen), *example.samples.shape[1:]
        self.memory = memory.pop() if memory else np.empty((length, channels, samples),
                                                           np.complex64)
        self.tx_m, self.rx_m = np.zeros((2, n, channels, 3))
        self.looks = None if example.pointing is None else np.zeros((2, n, 3))
        self.next = 0

    def keep(self, block: PulseBlock) -> None:
        """Keep pulses that did not come before."""
        position = self.position(block)
        self.memory[position] = block.samples
        self.tx_m[position], self.rx_m[position] = block.tx_m, block.rx_m
        if self.looks is not None and block.pointing is not None:
            self.looks[:, position] = block.pointing.boresight, block.pointing.up
        super().keep(block)

    def part(self, number: int, length: int) -> slice:
        """Sub-aperture of this many pulses; the last may have fewer, none lie beyond."""
        return slice(number * length, min((number + 1) * length, len(self.seen)))

    def block(self, part: slice | None = None) -> PulseBlock:
        """Pulses of a part, or of all, that came; a view where all did."""
        part = part or slice(0, len(self.seen))
        index = part if self.seen[part].all() else part.start + np.flatnonzero(self.seen[part])
        counter = self.first + np.arange(len(self.seen), dtype=np.uint32)
        return PulseBlock(self._radar, True, self.stamp_ns[index], counter[index],
                          self.memory[index], self.tx_m[index], self.rx_m[index],
                          pointing=self._pointing(index))

    def _pointing(self, index: Any) -> Pointing | None:
        return None if self.looks is None else Pointing.of_unit_vectors(*self.looks[:, index])

    def begins_like(self, other: AperturePulses, n_pulses: int) -> bool:
        """Whether so many pulses lie, on average, where the first of another aperture do."""
        first, before = (a.rx_m[:n_pulses, 0][a.seen[:n_pulses]] for a in (self, other))
        track = other.rx_m[other.seen, 0]
        return (len(first) > 0 < len(before)
                and np.linalg.norm(first.mean(axis=0) - before.mean(axis=0))
                < _SAME_PLACE * np.linalg.norm(track[-1] - track[0]))


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
        To count in: what happened so far.
    min_pulse_fraction : float
        Share of its pulses, 0 to 1, without which `_drop_short` drops an aperture; an attribute,
        too, which may be changed at any time.

    Raises
    ------
    ValueError
        The length is not positive, or the fraction out of range.
    """

    def __init__(self, pulses_per_aperture: int, statistics: ApertureStatistics,
                 min_pulse_fraction: float = 0.0):
        if pulses_per_aperture < 1:
            raise ValueError(f'pulses_per_aperture={pulses_per_aperture}; expected at least one')
        if not 0.0 <= min_pulse_fraction <= 1.0:
            raise ValueError(f'min_pulse_fraction={min_pulse_fraction}; expected 0 to 1')
        super().__init__()
        self.statistics, self.min_pulse_fraction = statistics, min_pulse_fraction
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

    def _fill(self, aperture: Any, block: PulseBlock) -> list[Any]:
        """Use pulses of an aperture that did not come before; errors leave them unused."""
        raise NotImplementedError

    def _finish(self, aperture: Any) -> list[Any]:
        """Close an aperture."""
        raise NotImplementedError

    def _begin_sequence(self) -> None:
        self._open: Any = None
        self._closed: int | None = None  # number of the last closed aperture
        self._late: list[int] = []  # counters since the last aperture was closed
        self._warned: set[str] = set()  # of what, figures left out

    @property
    def filling(self) -> int | None:
        """Number of the aperture being filled, None when there is none."""
        return None if self._open is None else self._open.number

    def add(self, block: PulseBlock) -> list[Any]:
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
        return results + self._accept(self._detector.submit(block))

    def flush(self) -> list[Any]:
        """Close the aperture being filled; nothing more is expected for now."""
        results = self._accept(self._detector.flush()) + self._close()
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

    def _prepare(self, block: PulseBlock) -> list[Any]:
        """Close what belongs to an old configuration and get ready for a new one."""
        if self._example is not None and block.matches(self._example):
            return []
        plan, results = self._configure(block), []
        if self._example is not None:
            results = self.flush()
            self._report('configuration', f'{self._example.difference(block)}; a new aperture '
                         'begins')
            self._detector.reset()
            self._begin_sequence()
        self._plan, self._example = plan, block
        return results

    def _accept(self, verdict: Any) -> list[Any]:
        results = [result for b in verdict.late for result in self._accumulate(b)]
        if verdict.restarted:
            results += self._close()
            self.statistics.restarts += 1
            self._report('restart', 'pulse counter jumped back to '
                         f'{int(verdict.accepted[0].counter[0])}; the radar restarted or the '
                         'recording loops, a new aperture begins')
            self._begin_sequence()
        return results + [result for b in verdict.accepted for result in self._accumulate(b)]

    def _accumulate(self, block: PulseBlock) -> list[Any]:
        results = []
        numbers = block.counter // np.uint32(self._length)
        edges = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), block.n_pulses]
        for start, end in zip(edges[:-1], edges[1:], strict=True):
            piece = block if end - start == block.n_pulses else block.select(slice(start, end))
            results += self._add_to_aperture(int(numbers[start]), piece)
        return results

    def _add_to_aperture(self, number: int, block: PulseBlock) -> list[Any]:
        current = self._closed if self._open is None else self._open.number
        # across the wrap-around of the counters that numbers come from
        later = current is None or counter_distance(number * self._length,
                                                    current * self._length) > 0
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

    def _close(self) -> list[Any]:
        aperture, self._open = self._open, None
        if aperture is None:
            return []
        self._closed = aperture.number
        return self._finish(aperture)

    def _drop(self, aperture: Any, why: str) -> None:
        """Count and report an aperture of which nothing comes."""
        self.statistics.apertures_dropped += 1
        self._report('aperture', f'aperture {aperture.number} dropped: {why}')

    def _drop_short(self, aperture: Any, least: int = 1) -> bool:
        """Drop an aperture that has too few of its pulses, or fewer than the least number."""
        n_known, length = len(aperture.known), len(aperture.seen)
        short = n_known < max(least, self.min_pulse_fraction * length)
        if short:
            self._drop(aperture, f'{n_known} of {length} pulses, fewer than min_pulse_fraction='
                       f'{self.min_pulse_fraction:g}; missing '
                       f'{describe_counters(aperture.missing.tolist())}')
        return short

    def _warn(self, number: int, warnings: Iterable[str]) -> None:
        """Report an aperture's warnings, each once in a sequence, whatever its figures."""
        for warning in warnings:
            if (kind := re.sub(r'[-+.\d]+', '', warning)) not in self._warned:
                self._warned.add(kind)
                self._report('plan', f'aperture {number}: {warning}')

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
