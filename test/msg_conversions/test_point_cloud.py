# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving targets to point clouds and back, also clouds that others wrote."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

pytest.importorskip('sensor_msgs', reason='needs the ROS message classes')

from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointField
from std_msgs.msg import Header

from msg_conversions import WireFormatError, point_cloud

HEADER = Header(stamp=Time(sec=12, nanosec=34), frame_id='map')
ROWS = np.arange(12, dtype=float).reshape(2, 6)


def through_cdr(message):
    serialization = pytest.importorskip('rclpy.serialization')
    return serialization.deserialize_message(serialization.serialize_message(message),
                                             type(message))


@given(hnp.arrays(np.float32, st.tuples(st.integers(0, 5), st.just(6))))
def test_round_trip(points):
    message = through_cdr(point_cloud.to_message(points, HEADER))
    np.testing.assert_array_equal(point_cloud.from_message(message), points)
    assert message.header == HEADER
    assert (message.height, message.width) == (1, len(points))
    assert message.is_dense == bool(np.isfinite(points[:, :3]).all())


def test_obstacles_have_fields_of_their_own():
    rows = np.arange(10, dtype=float).reshape(2, 5)
    message = through_cdr(point_cloud.to_message(rows, HEADER, point_cloud.OBSTACLE_FIELDS))
    assert [f.name for f in message.fields] == ['x', 'y', 'z', 'intensity', 'width']
    np.testing.assert_array_equal(
        point_cloud.from_message(message, point_cloud.OBSTACLE_FIELDS), rows)
    with pytest.raises(WireFormatError, match='no fields radial_velocity, snr'):
        point_cloud.from_message(message)


def test_layout_is_what_viewers_expect():
    message = point_cloud.to_message(ROWS, HEADER)
    assert [(f.name, f.offset, f.datatype) for f in message.fields[:3]] == [
        ('x', 0, PointField.FLOAT32), ('y', 4, PointField.FLOAT32), ('z', 8, PointField.FLOAT32)]
    assert (message.point_step, message.row_step, len(message.data)) == (24, 48, 48)


@pytest.mark.parametrize('order', ['<', '>'])
def test_cloud_of_another_writer(order):
    # Fields in another order with gaps, two padded rows of two points, either byte order.
    message = point_cloud.to_message(np.zeros((0, 6)), HEADER)
    for i, field in enumerate(reversed(message.fields)):
        field.offset = 4 + 8 * i
    message.height, message.width, message.point_step, message.row_step = 2, 2, 52, 112
    message.is_bigendian = order == '>'
    rows = np.arange(24, dtype=float).reshape(2, 2, 6)
    data = np.zeros((2, 112), np.uint8)
    for i, j, k in np.ndindex(rows.shape):
        place = 52 * j + 4 + 8 * (5 - k)
        data[i, place:place + 4] = np.array([rows[i, j, k]], f'{order}f4').view(np.uint8)
    message.data.frombytes(data.tobytes())
    np.testing.assert_array_equal(point_cloud.from_message(through_cdr(message)),
                                  rows.reshape(4, 6))


@pytest.mark.parametrize('shape', [(6,), (2, 5), (1, 2, 6)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(ValueError, match='points.shape'):
        point_cloud.to_message(np.zeros(shape), HEADER)


@pytest.mark.parametrize(('change', 'text'), [
    (lambda m: m.fields.pop(4), 'no fields snr'),
    (lambda m: setattr(m.fields[3], 'datatype', PointField.FLOAT64), 'field radial_velocity'),
    (lambda m: setattr(m.fields[0], 'count', 2), 'count 2'),
    (lambda m: setattr(m.fields[5], 'offset', 21), 'outside the point'),
    (lambda m: setattr(m, 'width', 3), 'len'),
    (lambda m: setattr(m, 'row_step', 24), 'row_step=24'),
    (lambda m: m.data.append(0), 'len.data.=49')])
def test_impossible_clouds_are_refused(change, text):
    message = point_cloud.to_message(ROWS, HEADER)
    change(message)
    with pytest.raises(WireFormatError, match=text):
        point_cloud.from_message(message)


def test_places_on_the_earth_are_float64_fields():
    fields = point_cloud.GEOGRAPHIC_FIELDS, point_cloud.OBSTACLE_FIELDS
    points = np.arange(12.0).reshape(2, 6)
    earth = np.array([[47.123456789012, -8.5, 450.25], [np.nan, np.nan, np.nan]])
    message = point_cloud.to_message(points, HEADER, geographic=earth)
    assert [(f.name, f.offset, f.datatype) for f in message.fields[6:]] == [
        ('latitude', 24, PointField.FLOAT64), ('longitude', 32, PointField.FLOAT64),
        ('altitude', 40, PointField.FLOAT64)]
    assert (message.point_step, message.row_step, message.is_dense) == (48, 96, True)
    np.testing.assert_array_equal(point_cloud.from_message(message), points)
    np.testing.assert_array_equal(point_cloud.from_message(message, fields[0]), earth)
    # of five fields: doubles are aligned to eight bytes
    message = point_cloud.to_message(points[:, :5], HEADER, fields[1], earth)
    assert message.fields[5].offset == 24
    np.testing.assert_array_equal(point_cloud.from_message(message, fields[1]), points[:, :5])
    np.testing.assert_array_equal(point_cloud.from_message(message, fields[0]), earth)
    message.fields[5].datatype = PointField.FLOAT32
    with pytest.raises(WireFormatError, match='field latitude .* expected one FLOAT64'):
        point_cloud.from_message(message, fields[0])
