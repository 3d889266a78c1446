# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses from fixes and attitudes, against the flight that both were made from."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.navigation import Fix, FixPoses
from sar_imaging.geometry.poses import PoseTrack

DATUM = Datum(69.0, -179.9999, 60.0, heading_deg=40.0)
ARM = np.array([0.4, -0.1, 0.7])
MS = 1_000_000


def position(t):
    """A curve of 300 m radius at 20 m/s, 2 km from the origin, in the frame."""
    return np.stack([2000 + 300 * np.sin(t / 15), -500 + 300 * np.cos(t / 15), 80 + t], axis=-1)


def attitude(t):
    """From the body into the frame: a heading that follows the curve, and a roll."""
    t = np.asarray(t)
    return (Rotation.from_rotvec(np.multiply.outer(-t / 15, [0, 0, 1]))
            * Rotation.from_rotvec(np.multiply.outer(0.2 * np.sin(t), [1, 0, 0])))


def fix(t):
    place = position(t) + attitude(t).apply(ARM)
    latitude, longitude, height = DATUM.to_geographic(place)
    return Fix(round(t * 1e9), float(latitude), float(longitude), float(height))


def enu_attitude(t):
    """What a sensor tells: from the body into east, north, up at the platform."""
    latitude, longitude, _ = DATUM.to_geographic(position(t))
    local = Datum(float(latitude), float(longitude))
    to_enu = Rotation.from_matrix(local.axes_ecef @ DATUM.axes_ecef.T)
    return (to_enu * attitude(t)).as_quat()


def fly(poses, fix_times, attitude_times=()):
    """All in the order of their times; returns the poses."""
    events = sorted([(t, 0) for t in attitude_times] + [(t, 1) for t in fix_times])
    out = []
    for t, is_fix in events:
        if is_fix:
            out += poses.add_fix(fix(t))
        else:
            out += poses.add_attitude(round(t * 1e9), enu_attitude(t))
    return out


def test_fixes_and_attitudes_make_the_flight():
    poses = FixPoses(datum=DATUM, antenna_m=ARM)
    found = fly(poses, np.arange(0, 4, 0.1), np.arange(-0.995, 4, 0.01))
    t = np.array([p.stamp_ns for p in found]) * 1e-9
    # All between the fixes but for those that await the third fix behind them.
    np.testing.assert_allclose(t, np.arange(0.005, 3.7, 0.01), atol=1e-9)
    # Interpolated over 0.1 s: h^4 |x''''| / 384 of a circle is 2e-9 m, that of the arm, which
    # rolls at 1 rad/s with 0.2 rad, 4e-8 m; at the ends of the track 20 times as much.
    np.testing.assert_allclose([p.position_m for p in found], position(t), atol=2e-6)
    turn = Rotation.from_quat([p.quaternion for p in found])
    # East is that at the antenna, not the body: 0.9 m / 6.4e6 m x tan(69 degrees).
    assert np.max((attitude(t).inv() * turn).magnitude()) < 4e-7
    assert poses.n_unused == 0


def test_attitudes_that_come_behind_their_fixes_are_poses_at_once():
    poses = FixPoses(datum=DATUM, antenna_m=ARM)
    assert fly(poses, np.arange(0, 1, 0.1)) == []
    found = fly(poses, [], np.arange(0.005, 1, 0.01))
    t = np.array([p.stamp_ns for p in found]) * 1e-9
    np.testing.assert_allclose(t, np.arange(0.005, 0.7, 0.01), atol=1e-9)
    np.testing.assert_allclose([p.position_m for p in found], position(t), atol=2e-6)


def test_without_attitude_each_fix_is_a_pose_turned_as_the_frame():
    poses = FixPoses(datum=DATUM, with_attitude=False)
    found = fly(poses, np.arange(0, 1, 0.1))
    t = np.arange(0, 1, 0.1)
    expected = position(t) + attitude(t).apply(ARM)
    np.testing.assert_allclose([p.position_m for p in found], expected, atol=1e-8)
    assert {p.quaternion for p in found} == {(0.0, 0.0, 0.0, 1.0)}


def test_fixes_wait_for_the_datum():
    poses = FixPoses(with_attitude=False)
    assert fly(poses, np.arange(0, 1, 0.1)) == []
    poses.datum = DATUM
    assert [p.stamp_ns for p in poses.take()] == [n * 100 * MS for n in range(10)]
    assert poses.take() == []


def test_no_pose_across_a_gap_of_the_fixes():
    poses = FixPoses(datum=DATUM, antenna_m=ARM)
    times = np.concatenate([np.arange(0, 1.05, 0.1), np.arange(3, 4.05, 0.1)])
    found = fly(poses, times, np.arange(0.005, 4, 0.01))
    t = np.array([p.stamp_ns for p in found]) * 1e-9
    np.testing.assert_allclose(t, np.concatenate([np.arange(0.005, 1, 0.01),
                                                  np.arange(3.005, 3.8, 0.01)]), atol=1e-9)
    np.testing.assert_allclose([p.position_m for p in found], position(t), atol=2e-6)
    assert poses.n_unused == 200  # those in the gap


def test_impossible_attitudes_are_counted():
    poses = FixPoses(datum=DATUM)
    for quaternion in ([0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 0, 1.1]):
        poses.add_attitude(0, quaternion)
    assert poses.n_unused == 3


@pytest.mark.parametrize('with_attitude', [True, False])
def test_a_clock_that_goes_back_begins_anew_as_with_other_poses(with_attitude):
    poses = FixPoses(datum=DATUM, with_attitude=with_attitude)
    track, verdicts = PoseTrack(), []
    for _ in range(2):
        for pose in fly(poses, np.arange(0, 3, 0.1), np.arange(0.005, 3, 0.01)):
            verdicts.append(track.add(*pose).name)
            if verdicts[-1] == 'RESTART':
                track = track.successor()
    assert verdicts.count('RESTART') == 1 and 'JUMP' not in verdicts and 'GAP' not in verdicts
