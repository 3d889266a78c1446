"""Form one image per aperture from range profiles as they arrive."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.sequence import (
    COUNTER_MASK,
    RestartDetector,
    StreamEvent,
    counter_distance,
    describe_counters,
)
from .backprojection import Backprojector


@dataclasses.dataclass(frozen=True)
class ApertureImage:
    """Image of one aperture.

    Parameters
    ----------
    image : (n_y, n_x) complex64
        ``f(x) = sum_m sum_n s_mn(tau(x)) exp(+j 2 pi f_c tau(x))``; row 0 is the largest y.
    grid : MapGrid
        Where the pixels are.
    stamp_ns : int
        Time of the middle of the aperture, nanoseconds since the epoch of the pulses' clock.
    aperture : int
        Number of the aperture, ``counter // pulses_per_aperture``.
    counters : (P,) uint32
        Counters of the pulses in the image, ascending.
    missing : (M,) int64
        Counters of the pulses that the aperture should have had, ascending.
    predicted_error_db : float
        Expected error of the backprojection against exact correlation, dB.
    """

    image: np.ndarray
    grid: MapGrid
    stamp_ns: int
    aperture: int
    counters: np.ndarray
    missing: np.ndarray
    predicted_error_db: float

    @property
    def n_pulses(self) -> int:
        """Number of pulses in the image."""
        return len(self.counters)

    @property
    def n_missing(self) -> int:
        """Number of pulses that the aperture lacks."""
        return len(self.missing)


@dataclasses.dataclass
class ApertureStatistics:
    """Counts of what `ApertureImager` did; pulses unless the name says otherwise."""

    imaged: int = 0
    duplicate: int = 0
    late: int = 0
    restarts: int = 0
    images: int = 0
    apertures_dropped: int = 0


class _Aperture:
    """The aperture being filled: its image so far and which pulses are in it."""

    def __init__(self, number: int, length: int, plan: Backprojector, shape: tuple[int, int]):
        self.number = number
        self.first = number * length
        # The last aperture before the 32 bit wrap-around of the counter is shorter.
        self.seen = np.zeros(min(length, COUNTER_MASK + 1 - self.first), bool)
        self.stamp_ns = np.zeros(len(self.seen), np.int64)
        self.image = np.zeros(shape, np.complex64)
        self.plan = plan

    @property
    def complete(self) -> bool:
        return bool(self.seen[-1])

    def add(self, block: PulseBlock) -> int:
        """Add the pulses not yet in the image and return their number."""
        position, first_rows = np.unique(block.counter.astype(np.int64) - self.first,
                                         return_index=True)
        rows = np.sort(first_rows[~self.seen[position]])
        if len(rows):
            new = block if len(rows) == block.n_pulses else block.select(rows)
            self.plan.add(new, self.image)
            position = new.counter.astype(np.int64) - self.first
            self.seen[position] = True
            self.stamp_ns[position] = new.stamp_ns
        return len(rows)

    def centre_ns(self) -> int:
        """Time of the aperture's middle, from the line through its first and last pulse."""
        first, last = np.flatnonzero(self.seen)[[0, -1]]
        start, end = int(self.stamp_ns[first]), int(self.stamp_ns[last])
        if first == last:
            return start
        middle = (len(self.seen) - 1) / 2
        return start + round((end - start) * ((middle - first) / (last - first)))


class ApertureImager:
    """Backproject range profiles while they arrive and return an image per aperture.

    Pulses with the same ``counter // pulses_per_aperture`` belong to one aperture. It is closed
    when its last pulse came, when a pulse of a later aperture came, or by `flush`. Its pulses may
    come in any order; each is used once. Counters that begin anew, because a recording loops or
    the radar restarted, close the aperture and begin another.

    Parameters
    ----------
    grid : MapGrid
        Pixels to image.
    pulses_per_aperture : int
        Length of an aperture in pulses.
    min_pulse_fraction : float
        Share of its pulses, 0 to 1, that an aperture must have to be imaged; may be changed at
        any time through the attribute of this name.
    target_db : float
        Largest error against exact correlation to plan for, dB.

    Attributes
    ----------
    statistics : ApertureStatistics
        What happened so far.

    Raises
    ------
    ValueError
        A length or fraction is out of range.
    """

    def __init__(self, grid: MapGrid, *, pulses_per_aperture: int,
                 min_pulse_fraction: float = 0.5, target_db: float = -80.0):
        if pulses_per_aperture < 1:
            raise ValueError(f'pulses_per_aperture={pulses_per_aperture}; expected at least one')
        if not 0.0 <= min_pulse_fraction <= 1.0:
            raise ValueError(f'min_pulse_fraction={min_pulse_fraction}; expected 0 to 1')
        self.grid = grid
        self.min_pulse_fraction = min_pulse_fraction
        self.statistics = ApertureStatistics()
        self._length = pulses_per_aperture
        self._target_db = target_db
        self._plan: Backprojector | None = None
        self._example: PulseBlock | None = None
        self._detector = RestartDetector(window=0)
        self._events: list[StreamEvent] = []
        self._begin_sequence()

    def _begin_sequence(self) -> None:
        self._open: _Aperture | None = None
        self._closed: int | None = None  # number of the last closed aperture
        self._late: list[int] = []  # counters since the last aperture was closed

    def take_events(self) -> list[StreamEvent]:
        """Events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def add(self, block: PulseBlock) -> list[ApertureImage]:
        """Add range profiles and return the images that became complete.

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
        images = self._prepare(block)
        verdict = self._detector.submit(block)
        images += [image for b in verdict.late for image in self._accumulate(b)]
        return images + self._accept(verdict)

    def flush(self) -> list[ApertureImage]:
        """Close the aperture being filled; nothing more is expected for now."""
        images = self._accept(self._detector.flush())
        images += self._close()
        self._report_late()
        return images

    def reset(self) -> int:
        """Forget the aperture being filled and the sequence; returns the pulses so dropped."""
        dropped = self._detector.held_pulses
        if self._open is not None:
            dropped += int(np.count_nonzero(self._open.seen))
        self._report_late()
        self._detector.reset()
        self._begin_sequence()
        return dropped

    def _prepare(self, block: PulseBlock) -> list[ApertureImage]:
        """Plan for a block of a new configuration and close what belongs to the old one."""
        if self._example is not None and block.matches(self._example):
            return []
        plan = Backprojector(self.grid, block.radar, block.n_samples, target_db=self._target_db)
        images = []
        if self._example is not None:
            images = self.flush()
            self._report('configuration', 'radar parameters or samples changed; '
                         'a new aperture begins')
            self._detector.reset()
            self._begin_sequence()
        self._plan, self._example = plan, block
        return images

    def _accept(self, verdict) -> list[ApertureImage]:
        images = []
        if verdict.restarted:
            images += self._close()
            self.statistics.restarts += 1
            self._report('restart', 'pulse counter jumped back to '
                         f'{int(verdict.accepted[0].counter[0])}; the radar restarted or the '
                         'recording loops, a new aperture begins')
            self._begin_sequence()
        for block in verdict.accepted:
            images += self._accumulate(block)
        return images

    def _accumulate(self, block: PulseBlock) -> list[ApertureImage]:
        images = []
        numbers = block.counter // np.uint32(self._length)
        edges = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), block.n_pulses]
        for start, end in zip(edges[:-1], edges[1:], strict=True):
            piece = block if end - start == block.n_pulses else block.select(slice(start, end))
            images += self._add_to_aperture(int(numbers[start]), piece)
        return images

    def _add_to_aperture(self, number: int, block: PulseBlock) -> list[ApertureImage]:
        current = self._closed if self._open is None else self._open.number
        later = current is None or self._is_later(number, current)
        if not later and (self._open is None or number != current):
            self.statistics.late += block.n_pulses
            self._late += block.counter.tolist()
            return []
        images = []
        if later:
            images += self._close()
            self._report_late()
            self._open = _Aperture(number, self._length, self._plan, self.grid.shape)
        added = self._open.add(block)
        self.statistics.imaged += added
        if added < block.n_pulses:
            self.statistics.duplicate += block.n_pulses - added
            self._report('duplicate', f'dropped {block.n_pulses - added} pulses that aperture '
                         f'{number} has already')
        return images + self._close() if self._open.complete else images

    def _is_later(self, number: int, than: int) -> bool:
        """Order of aperture numbers, across the wrap-around of the counter they come from."""
        return int(counter_distance(number * self._length, than * self._length)) > 0

    def _close(self) -> list[ApertureImage]:
        """Finish the aperture being filled: an image, or a report why there is none."""
        aperture, self._open = self._open, None
        if aperture is None:
            return []
        self._closed = aperture.number
        counters = aperture.first + np.flatnonzero(aperture.seen)
        missing = aperture.first + np.flatnonzero(~aperture.seen)
        if len(counters) < max(1, self.min_pulse_fraction * len(aperture.seen)):
            self.statistics.apertures_dropped += 1
            self._report('aperture', f'aperture {aperture.number} dropped: '
                         f'{len(counters)} of {len(aperture.seen)} pulses, fewer than '
                         f'min_pulse_fraction={self.min_pulse_fraction:g}; '
                         f'missing {describe_counters(missing.tolist())}')
            return []
        self.statistics.images += 1
        return [ApertureImage(aperture.image, self.grid, aperture.centre_ns(), aperture.number,
                              counters.astype(np.uint32), missing,
                              float(aperture.plan.predicted_error_db))]

    def _report_late(self) -> None:
        if self._late:
            late, self._late = self._late, []
            self._report('late', 'dropped pulses of an aperture that was closed before: '
                         f'{describe_counters(sorted(late))}')

    def _report(self, kind: str, text: str) -> None:
        self._events.append(StreamEvent(kind, text))
