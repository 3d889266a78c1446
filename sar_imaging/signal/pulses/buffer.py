# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Order pulses by their counter, find gaps and duplicates, and cut blocks within apertures."""

from __future__ import annotations

import collections
import dataclasses

import numpy as np

from .block import CORRUPT, PulseBlock, concatenate, sound_pulses
from .sequence import (
    COUNTER_MASK,
    EventSource,
    RestartDetector,
    Verdict,
    counter_distance,
    describe_counters,
    describe_range,
)

_REMEMBERED_TIMES = 4096  # tell another sender's pulses from repeated ones
_REMEMBERED_GAPS = 1024  # enough to tell late pulses from duplicates; bounds the memory


@dataclasses.dataclass
class BufferStatistics:
    """Counts of pulses; ``received = emitted + duplicate + late + corrupt + held + reset``."""

    received: int = 0
    emitted: int = 0
    missing: int = 0
    duplicate: int = 0
    conflicting: int = 0  # of the duplicates: sent at another time than the pulse kept
    late: int = 0
    corrupt: int = 0
    reset: int = 0
    restarts: int = 0
    configuration_changes: int = 0
    apertures_started: int = 0


class PulseBuffer(EventSource):
    """Put pulses back in order, find gaps, and cut blocks within apertures.

    Pulses with the same ``counter // pulses_per_aperture`` belong to one aperture. Blocks are cut
    at multiples of `pulses_per_block` counted from the start of the aperture and at its end, so
    that the same pulses always give the same blocks, wherever the buffer was started. They are
    shorter where pulses are missing.

    A pulse that is `reorder_window_pulses` behind the newest one is declared missing. The first
    pulses of a sequence are held until that window is full, since earlier ones may still arrive.

    Parameters
    ----------
    pulses_per_aperture : int
        Length of an aperture in pulses.
    pulses_per_block : int
        Largest number of pulses in an emitted block.
    reorder_window_pulses : int
        Largest distance over which pulses are put back in order.
    positions_required : bool
        Refuse blocks without phase centres; False where they come from poses later.

    Attributes
    ----------
    statistics : BufferStatistics
        What happened so far.

    Raises
    ------
    ValueError
        A length is not positive, or the window is negative.

    Examples
    --------
    >>> from sar_imaging.signal.pulses.buffer import PulseBuffer
    >>> from sar_imaging.simulation import SCENARIOS
    >>> blocks = list(SCENARIOS['psf']().blocks(pulses_per_block=25))
    >>> buffer = PulseBuffer(pulses_per_aperture=200, pulses_per_block=50)
    >>> late_first = [blocks[1], blocks[0], *blocks[2:]]  # the network changed the order
    >>> ordered = [b for block in late_first for b in buffer.push(block)] + buffer.flush()
    >>> [int(block.counter[0]) for block in ordered], buffer.statistics.missing
    ([0, 50, 100, 150], 0)
    """

    def __init__(self, *, pulses_per_aperture: int, pulses_per_block: int = 32,
                 reorder_window_pulses: int = 128, positions_required: bool = True):
        if pulses_per_aperture < 1 or pulses_per_block < 1:
            raise ValueError(f'pulses_per_aperture={pulses_per_aperture}, pulses_per_block='
                             f'{pulses_per_block}; expected at least one pulse each')
        if reorder_window_pulses < 0:
            raise ValueError(f'reorder_window_pulses={reorder_window_pulses} is negative; '
                             'pass 0 for pulses that always come in order')
        super().__init__()
        self._pulses_per_aperture = pulses_per_aperture
        self._pulses_per_block = pulses_per_block
        self._window = reorder_window_pulses
        self._positions_required = positions_required
        self._detector = RestartDetector(reorder_window_pulses)
        self._example: PulseBlock | None = None
        self.statistics = BufferStatistics()
        self._begin_sequence()

    def _begin_sequence(self) -> None:
        # Counters are held without the 32 bit limit: `_unwrap` continues them past the wrap.
        self._pending: dict[int, tuple[PulseBlock, int]] = {}
        self._times: dict[int, int] = {}  # of pulses that came, ns
        self._next: int | None = None  # first counter that is neither emitted nor missing
        self._first = 0  # first emitted counter of the sequence
        self._highest: int | None = None
        self._gaps: collections.deque[list[int]] = collections.deque(maxlen=_REMEMBERED_GAPS)
        self._open_gap = False  # the last gap may still grow and is not yet reported
        self._rows: list[tuple[PulseBlock, int]] = []  # pulses of the block being filled
        self._block_end = 0
        self._aperture: tuple[int, int] | None = None

    @property
    def held_pulses(self) -> int:
        """Number of pulses received and not yet emitted."""
        return len(self._pending) + len(self._rows) + self._detector.held_pulses

    def push(self, block: PulseBlock) -> list[PulseBlock]:
        """Add pulses and return the blocks that became complete.

        Parameters
        ----------
        block : PulseBlock
            Pulses in any order. Its arrays are kept, not copied.

        Returns
        -------
        list of PulseBlock
            Blocks in the order of the pulse counter, each within one aperture.

        Raises
        ------
        ValueError
            The block has no positions and they are required.
        """
        if self._positions_required and not block.has_positions:
            raise ValueError('block has no phase centres; send transmit and receive positions '
                             'with the pulses, or set pose.source to odometry, pose or tf')
        self.statistics.received += block.n_pulses
        emitted = []
        if self._example is not None and not block.matches(self._example):
            emitted += self._change_configuration(self._example, block)
        self._example = block
        block = self._without_corrupt_pulses(block)
        if block.n_pulses:
            emitted += self._follow(self._detector.submit(block))
        return emitted

    def flush(self) -> list[PulseBlock]:
        """Emit everything held; pulses missing between them are declared missing.

        The sequence goes on: later pulses continue it.
        """
        emitted = self._follow(self._detector.flush())
        return emitted + self._drain()

    def reset(self) -> int:
        """Forget the sequence and everything held; returns the number of pulses so dropped."""
        dropped = self.held_pulses
        self.statistics.reset += dropped
        self._detector.reset()
        self._begin_sequence()
        return dropped

    def _change_configuration(self, example: PulseBlock, block: PulseBlock) -> list[PulseBlock]:
        emitted = self.flush()
        self.statistics.configuration_changes += 1
        self._report('configuration', f'{example.difference(block)}; a new pulse sequence begins')
        self._detector.reset()
        self._begin_sequence()
        return emitted

    def _without_corrupt_pulses(self, block: PulseBlock) -> PulseBlock:
        good = sound_pulses(block.samples)
        if good.all():
            return block
        self._count('corrupt', [int(c) for c in block.counter[~good]], CORRUPT)
        return block.select(good)

    def _follow(self, verdict: Verdict) -> list[PulseBlock]:
        emitted = []
        for block in verdict.late:
            self._insert(block)
        if verdict.restarted:
            emitted += self._drain()
            self.statistics.restarts += 1
            self._report('restart', 'pulse counter jumped back to '
                         f'{int(verdict.accepted[0].counter[0])}; the radar restarted or the '
                         'recording loops, a new pulse sequence begins')
            self._begin_sequence()
        for block in verdict.accepted:
            emitted += self._release(self._insert(block) - self._window)
        return emitted

    def _insert(self, block: PulseBlock) -> int:
        """Keep the pulses of a block that did not come before; returns the highest counter."""
        late: list[int] = []
        duplicate: list[int] = []
        counters, highest = self._unwrap(block.counter)
        for row, counter in enumerate(counters):
            stamp_ns = int(block.stamp_ns[row])
            if self._times.setdefault(counter, stamp_ns) != stamp_ns:
                self.statistics.conflicting += 1
            if counter in self._pending:
                duplicate.append(counter)
            elif self._next is None or counter >= self._next:
                self._pending[counter] = (block, row)
            else:
                (late if self._never_emitted(counter) else duplicate).append(counter)
        while len(self._times) > _REMEMBERED_TIMES:
            del self._times[next(iter(self._times))]
        self._count('duplicate', duplicate, 'dropped duplicate pulses')
        self._count('late', late, 'dropped pulses that came late')
        return highest

    def _unwrap(self, counters: np.ndarray) -> tuple[list[int], int]:
        """Counters continued past the 32 bit wrap-around, and the highest one until now."""
        before = int(counters[0]) if self._highest is None else self._highest
        unwrapped = before + counter_distance(counters, before)
        self._highest = max(before, int(unwrapped.max()))
        return unwrapped.tolist(), self._highest

    def _never_emitted(self, counter: int) -> bool:
        return counter < self._first or any(a <= counter <= b for a, b in self._gaps)

    def _release(self, decided: int) -> list[PulseBlock]:
        """Emit pulses in order; counters below `decided` that are absent are missing."""
        emitted: list[PulseBlock] = []
        for counter in sorted(self._pending):
            if self._next is None:
                if counter >= decided:
                    break
                self._next = self._start(counter)
            if counter > self._next:
                emitted += self._declare_missing(min(counter, decided))
                if counter > self._next:
                    break
            self._report_gap()
            emitted += self._emit(counter)
        return emitted

    def _drain(self) -> list[PulseBlock]:
        """Emit every pending pulse and the block being filled."""
        if self._highest is None:
            return []
        emitted = self._release(self._highest + 1)
        self._report_gap()
        return emitted + self._cut()

    def _start(self, counter: int) -> int:
        """Begin the sequence with a counter, and return it."""
        self._first = counter
        position = (counter & COUNTER_MASK) % self._pulses_per_aperture
        where = f', {position} pulses into its aperture' if position else ''
        self._report('start', f'pulse sequence starts at {counter & COUNTER_MASK}{where}')
        return counter

    def _declare_missing(self, end: int) -> list[PulseBlock]:
        """Counters from the next expected one up to `end` (exclusive) will not come any more."""
        if self._next is None or end <= self._next:
            return []
        self.statistics.missing += end - self._next
        if self._open_gap:
            self._gaps[-1][1] = end - 1
        else:
            self._gaps.append([self._next, end - 1])
            self._open_gap = True
        self._next = end
        return self._cut() if self._rows and end > self._block_end else []

    def _emit(self, counter: int) -> list[PulseBlock]:
        emitted = []
        if self._rows and counter > self._block_end:
            emitted += self._cut()
        if not self._rows:
            self._open_block(counter)
        self._rows.append(self._pending.pop(counter))
        self._next = counter + 1
        if counter == self._block_end:
            emitted += self._cut()
        return emitted

    def _open_block(self, counter: int) -> None:
        number = counter & COUNTER_MASK
        aperture, position = divmod(number, self._pulses_per_aperture)
        block_end = (position // self._pulses_per_block + 1) * self._pulses_per_block
        last_position = min(block_end, self._pulses_per_aperture) - 1
        # The counter's wrap-around ends an aperture too: number // length begins at zero again.
        self._block_end = counter + min(last_position - position, COUNTER_MASK - number)
        if (counter >> 32, aperture) != self._aperture:
            self._aperture = (counter >> 32, aperture)
            self.statistics.apertures_started += 1

    def _cut(self) -> list[PulseBlock]:
        """Join the collected pulses, slices of the received blocks where they are in order."""
        pieces: list[tuple[PulseBlock, int, int]] = []
        for block, row in self._rows:
            if pieces and pieces[-1][0] is block and pieces[-1][2] == row:
                pieces[-1] = (block, pieces[-1][1], row + 1)
            else:
                pieces.append((block, row, row + 1))
        self.statistics.emitted += len(self._rows)
        self._rows = []
        return [concatenate([b.select(slice(i, j)) for b, i, j in pieces])] if pieces else []

    def _report_gap(self) -> None:
        if self._open_gap:
            first, last = self._gaps[-1]
            self._report('missing', f'pulses {describe_range(first, last)} missing '
                         f'({last - first + 1})')
            self._open_gap = False

    def _count(self, kind: str, counters: list[int], text: str) -> None:
        if counters:
            setattr(self.statistics, kind, getattr(self.statistics, kind) + len(counters))
            numbers = [c & COUNTER_MASK for c in sorted(counters)]
            self._report(kind, f'{text}: {describe_counters(numbers)}')
