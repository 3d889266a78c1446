"""Store the poses of a platform on their own clock, reject invalid ones, and interpolate them."""

from __future__ import annotations

import collections
import dataclasses
import enum
import math

import numpy as np
from scipy.spatial.transform import Rotation

from .pose_interpolation import REACH, interpolate_poses

CAPACITY = 32_768  # poses that a live track keeps
RESTART_POSES = 5  # in a row behind the newest pose: the clock went back
_LARGEST_ACCELERATION = 20.0  # m/s^2, of a platform that does not jump
_LARGEST_TURN_RATE = 7.0  # rad/s
_HISTORY = 5  # poses that predict the next one
_NORM_TOLERANCE = 0.01  # of quaternions, which are then normalised


class PoseStatus(enum.IntEnum):
    """What a track knows about a time."""

    READY = 0
    WAIT = 1  # poses are still to come that decide
    GAP = 2  # the poses around it are too far apart
    JUMP = 3  # the frame jumped between the poses around it
    BEFORE = 4  # it precedes the track
    LATE = 5  # poses did not come while one could wait


class PoseVerdict(enum.IntEnum):
    """What a track made of a pose."""

    TAKEN = 0
    GAP = 1  # taken; further from the one before than is bridged
    JUMP = 2  # taken; a frame begins anew with it
    CORRUPT = 3  # not a number, or no rotation
    OLD = 4  # as old as another one or older
    RESTART = 5  # the clock went back: a new track has to begin


@dataclasses.dataclass(frozen=True)
class Poses:
    """Poses of the platform at given times.

    Parameters
    ----------
    status : (P,) int64
        `PoseStatus` of each time.
    position_m : (P, 3) float64
        Where the platform's reference point is in the imaging frame, metres; NaN unless ready.
    attitude : scipy.spatial.transform.Rotation
        P rotations from the body into the imaging frame; identity unless ready.
    frame : (P,) int64
        Number of the frame, which grows with every jump and restart; -1 unless ready.
    """

    status: np.ndarray
    position_m: np.ndarray
    attitude: Rotation
    frame: np.ndarray

    def select(self, index: np.ndarray) -> Poses:
        """Poses at some of the times."""
        return Poses(self.status[index], self.position_m[index], self.attitude[index],
                     self.frame[index])


class PoseTrack:
    """Poses of a platform in the order of their times, interpolated between them.

    Times between two poses at most `max_gap_s` apart are interpolated, see
    `pose_interpolation`; wider gaps are refused, and no interpolation looks across them. A time
    is ready once three poses behind it are known, so that its position does not depend on when
    one asks.

    A pose further than `jump_m` from where the (up to five) poses before it lead, plus what an
    acceleration of 20 m/s^2 explains, is a jump of the frame, and so is a turn of more than
    `jump_rad` plus 7 rad/s. It begins a new frame: what lies before and after it has no common
    origin, however smooth an interpolation would look.

    Parameters
    ----------
    max_gap_s : float
        Longest time between two poses that is bridged, seconds.
    jump_m, jump_rad : float
        Departure from the predicted position, metres, and from the last attitude, radians.
    first_frame : int
        Number of the first frame.
    capacity : int
        Poses that are kept; the older half goes when there are more. A whole recording needs
        as many as it has.

    Raises
    ------
    ValueError
        A limit is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry.poses import PoseTrack
    >>> track = PoseTrack(max_gap_s=0.2)
    >>> for n in range(10):  # 2 m/s along x, 10 poses a second
    ...     _ = track.add(n * 100_000_000, (0.2 * n, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
    >>> poses = track.sample(np.array([450_000_000]))
    >>> poses.position_m.round(3).tolist()
    [[0.9, 0.0, 1.0]]
    """

    def __init__(self, *, max_gap_s: float = 0.2, jump_m: float = 0.05, jump_rad: float = 0.1,
                 first_frame: int = 0, capacity: int = CAPACITY):
        for name, value in (('max_gap_s', max_gap_s), ('jump_m', jump_m),
                            ('jump_rad', jump_rad), ('capacity', capacity)):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f'{name}={value} must be positive and finite')
        self._limits = dict(max_gap_s=max_gap_s, jump_m=jump_m, jump_rad=jump_rad)
        self._stamp = np.empty(capacity, np.int64)
        self._position = np.empty((capacity, 3))
        self._quaternion = np.empty((capacity, 4))
        self._segment = np.empty(capacity, np.int64)
        self._frame = np.empty(capacity, np.int64)
        self._n = 0
        self._first_frame = first_frame
        self._behind: list[tuple[int, list[float], list[float]]] = []
        self._recent: collections.deque[tuple[int, list[float]]] = collections.deque(
            maxlen=_HISTORY)  # of the newest segment
        self._recent_turn: list[float] = []
        self._last_motion: tuple[float, list[float]] | None = None  # before a jump

    def __len__(self) -> int:
        return self._n

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Times of the oldest and newest pose, nanoseconds; None without poses."""
        return (int(self._stamp[0]), int(self._stamp[self._n - 1])) if self._n else None

    @property
    def frame(self) -> int:
        """Number of the newest pose's frame."""
        return int(self._frame[self._n - 1]) if self._n else self._first_frame

    def add(self, stamp_ns: int, position_m, quaternion) -> PoseVerdict:
        """Take a pose.

        Parameters
        ----------
        stamp_ns : int
            Time, nanoseconds since the epoch of the poses' clock.
        position_m : (3,) array_like
            Metres in the imaging frame.
        quaternion : (4,) array_like
            x, y, z, w: turns body vectors into the imaging frame. Its norm must be one to 1 %.

        Returns
        -------
        PoseVerdict
            For `PoseVerdict.RESTART` the track stays as it is; `successor` continues.
        """
        position, turn = [float(v) for v in position_m], [float(v) for v in quaternion]
        norm = math.hypot(*turn)
        if (len(position) != 3 or len(turn) != 4 or not all(map(math.isfinite, position))
                or not abs(norm - 1) <= _NORM_TOLERANCE):
            return PoseVerdict.CORRUPT
        turn = [v / norm for v in turn]
        if self._n and stamp_ns <= self._stamp[self._n - 1]:
            return self._add_old(int(stamp_ns), position, turn)
        self._behind.clear()
        verdict = self._judge(stamp_ns, position, turn)
        self._append(stamp_ns, position, turn, verdict)
        return verdict

    def successor(self) -> PoseTrack:
        """The track that begins with the poses that made the clock go back."""
        track = PoseTrack(**self._limits, first_frame=self.frame + 1, capacity=len(self._stamp))
        for pose in self._behind:
            track.add(*pose)
        return track

    def between(self, first_ns: int, last_ns: int
                ) -> tuple[np.ndarray, np.ndarray, Rotation, np.ndarray]:
        """The poses of an interval of time.

        Parameters
        ----------
        first_ns, last_ns : int
            Times on the poses' clock, nanoseconds.

        Returns
        -------
        stamp_ns : (N,) int64
            Their times.
        position_m : (N, 3) float64
            Metres.
        attitude : scipy.spatial.transform.Rotation
            N rotations from the body into the imaging frame.
        segment : (N,) int64
            Numbers of the unbroken pieces of track: a gap or a jump begins another one.
        """
        first, last = np.searchsorted(self._stamp[:self._n], (first_ns, last_ns + 1))
        some = slice(first, max(first, last))
        turns = self._quaternion[some].copy() if last > first else np.empty((0, 4))
        return (self._stamp[some].copy(), self._position[some].copy(),
                Rotation.from_quat(turns), self._segment[some].copy())

    def sample(self, stamp_ns: np.ndarray, *, final: bool = False) -> Poses:
        """Poses at given times.

        Parameters
        ----------
        stamp_ns : (P,) int64
            Times on the poses' clock, nanoseconds.
        final : bool
            Wait no longer: interpolate with the poses at hand, and refuse what lies behind the
            newest one.

        Returns
        -------
        Poses
        """
        query = np.asarray(stamp_ns, np.int64)
        stamp, segment = self._stamp[:self._n], self._segment[:self._n]
        left = np.searchsorted(stamp, query, 'right') - 1
        left = self._closed_on_the_right(left, query)
        status = self._status(left, query, final)
        ready = status == PoseStatus.READY
        position = np.full((query.size, 3), np.nan)
        quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (query.size, 1))
        frame = np.where(ready, self._frame[np.maximum(left, 0)], -1)
        if ready.any():
            position[ready], attitude = interpolate_poses(
                stamp, self._position[:self._n], self._quaternion[:self._n], segment,
                left[ready], query[ready])
            quaternion[ready] = attitude.as_quat()
        return Poses(status, position, Rotation.from_quat(quaternion), frame)

    def _closed_on_the_right(self, left, query) -> np.ndarray:
        """A time exactly that of a segment's last pose belongs to the interval before it."""
        n = self._n
        if not n:
            return left
        at = np.clip(left, 0, n - 1)
        last = (at == n - 1) | (self._segment[np.minimum(at + 1, n - 1)] != self._segment[at])
        first = (at == 0) | (self._segment[at - 1] != self._segment[at])
        exact = (left >= 0) & (self._stamp[at] == query)
        return left - (exact & last & ~first)

    def _status(self, left, query, final: bool) -> np.ndarray:
        n = self._n
        status = np.full(query.size, int(PoseStatus.READY))
        at = np.clip(left, 0, max(n - 1, 0))
        behind = left >= n - 1  # also without any pose
        if n:
            after = np.minimum(at + 1, n - 1)
            broken = ~behind & (self._segment[at] != self._segment[after])
            jumped = broken & (self._frame[at] != self._frame[after])
            # Poses to come cannot change what lies before a break.
            newest = self._segment[at] == self._segment[n - 1]
            status[newest & (at + REACH > n - 1)] = PoseStatus.WAIT
            status[broken] = PoseStatus.GAP
            status[jumped] = PoseStatus.JUMP
            status[left < 0] = PoseStatus.BEFORE
        if final:
            status[status == PoseStatus.WAIT] = PoseStatus.READY
        status[behind] = PoseStatus.LATE if final else PoseStatus.WAIT
        return status

    def _add_old(self, stamp_ns: int, position: list[float], turn: list[float]) -> PoseVerdict:
        if self._behind and stamp_ns <= self._behind[-1][0]:
            self._behind.clear()
        self._behind.append((stamp_ns, position, turn))
        if len(self._behind) < RESTART_POSES:
            return PoseVerdict.OLD
        return PoseVerdict.RESTART

    def _judge(self, stamp_ns: int, position: list[float], turn: list[float]) -> PoseVerdict:
        n = self._n
        if not n:
            return PoseVerdict.TAKEN
        dt = (stamp_ns - int(self._stamp[n - 1])) * 1e-9
        if dt > self._limits['max_gap_s']:
            return PoseVerdict.GAP
        cosine = abs(sum(a * b for a, b in zip(self._recent_turn, turn, strict=True)))
        angle = 2 * math.acos(min(1.0, cosine))
        if angle > self._limits['jump_rad'] + _LARGEST_TURN_RATE * dt:
            return PoseVerdict.JUMP
        motion = self._motion or self._last_motion
        if motion is None:
            return PoseVerdict.TAKEN
        baseline, velocity = motion
        last = self._recent[-1][1]
        away = math.dist(position, [x + v * dt for x, v in zip(last, velocity, strict=True)])
        explained = 0.5 * _LARGEST_ACCELERATION * dt * (baseline + dt)
        return (PoseVerdict.JUMP if away > self._limits['jump_m'] + explained
                else PoseVerdict.TAKEN)

    @property
    def _motion(self) -> tuple[float, list[float]] | None:
        """Time, s, over which the last poses of the segment tell the velocity, and this, m/s."""
        if len(self._recent) < 2:
            return None
        (t0, first), (t1, last) = self._recent[0], self._recent[-1]
        baseline = (t1 - t0) * 1e-9
        return baseline, [(b - a) / baseline for a, b in zip(first, last, strict=True)]

    def _append(self, stamp_ns: int, position: list[float], turn: list[float],
                verdict: PoseVerdict) -> None:
        capacity = len(self._stamp)
        if self._n == capacity:
            keep = capacity // 2
            for a in (self._stamp, self._position, self._quaternion, self._segment, self._frame):
                a[:keep] = a[capacity - keep:].copy()
            self._n = keep
        n = self._n
        segment, frame = (int(self._segment[n - 1]), self.frame) if n else (0, self._first_frame)
        self._stamp[n], self._position[n], self._quaternion[n] = stamp_ns, position, turn
        self._segment[n] = segment + (verdict in (PoseVerdict.GAP, PoseVerdict.JUMP))
        self._frame[n] = frame + (verdict == PoseVerdict.JUMP)
        self._n = n + 1
        if verdict != PoseVerdict.TAKEN:
            # One pose after a jump tells no velocity; the platform still has that from before.
            self._last_motion = ((self._motion or self._last_motion)
                                 if verdict == PoseVerdict.JUMP else None)
            self._recent.clear()
        self._recent.append((stamp_ns, position))
        self._recent_turn = turn
