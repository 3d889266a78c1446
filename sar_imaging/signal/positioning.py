# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compute positions of pulses, and where the antenna looks, from poses on a clock of their own."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.alignment import Alignment
from ..geometry.antenna import Mount
from ..geometry.poses import Poses, PoseStatus, PoseTable, PoseTrack, PoseVerdict
from ..geometry.track import mean_centres
from .pulses import PulseBlock
from .pulses.sequence import COUNTER_MASK, EventSource, counter_distance, describe_counters
from .radar import RadarParameters

_BEFORE = 16  # pulses of the block before, which tell the direction of the track, too


class PointingFinder:
    """Pointing of blocks that come one after the other with their positions.

    Parameters
    ----------
    mount : Mount
        One that needs no attitude.
    """

    def __init__(self, mount: Mount):
        self._mount = mount
        self._last: tuple[int, np.ndarray] | None = None  # counter, and centres up to there

    def __call__(self, block: PulseBlock) -> PulseBlock:
        """The block with its pointing, which replaces any that it has.

        Raises
        ------
        ValueError
            The platform does not move, so that its track has no direction.
        """
        before = np.empty((0, 3))
        if self._last is not None and int(block.counter[0]) == self._last[0] + 1:
            before = self._last[1]
        n = len(before)
        centre = np.concatenate([before, block.phase_centre_m])
        self._last = int(block.counter[-1]), centre[-_BEFORE:]
        # times before a block matter to no mount
        stamp_ns = np.concatenate([np.full(n, block.stamp_ns[0]), block.stamp_ns])
        pointing = self._mount.pointing(stamp_ns, centre).select(slice(n, None))
        return dataclasses.replace(block, pointing=pointing)

    def reset(self) -> None:
        """Forget the pulses before."""
        self._last = None


_REASONS = {
    PoseStatus.GAP: 'the poses around them are further apart than max_gap_s',
    PoseStatus.JUMP: 'the frame of the poses jumped',
    PoseStatus.BEFORE: 'they were sent before the first pose',
    PoseStatus.LATE: 'no pose came in time',
}


@dataclasses.dataclass
class PositioningStatistics:
    """Counts; ``received = positioned + without_pose + other_frame + waiting + reset``."""

    received: int = 0
    positioned: int = 0
    without_pose: int = 0
    other_frame: int = 0
    reset: int = 0
    poses: int = 0
    poses_corrupt: int = 0
    poses_old: int = 0
    pose_outliers: int = 0
    pose_gaps: int = 0
    pose_jumps: int = 0
    pose_restarts: int = 0


def without_range_bias(radar: RadarParameters, alignment: Alignment) -> RadarParameters:
    """Radar parameters whose delays are geometric: the first sample comes earlier by the bias.

    The samples stay as they are, and so does the phase that the carrier had when it came so much
    too late: images carry the constant factor ``exp(-j 4 pi f_c range_bias / c)``.
    """
    delay_s = (radar.first_sample_delay_s
               - 2 * alignment.range_bias_m / radar.propagation_speed_m_per_s)
    return dataclasses.replace(radar, first_sample_delay_s=delay_s)


def with_positions(block: PulseBlock, poses: Poses, alignment: Alignment,
                   mount: Mount | None = None) -> PulseBlock:
    """Block with the phase centres of its platform's poses.

    Parameters
    ----------
    block : PulseBlock
        P pulses; positions that it has are replaced.
    poses : Poses
        The platform at the P pulses, all ready.
    alignment : Alignment
        Lever arms and range bias.
    mount : Mount, optional
        Mount of the antenna: the block then has its pointing.

    Returns
    -------
    PulseBlock
        Its radar parameters are those `without_range_bias`; times stay those of the radar.

    Raises
    ------
    ValueError
        The lever arms do not fit the channels, or a pose is not ready.
    """
    tx_m, rx_m = alignment.phase_centres(poses.position_m, poses.attitude, block.n_channels)
    pointing = block.pointing if mount is None else mount.pointing(
        block.stamp_ns, mean_centres(tx_m, rx_m), poses.attitude)
    return dataclasses.replace(block, radar=without_range_bias(block.radar, alignment),
                               tx_m=tx_m, rx_m=rx_m, pointing=pointing)


def locate(block: PulseBlock, track: PoseTrack | PoseTable, alignment: Alignment,
           mount: Mount | None = None) -> PulseBlock:
    """Give the pulses of a whole recording their phase centres from poses.

    This is the forward model of time offset, range bias and lever arms: call it again with
    another alignment to try that one.

    Parameters
    ----------
    block : PulseBlock
        Pulses, with or without positions.
    track : PoseTrack or PoseTable
        Track of the platform, such as `recordings.load` gives it.
    alignment : Alignment
        Between the two.
    mount : Mount, optional
        Mount of the antenna: the block then has its pointing.

    Returns
    -------
    PulseBlock
        See `with_positions`.

    Raises
    ------
    ValueError
        A pulse has no pose; the text says how many and why.

    Examples
    --------
    >>> import dataclasses
    >>> import numpy as np
    >>> from sar_imaging.geometry.alignment import Alignment
    >>> from sar_imaging.geometry.poses import PoseTrack
    >>> from sar_imaging.signal.positioning import locate
    >>> from sar_imaging.simulation import SCENARIOS
    >>> pulses = next(SCENARIOS['psf']().blocks(4))
    >>> pulses = dataclasses.replace(pulses, tx_m=None, rx_m=None)
    >>> poses = PoseTrack()
    >>> for n in range(-5, 10):  # 5 m/s along y, 100 poses a second
    ...     stamp_ns = int(pulses.stamp_ns[0]) + n * 10_000_000
    ...     _ = poses.add(stamp_ns, (0.0, 0.05 * n, 2.0), (0.0, 0.0, 0.0, 1.0))
    >>> lever_arm = Alignment(tx_m=np.array([[0.1, 0.0, 0.0]]), rx_m=np.array([[0.1, 0.0, 0.0]]))
    >>> locate(pulses, poses, lever_arm).phase_centre_m.round(4).tolist()
    [[0.1, 0.0, 2.0], [0.1, 0.0075, 2.0], [0.1, 0.015, 2.0], [0.1, 0.0225, 2.0]]
    """
    poses = track.sample(block.stamp_ns + alignment.time_offset_ns, final=True)
    for status in np.unique(poses.status[poses.status != PoseStatus.READY]):
        n = int((poses.status == status).sum())
        raise ValueError(f'{n} of {block.n_pulses} pulses have no pose: '
                         f'{_REASONS[PoseStatus(status)]}')
    return with_positions(block, poses, alignment, mount)


def join_turns(located: Sequence[PulseBlock], turn: np.ndarray) -> PulseBlock:
    """Block whose channels have the phase centres of their own times.

    Parameters
    ----------
    located : sequence of PulseBlock
        The same pulses of C channels with positions at T times.
    turn : (1 or C,) int64
        Which of them counts for each channel; one for all.

    Returns
    -------
    PulseBlock
        The first one with other phase centres.
    """
    if len(located) == 1:
        return located[0]
    channels = np.arange(located[0].n_channels)
    tx_m, rx_m = (np.stack([getattr(block, name) for block in located])[turn, :, channels]
                  .transpose(1, 0, 2) for name in ('tx_m', 'rx_m'))
    return dataclasses.replace(located[0], tx_m=tx_m, rx_m=rx_m)


def _joint_status(turns: list[Poses]) -> np.ndarray:
    """(P,) status of pulses of which each channel has a pose of its own, all in one frame."""
    status = turns[0].status.copy()
    for turn in turns[1:]:
        status = np.where(status == PoseStatus.READY, turn.status, status)
        status[(status == PoseStatus.READY) & (turn.frame != turns[0].frame)] = PoseStatus.JUMP
    for turn in turns:
        status[turn.status == PoseStatus.WAIT] = PoseStatus.WAIT
    return status


class Positioner(EventSource):
    """Give pulses their positions as soon as their poses are known.

    Blocks wait, in order, until all their pulses are decided, at most `wait_s` and in total at
    most `max_waiting_pulses`; then those that have no pose are dropped. Within an aperture only
    the pulses of one frame pass: after a jump of the frame the rest of the aperture is dropped,
    since an image of both parts would be of neither.

    Parameters
    ----------
    track : PoseTrack
        Poses; a new one takes its place when their clock goes back.
    alignment : Alignment
        Between poses and pulses.
    pulses_per_aperture : int
        Length of an aperture; blocks do not cross apertures.
    wait_s : float
        Longest wait for poses, seconds.
    max_waiting_pulses : int
        Bounds the memory.
    channel_offset_s : (1 or C,) array_like
        When each channel is sent after the stamp of its pulse, seconds: of radars whose
        transmitters take turns. One stands for all channels.
    mount : Mount, optional
        Mount of an antenna whose pointing follows from the attitude.

    Attributes
    ----------
    statistics : PositioningStatistics
        What happened so far.
    track : PoseTrack
        The poses.
    """

    def __init__(self, track: PoseTrack, alignment: Alignment, *, pulses_per_aperture: int,
                 wait_s: float = 1.0, max_waiting_pulses: int = 16_384,
                 channel_offset_s: ArrayLike = (0.0,), mount: Mount | None = None) -> None:
        super().__init__()
        self.track, self._alignment, self._mount = track, alignment, mount
        offset_ns = np.rint(np.asarray(channel_offset_s, float) * 1e9).astype(np.int64)
        self._offsets_ns, self._turn = np.unique(offset_ns, return_inverse=True)
        self._pulses_per_aperture = pulses_per_aperture
        self._wait_s, self._max_waiting = wait_s, max_waiting_pulses
        self._waiting: collections.deque[tuple[PulseBlock, float]] = collections.deque()
        self._n_waiting = 0
        self._last_verdict = PoseVerdict.TAKEN
        self._aperture: tuple[int, int] | None = None  # number and frame
        self._last_counter = 0
        self._nothing_since: PoseStatus | None = None  # why the blocks so far have no pose at all
        self._told_channels = 0
        self.statistics = PositioningStatistics()

    @property
    def waiting_pulses(self) -> int:
        """Pulses that wait for their poses."""
        return self._n_waiting

    def add_pose(self, stamp_ns: int, position_m: np.ndarray,
                 quaternion: Sequence[float] | np.ndarray) -> list[PulseBlock]:
        """Take a pose; see `PoseTrack.add`.

        Returns
        -------
        list of PulseBlock
            What had to be decided because the clock of the poses went back; call `advance` for
            the pulses that waited for this pose.
        """
        before = self.track.span_ns
        verdict = self.track.add(stamp_ns, position_m, quaternion)
        self._count_pose(verdict, stamp_ns, before)
        self._tell_of_departures()
        if verdict != PoseVerdict.RESTART:
            return []
        decided = self._decide(lambda since: True)
        self.track = self.track.successor()
        return decided

    def push(self, block: PulseBlock, now_s: float) -> list[PulseBlock]:
        """Add a block of one aperture and return those that are decided.

        Parameters
        ----------
        block : PulseBlock
            Pulses in order; positions that it has are replaced.
        now_s : float
            Time on any steady clock, seconds; the same clock as for `advance`.

        Raises
        ------
        ValueError
            The lever arms or the offsets of the channels do not fit its channels.
        """
        self._alignment.check_channels(block.n_channels)
        if len(self._turn) not in (1, block.n_channels):
            raise ValueError(f'{len(self._turn)} channel offsets for {block.n_channels} channels; '
                             'give one for all or one for each')
        self._tell_of_one_place(block.n_channels)
        self.statistics.received += block.n_pulses
        self._waiting.append((block, now_s))
        self._n_waiting += block.n_pulses
        return self.advance(now_s)

    def _tell_of_one_place(self, n_channels: int) -> None:
        """Say once that all channels share their phase centres."""
        if n_channels == self._told_channels:
            return
        self._told_channels = n_channels
        if n_channels > 1 and self._alignment.one_place and len(self._turn) == 1:
            self._report('one_place', f'{n_channels} channels with the same lever arms: all are '
                         'imaged as if they were at one place; give antenna.tx or antenna.rx x, '
                         'y, z of each channel unless they are')

    def advance(self, now_s: float) -> list[PulseBlock]:
        """Blocks that are decided now: their poses came, or the wait is over."""
        return self._decide(lambda since: now_s - since >= self._wait_s
                            or self._n_waiting > self._max_waiting)

    def reset(self) -> int:
        """Drop the pulses that wait and return their number; the poses stay."""
        dropped, self._n_waiting = self._n_waiting, 0
        self._waiting.clear()
        self._aperture = None
        self.statistics.reset += dropped
        return dropped

    def _decide(self, is_final: Callable[..., Any]) -> list[PulseBlock]:
        out = []
        while self._waiting:
            block, since = self._waiting[0]
            turns = self._sample(block.stamp_ns, is_final(since))
            status = _joint_status(turns)
            if (status == PoseStatus.WAIT).any():
                break
            self._waiting.popleft()
            self._n_waiting -= block.n_pulses
            out += self._located(block, turns, status)
        return out

    def _sample(self, stamp_ns: np.ndarray, final: bool) -> list[Poses]:
        """Poses at each of the channels' different times."""
        stamp_ns = stamp_ns + self._alignment.time_offset_ns
        return [self.track.sample(stamp_ns + offset, final=final) for offset in self._offsets_ns]

    def _located(self, block: PulseBlock, turns: list[Poses],
                 status: np.ndarray) -> list[PulseBlock]:
        """The pulses with a pose in the frame of their aperture, as no or one block."""
        ready = status == PoseStatus.READY
        for reason in map(PoseStatus, np.unique(status[~ready])):
            some = status == reason
            self._drop(block.counter[some], 'without_pose', _REASONS[reason]
                       + self._distance(block.stamp_ns[some], reason),
                       told=reason == self._nothing_since)
        self._nothing_since = None if ready.any() else reason
        if not ready.any():
            return []
        frame = self._frame_of(block, int(turns[0].frame[ready][0]))
        kept = ready & (turns[0].frame == frame)
        self._drop(block.counter[ready & ~kept], 'other_frame',
                   'the frame of the poses jumped within their aperture')
        if not kept.any():
            return []
        self.statistics.positioned += int(kept.sum())
        if not kept.all():
            block = block.select(kept)
        located = [with_positions(block, turn.select(kept), self._alignment, self._mount)
                   for turn in turns]
        return [join_turns(located, self._turn)]

    def _frame_of(self, block: PulseBlock, first_frame: int) -> int:
        """Frame of the block's aperture: that of its first pulse with a pose."""
        number = int(block.counter[0]) // self._pulses_per_aperture
        went_on = counter_distance(block.counter[0], self._last_counter) > 0
        if self._aperture is None or self._aperture[0] != number or not went_on:
            self._aperture = number, first_frame
        self._last_counter = int(block.counter[-1])
        return self._aperture[1]

    def _distance(self, stamp_ns: np.ndarray, reason: PoseStatus) -> str:
        """How far pulses are from the poses that there are."""
        span = self.track.span_ns
        if span is None or reason not in (PoseStatus.BEFORE, PoseStatus.LATE):
            return ''
        stamp_ns = stamp_ns + self._alignment.time_offset_ns
        if reason == PoseStatus.BEFORE:
            return f', by up to {1e-9 * (span[0] - int(stamp_ns[0])):.3g} s'
        return f'; the newest is up to {1e-9 * (int(stamp_ns[-1]) - span[1]):.3g} s older'

    def _drop(self, counters: np.ndarray, kind: str, why: str, *, told: bool = False) -> None:
        """Count pulses that are dropped, and report them unless that goes on as it did."""
        if not counters.size:
            return
        setattr(self.statistics, kind, getattr(self.statistics, kind) + counters.size)
        if not told:
            numbers = [int(c) & COUNTER_MASK for c in counters]
            self._report(kind, f'dropped pulses {describe_counters(numbers)}: {why}')

    def _tell_of_departures(self) -> None:
        for departure in self.track.take_departures():
            if departure.jump:
                self.statistics.pose_jumps += 1
            else:
                self.statistics.pose_outliers += departure.n_poses
            self._report('pose_jump' if departure.jump else 'pose_outlier', str(departure))

    def _count_pose(self, verdict: PoseVerdict, stamp_ns: int, before: Any) -> None:
        s = self.statistics
        s.poses += 1
        after_s = (stamp_ns - before[1]) * 1e-9 if before else 0.0
        repeated = verdict == self._last_verdict  # one line for a run of them
        self._last_verdict = verdict
        if verdict == PoseVerdict.CORRUPT:
            s.poses_corrupt += 1
            if not repeated:
                self._report('pose_corrupt', 'dropped poses that are not finite or whose '
                             'quaternion has not the norm 1')
        elif verdict == PoseVerdict.OLD:
            s.poses_old += 1
            if not repeated:
                self._report('pose_old', f'dropped poses that came {-after_s:.3g} s behind the '
                             'newest one')
        elif verdict == PoseVerdict.GAP:
            s.pose_gaps += 1
            self._report('pose_gap', f'no pose for {after_s:.3g} s of their clock, more than '
                         'max_gap_s')
        elif verdict == PoseVerdict.RESTART:
            s.pose_restarts += 1
            self._report('pose_restart', f'the clock of the poses went back by {-after_s:.3g} s; '
                         'a new track begins')
        elif before is None:
            self._report('start', 'poses begin')
