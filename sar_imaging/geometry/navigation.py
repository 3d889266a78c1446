# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Satellite navigation: the datum of a frame from fixes, and poses of platforms without odometry.

A `Fix` says where on the Earth an antenna was. `DatumSearch` compares fixes with places in the
imaging frame, `FixPoses` brings them into it.
"""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from .earth import Datum, ecef_to_geographic, geographic_to_ecef
from .poses import PoseStatus, PoseTrack, PoseVerdict
from .poses.track import CAPACITY, REACH


@dataclasses.dataclass(frozen=True)
class Fix:
    """Place of an antenna of satellite navigation at a time.

    Parameters
    ----------
    stamp_ns : int
        Time on the clock of the poses, nanoseconds.
    latitude_deg, longitude_deg : float
        Geodetic (WGS 84), degrees.
    height_m : float
        Above the WGS 84 ellipsoid, metres.
    std_m : float
        Standard deviation of the horizontal place along its worse axis, metres; NaN where the
        receiver does not tell.

    Examples
    --------
    >>> from sar_imaging.geometry.navigation import Fix
    >>> fix = Fix(stamp_ns=0, latitude_deg=0.0, longitude_deg=90.0, height_m=100.0, std_m=0.02)
    >>> fix.ecef_m.round(3).tolist()  # the equator's radius and 100 m along y
    [0.0, 6378237.0, 0.0]
    """

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    std_m: float = math.nan

    @property
    def ecef_m(self) -> np.ndarray:
        """(3,) float64 place in Earth-centred coordinates, metres."""
        return geographic_to_ecef(self.latitude_deg, self.longitude_deg, self.height_m)


_LARGEST_FRAME_M = 200e3  # from the origin; frames that go further are no tangent planes
_FEWEST = 3  # fixes that tell a heading: two would agree with any pair of places alike
_KEPT_SHARE = 1 / 50  # of the baseline: from one pair that is kept to the next
_DISAGREEMENT = 0.1  # of the baseline, or three standard deviations: more is a contradiction
_STEPS = 20
_ENOUGH_M = 1e-9


@dataclasses.dataclass(frozen=True)
class FoundDatum:
    """A datum that follows from fixes.

    Parameters
    ----------
    datum : Datum
        Datum of the frame.
    n_fixes : int
        Fixes that it is made of.
    residual_m : float
        Root mean square distance between fixes and places, metres; NaN for one fix.
    heading_std_deg : float
        How well the heading is known, degrees: what fixes that are wrong by their standard
        deviation, or by the residual, mean over the baseline. NaN where the heading was given.

    Examples
    --------
    >>> from sar_imaging.geometry.navigation import DatumSearch, Fix
    >>> found = DatumSearch(heading_deg=0.0).add(Fix(0, 47.0, 8.0, 450.0).ecef_m, (0.0, 0.0, 0.0))
    >>> print(f'{found.datum.latitude_deg:.4f}, {found.datum.longitude_deg:.4f}, '
    ...       f'{found.n_fixes} fix')
    47.0000, 8.0000, 1 fix
    """

    datum: Datum
    n_fixes: int
    residual_m: float = math.nan
    heading_std_deg: float = math.nan


def datum_through(ecef_m: ArrayLike, place_m: ArrayLike, heading_deg: float) -> Datum:
    """Datum of a frame with a known heading in which a place on the Earth is known.

    Parameters
    ----------
    ecef_m : (3,) array_like
        The place on the Earth, metres.
    place_m : (3,) array_like
        The same place in the frame, metres.
    heading_deg : float
        Bearing of the frame's y axis at its origin, degrees clockwise from north.

    Returns
    -------
    Datum
        WGS 84, degrees and metres.

    Raises
    ------
    ValueError
        The place is so far from the origin that the frame can be no tangent plane.

    Examples
    --------
    >>> from sar_imaging.geometry.navigation import Fix, datum_through
    >>> antenna = Fix(0, 47.0, 8.0, 450.0).ecef_m
    >>> datum = datum_through(antenna, (100.0, 0.0, 2.0), heading_deg=0.0)
    >>> print(f'{datum.latitude_deg:.5f}, {datum.longitude_deg:.5f}, {datum.height_m:.2f} m')
    47.00000, 7.99869, 448.00 m
    """
    ecef_m, place_m = np.asarray(ecef_m, np.float64), np.asarray(place_m, np.float64)
    _check_extent(place_m)
    datum = _at(ecef_m, heading_deg)
    for _ in range(_STEPS):  # contracts by the angle at the Earth's centre, 1/30 or less
        off = ecef_m - datum.to_ecef(place_m)
        datum = _at(datum.origin_ecef_m + off, heading_deg)
        if np.linalg.norm(off) < _ENOUGH_M:
            break
    return datum


class DatumSearch:
    """Find the datum of a frame while its platform moves.

    With a given heading one fix tells the datum. Without, places at least `baseline_m` apart do:
    the rotation and the shift about the vertical that bring the fixes closest to the places (least
    squares; Umeyama 1991 in two dimensions, without scale), repeated with the datum found until
    the curvature of the Earth is in it.

    Parameters
    ----------
    heading_deg : float
        Bearing of the frame's y axis, degrees clockwise from north; of no meaning with a baseline.
    baseline_m : float
        Least horizontal distance between the places that tell the heading, metres; 0 where it is
        given.

    Attributes
    ----------
    reason : str
        Why there is no datum yet.

    Examples
    --------
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.geometry.navigation import DatumSearch
    >>> truth = Datum(47.0, 8.0, 450.0, heading_deg=30.0)
    >>> search = DatumSearch(baseline_m=20.0)
    >>> for x in (0.0, 25.0, 50.0):  # the platform drives along the frame's x
    ...     found = search.add(truth.to_ecef([x, 0.0, 0.0]), (x, 0.0, 0.0))
    ...     if found is None:
    ...         print(search.reason)
    1 good fixes at places up to 0 m apart; the heading needs 3 and 20 m
    2 good fixes at places up to 25 m apart; the heading needs 3 and 20 m
    >>> print(f'heading {found.datum.heading_deg:.3f} degrees')
    heading 30.000 degrees
    """

    def __init__(self, heading_deg: float = 0.0, baseline_m: float = 0.0):
        self._heading_deg, self._baseline_m = heading_deg, baseline_m
        self._begin('no good fix yet')

    def add(self, ecef_m: ArrayLike, place_m: ArrayLike, std_m: float = math.nan
            ) -> FoundDatum | None:
        """Add a place that is known on the Earth and in the frame.

        Parameters
        ----------
        ecef_m, place_m : (3,) array_like
            Earth-centred, and in the frame; metres.
        std_m : float
            Standard deviation of the former, metres; NaN where nobody tells.

        Returns
        -------
        FoundDatum or None
            None where more is needed; `reason` says what.

        Raises
        ------
        ValueError
            The places contradict the fixes; those so far are forgotten.
        """
        ecef_m, place_m = np.asarray(ecef_m, np.float64), np.asarray(place_m, np.float64)
        if not self._baseline_m:
            return FoundDatum(datum_through(ecef_m, place_m, self._heading_deg), 1)
        _check_extent(place_m)
        if self._place_m and (math.dist(place_m[:2], self._place_m[-1][:2])
                              < _KEPT_SHARE * self._baseline_m):
            return None  # standing still tells nothing new
        self._ecef_m.append(ecef_m)
        self._place_m.append(place_m)
        self._std_m.append(std_m)
        first = self._place_m[0]
        way_m = max(math.dist(place[:2], first[:2]) for place in self._place_m)
        if way_m < self._baseline_m or len(self._place_m) < _FEWEST:
            self.reason = (f'{len(self._place_m)} good fixes at places up to {way_m:.3g} m apart; '
                           f'the heading needs {_FEWEST} and {self._baseline_m:g} m')
            return None
        return self._fit(way_m)

    def _begin(self, reason: str) -> None:
        self._ecef_m: list[np.ndarray] = []
        self._place_m: list[np.ndarray] = []
        self._std_m: list[float] = []
        self.reason = reason

    def _fit(self, way_m: float) -> FoundDatum:
        ecef_m, place_m = np.array(self._ecef_m), np.array(self._place_m)
        datum = _fitted(ecef_m, place_m)
        off_m = datum.from_ecef(ecef_m) - place_m
        residual_m = math.sqrt(np.mean(np.sum(off_m**2, axis=1)))
        known = [std for std in self._std_m if math.isfinite(std)]
        std_m = max(known, default=0.0)
        if residual_m > max(_DISAGREEMENT * way_m, 3 * std_m):
            self._begin('fixes and poses contradict each other')
            raise ValueError(f'{len(place_m)} fixes and the poses at their times differ by '
                             f'{residual_m:.3g} m over {way_m:.3g} m of way, whatever the '
                             'heading: is z of the frame up, and are their clocks the same?')
        return FoundDatum(datum, len(place_m), residual_m,
                          math.degrees(max(residual_m, std_m) / way_m))


def _fitted(ecef_m: np.ndarray, place_m: np.ndarray) -> Datum:
    """Datum whose frame has (N, 3) points of the Earth closest to their places in it."""
    datum = _at(ecef_m[0], 0.0)
    middle = place_m.mean(axis=0)
    for _ in range(_STEPS):
        found = datum.from_ecef(ecef_m)
        centre = found.mean(axis=0)
        a, b = (found - centre)[:, :2], (place_m - middle)[:, :2]
        angle = math.atan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
        cosine, sine = math.cos(angle), math.sin(angle)
        back = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        shift = centre - back @ middle  # of the origin, along the axes so far
        heading = math.remainder(datum.heading_deg + math.degrees(angle), 360.0)
        datum = _at(datum.to_ecef(shift), heading)
        if np.linalg.norm(shift) < _ENOUGH_M and abs(angle) < 1e-12:
            break
    return datum


def _at(ecef_m: np.ndarray, heading_deg: float) -> Datum:
    latitude, longitude, height = (float(v) for v in ecef_to_geographic(ecef_m))
    return Datum(latitude, longitude, height, heading_deg=heading_deg)


def _check_extent(place_m: np.ndarray) -> None:
    far_m = float(np.linalg.norm(place_m))
    if not far_m <= _LARGEST_FRAME_M:
        raise ValueError(f'the platform is {far_m / 1e3:.4g} km from the origin of its frame; '
                         f'expected a local frame, at most {_LARGEST_FRAME_M / 1e3:g} km: map '
                         'projections such as UTM and Earth-centred frames have no datum')


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

    Without attitudes every fix is a pose, rotated as the frame is: its position is that of the
    antenna. With attitudes there is a pose at the time of each: the place of the antenna is
    interpolated between the fixes as `PoseTrack` does, once three fixes behind it are known, and
    the lever arm of the antenna is subtracted. Attitudes turn body vectors into east, north and
    up at the platform; the frame's axes are those at its origin, so both are brought together
    through the Earth's axes.

    Parameters
    ----------
    datum : Datum or None
        Datum of the frame; fixes wait for it where it is not known yet, see `datum`.
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

    def __init__(self, *, datum: Datum | None = None, antenna_m: ArrayLike = (0.0, 0.0, 0.0),
                 with_attitude: bool = True, max_gap_s: float = 0.2, jump_m: float = 0.05) -> None:
        self.datum = datum
        self._antenna_m = np.asarray(antenna_m, np.float64)
        self._with_attitude = with_attitude
        self._fixes: collections.deque[Fix] = collections.deque(maxlen=CAPACITY)
        self._attitudes: collections.deque[tuple[int, tuple[float, ...]]] = collections.deque(
            maxlen=CAPACITY)
        self._track = PoseTrack(max_gap_s=max_gap_s, jump_m=jump_m)  # of the antenna
        self._fix_stamps: collections.deque[int] = collections.deque(maxlen=REACH)
        self.n_unused = 0

    def add_fix(self, fix: Fix) -> list[FramePose]:
        """Add a fix; returns the poses that it makes known."""
        self._fixes.append(fix)
        return self.take()

    def add_attitude(self, stamp_ns: int, quaternion: Sequence[float] | np.ndarray
                     ) -> list[FramePose]:
        """Add an attitude; returns poses where the fixes behind it came already.

        Parameters
        ----------
        stamp_ns : int
            Time on the clock of the fixes, nanoseconds.
        quaternion : (4,) array_like
            x, y, z, w: turns body vectors (x forward, y left, z up) into east, north, up.
        """
        rotation = tuple(float(v) for v in quaternion)
        if not abs(math.hypot(*rotation) - 1) <= _NORM_TOLERANCE:  # NaN as well
            self.n_unused += 1
            return []
        self._attitudes.append((stamp_ns, rotation))
        behind = self._fix_stamps[0] if len(self._fix_stamps) == REACH else stamp_ns
        return self._rotated() if stamp_ns < behind else []

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
        return poses or self._rotated()

    def _rotated(self) -> list[FramePose]:
        """Poses at the times of the attitudes that fixes surround."""
        if self.datum is None or not self._attitudes or not len(self._track):
            return []
        waiting = list(self._attitudes)
        stamps = np.array([stamp for stamp, _ in waiting], np.int64)
        places = self._track.sample(stamps)
        ready = np.flatnonzero(places.status == PoseStatus.READY)
        wait = np.flatnonzero(places.status == PoseStatus.WAIT)
        self._attitudes.clear()
        self._attitudes.extend(waiting[i] for i in wait)
        # Sensors of attitude begin before satellites are found: those are no loss.
        before = int(np.count_nonzero(places.status == PoseStatus.BEFORE))
        self.n_unused += len(waiting) - len(ready) - len(wait) - before
        if not ready.size:
            return []
        latitude, longitude, _ = self.datum.to_geographic(places.position_m[ready])
        from_enu = Rotation.from_matrix(self.datum.axes_ecef @ _enu_to_ecef(latitude, longitude))
        rotation = from_enu * Rotation.from_quat([waiting[i][1] for i in ready])
        position = places.position_m[ready] - rotation.apply(self._antenna_m)
        return [FramePose(int(stamp), tuple(place), tuple(quaternion)) for stamp, place, quaternion
                in zip(stamps[ready], position.tolist(), rotation.as_quat().tolist(), strict=True)]


def _enu_to_ecef(latitude_deg: np.ndarray, longitude_deg: np.ndarray) -> np.ndarray:
    """(N, 3, 3) rotations whose columns are east, north and up of N places."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    zero = np.zeros_like(lat)
    east = np.stack([-np.sin(lon), np.cos(lon), zero], axis=-1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    return np.stack([east, np.cross(up, east), up], axis=-1)
