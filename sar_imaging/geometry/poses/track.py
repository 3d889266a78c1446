# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Store the poses of a platform on their own clock, leave wrong ones out, and interpolate them.

Interpolation is a local cubic, so that later poses do not change the result.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from .motion import Departure, Miss, Motion, Pose

REACH = 3  # poses on each side of a time that its interpolation looks at
_STENCIL = 5  # poses that make the velocity at a pose
_LARGEST_ROTATION_RAD = 2.5  # within a stencil; rotation vectors are unique below pi


def interpolate_poses(stamp_ns: np.ndarray, position_m: np.ndarray, quaternion: np.ndarray,
                      segment: np.ndarray, left: np.ndarray, query_ns: np.ndarray,
                      ) -> tuple[np.ndarray, Rotation]:
    """Interpolate between given pairs of poses.

    Cubic Hermite interpolation; the velocities at the poses come from the polynomial through five
    poses around each (fewer at the ends of a segment). Attitudes are interpolated in the same way
    as rotation vectors relative to the pose before, which for two poses is spherical linear
    interpolation. With poses h apart the error inside a segment is at most
    ``h^4 |x''''| / 384 + h^5 |x'''''| / 310`` and terms in h^6; the error of attitudes follows
    from their rotation vectors in the same way.

    Parameters
    ----------
    stamp_ns : (N,) int64
        Times of the poses, strictly ascending, nanoseconds.
    position_m : (N, 3) float64
        Positions, metres.
    quaternion : (N, 4) float64
        Unit quaternions x, y, z, w that turn body vectors into the frame of the positions.
    segment : (N,) int64
        Number of the unbroken piece of track each pose belongs to, ascending.
    left : (P,) int64
        Pose before each query; the next one must be in the same segment.
    query_ns : (P,) int64
        Times from that of ``left`` to that of ``left + 1``, nanoseconds.

    Returns
    -------
    position_m : (P, 3) float64
        Metres.
    attitude : scipy.spatial.transform.Rotation
        P rotations from the body into the frame of the positions.
    """
    base, which = np.unique(left, return_inverse=True)
    window = _Window(stamp_ns, position_m, quaternion, segment, base)
    h = ((stamp_ns[base + 1] - stamp_ns[base]) * 1e-9)[which][:, None]
    u = ((query_ns - stamp_ns[left]) * 1e-9)[:, None] / h
    slope, next_slope, step = (v[which] for v in (
        window.slopes(base), window.slopes(base + 1), window.step))
    change = (u * (1 - u) ** 2 * h * slope - u ** 2 * (1 - u) * h * next_slope
              + u ** 2 * (3 - 2 * u) * step)
    attitude = Rotation.from_quat(quaternion[left]) * Rotation.from_rotvec(change[:, 3:])
    return position_m[left] + change[:, :3], attitude


class _Window:
    """Displacements and rotation vectors of the poses around each of U bases, relative to it."""

    def __init__(self, stamp_ns: np.ndarray, position_m: np.ndarray, quaternion: np.ndarray,
                 segment: np.ndarray, base: np.ndarray) -> None:
        self._first = np.searchsorted(segment, segment[base], 'left')
        self._stop = np.searchsorted(segment, segment[base], 'right')
        self._count = np.minimum(_STENCIL, self._stop - self._first)
        self._start = self._stencil_start(base)
        nodes = self._start[:, None] + np.arange(_STENCIL + 1)
        nodes = np.minimum(nodes, self._stop[:, None] - 1)  # repeated where a segment is short
        self._stamp = stamp_ns[nodes]
        move = position_m[nodes] - position_m[base][:, None]
        inverse = Rotation.from_quat(np.repeat(quaternion[base], nodes.shape[1], axis=0)).inv()
        rotation = (inverse * Rotation.from_quat(quaternion[nodes.ravel()])).as_rotvec()
        self._values = np.concatenate([move, rotation.reshape(*nodes.shape, 3)], axis=-1)
        rows = np.arange(len(base))
        self.step = self._values[rows, base + 1 - self._start]
        angle = np.linalg.norm(self._values[..., 3:], axis=-1).max(axis=1)
        self._spins = angle > _LARGEST_ROTATION_RAD
        self._mean_rotation = self.step[:, 3:] * (
            1e9 / (stamp_ns[base + 1] - stamp_ns[base]))[:, None]

    def _stencil_start(self, node: Any) -> np.ndarray:
        return np.clip(node - _STENCIL // 2, self._first, self._stop - self._count)

    def slopes(self, node: Any) -> np.ndarray:
        """(U, 6) derivatives by time at one pose near each base; mean turning rate in a spin."""
        out = np.empty((len(node), 6))
        start = self._stencil_start(node) - self._start
        for size in np.unique(self._count):
            some = np.flatnonzero(self._count == size)
            stencil = start[some, None] + np.arange(size)
            at = node[some] - self._start[some] - start[some]
            stamp = self._stamp[some[:, None], stencil]
            time_s = (stamp - stamp[np.arange(some.size), at][:, None]) * 1e-9
            out[some] = np.einsum('um,umk->uk', _derivative_weights(time_s, at),
                                  self._values[some[:, None], stencil])
        out[self._spins, 3:] = self._mean_rotation[self._spins]
        return out


def _derivative_weights(time_s: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(U, M) weights of the derivative at node `at` of each row, whose time is zero."""
    rows = np.arange(len(time_s))
    between = time_s[:, :, None] - time_s[:, None, :]
    np.einsum('umm->um', between)[:] = 1.0
    product = between.prod(axis=2)  # of the distances of each node to all others
    distance = time_s.copy()
    distance[rows, at] = 1.0
    weights = product[rows, at][:, None] / product / -distance
    weights[rows, at] = 0.0
    weights[rows, at] = -weights.sum(axis=1)
    return weights


CAPACITY = 32_768  # poses that a live track keeps
RESTART_POSES = 5  # in a row behind the newest pose: the clock went back
_NORM_TOLERANCE = 0.01  # of quaternions, which are then normalised
_SHORT_RUN = 3  # poses off the others that may last longer than a gap that is bridged
_LONGEST_RUN = 1000  # whatever time they take
_FEWEST = 3  # poses of a frame; fewer between a jump and a gap are what is off


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
    JUMP = 2  # taken; a frame began anew with the first of those that were held
    CORRUPT = 3  # not a number, or no rotation
    OLD = 4  # as old as another one or older
    RESTART = 5  # the clock went back: a new track has to begin
    HELD = 6  # it departs from the motion so far; the next ones decide whether it is right


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
    `interpolation`; wider gaps are refused, and no interpolation looks across them. A time
    is ready once three poses behind it are known, so that its position does not depend on when
    one asks.

    **Outliers and jumps.** A pose off the motion so far, see `Motion`, is held until the next ones
    tell what it was. It is an *outlier*, with those that are held, if a pose comes that goes on
    from those before rather than from them, and if no motion from there to that pose explains
    them: they are left out. The time between the poses around them is interpolated if it is
    `max_gap_s` or less, or twice that for a single one; otherwise it is a gap. If more than three
    are held, for longer than `max_gap_s`, the frame *jumped* with the first of them: what lies
    before and after it has no common origin, however smooth an interpolation would look. One or
    two poses between a jump and a gap, another jump or the begin of the track are left out, too.
    `take_departures` tells of all.

    Parameters
    ----------
    max_gap_s : float
        Longest time between two poses that is bridged, seconds.
    jump_m, jump_rad : float
        Departure of position and attitude that is more than scatter, metres and radians.
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
        self._behind: list[Pose] = []
        self._motion = Motion(jump_m, jump_rad)
        self._held: list[Pose] = []
        self._first_miss: Miss  # of the poses that are held, while some are
        self._departures: list[Departure] = []

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

    def add(self, stamp_ns: int, position_m: Sequence[float] | np.ndarray,
            quaternion: Sequence[float] | np.ndarray) -> PoseVerdict:
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
        position, rotation = [float(v) for v in position_m], [float(v) for v in quaternion]
        norm = math.hypot(*rotation)
        if (len(position) != 3 or len(rotation) != 4 or not all(map(math.isfinite, position))
                or not abs(norm - 1) <= _NORM_TOLERANCE):
            return PoseVerdict.CORRUPT
        pose = Pose(int(stamp_ns), position, [v / norm for v in rotation])
        if self._n and pose.stamp_ns <= self._newest_ns:
            return self._add_old(pose)
        self._behind.clear()
        return self._take(pose)

    def successor(self) -> PoseTrack:
        """The track that begins with the poses that made the clock go back."""
        track = PoseTrack(**self._limits, first_frame=self.frame + 1, capacity=len(self._stamp))
        for pose in self._behind:
            track._take(pose)
        return track

    def take_departures(self) -> list[Departure]:
        """Outliers and jumps that were found since the last call, in the order of their times."""
        found, self._departures = self._departures, []
        return found

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
        attitudes = self._quaternion[some].copy() if last > first else np.empty((0, 4))
        return (self._stamp[some].copy(), self._position[some].copy(),
                Rotation.from_quat(attitudes), self._segment[some].copy())

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

    def _closed_on_the_right(self, left: np.ndarray, query: np.ndarray) -> np.ndarray:
        """A time exactly that of a segment's last pose belongs to the interval before it."""
        n = self._n
        if not n:
            return left
        at = np.clip(left, 0, n - 1)
        last = (at == n - 1) | (self._segment[np.minimum(at + 1, n - 1)] != self._segment[at])
        first = (at == 0) | (self._segment[at - 1] != self._segment[at])
        exact = (left >= 0) & (self._stamp[at] == query)
        return left - (exact & last & ~first)

    def _status(self, left: np.ndarray, query: np.ndarray, final: bool) -> np.ndarray:
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

    @property
    def _newest_ns(self) -> int:
        return self._held[-1].stamp_ns if self._held else int(self._stamp[self._n - 1])

    def _add_old(self, pose: Pose) -> PoseVerdict:
        if self._behind and pose.stamp_ns <= self._behind[-1].stamp_ns:
            self._behind.clear()
        self._behind.append(pose)
        return PoseVerdict.OLD if len(self._behind) < RESTART_POSES else PoseVerdict.RESTART

    def _take(self, pose: Pose) -> PoseVerdict:
        """A pose behind the newest one: append it, or hold it."""
        if not self._n:
            return self._append(pose, PoseVerdict.TAKEN)
        if (pose.stamp_ns - self._newest_ns) * 1e-9 > self._limits['max_gap_s']:
            self.finish()
            return self._append(pose, PoseVerdict.GAP)
        if not self._held:
            miss = self._motion.miss(pose)
            self._motion.remember(miss)
            if not miss.doubtful:
                return self._append(pose, PoseVerdict.TAKEN)
            self._first_miss, self._held = miss, [pose]
            return PoseVerdict.HELD
        step, miss = self._motion.miss(pose, self._held[-1]), self._motion.miss(pose)
        self._motion.remember(step)
        if miss.ratio <= min(1, step.ratio) and self._motion.across(
                self._pose(self._n - 1), self._held, pose).ratio > 1:
            return self._append(pose, self._leave_out(pose))
        if self._first_miss.ratio <= 1:  # doubtful, and possible
            [held], self._held = self._held, []
            self._append(held, PoseVerdict.TAKEN)
            return self._take(pose)
        return self._hold_on(pose)

    def _hold_on(self, pose: Pose) -> PoseVerdict:
        """One more pose that may be of another frame, until there are enough."""
        self._held.append(pose)
        since_s = (pose.stamp_ns - int(self._stamp[self._n - 1])) * 1e-9
        if len(self._held) > _SHORT_RUN and (since_s > self._limits['max_gap_s']
                                             or len(self._held) > _LONGEST_RUN):
            self._jump()
            return PoseVerdict.JUMP
        return PoseVerdict.HELD

    def finish(self) -> None:
        """Decide about the poses that are held, since no more will come."""
        while len(self._held) >= _FEWEST:
            self._jump()
        if self._held and self._first_miss.ratio <= 1:
            self._append(self._held.pop(), PoseVerdict.TAKEN)
        elif self._held:
            self._leave_out(None)

    def _leave_out(self, behind: Pose | None) -> PoseVerdict:
        """Give the poses that are held up; returns what the next one is, if there is one."""
        held, self._held = self._held, []
        before, miss = self._pose(self._n - 1), self._first_miss
        gap_s = ((behind or held[-1]).stamp_ns - before.stamp_ns) * 1e-9
        if behind:
            miss = self._motion.across(before, held, behind)
        bridged = behind is not None and (
            gap_s <= self._limits['max_gap_s']
            or len(held) == 1 and gap_s <= 2 * self._limits['max_gap_s'])
        self._departures.append(Departure(
            held[0].stamp_ns, held[-1].stamp_ns, len(held), miss.away_m, miss.away_rad, False,
            gap_s, bridged))
        return PoseVerdict.TAKEN if bridged else PoseVerdict.GAP

    def _jump(self) -> None:
        """Begin a frame with the first pose that is held, and judge the others anew."""
        (first, *rest), self._held = self._held, []
        miss, verdict = self._first_miss, PoseVerdict.JUMP
        segment = self._segment[:self._n]
        start = int(np.searchsorted(segment, segment[-1]))
        few = self._n - start < _FEWEST
        before = self._pose(start if few else self._n - 1)
        if few:
            verdict = (PoseVerdict.TAKEN if not start else PoseVerdict.JUMP
                       if self._frame[start] != self._frame[start - 1] else PoseVerdict.GAP)
        self._departures.append(Departure(
            before.stamp_ns if few else first.stamp_ns, int(self._stamp[self._n - 1])
            if few else first.stamp_ns, self._n - start if few else 1, miss.away_m,
            miss.away_rad, not few, (first.stamp_ns - before.stamp_ns) * 1e-9, False))
        if few:
            self._n = start
        self._motion.restart()
        self._append(first, verdict)
        for pose in rest:
            self._take(pose)

    def _pose(self, n: int) -> Pose:
        return Pose(int(self._stamp[n]), self._position[n].tolist(), self._quaternion[n].tolist())

    def _append(self, pose: Pose, verdict: PoseVerdict) -> PoseVerdict:
        capacity = len(self._stamp)
        if self._n == capacity:
            keep = capacity // 2
            for a in (self._stamp, self._position, self._quaternion, self._segment, self._frame):
                a[:keep] = a[capacity - keep:].copy()
            self._n = keep
        n = self._n
        segment, frame = (int(self._segment[n - 1]), self.frame) if n else (0, self._first_frame)
        self._stamp[n], self._position[n], self._quaternion[n] = (pose.stamp_ns, pose.position,
                                                                  pose.quaternion)
        self._segment[n] = segment + (verdict in (PoseVerdict.GAP, PoseVerdict.JUMP))
        self._frame[n] = frame + (verdict == PoseVerdict.JUMP)
        self._n = n + 1
        if verdict == PoseVerdict.GAP:
            self._motion.restart()
        self._motion.follow(pose)
        return verdict
