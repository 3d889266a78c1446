# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Odometry in recordings, on a clock of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.recordings import bag_io, recording
from sar_imaging.recordings.truth import make_truth

START_NS = 1_700_000_000_000_000_000
OFFSET_S = 2.5


@pytest.fixture
def alignment():
    return Alignment(tx_m=[[0.0, 0.0, 1.0]], rx_m=[[0.0, 0.0, 3.0]], time_offset_s=OFFSET_S)


@pytest.fixture
def poses():
    """100 Hz around the pulses of `make_block`, turned upside down about x."""
    stamp = START_NS + round(OFFSET_S * 1e9) + np.arange(-50, 100) * 10_000_000
    t = (stamp - stamp[0]) * 1e-9
    position = np.stack([t, 2 * t, np.full_like(t, 10.0)], axis=1)
    return PoseTable(stamp, position, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), 'odom')


@pytest.fixture
def bag(tmp_path, make_block, poses, alignment):
    blocks = [dataclasses.replace(make_block(first, 5), tx_m=None, rx_m=None)
              for first in (0, 5, 10)]
    truth = make_truth(
        scenario='test', description='', scatterers=[],
        grid=MapGrid((1.0, 2.0, 0.0), 5, 7, 0.5), pulses_per_aperture=8, n_pulses=15,
        n_channels=1, cut_half_width_m=(1.0, 1.0), radar=blocks[0].radar, compressed=True,
        alignment=alignment)
    assert bag_io.write_bag(tmp_path / 'bag', blocks, truth, poses=poses) == 3
    return tmp_path / 'bag'


def test_poses_come_back_as_they_were(bag, poses):
    found = bag_io.read_poses(bag)
    np.testing.assert_array_equal(found.stamp_ns, poses.stamp_ns)
    np.testing.assert_array_equal(found.position_m, poses.position_m)
    np.testing.assert_array_equal(found.quaternion, poses.quaternion)
    assert (found.frame_id, found.child_frame_id) == ('odom', 'base_link')


def test_both_topics_are_recorded_on_the_clock_of_the_poses(bag):
    pulses = [(t, 'pulses') for t, _ in bag_io.raw_messages(bag)]
    poses = [(t, 'odometry') for t, _ in bag_io.pose_messages(bag)]
    # Blocks end with the pulses 4, 9 and 14, 10 ms apart.
    offset = START_NS + round(OFFSET_S * 1e9)
    assert [t - offset for t, _ in pulses] == [40_000_000, 90_000_000, 140_000_000]
    assert poses[0][0] - offset == -500_000_000


def test_odometry_is_what_ros_sends(bag, poses):
    rclpy = pytest.importorskip('rclpy.serialization', reason='needs ROS')
    from nav_msgs.msg import Odometry

    messages = [rclpy.deserialize_message(cdr, Odometry) for _, cdr in bag_io.pose_messages(bag)]
    assert len(messages) == len(poses.stamp_ns)
    last = messages[-1]
    assert last.header.stamp.sec * 10**9 + last.header.stamp.nanosec == poses.stamp_ns[-1]
    p = last.pose.pose.position
    np.testing.assert_array_equal([p.x, p.y, p.z], poses.position_m[-1])
    assert last.pose.pose.orientation.x == 1.0


def test_phase_centres_of_a_recording_come_from_its_poses(bag, poses):
    centres = recording.read_recording(bag).phase_centre_m
    t = 0.5 + 0.01 * np.arange(15)
    # Lever arms of 1 and 3 m up, upside down.
    np.testing.assert_allclose(centres, np.stack([t, 2 * t, np.full(15, 8.0)], axis=1),
                               atol=1e-9)


def test_pulses_beyond_the_poses_are_told(bag, monkeypatch, poses):
    early = dataclasses.replace(poses, **{name: getattr(poses, name)[:55] for name in (
        'stamp_ns', 'position_m', 'quaternion')})
    monkeypatch.setattr(recording, 'read_poses', lambda path: early)
    with pytest.raises(bag_io.BagError, match='pulses without poses around them'):
        recording.read_recording(bag)


def test_a_recording_without_odometry_has_no_poses(tmp_path, make_block):
    block = make_block(0, 5)
    truth = {'version': 1}
    bag_io.write_bag(tmp_path / 'bag', [block], truth)
    assert bag_io.read_poses(tmp_path / 'bag') is None


def test_a_long_recording_keeps_its_first_poses():
    """100 s at 400 Hz: more than a live track keeps."""
    stamp = START_NS + np.arange(40_000) * 2_500_000
    poses = PoseTable(stamp, np.c_[np.arange(40_000) * 0.01, np.zeros((40_000, 2))],
                          np.tile([0.0, 0.0, 0.0, 1.0], (40_000, 1)))
    found = poses.track().sample(stamp[[10, -10]] + 1_250_000)
    np.testing.assert_allclose(found.position_m[:, 0], [0.105, 399.905], atol=1e-9)
