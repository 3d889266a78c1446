# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from hypothesis.extra import numpy as hnp

pytest.importorskip('sensor_msgs', reason='needs the ROS message classes')

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from msg_conversions import WireFormatError, images
from msg_conversions.quicklook import quicklook
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.memory import IMAGE_BYTES, PUBLISHED_BYTES

SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, max_side=5)
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)
HEADER = Header(stamp=Time(sec=12, nanosec=34), frame_id='map')
PICTURE = np.array([[1, 2, 3], [4, 5, 6]], np.float32)  # asymmetric, so that a flip shows


def through_cdr(message):
    serialization = pytest.importorskip('rclpy.serialization')
    return serialization.deserialize_message(serialization.serialize_message(message),
                                             type(message))


# ------------------------------------------------------------------------------- images

@given(hnp.arrays(np.complex64, SHAPES, elements=st.complex_numbers(
    width=64, allow_nan=False, allow_infinity=False)))
def test_complex_round_trip(image):
    message = images.complex_to_message(image, HEADER)
    received = images.complex_from_message(through_cdr(message))
    assert received.dtype == np.complex64
    assert received.tobytes() == image.tobytes()


@given(hnp.arrays(np.float32, SHAPES, elements=FLOATS))
def test_amplitude_round_trip(image):
    received = images.amplitude_from_message(through_cdr(
        images.amplitude_to_message(image, HEADER)))
    assert received.dtype == np.float32
    assert received.tobytes() == image.tobytes()


@pytest.mark.parametrize('message, encoding, n_bytes', [
    (images.complex_to_message(PICTURE + 1j, HEADER), '32FC2', 8),
    (images.amplitude_to_message(PICTURE, HEADER), '32FC1', 4),
    (images.quicklook_to_message(PICTURE, HEADER, dynamic_range_db=40.0), 'mono8', 1)])
def test_fields_describe_the_pixels(message, encoding, n_bytes):
    assert message.header == HEADER
    assert (message.height, message.width, message.step) == (2, 3, 3 * n_bytes)
    assert message.encoding == encoding
    assert message.is_bigendian == 0  # every platform that ROS 2 supports
    assert len(message.data) == 6 * n_bytes


def test_rows_and_columns_keep_their_order():
    pixels = np.frombuffer(images.amplitude_to_message(PICTURE[:, ::-1], HEADER).data, np.float32)
    assert pixels.tolist() == [3, 2, 1, 6, 5, 4]
    pairs = np.frombuffer(images.complex_to_message(PICTURE + 7j, HEADER).data, np.float32)
    assert pairs[:4].tolist() == [1, 7, 2, 7]


def test_received_images_are_read_only_views():
    message = images.amplitude_to_message(PICTURE, HEADER)
    received = images.amplitude_from_message(message)
    assert np.shares_memory(received, np.frombuffer(message.data, np.uint8))
    assert not received.flags.writeable


@pytest.mark.parametrize('write, read, image', [
    (images.complex_to_message, images.complex_from_message, (PICTURE + 2j).astype('>c8')),
    (images.amplitude_to_message, images.amplitude_from_message, PICTURE.astype('>f4'))])
def test_big_endian_images_are_honoured(write, read, image):
    message = write(image, HEADER)
    del message.data[:]
    message.data.frombytes(image.tobytes())
    message.is_bigendian = 1
    np.testing.assert_array_equal(read(message), image)
    assert read(message).dtype.isnative


@pytest.mark.parametrize('changes, text', [
    ({'encoding': '32FC2'}, "encoding='32FC2'; expected '32FC1'; subscribe to the topic"),
    ({'encoding': 'x' * 10**6}, "encoding='x{32}'; expected"),
    ({'height': 0}, 'height=0, width=3; expected at least one pixel each'),
    ({'width': 0}, 'height=2, width=0; expected at least one pixel each'),
    ({'step': 16}, 'step=16; expected 12: 3 pixels of 4 bytes without padding'),
    ({'height': 3}, r'len\(data\)=24; expected 36: 3 rows of 12 bytes'),
    ({'height': 2**32 - 1, 'width': 2**30 - 1, 'step': 2**32 - 4}, 'len.data.=24; expected 184')])
def test_malformed_images_are_refused(changes, text):
    message = images.amplitude_to_message(PICTURE, HEADER)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(WireFormatError, match=text):
        images.amplitude_from_message(message)


def test_image_without_data_is_refused():
    message = images.quicklook_to_message(PICTURE, HEADER, dynamic_range_db=40.0)
    del message.data[:]
    with pytest.raises(WireFormatError, match=r'len\(data\)=0; expected 6'):
        images.quicklook_from_message(message)


@pytest.mark.parametrize('image, text', [
    (np.zeros((0, 3)), r'image.shape=\(0, 3\); expected \(n_y, n_x\) with at least one pixel'),
    (np.zeros(3), r'image.shape=\(3,\); expected'),
    (np.zeros((1, 2, 3)), r'image.shape=\(1, 2, 3\); expected')])
def test_arrays_that_are_no_images_are_refused(image, text):
    with pytest.raises(ValueError, match=text):
        images.complex_to_message(image, HEADER)
    with pytest.raises(ValueError, match=text):
        images.amplitude_to_message(image, HEADER)


def test_complex_values_are_no_amplitude():
    with pytest.raises(ValueError, match=r'complex64; expected real amplitudes; pass np.abs'):
        images.amplitude_to_message(PICTURE.astype(np.complex64), HEADER)


# ------------------------------------------------------------------------------- quicklook

def test_quicklook_is_linear_in_db():
    below_db = np.array([[0.0, 10.0, 20.0], [40.0, 41.0, 300.0]])
    amplitude = 7e-5 * 10 ** (-below_db / 20)
    message = images.quicklook_to_message(amplitude, HEADER, dynamic_range_db=40.0)
    # 255 * (1 - 10 / 40) = 191.25 and 127.5, whose rounding float32 decides
    received = images.quicklook_from_message(through_cdr(message)).tolist()
    assert received[0][:2] == [255, 191] and received[0][2] in (127, 128)
    assert received[1] == [0, 0, 0]


@given(hnp.arrays(np.float32, SHAPES, elements=st.floats(0, 2.0**127, width=32)),
       st.floats(1e-3, 200.0))
def test_quicklook_follows_its_definition(amplitude, dynamic_range_db):
    levels = quicklook(amplitude, dynamic_range_db)
    assert levels.dtype == np.uint8
    if amplitude.max() == 0:
        assert not levels.any()
        return
    with np.errstate(divide='ignore'):
        db = 20 * np.log10(amplitude.astype(float) / float(amplitude.max()))
    exact = 255 * np.clip(1 + db / dynamic_range_db, 0, 1)
    # Half a level of rounding; float32 errs by some 1e-6 dB, which matters for tiny ranges.
    np.testing.assert_allclose(levels, exact, rtol=0,
                               atol=0.5 + 255 * 1e-5 * (1 + 1 / dynamic_range_db))


def speckle(reflector_db, n=256):
    """Amplitudes of clutter with a median of one, and a reflector so much brighter."""
    rng = np.random.default_rng(3)
    amplitude = np.sqrt(rng.exponential(1 / np.log(2), (n, n)))
    amplitude[n // 2, n // 2] = 10 ** (reflector_db / 20)
    return amplitude


@pytest.mark.parametrize('reflector_db', [60.0, 80.0, 140.0])
def test_clutter_is_dark_grey_beside_any_reflector(reflector_db):
    amplitude = speckle(reflector_db)
    levels = quicklook(amplitude, 60.0, 'clutter')
    assert levels.max() == levels[128, 128] == 255
    # The median is 10 of 60 dB above black; the rest of it is the rounding of the level.
    assert np.median(levels) == pytest.approx(255 * 10 / 60, abs=1)
    # exp(-0.1 ln 2): the share of speckle above a tenth of its median intensity
    assert np.mean(levels > 0) == pytest.approx(2 ** -0.1, abs=0.01)
    shown = np.mean(quicklook(amplitude, 60.0, 'peak') > 0)
    assert shown < (0.6 if reflector_db == 60.0 else 0.001)  # by the peak it is half or all black


def test_a_quicklook_of_little_contrast_uses_all_levels():
    levels = quicklook(speckle(20.0), 60.0, 'clutter')
    assert levels.max() == 255
    assert np.median(levels) == pytest.approx(255 * 10 / 30, abs=1)  # 10 dB down, 20 dB up


@given(hnp.arrays(np.float32, SHAPES, elements=st.floats(0, 2.0**127, width=32)),
       st.floats(1.0, 200.0))
@example(np.full((1, 2), 2.0**127, np.float32), 1.0)  # whose sum overflows
def test_a_quicklook_by_the_clutter_follows_its_definition(amplitude, dynamic_range_db):
    levels = quicklook(amplitude, dynamic_range_db, 'clutter')
    known = amplitude[amplitude > 0].astype(float)
    if not known.size:
        assert not levels.any()
        return
    peak_db = 20 * np.log10(known.max())
    black_db = max(20 * np.log10(np.median(known)),
                   peak_db - 250) - 10
    white_db = min(black_db + dynamic_range_db, peak_db)
    with np.errstate(divide='ignore'):
        db = 20 * np.log10(amplitude.astype(float))
    exact = 255 * np.clip((db - black_db) / (white_db - black_db), 0, 1)
    # Half a level of rounding; float32 keeps levels of up to 300 dB to some 1e-5 of them.
    np.testing.assert_allclose(levels, exact, rtol=0,
                               atol=0.5 + 255 * 1e-4 * (1 + 1 / (white_db - black_db)))


def test_an_unknown_anchor_is_refused():
    with pytest.raises(ValueError, match="anchor='noise' is unknown; use one of clutter, peak"):
        quicklook(PICTURE, 60.0, 'noise')


@pytest.mark.parametrize('amplitude, text', [
    (np.zeros((0, 4)), r'amplitude.shape=\(0, 4\) is empty'),
    (np.array([[1.0, np.nan]]), 'largest amplitude is nan; expected finite amplitudes'),
    (np.array([[1.0, np.inf]]), 'largest amplitude is inf; expected finite amplitudes')])
def test_amplitudes_without_maximum_are_refused(amplitude, text):
    with pytest.raises(ValueError, match=text):
        images.quicklook_to_message(amplitude, HEADER, dynamic_range_db=50.0)


@pytest.mark.parametrize('dynamic_range_db', [0.0, -3.0, 201.0, np.nan, np.inf])
def test_impossible_dynamic_ranges_are_refused(dynamic_range_db):
    with pytest.raises(ValueError, match='dynamic_range_db=.*; expected above 0 and at most 200'):
        quicklook(PICTURE, dynamic_range_db)


# ------------------------------------------------------------------------------- map metadata

def test_origin_is_the_outer_corner_of_the_lower_left_pixel():
    grid = MapGrid((100.0, 200.0, 5.0), 4, 3, 0.5)
    message = images.map_metadata_to_message(grid, Time(sec=7))
    assert (message.width, message.height, message.resolution) == (4, 3, 0.5)
    assert message.origin.position.x == grid.x_m[0] - 0.25 == 99.0
    assert message.origin.position.y == grid.y_m[-1] - 0.25 == 199.25
    assert message.origin.position.z == 5.0
    assert message.origin.orientation.w == 1.0
    assert message.map_load_time.sec == 7


COORDINATES = st.floats(-6.4e6, 6.4e6)


@given(centre=st.tuples(COORDINATES, COORDINATES, COORDINATES), n_x=st.integers(1, 20_000),
       n_y=st.integers(1, 20_000), spacing_mm=st.integers(1, 99_999))
def test_grids_of_decimal_spacing_survive(centre, n_x, n_y, spacing_mm):
    grid = MapGrid(centre, n_x, n_y, spacing_mm / 1000)
    message = through_cdr(images.map_metadata_to_message(grid, Time()))
    received = images.map_metadata_from_message(message)
    assert (received.n_x, received.n_y, received.spacing_m) == (n_x, n_y, grid.spacing_m)
    # Two roundings of doubles below 2**23 m, the height is copied.
    np.testing.assert_allclose(received.centre_m, centre, rtol=0, atol=2**-29)
    assert received.centre_m[2] == centre[2]


@given(spacing=st.floats(1e-3, 1e3), n=st.integers(1, 10_000))
def test_other_spacings_keep_float32_precision(spacing, n):
    grid = MapGrid((0.0, 0.0, 0.0), n, n, spacing)
    received = images.map_metadata_from_message(
        through_cdr(images.map_metadata_to_message(grid, Time())))
    # The shortest decimal may lie half a float off, as the float from the spacing.
    assert received.spacing_m == pytest.approx(spacing, rel=2**-23)
    assert abs(received.centre_m[0]) <= n / 2 * spacing * 2**-23


@pytest.mark.parametrize('resolution, width, text', [
    (0.0, 3, 'describes no grid: spacing_m=0.0 must be positive'),
    (float('nan'), 3, 'describes no grid: centre_m=.*nan'),
    (1.0, 0, 'describes no grid: n_x=0')])
def test_impossible_grids_are_refused(resolution, width, text):
    message = images.map_metadata_to_message(MapGrid((0, 0, 0), 2, 2, 1.0), Time())
    message.resolution, message.width = resolution, width
    with pytest.raises(WireFormatError, match=text):
        images.map_metadata_from_message(message)


@pytest.mark.parametrize('z, w', [(0.5**0.5, 0.5**0.5), (0.5, 1.0), (0.0, 0.0), (-2e-9, 1.0),
                                  (0.0, 1.0 - 2e-9), (0.0, -1.0 - 2e-9)])
def test_rotated_maps_are_refused(z, w):
    message = images.map_metadata_to_message(MapGrid((0, 0, 0), 2, 2, 1.0), Time())
    message.origin.orientation.z, message.origin.orientation.w = z, w
    with pytest.raises(WireFormatError, match=r'orientation=.*; expected \(0, 0, 0, 1\): a north'):
        images.map_metadata_from_message(message)


@pytest.mark.parametrize(('z', 'w'), [(0.0, -1.0), (9e-10, 1.0), (0.0, 1.0 - 9e-10)])
def test_either_quaternion_of_a_north_up_map_is_read(z, w):
    grid = MapGrid((3.0, 4.0, 5.0), 2, 6, 1.0)
    message = images.map_metadata_to_message(grid, Time())
    message.origin.orientation.z, message.origin.orientation.w = z, w
    assert images.map_metadata_from_message(message) == grid


@pytest.mark.parametrize('convert', [
    images.complex_to_message,
    lambda image, header: images.amplitude_to_message(np.abs(image), header),
    lambda image, header: images.quicklook_to_message(np.abs(image), header,
                                                      dynamic_range_db=60.0),
    lambda image, header: images.occupancy_to_message(
        np.zeros(image.shape, np.int8), MapGrid((0.0, 0.0, 0.0), 256, 256, 0.5), header)],
    ids=['complex', 'amplitude', 'quicklook', 'occupancy'])
def test_messages_need_no_more_memory_than_images_are_refused_by(convert):
    serialization = pytest.importorskip('rclpy.serialization')
    image = np.ones((256, 256), np.complex64)
    tracemalloc.start()
    try:
        serialization.serialize_message(convert(image, HEADER))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # arrays of messages grow with 1/16 in reserve; the rest of a message is some kilobytes
    assert IMAGE_BYTES + peak / image.size <= PUBLISHED_BYTES + IMAGE_BYTES / 16 + 0.2


# ------------------------------------------------------------------------------- occupancy

GRID_OF_PICTURE = MapGrid((10.0, 20.0, 0.5), 3, 2, 0.5)
CELLS = np.array([[0, 0, 100], [-1, 0, 100]], np.int8)


def test_a_map_begins_with_its_bottom_row_and_is_where_the_image_is():
    message = through_cdr(images.occupancy_to_message(CELLS, GRID_OF_PICTURE, HEADER))
    assert message.header == HEADER
    assert message.info.map_load_time == HEADER.stamp
    assert list(message.data) == [images.UNKNOWN, 0, 100, 0, 0, 100]
    assert (message.info.origin.position.x, message.info.origin.position.y) == (9.25, 19.5)
    cells, grid = images.occupancy_from_message(message)
    assert grid == GRID_OF_PICTURE
    np.testing.assert_array_equal(cells, CELLS)


@pytest.mark.parametrize(('cells', 'text'), [
    (CELLS.astype(int), 'expected int8 from -1 to 100'),
    (CELLS - np.int8(1), 'int8 from -2'), (CELLS + np.int8(1), 'to 101'),
    (CELLS.T, 'does not match grid.shape')])
def test_impossible_occupancies_are_refused(cells, text):
    with pytest.raises(ValueError, match=text):
        images.occupancy_to_message(cells, GRID_OF_PICTURE, HEADER)


def test_a_map_with_another_number_of_cells_is_refused():
    message = images.occupancy_to_message(CELLS, GRID_OF_PICTURE, HEADER)
    message.data.pop()
    with pytest.raises(WireFormatError, match=r'len\(data\)=5; expected 6: 2 rows of 3 cells'):
        images.occupancy_from_message(message)
