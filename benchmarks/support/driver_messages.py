# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Raw messages as radar drivers publish them, from simulated echoes, for tests.

A cube holds complex samples (loops, turns, receivers, samples) with the sign of the board: a
longer delay turns forwards, as with the sideband that TI boards keep.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

_DIMENSION = 'string label\nuint32 size\nuint32 stride\n'
_HEADER = 'std_msgs/Header header\n'
# Written from what the packages document; only names and types count.
DEFINITIONS = {
    'xwr_msgs/msg/IQ': _HEADER + 'std_msgs/Int16MultiArray iq\nbool complete\n',
    'xwr_msgs/msg/ChirpInfo': _HEADER + ''.join(
        f'float32 {name}\n' for name in ('frequency', 'idle_time', 'adc_start_time',
                                         'ramp_end_time', 'tx_start_time', 'freq_slope'))
    + 'uint16 adc_samples\nuint16 sample_rate\nuint16 frame_length\n',
    'raw_radar_msgs/msg/MultiArrayDimension': _DIMENSION,
    'raw_radar_msgs/msg/MultiArrayLayout':
        'raw_radar_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n',
    'raw_radar_msgs/msg/ADCDataCube': _HEADER + 'raw_radar_msgs/MultiArrayLayout layout\n'
        'int16[] real_data\nint16[] imag_data\n',
    'xwr_raw_ros/msg/RadarFrameFull': _HEADER + 'string platform\nuint8 adc_output_fmt\n'
        'float32 range_bias\nfloat32[] rx_phase_bias\n' + ''.join(
            f'float32 {name}\n' for name in (
                'chirp_time', 'chirp_slope', 'frame_time', 'velocity_max', 'velocity_res',
                'sample_rate', 'range_max', 'range_res'))
        + 'uint8[] rx\nuint8[] tx\nuint32[] shape\nint16[] data\n',
    'bgt60tr13c_msgs/msg/RawFrame': 'builtin_interfaces/Time stamp\nuint8 num_rx\n'
        'uint16 num_samples_per_chirp\nuint16 num_chirps_per_frame\nfloat32[] data\n',
    'bgt60tr13c_msgs/msg/DeviceConfig': 'uint32 sample_rate_hz\nuint32 rx_mask\nuint32 tx_mask\n'
        'uint8 if_gain_db\nuint8 tx_power_level\nfloat64 start_frequency_hz\n'
        'float64 end_frequency_hz\nuint16 num_chirps_per_frame\nuint16 num_samples_per_chirp\n'
        'float32 chirp_repetition_time_s\nfloat32 frame_repetition_time_s\nstring mimo_mode\n'}


@dataclasses.dataclass(frozen=True)
class Ramp:
    """Numbers of the simulated radar, as data sheets have them; hertz and seconds."""

    start_frequency_hz: float
    slope_hz_per_s: float
    sample_rate_hz: float
    adc_start_s: float
    chirp_s: float
    period_s: float


def _stamp(ns: int) -> dict:
    return {'sec': ns // 10**9, 'nanosec': ns % 10**9}


def _header(ns: int) -> dict:
    return {'stamp': _stamp(ns), 'frame_id': 'radar'}


def _layout(labels, sizes) -> dict:
    strides = np.cumprod([1, *sizes[::-1]])[1:][::-1]
    return {'dim': [{'label': label, 'size': int(size), 'stride': int(stride)}
                    for label, size, stride in zip(labels, sizes, strides, strict=True)],
            'data_offset': 0}


def _whole(values) -> np.ndarray:
    return np.rint(values).astype(np.int16)


def iq(cube: np.ndarray, stamp_ns: int, complete: bool = True) -> dict:
    """xwr_msgs/IQ: I0 I1 Q0 Q1 along the last axis, whose size counts numbers."""
    pairs = cube.reshape(*cube.shape[:-1], -1, 2)
    numbers = _whole(np.concatenate([pairs.real, pairs.imag], axis=-1))
    sizes = (*cube.shape[:-1], 2 * cube.shape[-1])
    return {'header': _header(stamp_ns), 'complete': complete,
            'iq': {'layout': _layout(('chirp', 'tx', 'rx', 'sample'), sizes),
                   'data': numbers.reshape(-1)}}


def chirp_info(ramp: Ramp, n_samples: int, n_loops: int) -> dict:
    """xwr_msgs/ChirpInfo: GHz, MHz/us, kHz, us."""
    end_us = 1e6 * (ramp.adc_start_s + n_samples / ramp.sample_rate_hz) + 1.0
    return {'header': _header(0), 'frequency': ramp.start_frequency_hz / 1e9,
            'idle_time': 1e6 * ramp.chirp_s - end_us, 'adc_start_time': 1e6 * ramp.adc_start_s,
            'ramp_end_time': end_us, 'tx_start_time': 1.0,
            'freq_slope': ramp.slope_hz_per_s / 1e12, 'adc_samples': n_samples,
            'sample_rate': round(ramp.sample_rate_hz / 1e3), 'frame_length': n_loops}


def adc_data_cube(cube: np.ndarray, stamp_ns: int) -> dict:
    """raw_radar_msgs/ADCDataCube: real and imaginary parts of rx_channel, sample, chirp."""
    turned = cube.reshape(-1, *cube.shape[2:]).transpose(1, 2, 0)
    return {'header': _header(stamp_ns),
            'layout': _layout(('rx_channel', 'sample', 'chirp'), turned.shape),
            'real_data': _whole(turned.real).reshape(-1),
            'imag_data': _whole(turned.imag).reshape(-1)}


def radar_frame_full(cube: np.ndarray, ramp: Ramp, *, factors: np.ndarray,
                     range_bias_m: float = 0.0) -> dict:
    """xwr_raw_ros/RadarFrameFull: Q0 Q1 I0 I1, no time; antennas 0 and 2 of three send."""
    n_loops, n_tx, n_rx, n = cube.shape
    pairs = cube.reshape(n_loops * n_tx, n_rx, -1, 2)
    numbers = _whole(np.concatenate([pairs.imag, pairs.real], axis=-1))
    tx, rx = [1, 0, 1][:2 * n_tx - 1], [1] * n_rx + [0]
    bias = np.ones((len(tx), len(rx)), complex)
    bias[np.ix_(np.flatnonzero(tx), np.flatnonzero(rx))] = factors.reshape(n_tx, n_rx)
    return {'header': _header(0), 'platform': 'xWR18xx', 'adc_output_fmt': 1,
            'range_bias': range_bias_m,
            'rx_phase_bias': bias.reshape(-1).view(float).astype(np.float32),
            'chirp_time': 1e6 * ramp.chirp_s, 'chirp_slope': ramp.slope_hz_per_s,
            'frame_time': 1e3 * ramp.period_s, 'velocity_max': 0.0, 'velocity_res': 0.0,
            'sample_rate': ramp.sample_rate_hz, 'range_max': 0.0, 'range_res': 0.0,
            'rx': np.array(rx, np.uint8), 'tx': np.array(tx, np.uint8),
            'shape': np.array([n_loops * n_tx, n_rx, n], np.uint32),
            'data': numbers.reshape(-1)}


def bgt60(cube: np.ndarray, stamp_ns: int) -> dict:
    """bgt60tr13c_msgs/RawFrame: real parts of rx, sample, chirp."""
    turned = cube[:, 0].real.transpose(1, 2, 0)
    n_rx, n, n_chirps = turned.shape
    return {'stamp': _stamp(stamp_ns), 'num_rx': n_rx, 'num_samples_per_chirp': n,
            'num_chirps_per_frame': n_chirps, 'data': turned.astype(np.float32).reshape(-1)}


def device_config(ramp: Ramp, n_samples: int, n_chirps: int) -> dict:
    """bgt60tr13c_msgs/DeviceConfig."""
    swept_hz = ramp.slope_hz_per_s * n_samples / ramp.sample_rate_hz
    return {'sample_rate_hz': round(ramp.sample_rate_hz), 'rx_mask': 5, 'tx_mask': 1,
            'if_gain_db': 33, 'tx_power_level': 31, 'start_frequency_hz': ramp.start_frequency_hz,
            'end_frequency_hz': ramp.start_frequency_hz + swept_hz,
            'num_chirps_per_frame': n_chirps, 'num_samples_per_chirp': n_samples,
            'chirp_repetition_time_s': ramp.chirp_s, 'frame_repetition_time_s': ramp.period_s,
            'mimo_mode': 'off'}


def scan(cube: np.ndarray) -> dict:
    """std_msgs/Float32MultiArray: the real samples of one scan, no labels and no time."""
    return {'layout': {'dim': [], 'data_offset': 0}, 'data': cube.real.astype(np.float32).ravel()}


def fill(make: Callable[[str], object], fields: dict, name: str, types: Callable) -> object:
    """A message of a type from nested fields.

    Parameters
    ----------
    make : callable
        Gives the class of a message by its name, such as ``'std_msgs/msg/Header'``.
    fields : dict
        Values; what is absent is 0.
    name : str
        Of the type.
    types : callable
        Gives, by the name of a type, its fields: names, each with the name of a message type (or
        None) and whether it is a sequence.
    """
    values = {}
    for field, inner, many in types(name):
        value = fields.get(field, 0)
        if inner is not None:
            value = ([fill(make, v, inner, types) for v in value] if many
                     else fill(make, value, inner, types))
        values[field] = value
    return make(name)(**values)


def odometry(position_m, stamp_ns: int) -> dict:
    """nav_msgs/Odometry of a platform that does not turn."""
    zero = {'x': 0.0, 'y': 0.0, 'z': 0.0}
    place = dict(zip('xyz', map(float, position_m), strict=True))
    return {'header': {**_header(stamp_ns), 'frame_id': 'odom'}, 'child_frame_id': 'base_link',
            'pose': {'pose': {'position': place, 'orientation': {**zero, 'w': 1.0}},
                     'covariance': np.zeros(36)},
            'twist': {'twist': {'linear': zero, 'angular': zero}, 'covariance': np.zeros(36)}}


def record(path, messages, ros1: bool = False) -> None:
    """Write a bag with the definitions of the messages in it.

    Parameters
    ----------
    path : path
        File of a ROS 1 bag, or folder of a rosbag2.
    messages : sequence of tuples
        Type, topic, time of recording in nanoseconds and fields of each, in their order.
    ros1 : bool
        Whether it is a ROS 1 bag.
    """
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))

    def fields_of(name):
        for field, (kind, detail) in store.fielddefs[name][1]:
            many = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
            inner = detail[0] if many else (kind, detail)
            yield field, inner[1] if inner[0] == Nodetype.NAME else None, many

    if ros1:
        from rosbags.rosbag1 import Writer
        writer = Writer(path)
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        connections = {}
        for name, topic, ns, fields in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            message = fill(store.types.__getitem__, fields, name, fields_of)
            serialise = store.serialize_ros1 if ros1 else store.serialize_cdr
            writer.write(connections[topic], ns, serialise(message, name))
