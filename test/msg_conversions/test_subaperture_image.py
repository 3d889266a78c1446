# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sub-aperture images: round trip, layout, refusal of everything malformed."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from msg_conversions import WireFormatError, subaperture_wire as wire
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.afbp.polar_grids import UnifiedPolarGrids
from sar_imaging.signal.radar import SPEED_OF_LIGHT
from sar_imaging.streaming.subaperture_image import COUNTS, SubapertureEnds, SubapertureImage

# A pair keeps 48 bits; below about 1e-30 float32 itself ends at 2**-149.
PAIR = {'rel': 2**-48, 'abs': 2**-149}
SIZES = ('n_coarse', 'n_fine', 'n_coarse_range', 'n_fine_range')

ENDS = SubapertureEnds(((4.2e6, 1.7e5, 4.8e6), (4.2e6, 1.7e5 + 0.1, 4.8e6)),
                       ((1.0, 2.0, 3.0), (1.5, 2.0, 3.0)), 0x00020003,
                       ((0.6, 0.8, 0.0), (0.0, 1.0, 0.0)), ((0.0, 0.0, 1.0),) * 2, True)


def make_fusion(**changes):
    polar = PolarGrid(origin_m=(4.2e6, 1.7e5, 4.8e6 + 2**-20), track=(0.6, -0.8), side=-1,
                      z_m=4.8e6 - 300, range_start_m=1500.0, range_spacing_m=0.3, n_range=1,
                      alpha_start=-0.05, alpha_spacing=1e-4, n_alpha=4)
    return UnifiedPolarGrids(**{'polar': polar, 'n_coarse': 2, 'n_fine': 12, 'n_guard': 0.25,
                         'beta': 1.5, 'n_coarse_range': 3, 'n_fine_range': 5, 'half_range': 12.0,
                         'carrier_hz': 9.6e9, 'range_oversampling': 1.25,
                         'alpha_oversampling': 1.5, 'propagation_speed_m_per_s': 1e8} | changes)


def make_image(fusion=None, **changes):
    fusion = make_fusion() if fusion is None else fusion
    shape = fusion.coarse.n_alpha, fusion.coarse.n_range
    image = np.random.default_rng(math.prod(shape)).standard_normal(
        (*shape, 2), np.float32).view(np.complex64)[..., 0]
    return SubapertureImage(**{
        'image': image, 'fusion': fusion, 'centre_m': -3.25, 'bandwidth_hz': 5e8,
        'map_grid': MapGrid((4.2e6 + 900, 1.7e5, 4.8e6 - 300), 5, 0x00020003, 0.1),
        'session': 0xDEADBEEF, 'sequence': 0x00070008, 'revision': 2, 'aperture': 0x00010002,
        'number': 3, 'n_subapertures': 5, 'n_window': 4, 'first_counter': 0xFFFF0001,
        'n_pulses': 60, 'n_missing': 0x00050004, 'pulses_per_aperture': 0x00160015,
        'stamp_ns': 0x0123_4567_89AB_CDEF, 'predicted_error_db': -61.25,
        'ends': ENDS} | changes)


@st.composite
def fusions(draw):
    n_alpha, n_range, n_coarse, n_coarse_range = [draw(st.integers(1, 5)) for _ in range(4)]
    # guards of a coarse range or more at both ends
    n_coarse_range += 2
    n_fine_range = n_coarse_range * (n_range + 2) + draw(st.integers(0, 9))
    n_guard = draw(st.floats(0.01, 0.49)) * n_coarse
    angle = draw(st.floats(-math.pi, math.pi))
    height = draw(st.floats(-1e4, 1e4))
    z = draw(st.floats(-6.4e6, 6.4e6))
    position = st.floats(-6.4e6, 6.4e6)
    range_spacing_m = draw(st.floats(1e-3, 100.0))
    polar = PolarGrid(
        origin_m=(draw(position), draw(position), z + height),
        track=(math.cos(angle), math.sin(angle)), side=draw(st.sampled_from((-1, 1))), z_m=z,
        # Beyond the height by more than rounding and any direction of the grids take away.
        range_start_m=1.0 + 2 * abs(height) + 40 * range_spacing_m + draw(st.floats(0.0, 1e6)),
        range_spacing_m=range_spacing_m, n_range=n_range,
        alpha_start=draw(st.floats(-0.3, 0.3)), alpha_spacing=draw(st.floats(1e-7, 1e-3)),
        n_alpha=n_alpha)
    return UnifiedPolarGrids(
        polar, n_coarse, draw(st.integers(2 * n_alpha + 2, 100)) + 2 * n_alpha, n_guard,
        draw(st.floats(0.0, 50.0)), n_coarse_range, n_fine_range, draw(st.floats(1e-3, 400.0)),
        draw(st.floats(1e10, 1e12)), draw(st.floats(1.0, 4.0)), draw(st.floats(1.0, 4.0)),
        draw(st.floats(100.0, SPEED_OF_LIGHT)))


@st.composite
def ends(draw):
    place = st.floats(-6.4e6, 6.4e6)
    places = st.tuples(*[st.tuples(place, place, place)] * 2)
    if draw(st.booleans()):
        return None
    looks = {}
    if draw(st.booleans()):
        angle = draw(st.floats(-math.pi, math.pi))
        looks = {'boresight': ((math.cos(angle), math.sin(angle), 0.0), (1.0, 0.0, 0.0)),
                 'up': ((0.0, 0.0, 1.0),) * 2, 'weighted': draw(st.booleans())}
    return SubapertureEnds(draw(places), draw(places), draw(st.integers(1, 2**32 - 1)), **looks)


@st.composite
def images(draw):
    fusion = draw(fusions())
    uint32 = st.integers(0, 2**32 - 1)
    finite = st.floats(width=32, allow_nan=False, allow_infinity=False)
    iq = draw(hnp.arrays(np.float32, (fusion.coarse.n_alpha, fusion.coarse.n_range, 2),
                         elements=finite))
    number = draw(st.integers(0, 2**32 - 2))
    n_subapertures = draw(st.integers(number + 1, 2**32 - 1))
    pulses_per_aperture = draw(st.integers(1, 2**32 - 1))
    n_missing = draw(st.integers(0, pulses_per_aperture - 1))
    position = st.floats(-6.4e6, 6.4e6)
    target = MapGrid((draw(position), draw(position), draw(position)),
                     draw(st.integers(1, 2**32 - 1)), draw(st.integers(1, 2**32 - 1)),
                     draw(st.floats(1e-3, 1e3)))
    return SubapertureImage(
        iq.view(np.complex64)[..., 0], fusion, draw(st.floats(-1e5, 1e5)), target,
        draw(st.floats(1e3, 1e11)), draw(uint32), draw(uint32), draw(uint32), draw(uint32),
        number, n_subapertures, draw(st.integers(1, n_subapertures)), draw(uint32),
        draw(st.integers(1, pulses_per_aperture - n_missing)), n_missing, pulses_per_aperture,
        stamp_ns=draw(st.integers(1 - 2**31 * 10**9, 2**31 * 10**9 - 1)),
        predicted_error_db=draw(st.floats(-300.0, 0.0)), ends=draw(ends()))


def assert_same(received, sent):
    assert received.image.shape == sent.image.shape
    assert received.image.tobytes() == sent.image.tobytes()  # negative zeros included
    for name in (*COUNTS, 'stamp_ns'):
        assert getattr(received, name) == getattr(sent, name)
    for name in SIZES:
        assert getattr(received.fusion, name) == getattr(sent.fusion, name)
    numbers = {'n_guard', 'beta', 'half_range', 'carrier_hz', 'range_oversampling',
               'alpha_oversampling'}
    for one, other, names in (
            (received, sent, {'bandwidth_hz', 'predicted_error_db', 'centre_m'}),
            (received.fusion, sent.fusion, numbers),
            (received.fusion.polar, sent.fusion.polar, vars(sent.fusion.polar)),
            (received.map_grid, sent.map_grid, vars(sent.map_grid))):
        for name in names:
            assert getattr(one, name) == pytest.approx(getattr(other, name), **PAIR)
    assert (received.ends is None) == (sent.ends is None)
    if sent.ends is not None:
        for name in ('tx_m', 'rx_m', 'boresight', 'up'):
            assert np.ravel(getattr(received.ends, name)) == pytest.approx(
                np.ravel(getattr(sent.ends, name)), **PAIR)
        for name in ('n_channels', 'weighted'):
            assert getattr(received.ends, name) == getattr(sent.ends, name)


def edited(index, value):
    def change(data, dims, offset):
        data[index] = value
        return data, dims, offset
    return change


# ------------------------------------------------------------------------------- round trip

@given(sent=images())
def test_round_trip(sent):
    assert_same(wire.from_array(*wire.to_array(sent)), sent)


@given(sent=images())
def test_values_do_not_drift_from_stage_to_stage(sent):
    first, dims, offset = wire.to_array(sent)
    once = wire.from_array(first, dims, offset)
    second, *_ = wire.to_array(once)
    np.testing.assert_array_equal(second, first)
    # Fusion tells by comparison whether two sub-apertures share a grid.
    again = wire.from_array(second, dims, offset)
    assert (again.fusion, again.map_grid) == (once.fusion, once.map_grid)


def test_an_unknown_error_comes_through():
    """Profiles that cover no pixel for all pulses leave no error to tell."""
    data, dims, offset = wire.to_array(make_image(predicted_error_db=math.nan))
    assert np.isfinite(data).all()
    assert math.isnan(wire.from_array(data, dims, offset).predicted_error_db)


@given(sent=images())
def test_handed_over_directly_is_as_received(sent):
    direct, received = wire.as_received(sent), wire.from_array(*wire.to_array(sent))
    assert direct.image is sent.image
    for field in dataclasses.fields(direct)[1:]:
        assert getattr(direct, field.name) == getattr(received, field.name)


def test_layout_is_the_documented_one():
    sent = make_image()
    data, dims, offset = wire.to_array(sent)
    assert dims == [('angle', 2, 12), ('range', 3, 6), ('iq', 2, 2)]
    assert offset == 144
    assert data[:8].tolist() == [5456201, 7, 144, -1, 0xCDEF, 0x89AB, 0x4567, 0x0123]
    assert data[8:28].tolist() == [0xBEEF, 0xDEAD, 8, 7, 2, 0, 2, 1, 3, 0, 5, 0, 4, 0, 1, 0xFFFF,
                                   60, 0, 4, 5]
    assert data[28:30].tolist() == [0x15, 0x16]
    assert data[30:42].tolist() == [4, 0, 1, 0, 12, 0, 5, 0, 5, 0, 3, 2]
    polar = sent.fusion.polar
    assert data[42:90:2].tolist() == [np.float32(value) for value in (
        9.6e9, 5e8, -61.25, *polar.origin_m, *polar.track, polar.z_m, 1500.0, 0.3, -0.05, 1e-4,
        0.25, 1.5, 12.0, 1.25, -3.25, *sent.map_grid.centre_m, 0.1, 1.5, 1e8)]
    assert data[90:96].tolist() == [1, 1, 1, 0, 3, 2]
    ends = sent.ends
    assert data[96:144:2].tolist() == [np.float32(value) for value in np.ravel(
        (ends.tx_m, ends.rx_m, ends.boresight, ends.up))]
    assert data[144:].tobytes() == sent.image.tobytes()


def test_image_is_a_read_only_view():
    data, dims, offset = wire.to_array(make_image())
    image = wire.from_array(data, dims, offset).image
    assert np.shares_memory(image, data)
    assert not image.flags.writeable


def test_works_without_ros():
    program = ("import sys\n"
               "sys.modules.update(dict.fromkeys(['rclpy', 'std_msgs']))\n"
               "import msg_conversions.subaperture_wire\n"
               "print('imported')\n")
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.stdout == 'imported\n', run.stderr


# ------------------------------------------------------------------------------- refused

# The valid message has 2 angles and 3 ranges: a header of 144 floats, 156 floats in all.
MALFORMED = {
    'truncated': (lambda d, m, o: (d[:-1], m, o),
                  r'len\(data\)=155; expected 156: data_offset=144'),
    'extended': (lambda d, m, o: (np.append(d, d[:2]), m, o), r'len\(data\)=158; expected 156'),
    'without data': (lambda d, m, o: (d[:0], m, o), r'len\(data\)=0; expected 156'),
    'a pulse block': (lambda d, m, o: (d, [('pulse', 1, 12), *m], o), r"\('angle', 'range', 'iq'"),
    'no angle': (lambda d, m, o: (d, [('angle', 0, 0), *m[1:]], o),
                 r'at least one angle and range, and 2 for iq; do not send empty images'),
    'absurd size': (lambda d, m, o: (d, wire.LAYOUT.dimensions((2**32 - 1, 2**32 - 1)), o),
                    'mean 36893488130239234050 floats of pixels; accepted are at most 67108864'),
    'wrong stride': (lambda d, m, o: (d, [('angle', 2, 6), *m[1:]], o), r'strides are \(6, 6, 2'),
    'no header': (lambda d, m, o: (d[o:], m, 0), 'data_offset=0; expected 144: the length'),
    'absurd offset': (lambda d, m, o: (d, m, 2**32 - 1), 'data_offset=4294967295; expected 144'),
    'wrong magic': (edited(0, 5456210), 'magic number 5456201; .* carry sub-aperture images'),
    'wrong version': (edited(1, 2), 'format version is 2; expected 7'),
    'wrong header length': (edited(2, 48), 'header length is 48 floats; expected 144'),
    'no side': (edited(3, 0), r'side \(data\[3\]\) is 0; expected \+1'),
    'fractional side': (edited(3, 0.5), r'side \(data\[3\]\) is 0.5'),
    'NaN in the header': (edited(62, np.nan), 'header holds 1 numbers that are NaN .* index 62'),
    'infinite low part': (edited(89, np.inf), 'header holds 1 numbers .* index 89'),
    'fractional stamp': (edited(5, 0.5), r'stamp limbs \(data\[4:8\]\) are .* whole numbers'),
    'negative count': (edited(9, -1), r'count limbs \(data\[8:42\]\) are .* whole numbers'),
    'limb too large': (edited(41, 65536), r'count limbs .* 65536.0\]; expected'),
    'no pulses': (edited([24, 25], 0), 'impossible: n_pulses=0, n_missing='),
    'more pulses than the aperture has': (edited(29, 4), 'at most pulses_per_aperture=262165'),
    'number of another aperture': (edited(16, 5), 'impossible: number=5 of n_subapertures=5'),
    'window longer than the aperture': (edited(20, 6), 'n_window=6 of n_subapertures=5'),
    'no window': (edited(20, 0), 'n_window=0 of n_subapertures=5'),
    'carrier of zero': (edited([42, 43], 0), 'impossible: carrier_hz=0.0 must be positive'),
    'negative bandwidth': (edited(44, -5e8), 'impossible: bandwidth_hz=-500000000.0 must be'),
    'track no unit vector': (edited(54, 0.7), r'impossible: track=.* is no unit vector'),
    'descending ranges': (edited(62, -0.3), 'expected positive spacings'),
    'descending angles': (edited(66, -1e-4), 'expected positive spacings'),
    'ranges above the plane': (edited(60, 10.0), 'impossible: .*range_start_m=.* does not reach'),
    'angle beyond the track': (edited(64, 1.5), 'impossible: .*range_start_m=.* at alpha=1.5'),
    'more ranges than pixels': (edited(32, 3), 'n_fine_range=5; .* the 3 wanted ones and a guard'),
    'fine grid too small': (edited(34, 4), 'n_fine=4 directions do not hold'),
    'guards wider than the grid': (edited(68, 1.0), 'do not hold two guards of n_guard=1'),
    'no range guard': (edited(36, 4), 'n_coarse_range=3, n_fine_range=4; expected at least'),
    'coarser than fused': (edited(36, 2), 'n_coarse_range=3, n_fine_range=2; expected at least'),
    'negative taper': (edited(70, -1.0), 'beta=-1.0; expected 0 to 700'),
    'absurd band': (edited(72, 1e6), 'half_range=1e.06 rad/m exceeds the carrier'),
    'undersampled': (edited(74, 0.5), 'range_oversampling=0.5; expected 1 or more'),
    'too few lines': (edited(86, 0.5), 'alpha_oversampling=0.5; expected 1 or more'),
    'absurd fine grid': (edited(35, 65535), 'expected at most 2147483648 pixels'),
    'empty map': (edited(38, 0), 'n_x=0, n_y=131075; expected at least one pixel'),
    'map without spacing': (edited([84, 85], 0), 'spacing_m=0.0 must be positive'),
    'standing waves': (edited(88, 0.0), 'propagation_speed_m_per_s=.* must be positive'),
    'a flag of 2': (edited(91, 2), r'flag data\[91\] is 2; expected 0 or 1'),
    'no channel': (edited([94, 95], 0), 'n_channels=0; expected at least 1'),
    'a long boresight': (edited(120, 1.5), 'no perpendicular unit vectors'),
    'weighed, and nobody knows how': (edited(91, 0), 'lack boresight or up'),
    'NaN pixel': (edited(144, np.nan), 'pixel array holds 1 numbers that are NaN .* its index 0'),
    'doubles': (lambda d, m, o: (d.astype(np.float64), m, o), "has format 'd'"),
}


@pytest.mark.parametrize('change, text', MALFORMED.values(), ids=MALFORMED)
def test_malformed_messages_are_refused(change, text):
    with pytest.raises(WireFormatError, match=text):
        wire.from_array(*change(*wire.to_array(make_image())))


LARGE = make_fusion(n_coarse=256, n_fine=1024, n_coarse_range=2049,
                    n_fine_range=4096)


@pytest.mark.parametrize('change', ['truncated', 'absurd size', 'absurd offset', 'wrong magic',
                                    'no pulses', 'descending ranges'])
def test_large_malformed_messages_are_refused_without_allocation(change):
    message = MALFORMED[change][0](*wire.to_array(make_image(LARGE)))
    tracemalloc.start()
    try:
        with pytest.raises(WireFormatError):
            wire.from_array(*message)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**17  # the error and its traceback; the pixels are 4 MiB


def test_size_limit_is_the_callers():
    message = wire.to_array(make_image())
    assert wire.from_array(*message, max_elements=12).image.shape == (2, 3)
    with pytest.raises(WireFormatError, match='mean 12 floats of pixels; .* are at most 11'):
        wire.from_array(*message, max_elements=11)


def test_grids_beyond_float32_are_not_written():
    polar = dataclasses.replace(make_fusion().polar, range_start_m=1e39)
    with pytest.raises(WireFormatError, match='largest magnitude 1e.39 does not fit'):
        wire.to_array(make_image(make_fusion(polar=polar)))


@pytest.mark.parametrize('changes, text', [
    ({'image': np.zeros((3, 2))}, r'image.shape=\(3, 2\) does not match the grid; .*\(2, 3\)'),
    ({'first_counter': 2**32}, 'first_counter=4294967296; expected 0 to 4294967295'),
    ({'aperture': -1}, 'aperture=-1; expected 0 to'),
    ({'n_missing': 2**32 - 1}, 'at most pulses_per_aperture=1441813 together'),
    ({'stamp_ns': 2**63}, 'stamp_ns=9223372036854775808 exceeds 64 bits'),
    ({'predicted_error_db': -math.inf}, 'predicted_error_db=-inf must be finite'),
    ({'centre_m': math.nan}, 'centre_m=nan must be finite'),
    ({'bandwidth_hz': math.nan}, 'bandwidth_hz=nan must be positive and finite')])
def test_impossible_images_cannot_be_made(changes, text):
    with pytest.raises(ValueError, match=text):
        make_image(**changes)


# ------------------------------------------------------------------------------- fuzz

def read_or_refuse(data, dims, offset):
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # a cast of nonsense must not even warn
        try:
            received = wire.from_array(data, dims, offset)
        except WireFormatError as error:
            assert str(error)
        else:
            assert np.isfinite(received.image).all()


@settings(max_examples=500)
@given(changes=st.lists(st.tuples(st.integers(0, 615), st.integers(0, 255)), min_size=1))
def test_corrupted_bytes_are_read_or_refused(changes):
    data, dims, offset = wire.to_array(make_image())
    for index, byte in changes:
        data.view(np.uint8)[index] = byte
    read_or_refuse(data, dims, offset)


@settings(max_examples=500)
@given(changes=st.lists(st.tuples(st.integers(3, 153), st.floats(width=32)), min_size=1))
def test_corrupted_floats_are_read_or_refused(changes):
    data, dims, offset = wire.to_array(make_image())
    for index, value in changes:
        data[index] = value
    read_or_refuse(data, dims, offset)


@given(shape=st.tuples(*[st.integers(0, 8)] * 2), offset=st.integers(0, 100))
def test_consistent_layouts_of_other_sizes_are_read_or_refused(shape, offset):
    data, *_ = wire.to_array(make_image())
    read_or_refuse(data, wire.LAYOUT.dimensions(shape), offset)


# ------------------------------------------------------------------------------- messages

def test_round_trip_through_a_serialised_message():
    pytest.importorskip('std_msgs', reason='needs the ROS message classes')
    serialization = pytest.importorskip('rclpy.serialization')
    from msg_conversions import subaperture_image

    sent = make_image()
    message = subaperture_image.to_message(sent)
    data, dims, offset = wire.to_array(sent)
    assert message.data.tobytes() == data.tobytes()
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == dims
    assert message.layout.data_offset == offset
    arrived = serialization.deserialize_message(serialization.serialize_message(message),
                                                type(message))
    assert_same(subaperture_image.from_message(arrived), sent)
    with pytest.raises(WireFormatError, match='are at most 11'):
        subaperture_image.from_message(arrived, max_elements=11)
