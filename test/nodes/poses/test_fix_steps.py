# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixes and the datum in steps, without processes."""

import types

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from builtin_interfaces.msg import Time
from sensor_msgs.msg import Imu, NavSatFix

from msg_conversions.navigation import datum_from_message, datum_to_message
from sar_imaging.geometry.earth import Datum
from sar_imaging.nodes.backprojection import BackprojectionStep
from sar_imaging.nodes.poses.frame_datum import DatumInput
from sar_imaging.nodes.poses.pose_input import PoseInput
from sar_imaging.nodes.pulse_buffer import PulseBufferStep

from ..step_bench import make
from .test_pose_steps import Node

DATUM = Datum(47.0, 8.0, 450.0, heading_deg=20.0)


class FixNode(Node):
    """Names of topics as a node resolves them."""

    def resolve_topic_name(self, topic):
        return f'/{topic}'


def fix(datum, step, scale=1.0, **changes):
    """Every 0.1 s, 2 m further along x."""
    latitude, longitude, height = datum.to_geographic([2.0 * scale * step, 5.0, 30.0])
    message = NavSatFix(latitude=float(latitude), longitude=float(longitude),
                        altitude=float(height), **changes)
    message.status.status = 0
    message.header.stamp = Time(sec=step // 10, nanosec=step % 10 * 100_000_000)
    return message


@pytest.fixture
def listening():
    """Poses from fixes in a node that is told the datum by another one."""
    step, log = make(BackprojectionStep, **{'pose.source': 'fix_imu', 'datum.source': 'fix',
                                            'frame_id': 'odom'})
    node = FixNode()
    datum = DatumInput(step.parameters, log)
    datum.activate(node)
    came = []
    poses = PoseInput(step.parameters, log, datum, lambda: came.append(1))
    poses.activate(node)
    return types.SimpleNamespace(node=node, datum=datum, poses=poses, came=came, log=log)


def attitude(step):
    message = Imu()
    message.header.stamp = Time(sec=step // 10, nanosec=step % 10 * 100_000_000 + 50_000_000)
    message.orientation.w = 1.0  # looks east, so 20 degrees to the left of x
    return message


def test_fixes_wait_for_the_datum_of_another_node(listening):
    for step in range(10):
        listening.node.callbacks['imu'](attitude(step))
        listening.node.callbacks['fix'](fix(DATUM, step))
    assert listening.poses.take() == []
    assert 'which pulse_buffer publishes once fixes tell it' in listening.datum.reason
    message = datum_to_message(DATUM, 'map', Time())
    listening.node.callbacks['datum'](message)
    assert listening.datum.value is None
    assert listening.log.lines[-1].endswith("it is that of frame 'map'; images are in odom")
    message.child_frame_id = '/odom'
    listening.node.callbacks['datum'](message)
    listening.node.callbacks['fix'](fix(DATUM, 10))
    poses = listening.poses.take()
    assert len(poses) == len(listening.came) == 8  # those with three fixes behind them
    np.testing.assert_allclose([p for _, p, _ in poses],
                               [(2.0 * n + 1.0, 5.0, 30.0) for n in range(8)], atol=1e-7)
    # East at the platform is that at the origin to 3e-6 rad; a turn by 20 degrees about z.
    np.testing.assert_allclose(poses[0][2], (0, 0, np.sin(np.radians(10)),
                                             np.cos(np.radians(10))), atol=1e-5)


def test_bad_messages_are_counted_and_told_of_once(listening):
    for _ in range(3):
        listening.node.callbacks['fix'](fix(DATUM, 0, position_covariance_type=2,
                                            position_covariance=[1e6] * 9))
        bad = attitude(0)
        bad.orientation_covariance[0] = -1.0
        listening.node.callbacks['imu'](bad)
    of_fixes = listening.poses.of_fixes
    fixes = of_fixes.fixes
    assert (fixes.n_received, fixes.n_rejected, of_fixes.n_attitudes_unused) == (3, 3, 3)
    assert [line for line in listening.log.lines if 'dropped' in line] == [
        'dropped messages of /fix: standard deviation 1e+03 m, more than 10 m',
        'dropped messages of /imu: orientation_covariance[0] is -1: no orientation']


def test_what_was_begun_is_undone(listening):
    assert set(listening.node.callbacks) == {'datum', 'fix', 'imu'}
    listening.node.activity.close()
    assert listening.node.callbacks == {}


def test_where_poses_contradict_fixes_the_search_begins_anew():
    from nav_msgs.msg import Odometry

    step, log = make(PulseBufferStep, **{'pose.source': 'odometry', 'datum.source': 'fix',
                                         'datum.heading_baseline_m': 10.0, 'frame_id': 'odom'})
    node = FixNode()
    node.get_clock = lambda: types.SimpleNamespace(now=lambda: types.SimpleNamespace(to_msg=Time))
    step.create_outputs(node)
    step.activate(node)

    def fly(first, stop, scale):
        for n in range(first, stop):
            pose = Odometry()
            pose.header.frame_id, pose.pose.pose.orientation.w = 'odom', 1.0
            pose.header.stamp = Time(sec=n // 10, nanosec=n % 10 * 100_000_000)
            position = pose.pose.pose.position
            position.x, position.y, position.z = 2.0 * n, 5.0, 30.0
            node.callbacks['odometry'](pose)
            node.callbacks['fix'](fix(DATUM, n, scale))
        step.collect()

    fly(0, 20, scale=0.5)
    assert any('no datum: ' in line and 'whatever the heading' in line for line in log.lines)
    assert node.sent['datum'] == []
    fly(20, 40, scale=1.0)
    assert len(node.sent['datum']) == 1
    found = datum_from_message(node.sent['datum'][0])
    np.testing.assert_allclose(found.to_ecef(np.eye(3)), DATUM.to_ecef(np.eye(3)), atol=1e-6)
    step.update_counters()
    assert (log['fixes_received'], log['fixes_rejected']) == (40, 0)
    node.activity.close()
    assert node.callbacks == {}
