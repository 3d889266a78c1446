# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixes, attitudes and the datum as messages."""

import contextlib
import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='messages need ROS')

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from hypothesis import given, strategies as st
from sensor_msgs.msg import Imu, NavSatFix

from msg_conversions.errors import WireFormatError
from msg_conversions.navigation import (
    attitude_from_message,
    datum_from_message,
    datum_to_message,
    fix_from_message,
)
from sar_imaging.geometry.earth import Datum


def fix_message(latitude=47.5, longitude=8.25, altitude=450.125, status=0, variance=None):
    message = NavSatFix(latitude=latitude, longitude=longitude, altitude=altitude)
    message.header.stamp = Time(sec=1_700_000_000, nanosec=123_456_789)
    message.status.status = status
    if variance is not None:
        message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
        message.position_covariance = [variance[0], 0.0, 0.0, 0.0, variance[1], 0.0, 0.0, 0.0, 9.0]
    return message


def test_a_fix_keeps_every_digit():
    fix = fix_from_message(fix_message(variance=(0.25, 0.04)), max_std_m=0.5)
    assert fix.stamp_ns == 1_700_000_000_123_456_789
    assert (fix.latitude_deg, fix.longitude_deg, fix.height_m, fix.std_m) == (47.5, 8.25, 450.125,
                                                                              0.5)
    assert math.isnan(fix_from_message(fix_message(), max_std_m=0.5).std_m)
    assert math.isnan(fix_from_message(fix_message(variance=(-1.0, -1.0))).std_m)
    assert math.isnan(fix_from_message(fix_message(variance=(math.nan,) * 2), max_std_m=1).std_m)


@pytest.mark.parametrize(('message', 'reason'), [
    (fix_message(status=-1), 'status -1: no fix'),
    (fix_message(status=-2), 'status -2: no fix'),
    (fix_message(altitude=math.nan), 'expected three finite numbers'),
    (fix_message(latitude=91.0), 'latitude_deg=91; expected -90 to 90'),
    (fix_message(variance=(4.0, 1.0)), 'standard deviation 2 m, more than 1 m')])
def test_what_is_no_good_fix_says_why(message, reason):
    with pytest.raises(WireFormatError, match=reason):
        fix_from_message(message, max_std_m=1.0)


def test_attitudes():
    message = Imu()
    message.header.stamp = Time(sec=7, nanosec=5)
    message.orientation.x, message.orientation.w = 0.6, 0.8
    assert attitude_from_message(message) == (7_000_000_005, (0.6, 0.0, 0.0, 0.8))
    message.orientation_covariance[0] = -1.0
    with pytest.raises(WireFormatError, match='no orientation'):
        attitude_from_message(message)
    message.orientation_covariance[0] = 0.0
    message.orientation.w = 0.0
    with pytest.raises(WireFormatError, match='norm 0.6; expected 1'):
        attitude_from_message(message)


@given(st.floats(-89.9, 89.9), st.floats(-180, 180), st.floats(-400, 9000), st.floats(-360, 360))
def test_the_datum_travels_exactly(latitude, longitude, height, heading):
    datum = Datum(latitude, longitude, height, heading)
    message = datum_to_message(datum, 'odom', Time(sec=3))
    assert (message.header.frame_id, message.child_frame_id) == ('earth', 'odom')
    # The message says where points are as tf does: rotated, then moved.
    points = np.vstack([np.zeros(3), 1000 * np.eye(3)])
    back = datum_from_message(message)
    # float64 at the Earth's radius: 1e-9 m of the origin, of which latitude and longitude each
    # take a share, and 1e-16 of a turn
    np.testing.assert_allclose(back.to_ecef(points), datum.to_ecef(points), rtol=0, atol=1e-8)


def test_the_transform_is_what_tf_means_by_it():
    message = datum_to_message(Datum(0.0, 0.0, 0.0), 'map', Time())
    # At latitude and longitude 0 x (east) is ECEF y, y (north) is z, z (up) is x: a third of a
    # turn about the diagonal.
    q = message.transform.rotation
    sign = math.copysign(1.0, q.w)
    np.testing.assert_allclose(sign * np.array([q.x, q.y, q.z, q.w]), 0.5, atol=1e-15)
    t = message.transform.translation
    np.testing.assert_allclose([t.x, t.y, t.z], [6378137.0, 0.0, 0.0], atol=1e-9)


def test_transforms_that_are_no_datum_are_refused():
    message = datum_to_message(Datum(47.0, 8.0, 450.0), 'odom', Time())
    message.header.frame_id = 'map'
    with pytest.raises(WireFormatError, match="from frame 'map'; expected earth"):
        datum_from_message(message)
    message.header.frame_id = 'earth'
    message.transform.translation.z += 1000.0  # where the frame would be tilted
    with pytest.raises(WireFormatError, match='z of odom is 0.006.* degrees off the normal'):
        datum_from_message(message)
    message.transform.translation.z = math.nan
    with pytest.raises(WireFormatError, match='expected finite numbers'):
        datum_from_message(message)
    with pytest.raises(WireFormatError, match='expected earth'):
        datum_from_message(TransformStamped())


ANYTHING = st.floats(width=64)  # NaN and infinities among them


@given(st.integers(-128, 127), st.lists(ANYTHING, min_size=3, max_size=3),
       st.lists(ANYTHING, min_size=9, max_size=9), st.integers(0, 3))
def test_whatever_a_receiver_sends_is_a_place_on_the_earth_or_refused(status, place, covariance,
                                                                      kind):
    message = NavSatFix(latitude=place[0], longitude=place[1], altitude=place[2],
                        position_covariance=covariance, position_covariance_type=kind)
    message.status.status = status
    try:
        fix = fix_from_message(message, max_std_m=10.0)
    except WireFormatError:
        return
    assert np.isfinite(fix.ecef_m).all() and not fix.std_m > 10.0


@given(st.lists(ANYTHING, min_size=4, max_size=4))
def test_whatever_a_sensor_sends_is_a_rotation_or_refused(numbers):
    message = Imu()
    q = message.orientation
    q.x, q.y, q.z, q.w = numbers
    try:
        _, turn = attitude_from_message(message)
    except WireFormatError:
        return
    assert math.hypot(*turn) == pytest.approx(1.0, abs=0.01)


@given(st.lists(ANYTHING, min_size=7, max_size=7))
def test_whatever_a_transform_holds_is_a_datum_or_refused(numbers):
    message = datum_to_message(Datum(47.0, 8.0), 'odom', Time())
    t, q = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z, q.x, q.y, q.z, q.w = numbers
    with contextlib.suppress(WireFormatError):
        datum_from_message(message)
