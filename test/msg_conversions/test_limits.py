# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every limit of the conversions, just inside and just outside."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('sensor_msgs', reason='needs the ROS message classes')

from std_msgs.msg import Header

from msg_conversions import WireFormatError, images, multi_array, point_cloud, pulse_block, wire
from msg_conversions.float_pairs import MAX_OFFSET_NS
from msg_conversions.quicklook import quicklook
from sar_imaging.geometry.grids import MapGrid

SECOND_2_31 = 2**31 * 10**9
LARGEST_FLOAT = float(np.finfo(np.float32).max)


def stamps(make_block, *values):
    return make_block(n_pulses=len(values), stamp_ns=values)


@pytest.mark.parametrize('sign', [-1, 1])
def test_times_within_78_hours_of_the_first_pulse_are_written(make_block, assert_same_block,
                                                               sign):
    block = stamps(make_block, 10**18, 10**18 + sign * MAX_OFFSET_NS)
    assert_same_block(wire.from_array(*wire.to_array(block)), block)
    with pytest.raises(WireFormatError, match='expected at most 78 h'):
        wire.to_array(stamps(make_block, 10**18, 10**18 + sign * (MAX_OFFSET_NS + 1)))


@pytest.mark.parametrize('sign', [-1, 1])
def test_times_within_78_hours_of_the_epoch_are_read(make_block, sign):
    data, dims, offset = wire.to_array(stamps(make_block, 0, 0))
    row = slice(24 + 28 + 2, 24 + 28 + 4)  # time of the second pulse, in a pair of floats
    data[row] = sign * np.array([MAX_OFFSET_NS / 1e9 // 32 * 32, MAX_OFFSET_NS / 1e9 % 32])
    assert abs(wire.from_array(data, dims, offset).stamp_ns[1]) <= MAX_OFFSET_NS
    data[row.stop - 1] += sign * 1e-3
    with pytest.raises(WireFormatError, match='expected at most 78 h'):
        wire.from_array(data, dims, offset)


@pytest.mark.parametrize('latest', [2**63 - 1, -2**63])
def test_the_first_and_last_nanosecond_of_64_bits_are_read(make_block, latest):
    block = stamps(make_block, latest)
    assert wire.from_array(*wire.to_array(block)).stamp_ns.tolist() == [latest]


@pytest.mark.parametrize('latest', [SECOND_2_31 - 1, 1 - SECOND_2_31])
def test_messages_hold_the_seconds_that_a_header_does(make_block, latest):
    message = pulse_block.to_message(stamps(make_block, latest))
    assert pulse_block.from_message(message).stamp_ns.tolist() == [latest]
    beyond = latest + (1 if latest > 0 else -1)
    with pytest.raises(WireFormatError, match=r'below 2\^31'):
        pulse_block.from_message(pulse_block.to_message(stamps(make_block, beyond)))
    multi_array.check_times(-SECOND_2_31 + 1, SECOND_2_31 - 1)
    for times in ((-SECOND_2_31, 0), (0, SECOND_2_31)):
        with pytest.raises(WireFormatError, match=r'below 2\^31'):
            multi_array.check_times(*times)


def test_layout_fields_hold_up_to_32_bits():
    wire.LAYOUT.check_size('samples', (1, 1, 2**31 - 26), 51)  # 2**32 - 1 floats in all
    with pytest.raises(WireFormatError, match=r'less than 2\*\*32'):
        wire.LAYOUT.check_size('samples', (1, 1, 2**31 - 26), 52)


@pytest.mark.parametrize('value', [LARGEST_FLOAT, -LARGEST_FLOAT])
def test_positions_may_be_as_large_as_float32(make_block, value):
    centres = np.zeros((1, 1, 3))
    centres[..., 1] = value
    block = make_block(n_pulses=1, n_channels=1, tx_m=centres, rx_m=centres)
    assert wire.from_array(*wire.to_array(block)).tx_m[0, 0, 1] == value
    with pytest.raises(WireFormatError, match='expected finite numbers below 3.4e38'):
        wire.to_array(make_block(n_pulses=1, n_channels=1, tx_m=1.001 * centres, rx_m=centres))


def test_counters_use_all_32_bits(make_block):
    counter = [0, 1, 65535, 65536, 2**31, 2**32 - 1]
    block = make_block(n_pulses=6, counter=counter)
    assert wire.from_array(*wire.to_array(block)).counter.tolist() == counter


@pytest.mark.parametrize('dynamic_range_db', [1e-3, 200.0])
def test_dynamic_ranges_up_to_their_ends_are_possible(dynamic_range_db):
    assert quicklook(np.array([[1.0, 1e-12]]), dynamic_range_db).tolist() == [[255, 0]]
    with pytest.raises(ValueError, match='at most 200'):
        quicklook(np.ones((1, 1)), 200.001)


def test_one_pixel_is_an_image():
    grid = MapGrid((0.0, 0.0, 0.0), 1, 1, 0.5)
    message = images.complex_to_message(np.full((1, 1), 1j), Header())
    assert images.complex_from_message(message).tolist() == [[1j]]
    assert images.map_metadata_from_message(
        images.map_metadata_to_message(grid, Header().stamp)) == grid


def test_the_last_field_of_a_point_may_end_with_it():
    message = point_cloud.to_message(np.arange(12.0).reshape(2, 6), Header())
    assert message.fields[-1].offset + 4 == message.point_step
    np.testing.assert_array_equal(point_cloud.from_message(message),
                                  np.arange(12.0).reshape(2, 6))
    message.fields[-1].offset += 1
    with pytest.raises(WireFormatError, match='lies outside the point'):
        point_cloud.from_message(message)
