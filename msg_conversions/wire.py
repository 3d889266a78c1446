# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Wire format of a pulse block: arrays of a std_msgs/Float32MultiArray, without ROS.

``data = [block header | per-pulse table | samples]``, described field by field in
docs/wire_format.md. Writing and reading here use plain NumPy, so that bags can be written and
read where no ROS is installed.
"""

from __future__ import annotations

import numpy as np

from sar_imaging.geometry.illumination import Pointing
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform

from . import float_pairs
from .errors import WireFormatError
from .layout import DEFAULT_MAX_ELEMENTS, Data, Dims, Layout, as_floats, check_finite, check_magic

MAGIC = 0x534152  # 'SAR' in ASCII, exact in a float32
VERSION = 1
LAYOUT = Layout(('pulse', 'channel', 'sample'), content='samples', unit='block')
FRAME_MARK = '@'  # the first label may name the frame of the positions: pulse@odom
LONGEST_FRAME = 255

# Header of version 1. Its length is even and so is that of a row: samples stay 8-byte aligned.
HEADER_LENGTH = 24
LONGER_HEADER = 26  # where the waves travel at another speed than c
EPOCH = slice(4, 8)
RADAR = slice(8, 20)
RADAR_FIELDS = ('carrier_hz', 'sample_rate_hz', 'bandwidth_hz', 'chirp_rate_hz_per_s',
                'pulse_length_s', 'first_sample_delay_s')
COMPRESSED = 20
WAVEFORM = 21
POSITIONS = 22
POINTING = 23
SPEED = slice(24, 26)

# Row of the per-pulse table.
COUNTER = slice(0, 2)
TIME = slice(2, 4)
PHASE_CENTRES = 4  # where they begin
FLOATS_PER_CHANNEL = 12  # transmit and receive, x y z, high and low
FLOATS_OF_POINTING = 12  # boresight and up, x y z, high and low: behind the phase centres

SAMPLES_ADVICE = 'drop faulty pulses in the sender'


def row_length(n_channels: int, has_positions: bool, has_pointing: bool = False) -> int:
    """Data in one row of the per-pulse table."""
    return (PHASE_CENTRES + FLOATS_PER_CHANNEL * n_channels * has_positions
            + FLOATS_OF_POINTING * has_pointing)


def _header_length(radar: RadarParameters) -> int:
    """Data in the header; earlier readers refuse the longer one, which they would misread."""
    speed = float_pairs.join_double(float_pairs.split_double(radar.propagation_speed_m_per_s))
    return HEADER_LENGTH if speed == SPEED_OF_LIGHT else LONGER_HEADER


def dimensions(shape: tuple[int, int, int], frame: str = '') -> list[tuple[str, int, int]]:
    """``(label, size, stride)`` of each dimension for samples of shape (P, C, N).

    The first label names the frame of the positions, where it is known.

    Raises
    ------
    WireFormatError
        The name of the frame is too long.
    """
    (label, size, stride), *others = LAYOUT.dimensions(shape)
    _check_frame(frame)
    return [(f'{label}{FRAME_MARK}{frame}' if frame else label, size, stride), *others]


def _check_frame(frame: str) -> None:
    if len(frame) > LONGEST_FRAME:
        raise WireFormatError(f'the frame of the positions has a name of {len(frame)} characters; '
                              f'expected at most {LONGEST_FRAME}')


def split_frame(dims: Dims) -> tuple[Dims, str]:
    """Dimensions with plain labels, and the frame that the first of them names, empty without.

    Raises
    ------
    WireFormatError
        The name of the frame is too long.
    """
    if not dims or FRAME_MARK not in dims[0][0]:
        return dims, ''
    (label, size, stride), *others = dims
    label, _, frame = label.partition(FRAME_MARK)
    _check_frame(frame)
    return [(label, size, stride), *others], frame


# ------------------------------------------------------------------------------------- writing

def to_array(block: PulseBlock) -> tuple[np.ndarray, list[tuple[str, int, int]], int]:
    """Write a block as one array of floats.

    Parameters
    ----------
    block : PulseBlock
        At least one pulse, channel and sample.

    Returns
    -------
    data : (H + P * M + P * C * N * 2,) float32
        Header, table and samples.
    dims : list of (label, size, stride)
        For ``layout.dim``.
    data_offset : int
        For ``layout.data_offset``: where the samples begin.

    Raises
    ------
    WireFormatError
        The block is empty, too large for the 32-bit layout fields, spans more than 78 hours, or
        holds a number outside the range of float32.
    """
    head = preamble(block)
    data = np.empty(head.size + 2 * block.samples.size, np.float32)
    data[:head.size] = head
    data[head.size:].view(np.complex64).reshape(block.samples.shape)[...] = block.samples
    return data, dimensions(block.samples.shape, block.frame), head.size


def preamble(block: PulseBlock) -> np.ndarray:
    """(H + P * M,) float32: everything of a block that precedes its samples; see `to_array`."""
    row = row_length(block.n_channels, block.has_positions, block.pointing is not None)
    n_header = _header_length(block.radar)
    length = n_header + block.n_pulses * row
    LAYOUT.check_size('samples', block.samples.shape, length)
    head = np.empty(length, np.float32)
    _write_header(block, head[:n_header], row)
    _write_table(block, head[n_header:].reshape(block.n_pulses, row))
    return head


def _write_header(block: PulseBlock, header: np.ndarray, row: int) -> None:
    header[:EPOCH.start] = MAGIC, VERSION, len(header), row
    header[EPOCH] = float_pairs.split_limbs(int(block.stamp_ns[0]), 4)
    values = [getattr(block.radar, name) for name in RADAR_FIELDS]
    header[RADAR] = float_pairs.split_double(values).ravel()
    header[COMPRESSED] = block.compressed
    header[WAVEFORM] = block.radar.waveform
    header[POSITIONS] = block.has_positions
    header[POINTING] = block.pointing is not None
    if len(header) == LONGER_HEADER:
        header[SPEED] = float_pairs.split_double([block.radar.propagation_speed_m_per_s]).ravel()


def _write_table(block: PulseBlock, table: np.ndarray) -> None:
    epoch = int(block.stamp_ns[0])
    longest = max(int(block.stamp_ns.max()) - epoch, epoch - int(block.stamp_ns.min()))
    if longest > float_pairs.MAX_OFFSET_NS:
        raise WireFormatError(f'stamp_ns reaches {longest / 3.6e12:.1f} h from the first pulse; '
                              'expected at most 78 h; send shorter blocks or correct the stamps')
    table[:, COUNTER.start] = block.counter & (float_pairs.LIMB - 1)
    table[:, COUNTER.start + 1] = block.counter >> 16
    table[:, TIME] = float_pairs.split_nanoseconds(block.stamp_ns - epoch)
    if block.tx_m is not None and block.rx_m is not None:
        centres = np.stack([block.tx_m, block.rx_m], axis=2)
        table[:, PHASE_CENTRES:PHASE_CENTRES + FLOATS_PER_CHANNEL * block.n_channels] = (
            float_pairs.split_double(centres).reshape(block.n_pulses, -1))
    if block.pointing is not None:
        looks = np.stack([block.pointing.boresight, block.pointing.up], axis=1)
        table[:, -FLOATS_OF_POINTING:] = float_pairs.split_double(looks).reshape(block.n_pulses,
                                                                                -1)


# ------------------------------------------------------------------------------------- reading

def from_array(data: Data, dims: Dims, data_offset: int, *,
               max_elements: int = DEFAULT_MAX_ELEMENTS, finite: bool = True) -> PulseBlock:
    """Read a block from the array of a message.

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
        Largest number of floats of samples to accept.
    finite : bool
        Refuse samples that are NaN or infinite; False for who drops their pulses alone.

    Returns
    -------
    PulseBlock
        Its samples are a read-only view of `data`; everything else is a copy.

    Raises
    ------
    WireFormatError
        The message does not follow the format, or holds numbers that are not finite.
    """
    dims, frame = split_frame(dims)
    shape = LAYOUT.check_dims(dims, max_elements)
    if data_offset == 0:
        raise WireFormatError('data_offset=0: a bare cube of samples without block header, which '
                              'no node can image; read it with from_bare_cube, which takes '
                              'times, counters and radar parameters from the caller, and send '
                              'what to_message makes of the block')
    if data_offset < HEADER_LENGTH:
        raise WireFormatError(f'data_offset={data_offset}; expected 0 for a bare cube or at least '
                              f'the {HEADER_LENGTH} floats of a block header; see '
                              'docs/wire_format.md')
    values = as_floats(data)
    LAYOUT.check_length(values, shape, data_offset)
    longer = values[2] == LONGER_HEADER and data_offset >= LONGER_HEADER
    header = values[:LONGER_HEADER if longer else HEADER_LENGTH]
    _check_header(header, shape, data_offset)
    table = values[len(header):data_offset].reshape(shape[0], -1)
    check_finite(table, 'per-pulse table', 'send only pulses with known time and positions')
    try:
        return PulseBlock(
            radar=_read_radar(header), compressed=bool(header[COMPRESSED]),
            stamp_ns=_read_times(table, float_pairs.join_int64(header[EPOCH])),
            counter=_read_counters(table),
            samples=LAYOUT.read_content(values, shape, data_offset,
                                        SAMPLES_ADVICE if finite else ''), frame=frame,
            pointing=_read_pointing(table, header), **_read_positions(table, shape[1], header))
    except WireFormatError:
        raise
    except ValueError as error:  # well formed, but no pulses of a radar
        raise WireFormatError(f'the block makes no sense: {error}; correct it in the sender'
                              ) from error


def samples_from_bare_cube(data: Data, dims: Dims, data_offset: int, *,
                           max_elements: int = DEFAULT_MAX_ELEMENTS) -> np.ndarray:
    """Read the samples of a message without block header (``data_offset`` is 0).

    Parameters and errors as in `from_array`.

    Returns
    -------
    (P, C, N) complex64
        Read-only view of `data`.
    """
    shape = LAYOUT.check_dims(dims, max_elements)
    if data_offset != 0:
        raise WireFormatError(f'data_offset={data_offset}; expected 0 for a bare cube; read '
                              'blocks with a header with from_message')
    values = as_floats(data)
    LAYOUT.check_length(values, shape, 0)
    return LAYOUT.read_content(values, shape, 0, SAMPLES_ADVICE)


def _check_header(header: np.ndarray, shape: tuple[int, ...], data_offset: int) -> None:
    values = header.tolist()
    check_magic(values, MAGIC, VERSION, 'pulse blocks')
    check_finite(header, 'block header', 'correct the radar parameters of the sender')
    for index, name, allowed in ((COMPRESSED, 'compressed', (0, 1)),
                                 (WAVEFORM, 'waveform', tuple(map(int, Waveform))),
                                 (POSITIONS, 'position source', (0, 1)),
                                 (POINTING, 'pointing', (0, 1))):
        if values[index] not in allowed:
            raise WireFormatError(f'flag {name} (data[{index}]) is {values[index]:g}; expected '
                                  f'one of {allowed}; see docs/wire_format.md')
    if not float_pairs.are_limbs(header[EPOCH]):
        raise WireFormatError(f'epoch limbs (data[4:8]) are {values[EPOCH]}; expected '
                              'whole numbers of 0 to 65535; split the time into 16-bit limbs')
    row = row_length(shape[1], bool(values[POSITIONS]), bool(values[POINTING]))
    length = len(values)
    if (values[2], values[3]) != (length, row):
        raise WireFormatError(f'header and row length are {values[2]:g} and {values[3]:g} floats; '
                              f'expected {length} and {row} for {shape[1]} channels '
                              f'{"with" if values[POSITIONS] else "without"} positions and '
                              f'{"with" if values[POINTING] else "without"} pointing '
                              f'({LONGER_HEADER} with a speed of the waves); see '
                              'docs/wire_format.md')
    if data_offset != length + shape[0] * row:
        raise WireFormatError(f'data_offset={data_offset}; expected '
                              f'{length + shape[0] * row}: a header of {length} '
                              f'floats and {shape[0]} rows of {row}')


def _read_radar(header: np.ndarray) -> RadarParameters:
    values = float_pairs.join_double(header[RADAR].reshape(-1, 2)).tolist()
    numbers = dict(zip(RADAR_FIELDS, values, strict=True))
    if len(header) == LONGER_HEADER:
        numbers['propagation_speed_m_per_s'] = float(float_pairs.join_double(header[SPEED]))
    try:
        return RadarParameters(**numbers,
                               waveform=Waveform(int(header[WAVEFORM])))
    except ValueError as error:
        raise WireFormatError(f'radar parameters of the block header are impossible: {error}; '
                              'correct them in the sender') from error


def _read_times(table: np.ndarray, epoch_ns: int) -> np.ndarray:
    offset_ns = float_pairs.join_nanoseconds(table[:, TIME])
    earliest, latest = float(offset_ns.min()), float(offset_ns.max())
    if max(latest, -earliest) > float_pairs.MAX_OFFSET_NS:
        raise WireFormatError(f'pulse times reach {max(latest, -earliest) / 3.6e12:.4g} h from '
                              'the epoch; expected at most 78 h; send shorter blocks')
    if epoch_ns + int(earliest) < -2**63 or epoch_ns + int(latest) >= 2**63:
        raise WireFormatError(f'epoch {epoch_ns} ns plus pulse times exceeds 64 bits; expected '
                              'nanoseconds since 1970; correct the clock of the sender')
    return epoch_ns + offset_ns.astype(np.int64)


def _read_counters(table: np.ndarray) -> np.ndarray:
    limbs = table[:, COUNTER]
    if not float_pairs.are_limbs(limbs):
        raise WireFormatError(f'pulse counter limbs range from {limbs.min():g} to '
                              f'{limbs.max():g}; expected whole numbers of 0 to 65535; split the '
                              'counter into its low and high 16 bits')
    low, high = limbs.T.astype(np.uint32)
    return low | high << 16


def _read_positions(table: np.ndarray, n_channels: int, header: np.ndarray
                    ) -> dict[str, np.ndarray]:
    if not header[POSITIONS]:
        return {}
    pairs = table[:, PHASE_CENTRES:PHASE_CENTRES + FLOATS_PER_CHANNEL * n_channels]
    centres = float_pairs.join_double(pairs.reshape(-1, n_channels, 2, 3, 2))
    return {'tx_m': np.ascontiguousarray(centres[:, :, 0]),
            'rx_m': np.ascontiguousarray(centres[:, :, 1])}


def _read_pointing(table: np.ndarray, header: np.ndarray) -> Pointing | None:
    if not header[POINTING]:
        return None
    looks = float_pairs.join_double(table[:, -FLOATS_OF_POINTING:].reshape(-1, 2, 3, 2))
    return Pointing.of_unit_vectors(looks[:, 0], looks[:, 1])
