# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import array
import dataclasses
import re
import subprocess
import sys
import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from msg_conversions import WireFormatError, wire
from msg_conversions.float_pairs import MAX_OFFSET_NS
from sar_imaging.geometry.illumination import Pointing


def replaced(sequence, index, value):
    out = list(sequence)
    out[index] = value
    return out


# ------------------------------------------------------------------------------- round trip

@given(data=st.data())
def test_round_trip(data, blocks, assert_same_block):
    block = data.draw(blocks)
    assert_same_block(wire.from_array(*wire.to_array(block)), block)


@given(data=st.data())
def test_values_do_not_drift_from_stage_to_stage(data, blocks):
    first, dims, offset = wire.to_array(data.draw(blocks))
    once = wire.from_array(first, dims, offset)
    second, *_ = wire.to_array(once)
    np.testing.assert_array_equal(second, first)
    assert wire.from_array(second, dims, offset).matches(once)


def test_samples_are_a_read_only_view(make_block):
    data, dims, offset = wire.to_array(make_block())
    block = wire.from_array(data, dims, offset)
    assert np.shares_memory(block.samples, data)
    assert not block.samples.flags.writeable
    assert not np.shares_memory(block.counter, data)


def test_block_of_a_selection_of_pulses(make_block, assert_same_block):
    part = make_block(n_pulses=9).select(slice(7, 1, -2))  # no longer contiguous, times descending
    assert_same_block(wire.from_array(*wire.to_array(part)), part)


def test_any_buffer_of_floats_is_read(make_block, assert_same_block):
    block = make_block()
    data, dims, offset = wire.to_array(block)
    data.flags.writeable = False  # as rosbags delivers it
    assert_same_block(wire.from_array(data, dims, offset), block)
    assert_same_block(wire.from_array(array.array('f', data.tobytes()), dims, offset), block)


def test_layout_is_the_documented_one(make_block):
    block = make_block(n_pulses=2, n_channels=1, n_samples=3, compressed=True,
                       stamp_ns=[0x0123_4567_89AB_CDEF, 0x0123_4567_89AB_CDEF + 1_500_000_000],
                       counter=[0xFFFF0001, 0xFFFF0002], tx_m=[[[1, 2, 3]], [[7, 8, 9]]],
                       rx_m=[[[4, 5, 6 + 2**-30]], [[10, 11, 12]]])
    data, dims, offset = wire.to_array(block)
    assert dims == [('pulse', 2, 12), ('channel', 1, 6), ('sample', 3, 6), ('iq', 2, 2)]
    assert offset == 24 + 2 * 16
    assert data[:8].tolist() == [5456210, 1, 24, 16, 0xCDEF, 0x89AB, 0x4567, 0x0123]
    assert data[8:20:2].tolist() == [np.float32(value) for value in (
        10e9, 360e6, 300e6, -3e13, 10e-6, 66.7e-6)]
    assert data[20:24].tolist() == [1, 0, 1, 0]
    assert data[24:40].tolist() == [1, 65535, 0, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 2**-30]
    assert data[40:56].tolist() == [2, 65535, 1.5, 0, 7, 0, 8, 0, 9, 0, 10, 0, 11, 0, 12, 0]
    assert data[56:].tobytes() == block.samples.tobytes()


def test_pointing_lengthens_the_rows(make_block, assert_same_block):
    """Messages of before have 0 where the flag is; with it rows end with boresight and up."""
    plain = make_block(n_pulses=2)
    before, dims, offset = wire.to_array(plain)
    assert before[23] == 0 and wire.from_array(before, dims, offset).pointing is None
    looks = Pointing([[1.0, 0, 0], [0.6, 0.8, 0]])
    for positions in (True, False):
        block = make_block(n_pulses=2, positions=positions, pointing=looks)
        data, dims, offset = wire.to_array(block)
        row = 4 + 24 * positions + 12
        assert data[3] == row and data[23] == 1 and offset == 24 + 2 * row
        end = data[24 + 2 * row - 12:24 + 2 * row]
        assert end[::2].tolist() == [np.float32(v) for v in (0.6, 0.8, 0, 0, 0, 1)]
        assert_same_block(wire.from_array(data, dims, offset), block)
        data[24 + 2 * row - 11] = data[24 + 2 * row - 12] = 0.5
        with pytest.raises(WireFormatError, match='no perpendicular unit vectors'):
            wire.from_array(data, dims, offset)
    changed = before.copy()
    changed[23] = 1
    with pytest.raises(WireFormatError, match='expected 24 and 40 for 2 channels with positions '
                                              'and with pointing'):
        wire.from_array(changed, wire.dimensions(plain.samples.shape), 24 + 2 * 28)


def test_the_speed_of_other_waves_lengthens_the_header(make_block, radar, assert_same_block):
    light = make_block()
    sound = make_block(radar=dataclasses.replace(
        radar, carrier_hz=300e3, bandwidth_hz=60e3, sample_rate_hz=100e3, chirp_rate_hz_per_s=6e6,
        propagation_speed_m_per_s=1480.3))
    data, dims, offset = wire.to_array(sound)
    assert data[2] == 26 and offset == wire.to_array(light)[2] + 2
    assert float(data[24]) + float(data[25]) == pytest.approx(1480.3, rel=2**-48)
    assert_same_block(wire.from_array(data, dims, offset), sound)
    # What readers from before the speed check first: they refuse it and do not take it for light.
    assert data[2] != wire.HEADER_LENGTH
    for index, value, text in ((24, -1480.3, 'impossible: propagation_speed_m_per_s=-1480'),
                               (24, 3.1e8, 'impossible: propagation_speed_m_per_s=3.1e'),
                               (25, np.nan, 'block header holds 1 numbers that are NaN .* 25')):
        changed = data.copy()
        changed[index] = value
        with pytest.raises(WireFormatError, match=text):
            wire.from_array(changed, dims, offset)


def test_a_speed_that_rounds_to_that_of_light_needs_no_longer_header(make_block, radar):
    nearly = dataclasses.replace(
        radar, propagation_speed_m_per_s=np.nextafter(radar.propagation_speed_m_per_s, 0))
    assert wire.to_array(make_block(radar=nearly))[0][2] == wire.HEADER_LENGTH


def test_messages_of_radars_in_air_are_those_of_before(make_block):
    data, _, offset = wire.to_array(make_block(n_pulses=2))
    assert data[2] == 24 and offset == 24 + 2 * (4 + 12 * 2)


# ------------------------------------------------------------------------------- refused to write

def test_empty_blocks_are_not_written(make_block):
    with pytest.raises(WireFormatError, match=r'samples.shape=\(0, 2, 4\); expected at least one'):
        wire.to_array(make_block().select(slice(0)))


@pytest.mark.parametrize('sign', [-1, 1])
def test_blocks_longer_than_the_time_field_are_not_written(make_block, sign):
    stamps = np.array([0, sign * (MAX_OFFSET_NS + 1)])
    with pytest.raises(WireFormatError, match='reaches 78.2 h from the first pulse'):
        wire.to_array(make_block(n_pulses=2, stamp_ns=stamps))


def test_stamps_that_differ_by_more_than_int64_are_not_written(make_block):
    with pytest.raises(WireFormatError, match='from the first pulse; expected at most 78 h'):
        wire.to_array(make_block(n_pulses=2, stamp_ns=[-2**63, 2**63 - 1]))


def test_blocks_beyond_32_bit_layout_fields_are_not_written(make_block):
    block = make_block(n_pulses=1, n_channels=1)
    # A broadcast view has the size without the memory.
    huge = np.broadcast_to(np.complex64(0), (1, 1, 2**31))
    object.__setattr__(block, 'samples', huge)
    with pytest.raises(WireFormatError, match=r'layout fields hold less than 2\*\*32'):
        wire.to_array(block)


# ------------------------------------------------------------------------------- refused to read

def put(index, value):
    def change(data, dims, offset):
        data[index] = value
        return data, dims, offset
    return change


def layout(index, field, value):
    def change(data, dims, offset):
        return data, replaced(dims, index, replaced(dims[index], field, value)), offset
    return change


# The valid message has 3 pulses, 2 channels, 4 samples and positions: a header of 24 floats, rows
# of 28, 108 floats before the samples, 156 in all.
MALFORMED = {
    'truncated': (lambda d, m, o: (d[:-1], m, o), r'len\(data\)=155; expected 156: data_offset=1'),
    'truncated into the header': (lambda d, m, o: (d[:5], m, o), r'len\(data\)=5; expected 156'),
    'without data': (lambda d, m, o: (d[:0], m, o), r'len\(data\)=0; expected 156'),
    'extended': (lambda d, m, o: (np.append(d, d[:2]), m, o), r'len\(data\)=158; expected 156'),
    'no dimensions': (lambda d, m, o: (d, [], o), r'labels are \(\); expected \(.pulse., .chan'),
    'three dimensions': (lambda d, m, o: (d, m[:3], o), r'layout.dim labels are \(.pulse.'),
    'five dimensions': (lambda d, m, o: (d, [*m, m[3]], o), r"'iq', 'iq'\); expected"),
    'wrong label': (layout(2, 0, 'range'), r"'range', 'iq'\); expected \('pulse', 'channel'"),
    'endless label': (layout(2, 0, 'x' * 10**6), r'labels are .{1,200}; expected'),
    'wrong order': (lambda d, m, o: (d, [m[1], m[0], *m[2:]], o), r"labels are \('channel', 'pul"),
    'stride without own size': (layout(0, 2, 16), r'strides are \(16, 16, 8, 2\); expected \(48,'),
    'strides in bytes': (layout(3, 2, 8), r'expected \(48, 16, 8, 2\) for sizes \(3, 2, 4, 2\)'),
    'no pulse': (layout(0, 1, 0), r'sizes are \(0, 2, 4, 2\); expected at least one pulse'),
    'no sample': (layout(2, 1, 0), r'sizes are \(3, 2, 0, 2\); expected at least one pulse'),
    'real samples': (layout(3, 1, 1), r'sizes are \(3, 2, 4, 1\); .* 2 for iq'),
    'bare cube': (lambda d, m, o: (d[o:], m, 0), 'a bare cube .* read it with from_bare_cube'),
    'offset inside the header': (lambda d, m, o: (d, m, 4), 'data_offset=4; expected 0 for a bar'),
    'offset without table': (lambda d, m, o: (np.delete(d, range(24, 108)), m, 24),
                             'data_offset=24; expected 108: a header of 24 floats and 3 rows'),
    'wrong magic': (put(0, 1), r'data\[0\]=1.0; expected the magic number 5456210'),
    'NaN magic': (put(0, np.nan), r'data\[0\]=nan; expected the magic number 5456210'),
    'wrong version': (put(1, 2), 'format version is 2; expected 1; use the same release'),
    'wrong header length': (put(2, 25), 'row length are 25 and 28 floats; expected 24 and 28'),
    'longer header denied': (put(2, 26), 'data_offset=108; expected 110: a header of 26 floats'),
    'wrong row length': (put(3, 16), 'are 24 and 16 floats; expected 24 and 28 for 2 channels'),
    'positions denied': (put(22, 0), '24 and 28 floats; expected 24 and 4 for 2 channels without'),
    'NaN in the header': (put(9, np.nan), 'block header holds 1 numbers that are NaN .* index 9'),
    'infinity in the header': (put(23, np.inf), 'block header holds 1 numbers .* index 23'),
    'fractional flag': (put(20, 0.5), r'flag compressed \(data\[20\]\) is 0.5; expected one of'),
    'unknown waveform': (put(21, 7), r'flag waveform \(data\[21\]\) is 7; expected one of \(0, 1'),
    'unknown position source': (put(22, 2), r'flag position source \(data\[22\]\) is 2; expected'),
    'fractional epoch': (put(4, 0.25), r'epoch limbs .* are \[0.25, .* whole numbers of 0 to 655'),
    'epoch limb too large': (put(7, 65536), 'epoch limbs .* 65536.0.; expected whole numbers'),
    'epoch at the end of time': (put(slice(4, 8), (65535, 65535, 65535, 32767)),
                                 'epoch 9223372036854775807 ns plus .* exceeds 64 bits'),
    'epoch before the beginning of time': (put([4, 5, 6, 7, 54], (0, 0, 0, 32768, -1)),
                                           'epoch -9223372036854775808 ns plus .* exceeds 64'),
    'carrier of zero': (put(slice(8, 10), 0), 'impossible: carrier_hz=0.0 must be positive'),
    'negative pulse length': (put(16, -1), 'impossible: pulse_length_s=-.* must not be negative'),
    'NaN in the table': (put(40, np.nan), 'per-pulse table holds 1 numbers .* its index 16'),
    'infinite position': (put(107, -np.inf), 'per-pulse table holds 1 numbers .* its index 83'),
    'fractional counter': (put(24, 1.5), 'counter limbs range from .* whole numbers of 0 to'),
    'negative counter': (put(25, -1), 'counter limbs range from -1 to'),
    'counter limb too large': (put(24, 65536), 'counter limbs range from .* to 65536; expected'),
    'pulse of another epoch': (put(54, 3e5), 'pulse times reach 83.33 h from the epoch'),
    'absurd pulse time': (put(54, -3e38), r'pulse times reach 8.3.*e\+34 h from the epoch'),
    'NaN sample': (put(109, np.nan), 'sample array holds 1 numbers that are NaN .* its index 1'),
    'infinite samples': (put(slice(150, 152), -np.inf), 'sample array holds 2 numbers'),
    'doubles': (lambda d, m, o: (d.astype(np.float64), m, o), "has format 'd' and shape .156,.;"),
    'bytes': (lambda d, m, o: (d.tobytes(), m, o), "has format 'B' and shape .624,.; expected"),
    'big-endian': (lambda d, m, o: (d.astype('>f4'), m, o), "has format '>f'"),
    'every second float': (lambda d, m, o: (np.repeat(d, 2)[::2], m, o), 'expected contiguous'),
    'a list': (lambda d, m, o: (d.tolist(), m, o), 'data is a list; expected contiguous 32-bit'),
}


@pytest.mark.parametrize('change, text', MALFORMED.values(), ids=MALFORMED)
def test_malformed_messages_are_refused(make_block, change, text):
    with pytest.raises(WireFormatError, match=text):
        wire.from_array(*change(*wire.to_array(make_block())))


# Sizes are 32-bit in a layout. The third set multiplies to 2**64, zero in 64-bit arithmetic.
ABSURD = [(2**32 - 1, 1, 1), (2**32 - 1, 2**32 - 1, 2**32 - 1), (2**31, 2**31, 2),
          (1, 1, 2**25 + 1)]


@pytest.mark.parametrize('shape', ABSURD)
def test_absurd_sizes_are_refused_without_allocation(make_block, shape):
    data, _, offset = wire.to_array(make_block())
    dims = wire.dimensions(shape)
    n_floats = 2 * shape[0] * shape[1] * shape[2]
    refused_without_allocation(
        data, dims, offset, re.escape(f'sizes {(*shape, 2)} mean {n_floats} floats of samples; '
                                      f'accepted are at most {2**26}; send smaller blocks'))


@pytest.mark.parametrize('change, text', [
    (lambda d, m, o: (d[:-2], m, o), r'len\(data\)=\d+; expected \d+'),
    (lambda d, m, o: (d, replaced(m, 0, ('pulse', 2**20, 2**20 * m[1][2])), o), 'len.data.=|mean'),
    (lambda d, m, o: (d, m, 2**32 - 1), r'expected \d+: data_offset=4294967295'),
    (put(0, 0), 'magic number'), (put(1, 9), 'version'), (put(10, np.nan), 'block header'),
    (put(3, 2e9), 'row length'), (put(16, -1), 'impossible')])
def test_large_malformed_messages_are_refused_without_allocation(make_block, change, text):
    block = make_block(n_pulses=16, n_channels=1, n_samples=2**16)
    refused_without_allocation(*change(*wire.to_array(block)), text)


def refused_without_allocation(data, dims, offset, text):
    tracemalloc.start()
    try:
        with pytest.raises(WireFormatError, match=text):
            wire.from_array(data, dims, offset)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**17  # the error and its traceback; the data would be 16 pulses of 512 KiB


def test_size_limit_is_the_callers(make_block, assert_same_block):
    block = make_block()
    message = wire.to_array(block)
    assert_same_block(wire.from_array(*message, max_elements=48), block)
    with pytest.raises(WireFormatError, match='mean 48 floats of samples; .* are at most 47'):
        wire.from_array(*message, max_elements=47)


def test_the_first_label_names_the_frame_of_the_positions(make_block):
    _, dims, _ = wire.to_array(make_block(frame='odom'))
    assert [label for label, *_ in dims] == ['pulse@odom', 'channel', 'sample', 'iq']
    data, dims, offset = wire.to_array(make_block())
    assert dims[0][0] == 'pulse' and wire.from_array(data, dims, offset).frame == ''
    named = replaced(dims, 0, ('pulse@a@b', *dims[0][1:]))  # a frame may be called anything
    assert wire.from_array(data, named, offset).frame == 'a@b'
    with pytest.raises(WireFormatError, match='has a name of 256 characters; expected at most'):
        wire.from_array(data, replaced(dims, 0, ('pulse@' + 256 * 'x', *dims[0][1:])), offset)
    with pytest.raises(WireFormatError, match='layout.dim labels are'):
        wire.from_array(data, replaced(dims, 1, ('channel@odom', *dims[1][1:])), offset)


# ------------------------------------------------------------------------------- fuzz

def read_or_refuse(data, dims, offset):
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # a cast of nonsense must not even warn
        try:
            block = wire.from_array(data, dims, offset)
        except WireFormatError as error:
            assert str(error)
        else:
            assert np.isfinite(block.samples).all()


@settings(max_examples=500)
@given(changes=st.lists(st.tuples(st.integers(0, 623), st.integers(0, 255)), min_size=1))
def test_corrupted_bytes_are_read_or_refused(make_block, changes):
    data, dims, offset = wire.to_array(make_block())
    for index, byte in changes:
        data.view(np.uint8)[index] = byte
    read_or_refuse(data, dims, offset)


@settings(max_examples=500)
@given(changes=st.lists(st.tuples(st.integers(2, 155), st.floats(width=32)), min_size=1))
def test_corrupted_floats_are_read_or_refused(make_block, changes):
    data, dims, offset = wire.to_array(make_block())
    for index, value in changes:
        data[index] = value
    read_or_refuse(data, dims, offset)


UINT32 = st.integers(0, 8) | st.integers(0, 2**32 - 1)


ANY_DIMS = st.lists(st.tuples(st.text(max_size=3), UINT32, UINT32), max_size=6)
LABELLED_DIMS = st.tuples(*[st.tuples(st.just(label), UINT32, UINT32)
                            for label in (*wire.LAYOUT.labels, 'iq')])


@given(dims=ANY_DIMS | LABELLED_DIMS, offset=UINT32, n_floats=st.integers(0, 200))
def test_arbitrary_layouts_are_refused(make_block, dims, offset, n_floats):
    data, *_ = wire.to_array(make_block())
    with pytest.raises(WireFormatError):
        wire.from_array(np.resize(data, n_floats + 1)[:-1], dims, offset)


@settings(max_examples=300)
@given(shape=st.tuples(*[st.integers(0, 6)] * 3), offset=st.integers(0, 156))
def test_consistent_layouts_of_other_sizes_are_read_or_refused(make_block, shape, offset):
    data, *_ = wire.to_array(make_block())
    read_or_refuse(data, wire.dimensions(shape), offset)


# ------------------------------------------------------------------------------- bare cube, ROS

def test_bare_cube_is_a_view_of_its_samples(make_block):
    samples = make_block().samples
    data = np.ascontiguousarray(samples).view(np.float32).ravel()
    cube = wire.samples_from_bare_cube(data, wire.dimensions(samples.shape), 0)
    np.testing.assert_array_equal(cube, samples)
    assert np.shares_memory(cube, data) and not cube.flags.writeable


@pytest.mark.parametrize('change, text', [
    (lambda d, m: (d, m, 108), 'data_offset=108; expected 0 for a bare cube; .* from_message'),
    (lambda d, m: (d[2:], m, 0), r'len\(data\)=46; expected 48'),
    (lambda d, m: (d * np.float32(np.nan), m, 0), 'sample array holds 48 numbers'),
    (lambda d, m: (d, wire.dimensions((3, 2, 2**30)), 0), 'accepted are at most'),
    (lambda d, m: (d, m[:2], 0), 'layout.dim labels are')])
def test_malformed_bare_cubes_are_refused(make_block, change, text):
    samples = make_block().samples
    data = samples.view(np.float32).ravel()
    with pytest.raises(WireFormatError, match=text):
        wire.samples_from_bare_cube(*change(data, wire.dimensions(samples.shape)))


def test_works_without_ros():
    """The simulator writes bags where neither rclpy nor a message class is installed."""
    program = ("import sys\n"
               "sys.modules.update(dict.fromkeys(['rclpy', 'std_msgs', 'sensor_msgs']))\n"
               "import msg_conversions.wire, msg_conversions.float_pairs\n"
               "print(msg_conversions.WireFormatError.__name__)\n")
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.stdout == 'WireFormatError\n', run.stderr
