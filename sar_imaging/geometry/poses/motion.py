# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Tell whether a pose continues the motion of those before it, and by how much it does not."""

from __future__ import annotations

import collections
import dataclasses
import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

_LARGEST_ACCELERATION = 20.0  # m/s^2, of a platform that does not jump
_LARGEST_RATE_CHANGE = 7.0  # rad/s, of its turning rate from pose to pose, or this rate itself
_UNUSUAL = 0.75  # of what acceleration explains; more makes a pose doubtful
_HISTORY = 5  # poses that predict the next one
_SCATTER_POSES = 15  # whose misses tell the scatter; it is unknown with fewer than three
_UNKNOWN_SCATTER = 4.0  # of the least departure
_WRONG_RAD = 0.5  # of an attitude alone that is off, beyond which cures are named
_SCATTERS = 4.0  # medians of three normal errors: 6 standard deviations of each


class Pose(NamedTuple):
    """Time in ns, position in metres, and unit quaternion x, y, z, w; as plain numbers.

    Poses come up to a thousand times a second, one by one: arrays of three numbers are slower.
    """

    stamp_ns: int
    position: list[float]
    quaternion: list[float]


class Miss(NamedTuple):
    """How far a pose is from where it is expected, and what is explained of it."""

    away_m: float
    away_rad: float
    limit_m: float
    limit_rad: float
    doubtful: bool = False

    @property
    def ratio(self) -> float:
        """Of what is explained; above 1 the platform cannot have moved like that."""
        return max(self.away_m / self.limit_m, self.away_rad / self.limit_rad)


@dataclasses.dataclass(frozen=True)
class Departure:
    """Poses that do not continue the motion of those before.

    Parameters
    ----------
    first_ns, last_ns : int
        Times of the first and the last of them, nanoseconds.
    n_poses : int
        Their number.
    away_m, away_rad : float
        Largest departure of position and attitude: of outliers from what the poses around them
        agree on, of a jump from where the poses before lead.
    jump : bool
        True where the poses after them stay with them; they are then taken, in a new frame.
    gap_s : float
        Time between the poses around them, seconds; of a jump that to the pose before.
    bridged : bool
        True where poses are interpolated across them.

    Examples
    --------
    >>> from sar_imaging.geometry.poses import Departure
    >>> print(Departure(14_850_000_000, 14_850_000_000, 1, 0.0, 3.1416, False, 0.02, True))
    the pose at 14.850000 s is 0 m and 180 deg off those around it, and is left out: 0.02 s are ...
    """

    first_ns: int
    last_ns: int
    n_poses: int
    away_m: float
    away_rad: float
    jump: bool
    gap_s: float
    bridged: bool

    def __str__(self) -> str:
        size = (f'{round(self.away_m, 4):.3g} m and '
                f'{round(math.degrees(self.away_rad), 1):.3g} deg')
        first_s, last_s = (f'{t // 10**9}.{t % 10**9 // 1000:06d}'
                           for t in (self.first_ns, self.last_ns))
        if self.jump:
            return (f'the frame of the poses jumped by {size} at {first_s} s: the platform cannot '
                    f'have moved like that within {self.gap_s:.3g} s; no aperture extends across '
                    'it (odometry that never jumps makes better images than a map frame)')
        who = (f'the pose at {first_s} s is {size} off those around it, and is left out'
               if self.n_poses == 1 else f'{self.n_poses} poses from {first_s} to {last_s} s are '
               f'up to {size} off those around them, and are left out')
        return f'{who}: {self.gap_s:.3g} s ' + (
            'are interpolated' if self.bridged else 'have no poses') + (
            '; where attitudes are never right, poses.level: true of a description ignores them'
            if self.away_rad > _WRONG_RAD else '')


class Motion:
    """The motion of the latest poses, and how well they kept to it.

    A pose is expected where the mean velocity of the (up to five) poses before it leads, and
    turned as the last one or as their turning goes on. Explained is a departure of `jump_m` and
    what an acceleration of 20 m/s^2 does, of `jump_rad` and a turning rate, or a change of it, of
    7 rad/s, and four times the median departure of the last 15 poses from the one before each:
    their own scatter.

    Parameters
    ----------
    jump_m, jump_rad : float
        Metres and radians.
    """

    def __init__(self, jump_m: float, jump_rad: float):
        self._jump_m, self._jump_rad = jump_m, jump_rad
        self._latest: collections.deque[Pose] = collections.deque(maxlen=_HISTORY)
        self._misses: collections.deque[Miss] = collections.deque(maxlen=_SCATTER_POSES)

    def restart(self) -> None:
        """Begin anew, as behind a gap; what is known of the scatter stays."""
        self._latest.clear()

    def follow(self, pose: Pose) -> None:
        """Count a pose among those that tell the motion."""
        self._latest.append(pose)

    def remember(self, miss: Miss) -> None:
        """Count how far a pose was off the one before it, for the scatter."""
        if len(self._latest) > 1:
            self._misses.append(miss)

    def miss(self, pose: Pose, after: Pose | None = None) -> Miss:
        """How far a pose is off where the motion leads.

        Parameters
        ----------
        pose : Pose
            That is judged.
        after : Pose, optional
            From where the motion goes on; from the latest pose unless given.
        """
        latest, last = self._latest, after or self._latest[-1]
        dt = (pose.stamp_ns - last.stamp_ns) * 1e-9
        away_m, limit_m, explained_m = 0.0, math.inf, 0.0  # one pose tells no velocity
        away_rad = _angle(last.quaternion, pose.quaternion)
        limit_rad = self._jump_rad + (1 if len(latest) > 1 else 2) * _LARGEST_RATE_CHANGE * dt
        if len(latest) > 1:
            baseline = (latest[-1].stamp_ns - latest[0].stamp_ns) * 1e-9
            ahead = dt / baseline
            away_m = math.dist(pose.position, [
                x + ahead * (b - a) for x, a, b in zip(
                    last.position, latest[0].position, latest[-1].position, strict=True)])
            explained_m = 0.5 * _LARGEST_ACCELERATION * dt * (baseline + dt)
            limit_m = self._jump_m + explained_m
            if away_rad > self._jump_rad:
                expected = _extrapolated(latest[-2], latest[-1], last.quaternion, dt)
                away_rad = min(away_rad, _angle(expected, pose.quaternion))
        usual_m = limit_m - _UNUSUAL * explained_m
        if after is not None or away_m > usual_m or away_rad > limit_rad:
            scatter_m = (self._scatter('away_m') if len(self._misses) > 2
                         else _UNKNOWN_SCATTER * self._jump_m)
            usual_m, limit_m = usual_m + scatter_m, limit_m + scatter_m
            limit_rad += self._scatter('away_rad')
        return Miss(away_m, away_rad, limit_m, limit_rad,
                    away_m > usual_m or away_rad > limit_rad)

    def across(self, before: Pose, poses: list[Pose], behind: Pose) -> Miss:
        """How far the worst of some poses is off the even motion between two others.

        Explained are the same changes of velocity and turning rate, over both steps.
        """
        first_s, both_s = (np.array([p.stamp_ns - before.stamp_ns for p in some]) * 1e-9
                           for some in (poses, [behind]))
        start, place = Rotation.from_quat(before.quaternion), np.array(before.position)
        rotation = (start.inv() * Rotation.from_quat(behind.quaternion)).as_rotvec()
        share = (first_s / both_s)[:, None]
        expected = start * Rotation.from_rotvec(share * rotation)
        off = expected.inv() * Rotation.from_quat([p.quaternion for p in poses])
        away = np.array([p.position for p in poses]) - place - share * (
            np.array(behind.position) - place)
        steps = first_s * (both_s - first_s)
        limit_m = (self._jump_m + 0.5 * _LARGEST_ACCELERATION * steps + self._scatter('away_m'))
        limit_rad = (self._jump_rad + _LARGEST_RATE_CHANGE * steps / both_s
                     + self._scatter('away_rad'))
        misses = [Miss(*numbers) for numbers in zip(
            np.linalg.norm(away, axis=1).tolist(), off.magnitude().tolist(), limit_m.tolist(),
            limit_rad.tolist(), strict=True)]
        return max(misses, key=lambda miss: miss.ratio)

    def _scatter(self, name: str) -> float:
        values = sorted(getattr(miss, name) for miss in self._misses)
        return _SCATTERS * values[(len(values) - 1) // 2] if values else 0.0


def _angle(a: list[float], b: list[float]) -> float:
    return 2 * math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b, strict=True)))))


def _extrapolated(before: Pose, last: Pose, quaternion: list[float], dt: float) -> list[float]:
    """Quaternion after `dt` seconds more of the turning from one pose to the next."""
    *vector, scalar = before.quaternion
    x, y, z, w = _product([*(-v for v in vector), scalar], last.quaternion)
    sine = math.hypot(x, y, z)
    if sine < 1e-12:
        return quaternion
    half = math.atan2(sine, abs(w)) * dt * 1e9 / (last.stamp_ns - before.stamp_ns)
    scale = math.copysign(math.sin(half) / sine, w)
    return _product(quaternion, [scale * x, scale * y, scale * z, math.cos(half)])


def _product(a: list[float], b: list[float]) -> list[float]:
    """Product of quaternions x, y, z, w."""
    return [a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
            a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
            a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
            a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]]
