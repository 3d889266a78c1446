# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Raw frames of radar drivers, read by the names of message types and fields.

No package of a driver is needed: the messages may be those of rclpy, or of rosbags with the
definitions that recordings carry. What each driver fills in is said at its decoder.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from sar_imaging.recordings.frames import FrameError, RawFrame


@dataclasses.dataclass(frozen=True)
class FrameType:
    """How to read a type of message.

    Attributes
    ----------
    decode : callable
        Message, sizes and axes of a description to `RawFrame`.
    fields : tuple of str
        That a message of this type has.
    reliable : bool
        Whether the driver publishes reliably.
    takes : tuple of str
        Keys of ``samples`` in descriptions that say what its messages do not.
    """

    decode: Callable[[Any, Mapping[str, int], Sequence[str] | None], RawFrame]
    fields: tuple[str, ...]
    reliable: bool = True
    takes: tuple[str, ...] = ()


def short_name(message_type: str) -> str:
    """``'IQ'`` of ``'xwr_msgs/msg/IQ'`` and of ``'xwr_msgs/IQ'``."""
    return message_type.rpartition('/')[2]


def read_frame(message: Any, message_type: str, sizes: Mapping[str, int] | None = None,
               axes: Sequence[str] | None = None) -> RawFrame:
    """Frame of a message.

    Parameters
    ----------
    message : object
        With the fields of its type.
    message_type : str
        Such as ``'xwr_msgs/msg/IQ'``; the package does not matter.
    sizes : mapping, optional
        Sizes of ``channel`` and ``sample``, for messages that do not tell them.
    axes : sequence of str, optional
        What the axes of the numbers count, the slowest first, for messages that do not label
        them: ``pulse`` (chirps), ``rx``, ``sample``.

    Raises
    ------
    FrameError
        The type is unknown, or the message is not of this form.
    """
    kind = FRAME_TYPES.get(short_name(message_type))
    if kind is None:
        raise FrameError(f'{message_type} is no known raw message; known are '
                         f'{", ".join(FRAME_TYPES)}')
    lacking = [name for name in kind.fields if not hasattr(message, name)]
    if lacking:
        raise FrameError(f'{message_type} has no field {" and no ".join(lacking)}; expected that '
                         'of docs/drivers.md')
    for key, value in (('sizes', sizes), ('axes', axes)):
        if value and key not in kind.takes:
            raise FrameError(f'samples.{key}={value}: messages {short_name(message_type)} tell '
                             'them themselves; leave it out')
    return kind.decode(message, sizes or {}, axes)


def read_info(message: Any, message_type: str) -> dict[str, float | str]:
    """Numbers of a message that describes the radar, by their keys in descriptions.

    Raises
    ------
    FrameError
        The type is unknown, or the message is not of this form.
    """
    read = INFO_TYPES.get(short_name(message_type))
    if read is None:
        raise FrameError(f'{message_type} describes no radar; known are {", ".join(INFO_TYPES)}')
    try:
        return read(message)
    except AttributeError as error:
        raise FrameError(f'{message_type}: {error}') from error


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _shaped(data: ArrayLike, shape: tuple[int, ...], what: str, dtype: DTypeLike = np.int16
            ) -> np.ndarray:
    numbers = np.asarray(data, dtype)
    if min(shape) < 1 or numbers.size != np.prod(shape, dtype=np.int64):
        raise FrameError(f'{what} holds {numbers.size} numbers; expected '
                         f'{" x ".join(map(str, shape))}')
    return numbers.reshape(shape)


def _labelled(layout: Any, labels: tuple[str, ...]) -> list[int]:
    found = {dim.label: int(dim.size) for dim in layout.dim}
    lacking = [label for label in labels if label not in found]
    if lacking:
        raise FrameError(f'the layout has the axes {", ".join(found) or "(none)"}; expected '
                         f'{", ".join(labels)}')
    return [list(found).index(label) for label in labels]


def _iq(message: Any, *_: object) -> RawFrame:
    """RadarML/xwr_ros: chirp, tx, rx, sample; the last axis counts I0 I1 Q0 Q1."""
    layout = message.iq.layout
    order = _labelled(layout, ('chirp', 'tx', 'rx', 'sample'))
    data = np.asarray(message.iq.data, np.int16)[layout.data_offset:]
    numbers = _shaped(data, tuple(int(dim.size) for dim in layout.dim), 'iq').transpose(order)
    n_loops, n_tx, n_rx, n = numbers.shape
    return RawFrame(numbers.reshape(n_loops * n_tx, n_rx, n), 'iiqq',
                    _nanoseconds(message.header.stamp), 'start', bool(message.complete),
                    n_transmitters=n_tx)


def _adc_data_cube(message: Any, *_: object) -> RawFrame:
    """CPSL_TI_Radar_ROS2: real and imaginary parts of rx_channel, sample, chirp; receipt time."""
    shape = tuple(int(dim.size) for dim in message.layout.dim)
    order = ((2, 0, 1) if len(shape) == 3 and not any(dim.label for dim in message.layout.dim)
             else _labelled(message.layout, ('chirp', 'rx_channel', 'sample')))
    real, imaginary = (_shaped(data, shape, name).transpose(order) for data, name in (
        (message.real_data, 'real_data'), (message.imag_data, 'imag_data')))
    return RawFrame(real + 1j * imaginary, 'complex', _nanoseconds(message.header.stamp),
                    'receipt')


def _radar_frame_full(message: Any, *_: object) -> RawFrame:
    """xwr_raw_ros: shape chirps, rx, samples; Q0 Q1 I0 I1; its driver leaves the stamp empty.

    Chirp time (idle and ramp) in microseconds, frame time in milliseconds, slope in Hz/s, sample
    rate in Hz. `rx_phase_bias` holds real and imaginary part of a factor for each pair of
    antennas, whether in use or not.
    """
    if len(message.shape) != 3:
        raise FrameError(f'shape={list(message.shape)}; expected chirps, receivers, samples')
    n_chirps, n_rx, n = (int(size) for size in message.shape)
    is_real = int(message.adc_output_fmt) == 0
    data = message.data
    numbers = _shaped(data, (n_chirps, n_rx, n if is_real else 2 * n), 'data')
    told = {'slope_hz_per_s': float(message.chirp_slope),
            'sample_rate_hz': float(message.sample_rate),
            'chirp_s': 1e-6 * float(message.chirp_time),
            'period_s': 1e-3 * float(message.frame_time)}
    return RawFrame(numbers, 'real' if is_real else 'qqii', _nanoseconds(message.header.stamp),
                    'receipt', weights=None if is_real else _phase_bias(message),
                    range_bias_m=float(message.range_bias), told=told,
                    n_transmitters=sum(on > 0 for on in message.tx) or None)


def _phase_bias(message: Any) -> np.ndarray | None:
    parts = np.asarray(message.rx_phase_bias, float)
    tx, rx = (np.asarray(list(a), int) > 0 for a in (message.tx, message.rx))
    if parts.size != 2 * tx.size * rx.size:
        if parts.size == 0:
            return None
        raise FrameError(f'rx_phase_bias holds {parts.size} numbers; expected 2 for each of '
                         f'{tx.size} x {rx.size} antennas')
    return (parts[0::2] + 1j * parts[1::2]).reshape(tx.size, rx.size)[tx][:, rx].reshape(-1)


def _bgt60(message: Any, _: object, axes: Sequence[str] | None) -> RawFrame:
    """bgt60tr13c_ros2: real numbers of rx, sample, chirp as its message says; time of receipt.

    Its driver hands on what the maker's library returns, whose order may be another: then the
    description says ``axes: [rx, pulse, sample]``.
    """
    axes = tuple(axes or ('rx', 'sample', 'pulse'))
    if sorted(axes) != ['pulse', 'rx', 'sample']:
        raise FrameError(f'samples.axes={list(axes)}; expected rx, sample and pulse in the order '
                         'of the numbers')
    size = {'rx': message.num_rx, 'sample': message.num_samples_per_chirp,
            'pulse': message.num_chirps_per_frame}
    numbers = _shaped(message.data, tuple(int(size[a]) for a in axes), 'data', np.float32)
    numbers = numbers.transpose([axes.index(a) for a in ('pulse', 'rx', 'sample')])
    return RawFrame(numbers, 'real', _nanoseconds(message.stamp), 'receipt')


def _scans(message: Any, sizes: Mapping[str, int], _: object) -> RawFrame:
    """Time Domain P440: one scan of real numbers a message, or one of each channel; no time."""
    data = np.asarray(message.data, np.float32)[message.layout.data_offset:]
    n_channels, n = sizes.get('channel', 1), sizes.get('sample')
    if n is None:
        n = data.size // max(n_channels, 1)
    return RawFrame(_shaped(data, (1, n_channels, n), 'data', np.float32), 'real', 0, 'receipt')


def _chirp_info(message: Any) -> dict[str, float | str]:
    """GHz, MHz/us, kHz and us, in float32: digits beyond the seventh are not told."""
    us = {name: 1e-6 * _told(getattr(message, name)) for name in (
        'idle_time', 'adc_start_time', 'ramp_end_time')}
    return {'waveform': 'fmcw', 'start_frequency_hz': 1e9 * _told(message.frequency),
            'slope_hz_per_s': 1e12 * _told(message.freq_slope),
            'sample_rate_hz': 1e3 * float(message.sample_rate),
            'adc_start_s': us['adc_start_time'],
            'chirp_s': us['idle_time'] + us['ramp_end_time']}


def _told(value: float) -> float:
    """Decimal that a float32 was given as."""
    return float(str(np.float32(value)))


def _device_config(message: Any) -> dict[str, float | str]:
    n, rate_hz = int(message.num_samples_per_chirp), float(message.sample_rate_hz)
    swept_hz = float(message.end_frequency_hz) - float(message.start_frequency_hz)
    return {'waveform': 'fmcw_real', 'start_frequency_hz': float(message.start_frequency_hz),
            'slope_hz_per_s': swept_hz * rate_hz / n, 'sample_rate_hz': rate_hz,
            'chirp_s': _told(message.chirp_repetition_time_s),
            'period_s': _told(message.frame_repetition_time_s)}


FRAME_TYPES = {
    'IQ': FrameType(_iq, ('header', 'iq', 'complete')),
    'ADCDataCube': FrameType(_adc_data_cube, ('header', 'layout', 'real_data', 'imag_data')),
    'RadarFrameFull': FrameType(_radar_frame_full, (
        'header', 'adc_output_fmt', 'range_bias', 'rx_phase_bias', 'chirp_time', 'chirp_slope',
        'frame_time', 'sample_rate', 'rx', 'tx', 'shape', 'data')),
    'RawFrame': FrameType(_bgt60, ('stamp', 'num_rx', 'num_samples_per_chirp',
                                   'num_chirps_per_frame', 'data'), reliable=False,
                          takes=('axes',)),
    'Float32MultiArray': FrameType(_scans, ('layout', 'data'), takes=('sizes',))}
LATCHED_INFO = ('DeviceConfig',)  # kept for who subscribes later
INFO_TYPES = {'ChirpInfo': _chirp_info, 'DeviceConfig': _device_config}
