# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Wire format of a sub-aperture image: arrays of a std_msgs/Float32MultiArray, without ROS.

``data = [header | pixels]``, described field by field in docs/wire_format.md. It follows the
format of pulse blocks: high/low pairs and limbs, strides in elements, the same checks.
"""

from __future__ import annotations

import math

import numpy as np

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.afbp.polar_grids import UnifiedPolarGrids
from sar_imaging.streaming.subaperture_image import (
    COUNTS,
    SubapertureEnds,
    SubapertureImage,
)

from . import float_pairs
from .errors import WireFormatError
from .layout import DEFAULT_MAX_ELEMENTS, Data, Dims, Layout, as_floats, check_finite, check_magic

MAGIC = 0x534149  # 'SAI' in ASCII, exact in a float32
VERSION = 7
LAYOUT = Layout(('angle', 'range'), content='pixels', unit='image')

# Header of version 7; its even length keeps the pixels 8-byte aligned.
HEADER_LENGTH = 144
SIDE = 3
STAMP = slice(4, 8)
LIMBS = slice(8, 42)  # COUNTS, then the sizes
SIZES = ('n_alpha', 'n_range', 'n_fine', 'n_fine_range', 'n_x', 'n_y')
NUMBERS = slice(42, 90)
ENDS_KNOWN, POINTING_KNOWN, WEIGHTED, ERROR_UNKNOWN = 90, 91, 92, 93
CHANNELS = slice(94, 96)
ENDS = slice(96, 144)


def to_array(subaperture: SubapertureImage) -> tuple[np.ndarray, list[tuple[str, int, int]], int]:
    """Write a sub-aperture image as one array of floats.

    Parameters
    ----------
    subaperture : SubapertureImage
        At least one pixel.

    Returns
    -------
    data : (H + n_alpha * n_range * 2,) float32
        Header and pixels.
    dims : list of (label, size, stride)
        For ``layout.dim``.
    data_offset : int
        For ``layout.data_offset``: where the pixels begin.

    Raises
    ------
    WireFormatError
        The image is too large for the 32-bit layout fields, or a number of the grid exceeds the
        range of float32.
    """
    head = preamble(subaperture)
    image = subaperture.image
    data = np.empty(head.size + 2 * image.size, np.float32)
    data[:head.size] = head
    data[head.size:].view(np.complex64).reshape(image.shape)[...] = image
    return data, LAYOUT.dimensions(image.shape), head.size


def preamble(subaperture: SubapertureImage) -> np.ndarray:
    """(H,) float32: everything that precedes the pixels; see `to_array`."""
    LAYOUT.check_size('image', subaperture.image.shape, HEADER_LENGTH)
    fusion, target = subaperture.fusion, subaperture.map_grid
    polar = fusion.polar
    header = np.zeros(HEADER_LENGTH, np.float32)
    header[:STAMP.start] = MAGIC, VERSION, HEADER_LENGTH, polar.side
    header[STAMP] = float_pairs.split_limbs(subaperture.stamp_ns, 4)
    counts = [getattr(subaperture, name) for name in COUNTS]
    sizes = (polar.n_alpha, polar.n_range, fusion.n_fine, fusion.n_fine_range, target.n_x,
             target.n_y)
    header[LIMBS] = [limb for n in (*counts, *sizes)
                     for limb in float_pairs.split_limbs(int(n), 2)]
    error_db = subaperture.predicted_error_db
    header[ERROR_UNKNOWN] = math.isnan(error_db)
    header[NUMBERS] = float_pairs.split_double([
        fusion.carrier_hz, subaperture.bandwidth_hz, 0.0 if math.isnan(error_db) else error_db,
        *polar.origin_m, *polar.track, polar.z_m, polar.range_start_m, polar.range_spacing_m,
        polar.alpha_start, polar.alpha_spacing, fusion.n_guard, fusion.beta, fusion.half_range,
        fusion.range_oversampling, subaperture.centre_m, *target.centre_m, target.spacing_m,
        fusion.alpha_oversampling, fusion.propagation_speed_m_per_s]).ravel()
    if subaperture.ends is not None:
        _write_ends(header, subaperture.ends)
    return header


def _write_ends(header: np.ndarray, ends: SubapertureEnds) -> None:
    """Where the pulses at both ends were sent; zeros for directions that nobody tells."""
    header[ENDS_KNOWN], header[POINTING_KNOWN] = 1, bool(ends.up)
    header[WEIGHTED] = ends.weighted
    header[CHANNELS] = float_pairs.split_limbs(ends.n_channels, 2)
    nothing = ((0.0,) * 3,) * 2
    header[ENDS] = float_pairs.split_double(np.array([
        ends.tx_m, ends.rx_m, ends.boresight or nothing, ends.up or nothing]).ravel()).ravel()


def _read_ends(header: np.ndarray) -> SubapertureEnds | None:
    """Raises ValueError where they are impossible."""
    if not header[ENDS_KNOWN]:
        return None
    numbers = float_pairs.join_double(header[ENDS].reshape(-1, 2)).reshape(4, 2, 3)
    low, high = header[CHANNELS].astype(np.int64)
    boresight, up = (numbers[2], numbers[3]) if header[POINTING_KNOWN] else ((), ())
    return SubapertureEnds(numbers[0], numbers[1], int(low | high << 16), boresight, up,
                           weighted=bool(header[WEIGHTED]))


def as_received(subaperture: SubapertureImage) -> SubapertureImage:
    """What a receiver of the message would hold: numbers rounded to pairs, the same pixels.

    For stages of one process that hand images over directly and are to agree to the last bit with
    stages that send them.

    Raises
    ------
    WireFormatError
        As `to_array`.
    """
    return _read(preamble(subaperture), subaperture.image)


def from_array(data: Data, dims: Dims, data_offset: int, *,
               max_elements: int = DEFAULT_MAX_ELEMENTS) -> SubapertureImage:
    """Read a sub-aperture image from the array of a message.

    Nothing is allocated in proportion to a number in the message before that number was compared
    with the data really present.

    Parameters
    ----------
    data : (K,) float32, any object with a buffer of native floats
        ``msg.data``.
    dims : sequence of (label, size, stride)
        ``msg.layout.dim``.
    data_offset : int
        ``msg.layout.data_offset``.
    max_elements : int
        Largest number of floats of pixels to accept.

    Returns
    -------
    SubapertureImage
        Its image is a read-only view of `data`; everything else is a copy.

    Raises
    ------
    WireFormatError
        The message does not follow the format, or holds numbers that are not finite.
    """
    shape = LAYOUT.check_dims(dims, max_elements)
    if data_offset != HEADER_LENGTH:
        raise WireFormatError(f'data_offset={data_offset}; expected {HEADER_LENGTH}: the length '
                              'of the header; see docs/wire_format.md')
    values = as_floats(data)
    LAYOUT.check_length(values, shape, data_offset)
    header = values[:HEADER_LENGTH]
    _check_header(header)
    image = LAYOUT.read_content(values, shape, data_offset,
                                'drop faulty sub-apertures in the sender')
    return _read(header, image)


def _check_header(header: np.ndarray) -> None:
    values = header.tolist()
    check_magic(values, MAGIC, VERSION, 'sub-aperture images')
    if values[2] != HEADER_LENGTH:
        raise WireFormatError(f'header length is {values[2]:g} floats; expected {HEADER_LENGTH}; '
                              'see docs/wire_format.md')
    check_finite(header, 'header', 'correct the grid and radar parameters of the sender')
    if values[SIDE] not in (-1, 1):
        raise WireFormatError(f'side (data[{SIDE}]) is {values[SIDE]:g}; expected +1, left of the '
                              'track, or -1, right of it; see docs/wire_format.md')
    for flag in (ENDS_KNOWN, POINTING_KNOWN, WEIGHTED, ERROR_UNKNOWN):
        if values[flag] not in (0, 1):
            raise WireFormatError(f'flag data[{flag}] is {values[flag]:g}; expected 0 or 1; see '
                                  'docs/wire_format.md')
    for name, fields in (('stamp', STAMP), ('count', LIMBS), ('channel', CHANNELS)):
        if not float_pairs.are_limbs(header[fields]):
            raise WireFormatError(f'{name} limbs (data[{fields.start}:{fields.stop}]) are '
                                  f'{values[fields]}; expected whole numbers of 0 to 65535; split '
                                  'integers into 16-bit limbs')


def _read(header: np.ndarray, image: np.ndarray) -> SubapertureImage:
    low, high = header[LIMBS].reshape(-1, 2).T.astype(np.int64)
    numbers = dict(zip((*COUNTS, *SIZES), (low | high << 16).tolist(), strict=True))
    n_alpha, n_range, n_fine, n_fine_range, n_x, n_y = (numbers.pop(name) for name in SIZES)
    (carrier_hz, bandwidth_hz, error_db, *origin_m, u, v, z_m, range_start_m, range_spacing_m,
     alpha_start, alpha_spacing, n_guard, beta, half_range, range_oversampling, centre_m, x, y,
     z, spacing_m, alpha_oversampling, speed) = float_pairs.join_double(
         header[NUMBERS].reshape(-1, 2)).tolist()
    try:
        polar = PolarGrid(
            origin_m=tuple(origin_m), track=(u, v), side=int(header[SIDE]), z_m=z_m,
            range_start_m=range_start_m, range_spacing_m=range_spacing_m, n_range=n_range,
            alpha_start=alpha_start, alpha_spacing=alpha_spacing, n_alpha=n_alpha)
        fusion = UnifiedPolarGrids(polar, image.shape[0], n_fine, n_guard, beta, image.shape[1],
                            n_fine_range, half_range, carrier_hz, range_oversampling,
                            alpha_oversampling, speed)
        return SubapertureImage(
            image, fusion, centre_m, MapGrid((x, y, z), n_x, n_y, spacing_m), bandwidth_hz,
            stamp_ns=float_pairs.join_int64(header[STAMP]),
            predicted_error_db=math.nan if header[ERROR_UNKNOWN] else error_db,
            ends=_read_ends(header), **numbers)
    except ValueError as error:
        raise WireFormatError(f'header of the sub-aperture image is impossible: {error}; correct '
                              'it in the sender') from error
