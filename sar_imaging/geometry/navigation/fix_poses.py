"""Poses of a platform without odometry: from fixes, and attitudes where it has them."""

from __future__ import annotations

import collections
import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..earth import Datum
from ..poses import PoseStatus, PoseTrack, PoseVerdict
from ..poses.interpolation import REACH
from ..poses.track import CAPACITY
from .fixes import Fix

_LEVEL = (0.0, 0.0, 0.0, 1.0)
_NORM_TOLERANCE = 0.01  # of quaternions


class FramePose(NamedTuple):
    """A pose as `PoseTrack.add` takes it: ns, metres, quaternion x, y, z, w.

    Parameters
    ----------
    stamp_ns : int
        Time, nanoseconds.
    position_m : (3,) floats
        In the imaging frame, metres.
    quaternion : (4,) floats
        x, y, z, w: turns body vectors into the imaging frame.

    Examples
    --------
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.geometry.navigation import Fix, FixPoses
    >>> poses = FixPoses(datum=Datum(47.0, 8.0, 450.0), with_attitude=False)
    >>> [pose] = poses.add_fix(Fix(1_000_000_000, 47.0, 8.0, 452.0))
    >>> pose.stamp_ns, [round(x, 3) + 0.0 for x in pose.position_m]
    (1000000000, [0.0, 0.0, 2.0])
    """

    stamp_ns: int
    position_m: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


class FixPoses:
    """Turn fixes of satellite navigation, and attitudes, into poses in a frame.

    Without attitudes every fix is a pose, turned as the frame is: its position is that of the
    antenna. With attitudes there is a pose at the time of each: the place of the antenna is
    interpolated between the fixes as `PoseTrack` does, once three fixes behind it are known, and
    the lever arm of the antenna is subtracted. Attitudes turn body vectors into east, north and
    up at the platform; the frame's axes are those at its origin, so both are brought together
    through the Earth's axes.

    Parameters
    ----------
    datum : Datum or None
        Of the frame; fixes wait for it where it is not known yet, see `datum`.
    antenna_m : (3,) array_like
        Place of the navigation's antenna in the body frame, metres.
    with_attitude : bool
        Whether attitudes will come.
    max_gap_s, jump_m : float
        As of `PoseTrack`; between fixes further apart, or across a jump, there are no poses.

    Attributes
    ----------
    datum : Datum or None
        May be set once it is known; call `take` then.
    n_unused : int
        Attitudes in a gap or a jump of the fixes, and those that are no rotation; not those before
        the first fix.

    Examples
    --------
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.geometry.navigation import Fix, FixPoses
    >>> poses = FixPoses(datum=Datum(47.0, 8.0, 450.0), with_attitude=False)
    >>> for second in range(3):  # flying north by 1e-5 degrees a second
    ...     for pose in poses.add_fix(Fix(second * 10**9, 47.0 + second * 1e-5, 8.0, 450.0)):
    ...         print(f'{second} s: {pose.position_m[1]:.2f} m')
    0 s: 0.00 m
    1 s: 1.11 m
    2 s: 2.22 m
    """

    def __init__(self, *, datum: Datum | None = None, antenna_m=(0.0, 0.0, 0.0),
                 with_attitude: bool = True, max_gap_s: float = 0.2, jump_m: float = 0.05):
        self.datum = datum
        self._antenna_m = np.asarray(antenna_m, np.float64)
        self._with_attitude = with_attitude
        self._fixes: collections.deque[Fix] = collections.deque(maxlen=CAPACITY)
        self._attitudes: collections.deque[tuple[int, tuple]] = collections.deque(maxlen=CAPACITY)
        self._track = PoseTrack(max_gap_s=max_gap_s, jump_m=jump_m)  # of the antenna
        self._fix_stamps: collections.deque[int] = collections.deque(maxlen=REACH)
        self.n_unused = 0

    def add_fix(self, fix: Fix) -> list[FramePose]:
        """Add a fix; returns the poses that it makes known."""
        self._fixes.append(fix)
        return self.take()

    def add_attitude(self, stamp_ns: int, quaternion) -> list[FramePose]:
        """Add an attitude; returns poses where the fixes behind it came already.

        Parameters
        ----------
        stamp_ns : int
            Time on the clock of the fixes, nanoseconds.
        quaternion : (4,) array_like
            x, y, z, w: turns body vectors (x forward, y left, z up) into east, north, up.
        """
        turn = tuple(float(v) for v in quaternion)
        if not abs(math.hypot(*turn) - 1) <= _NORM_TOLERANCE:  # NaN as well
            self.n_unused += 1
            return []
        self._attitudes.append((stamp_ns, turn))
        behind = self._fix_stamps[0] if len(self._fix_stamps) == REACH else stamp_ns
        return self._turned() if stamp_ns < behind else []

    def take(self) -> list[FramePose]:
        """Poses that are known now and were not returned yet, in the order of their times."""
        if self.datum is None:
            return []
        poses: list[FramePose] = []
        while self._fixes:
            fix = self._fixes.popleft()
            self._fix_stamps.append(fix.stamp_ns)
            place_m = self.datum.from_ecef(fix.ecef_m)
            if not self._with_attitude:
                poses.append(FramePose(fix.stamp_ns, tuple(place_m.tolist()), _LEVEL))
            elif self._track.add(fix.stamp_ns, place_m, _LEVEL) == PoseVerdict.RESTART:
                self._track = self._track.successor()
                self._attitudes.clear()
        return poses or self._turned()

    def _turned(self) -> list[FramePose]:
        """Poses at the times of the attitudes that fixes surround."""
        if not self._attitudes or not len(self._track):
            return []
        waiting = list(self._attitudes)
        stamps = np.array([stamp for stamp, _ in waiting], np.int64)
        places = self._track.sample(stamps)
        ready = np.flatnonzero(places.status == PoseStatus.READY)
        wait = np.flatnonzero(places.status == PoseStatus.WAIT)
        self._attitudes.clear()
        self._attitudes.extend(waiting[i] for i in wait)
        # Sensors of attitude begin before satellites are found: those are no loss.
        before = np.count_nonzero(places.status == PoseStatus.BEFORE)
        self.n_unused += len(waiting) - len(ready) - len(wait) - before
        if not ready.size:
            return []
        latitude, longitude, _ = self.datum.to_geographic(places.position_m[ready])
        from_enu = Rotation.from_matrix(self.datum.axes_ecef @ _enu_to_ecef(latitude, longitude))
        turn = from_enu * Rotation.from_quat([waiting[i][1] for i in ready])
        position = places.position_m[ready] - turn.apply(self._antenna_m)
        return [FramePose(int(stamp), tuple(place), tuple(quaternion)) for stamp, place, quaternion
                in zip(stamps[ready], position.tolist(), turn.as_quat().tolist(), strict=True)]


def _enu_to_ecef(latitude_deg: np.ndarray, longitude_deg: np.ndarray) -> np.ndarray:
    """(N, 3, 3) rotations whose columns are east, north and up of N places."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    zero = np.zeros_like(lat)
    east = np.stack([-np.sin(lon), np.cos(lon), zero], axis=-1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    return np.stack([east, np.cross(up, east), up], axis=-1)
