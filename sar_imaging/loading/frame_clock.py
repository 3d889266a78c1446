"""When frames began, from stamps that may come late."""

from __future__ import annotations

import collections
import itertools
import statistics
from collections.abc import Sequence

_DRIFT = 1e-4  # relative, of a radar's clock against the computer's
_JUDGED = 20  # intervals that tell whether the period is right
_MOST_OFF = 0.1  # of a period, that their median may be off
_LONGEST_PAUSE = 1000  # periods; after longer ones the radar was started anew


class FrameClock:
    """Give each frame its time and its number.

    Stamps taken at receipt come late by a time that varies and is never negative. Where the
    period of the frames is known, the earliest stamps tell the times of the others: a frame
    cannot have begun later than its stamp, nor later than the frames before it plus whole periods.

    Parameters
    ----------
    period_s : float
        From frame to frame, seconds; 0 where it is unknown. Frames are then counted as they come.
    late_s : float
        From the start of a frame to its stamp at the least, seconds.
    jitter : bool
        Stamps vary: follow the earliest ones.

    Attributes
    ----------
    missing : int
        Frames that did not come so far.
    """

    def __init__(self, period_s: float, late_s: float, *, jitter: bool):
        self._period_ns, self._late_ns = round(period_s * 1e9), round(late_s * 1e9)
        self._jitter = jitter
        self._last: tuple[int, int] | None = None
        self._stamp_ns: collections.deque[int] = collections.deque(maxlen=_JUDGED + 1)
        self.missing = 0

    def place(self, stamp_ns: int) -> tuple[int, int]:
        """Start of a frame, nanoseconds, and its number.

        Parameters
        ----------
        stamp_ns : int
            Of the frame, nanoseconds.
        """
        self._stamp_ns.append(stamp_ns)
        start_ns = stamp_ns - self._late_ns
        if self._last is None:
            self._last = start_ns, 0
            return self._last
        before_ns, number = self._last
        steps = self._steps(start_ns - before_ns)
        self.missing += steps - 1
        if self._jitter and self._period_ns and steps <= _LONGEST_PAUSE:
            since_ns = steps * self._period_ns
            start_ns = min(start_ns, before_ns + round(since_ns * (1 + _DRIFT)))
        self._last = start_ns, number + steps
        return self._last

    def doubts(self) -> tuple[str, ...]:
        """Text on a period that the latest stamps contradict."""
        if not self._period_ns or len(self._stamp_ns) <= _JUDGED:
            return ()
        every_ns = [b - a for a, b in itertools.pairwise(self._stamp_ns)]
        # The median bears lost frames, the mean bears frames that arrive in bunches.
        usual = [middle(every_ns) / self._period_ns for middle in (statistics.median,
                                                                   statistics.fmean)]
        if any(abs(steps - max(1, round(steps))) <= _MOST_OFF for steps in usual):
            return ()
        return (f'frames come every {usual[0] * self._period_ns * 1e-9:.4g} s; expected '
                f'frames.period_s={self._period_ns * 1e-9:g} s or, with lost frames, a multiple: '
                'correct it (seconds from frame to frame)',)

    def _steps(self, since_ns: int) -> int:
        if not self._period_ns:
            return 1
        steps = max(1, round(since_ns / self._period_ns))
        return steps if steps <= _LONGEST_PAUSE else 1

    def settled(self, placed: Sequence[tuple[int, int]]) -> list[int]:
        """Starts of frames once all are known, nanoseconds: later ones tell of earlier ones, too.

        Parameters
        ----------
        placed : sequence of (int, int)
            What `place` gave for each frame.
        """
        starts = [start for start, _ in placed]
        if not (self._jitter and self._period_ns):
            return starts
        for i in range(len(starts) - 2, -1, -1):
            steps = placed[i + 1][1] - placed[i][1]
            if starts[i + 1] - starts[i] <= _LONGEST_PAUSE * self._period_ns:
                earliest = starts[i + 1] - round(steps * self._period_ns * (1 - _DRIFT))
                starts[i] = min(starts[i], earliest)
        return starts
