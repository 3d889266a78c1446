# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses in the plane as messages: where each number stands, and what is refused."""

import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='messages come with ROS')

from std_msgs.msg import Header

from msg_conversions.planar_poses import UNKNOWN_VARIANCE, pose_to_message, transform_to_message


def test_a_covariance_stands_where_filters_look_for_it():
    covariance = np.array([[1.0, 0.2, 0.3], [0.2, 2.0, 0.4], [0.3, 0.4, 3.0]])
    message = pose_to_message((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8), covariance,
                              Header(frame_id='map'))
    whole = np.array(message.pose.covariance).reshape(6, 6)  # x, y, z, roll, pitch, yaw
    assert whole[[0, 0, 1, 5, 5, 5], [0, 1, 1, 0, 1, 5]].tolist() == [1.0, 0.2, 2.0, 0.3, 0.4, 3.0]
    assert np.diag(whole)[2:5].tolist() == [UNKNOWN_VARIANCE] * 3
    assert (whole == whole.T).all() and np.count_nonzero(whole) == 12
    assert message.pose.pose.position.z == 3.0 and message.pose.pose.orientation.w == 0.8


@pytest.mark.parametrize('variance', [math.inf, math.nan, 0.0, -1.0])
def test_what_is_no_covariance_is_refused(variance):
    with pytest.raises(ValueError, match='expected finite numbers and positive variances'):
        pose_to_message((0, 0, 0), (0, 0, 0, 1), np.diag([1.0, variance, 1.0]), Header())


def test_a_heading_turns_about_z():
    turn = transform_to_message((1.0, 2.0, math.pi / 2), Header(), 'odom').transform.rotation
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx(
        (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
