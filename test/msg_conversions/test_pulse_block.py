# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Conversions with the real message classes, also through the middleware's serialisation."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, strategies as st

pytest.importorskip('std_msgs', reason='needs the ROS message classes')

from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from msg_conversions import WireFormatError, pulse_block, wire
from sar_imaging.signal.radar import RadarParameters


def through_cdr(message):
    serialization = pytest.importorskip('rclpy.serialization')
    return serialization.deserialize_message(serialization.serialize_message(message),
                                             type(message))


@given(data=st.data())
def test_round_trip(data, blocks, assert_same_block):
    block = data.draw(blocks)
    assert_same_block(pulse_block.from_message(pulse_block.to_message(block)), block)


@given(data=st.data())
def test_round_trip_through_serialisation(data, blocks, assert_same_block):
    block = data.draw(blocks)
    assert_same_block(pulse_block.from_message(through_cdr(pulse_block.to_message(block))), block)


@given(data=st.data())
def test_a_block_handed_over_directly_is_the_one_sent(data, blocks):
    block = data.draw(blocks)
    direct, sent = pulse_block.as_received(block), pulse_block.from_message(
        pulse_block.to_message(block))
    assert direct.radar == sent.radar
    assert direct.matches(sent)
    for name in ('stamp_ns', 'counter', 'samples', 'tx_m', 'rx_m'):
        np.testing.assert_array_equal(getattr(direct, name), getattr(sent, name))


def test_blocks_of_a_sonar_go_through_messages(make_block, assert_same_block):
    sonar = make_block(radar=RadarParameters(300e3, 60e3, 90e3, 0.027, 2e-3, 3e7,
                                             propagation_speed_m_per_s=1480.3))
    received = pulse_block.from_message(through_cdr(pulse_block.to_message(sonar)))
    assert_same_block(received, sonar)
    assert pulse_block.as_received(sonar).radar == received.radar


def test_message_equals_the_arrays_written_to_bags(make_block):
    block = make_block(n_pulses=9).select(slice(7, 1, -2))
    message = pulse_block.to_message(block)
    data, dims, offset = wire.to_array(block)
    assert message.data.tobytes() == data.tobytes()
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == dims
    assert message.layout.data_offset == offset


@pytest.mark.parametrize('late_ns', [2**31 * 10**9 - 2, -2**31 * 10**9])
def test_times_that_no_header_can_hold_are_refused(make_block, late_ns):
    # A flipped bit in the epoch; the image would have no stamp.
    message = pulse_block.to_message(make_block(n_pulses=3, stamp_ns=late_ns + np.arange(3)))
    with pytest.raises(WireFormatError, match='expected seconds that ROS can hold'):
        pulse_block.from_message(message)


def test_samples_are_a_read_only_view_of_the_message(make_block):
    message = pulse_block.to_message(make_block())
    samples = pulse_block.from_message(message).samples
    assert not samples.flags.writeable
    message.data[message.layout.data_offset] = 42.0
    assert samples[0, 0, 0].real == 42.0


def test_samples_outlive_the_message(make_block):
    block = make_block()
    samples = pulse_block.from_message(pulse_block.to_message(block)).samples
    np.testing.assert_array_equal(samples, block.samples)


def truncate(message):
    del message.data[-1]


def empty(message):
    del message.data[:]


def wrong_stride(message):
    message.layout.dim[1].stride = 8


def wrong_label(message):
    message.layout.dim[2].label = 'range'


def absurd_size(message):
    message.layout.dim[0].size = 2**32 - 1


def no_layout(message):
    message.layout.dim = []


def nan_header(message):
    message.data[8] = np.nan


@pytest.mark.parametrize('damage, text', [
    (truncate, r'len\(data\)=155; expected 156'),
    (empty, r'len\(data\)=0; expected 156'),
    (wrong_stride, r'strides are \(48, 8, 8, 2\); expected \(48, 16, 8, 2\)'),
    (wrong_label, "'range', 'iq'.; expected"),
    (absurd_size, r'mean 68719476720 floats of samples; accepted are at most'),
    (no_layout, r'labels are \(\); expected'),
    (nan_header, 'block header holds 1 numbers that are NaN')])
def test_malformed_messages_are_refused(make_block, damage, text):
    message = pulse_block.to_message(make_block())
    damage(message)
    with pytest.raises(WireFormatError, match=text):
        pulse_block.from_message(through_cdr(message))


def test_default_message_is_refused():
    with pytest.raises(WireFormatError, match='layout.dim labels are'):
        pulse_block.from_message(Float32MultiArray())


def test_size_limit_is_the_callers(make_block):
    with pytest.raises(WireFormatError, match='accepted are at most 47'):
        pulse_block.from_message(pulse_block.to_message(make_block()), max_elements=47)


@pytest.fixture
def bare_cube(make_block):
    samples = make_block().samples
    message = Float32MultiArray()
    message.layout.dim = [MultiArrayDimension(label=label, size=size, stride=stride)
                          for label, size, stride in wire.dimensions(samples.shape)]
    message.data = samples.view(np.float32).ravel().tolist()
    return message


def from_caller(block):
    return {name: getattr(block, name)
            for name in ('radar', 'compressed', 'stamp_ns', 'counter', 'tx_m', 'rx_m')}


def test_bare_cube_takes_the_rest_from_the_caller(bare_cube, make_block):
    block = make_block()
    received = pulse_block.from_bare_cube(bare_cube, **from_caller(block))
    np.testing.assert_array_equal(received.samples, block.samples)
    np.testing.assert_array_equal(received.stamp_ns, block.stamp_ns)
    assert received.radar == block.radar


def test_bare_cube_is_not_mistaken_for_a_block(bare_cube, make_block):
    with pytest.raises(WireFormatError, match='bare cube .* read it with from_bare_cube'):
        pulse_block.from_message(bare_cube)
    block = make_block()
    with pytest.raises(WireFormatError, match='data_offset=108; .* from_message'):
        pulse_block.from_bare_cube(pulse_block.to_message(block), **from_caller(block))


def test_bare_cube_with_times_of_other_pulses_is_refused(bare_cube, make_block):
    fields = from_caller(make_block()) | {'stamp_ns': [0, 1]}
    with pytest.raises(ValueError, match=r'does not match stamp_ns.shape=\(2,\)'):
        pulse_block.from_bare_cube(bare_cube, **fields)


CHECKED = """
import numpy as np
from builtin_interfaces.msg import Time
from std_msgs.msg import Header, MultiArrayDimension
from msg_conversions import images, pulse_block
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

try:
    MultiArrayDimension(size='3')
except AssertionError:
    print('fields are checked')
block = PulseBlock(RadarParameters(1e10, 3e8, 3e8, 0.0), True, [5, 6], [1, 2],
                   np.ones((2, 3, 4)), np.ones((2, 3, 3)), np.ones((2, 3, 3)))
pulse_block.from_message(pulse_block.to_message(block))
image = np.ones((2, 3), np.complex64)
images.complex_from_message(images.complex_to_message(image, Header()))
images.amplitude_from_message(images.amplitude_to_message(abs(image), Header()))
images.quicklook_to_message(abs(image), Header(), dynamic_range_db=50.0)
grid = MapGrid((1, 2, 3), np.int64(4), np.int64(5), np.float64(0.25))
assert images.map_metadata_from_message(images.map_metadata_to_message(grid, Time())) == grid
print('converted')
"""


def test_messages_pass_the_field_checks_of_rosidl():
    run = subprocess.run([sys.executable, '-c', CHECKED], capture_output=True, text=True,
                         env=os.environ | {'ROS_PYTHON_CHECK_FIELDS': '1'})
    assert run.stdout == 'fields are checked\nconverted\n', run.stderr
