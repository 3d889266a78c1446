# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of five radar drivers: a simulated reflector as each publishes it, with its traps."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator

from . import driver_messages as drivers

RAMP = drivers.Ramp(77e9, 40e12, 5e6, 4e-6, 100e-6, 20e-3)
N, LOOPS, FRAMES = 64, 4, 60
TX_M = np.array([[0.0, 0, 0], [0.02, 0, 0]])
RX_M = np.array([[0.0, 0, 0.01], [0.002, 0, 0.01], [0.004, 0, 0.01]])
POINT = (0.4, 5.0, 0.0)
START_NS = 1_763_000_000_000_000_000
LATE_S = 3e-3  # from the end of a frame to its receipt, at least
RADAR = fmcw_parameters(n_samples=N, start_frequency_hz=RAMP.start_frequency_hz,
                        slope_hz_per_s=RAMP.slope_hz_per_s, sample_rate_hz=RAMP.sample_rate_hz,
                        adc_start_s=RAMP.adc_start_s)
REAL = dataclasses.replace(RADAR, waveform=Waveform.FMCW_REAL)
SCANS = RadarParameters(3.95e9, 1.5e9, 16e9, 2 * 3.5 / SPEED_OF_LIGHT, waveform=Waveform.PASSBAND)
FRAME_NS = START_NS + np.rint(np.arange(FRAMES) * RAMP.period_s * 1e9).astype(np.int64)
GENERATOR = np.random.default_rng(11)
# Receipt: the end of the frame, the latency, and a random wait that is now and then small.
JITTER_NS = np.rint(2e6 * GENERATOR.exponential(1.0, FRAMES)).astype(np.int64)
FACTORS = np.exp(1j * np.linspace(-2, 2, 6)) * np.linspace(0.8, 1.2, 6)


def flight(time_s):
    """Platform in metres and its attitude; it accelerates and turns."""
    t = np.asarray(time_s) - 0.6
    position = np.stack([1.5 * t + 0.3 * t**2, 0.02 * np.sin(3 * t), 1 + 0.02 * t], axis=-1)
    return position, Rotation.from_rotvec(np.multiply.outer(0.1 * t, [0, 0, 1]))


def centres(chirp_s, n_tx, frame_ns=FRAME_NS, loops=LOOPS):
    """(P, C, 3) true phase centres: every channel where the platform is when it is sent."""
    start = (frame_ns - START_NS)[:, None] * 1e-9 + chirp_s * n_tx * np.arange(loops)
    tx, rx = [], []
    for k in range(n_tx):
        position, turn = flight(start.reshape(-1) + k * chirp_s)
        for arm in RX_M:
            tx.append(position + turn.apply(TX_M[k]))
            rx.append(position + turn.apply(arm))
    return np.stack(tx, axis=1), np.stack(rx, axis=1)


def cubes(radar, tx_m, rx_m, n, loops=LOOPS):
    """Echoes of one reflector with the sign of the board: (frames, loops, turns, rx, n)."""
    echoes = EchoSimulator(radar, n, compressed=False, points_m=[POINT],
                           amplitudes=[8000.0])(tx_m, rx_m)
    n_tx = tx_m.shape[1] // len(RX_M)
    return echoes.conj().reshape(-1, loops, n_tx, len(RX_M), n), echoes


@dataclasses.dataclass
class Sent:
    """What a driver recorded, and what must come out."""

    kind: str
    messages: list  # (type, topic, recorded_ns, fields)
    description: dict
    samples: np.ndarray
    centres: tuple
    radar: RadarParameters
    frame_ns: np.ndarray
    late_s: float = 0.0


TRUE_M = {n: centres(RAMP.chirp_s, n) for n in (1, 2)}
FMCW_KEYS = {'waveform': 'fmcw', 'start_frequency_hz': 77e9, 'adc_start_s': 4e-6}
ARRAY = {'tx_m': TX_M.tolist(), 'rx_m': RX_M.tolist()}
RECEIVED_NS = (FRAME_NS + round(1e9 * (2 * LOOPS * RAMP.chirp_s + LATE_S)) + JITTER_NS)


def xwr():
    """xwr_ros: stamps of the first chirp, the parameters in ChirpInfo."""
    cube, samples = cubes(RADAR, *TRUE_M[2], N)
    messages = [('xwr_msgs/msg/ChirpInfo', '/xwr/info', int(FRAME_NS[2]),
                 drivers.chirp_info(RAMP, N, LOOPS))]
    messages += [('xwr_msgs/msg/IQ', '/xwr/iq', int(ns) + 10**7, drivers.iq(c, int(ns)))
                 for c, ns in zip(cube, FRAME_NS, strict=True)]
    return Sent('xwr', messages, {'samples': {'topic': '/xwr/iq', 'conjugate': True},
                                  'array': ARRAY, 'frames': {'period_s': RAMP.period_s}},
                samples, TRUE_M[2], RADAR, FRAME_NS)


def cpsl():
    """CPSL: stamps at receipt, parameters nowhere."""
    cube, samples = cubes(RADAR, *TRUE_M[2], N)
    messages = [('raw_radar_msgs/msg/ADCDataCube', '/radar/adc', int(ns),
                 drivers.adc_data_cube(c, int(ns)))
                for c, ns in zip(cube, RECEIVED_NS, strict=True)]
    radar = FMCW_KEYS | {'slope_hz_per_s': 40e12, 'sample_rate_hz': 5e6}
    return Sent('cpsl', messages, {
        'samples': {'topic': '/radar/adc', 'conjugate': True}, 'array': ARRAY, 'radar': radar,
        'frames': {'period_s': RAMP.period_s, 'chirp_s': RAMP.chirp_s, 'latency_s': LATE_S}},
        samples, TRUE_M[2], RADAR, FRAME_NS, late_s=1e-3)


def xwr_raw():
    """xwr_raw_ros: no stamps, Q before I, factors that calibrate, a bias of range."""
    cube, samples = cubes(RADAR, *TRUE_M[2], N)
    # The driver wants the factors multiplied; recorded is what they correct.
    cube = cube / FACTORS.reshape(2, 3)[:, :, None]
    messages = [('xwr_raw_ros/msg/RadarFrameFull', '/radar_data', int(ns),
                 drivers.radar_frame_full(c, RAMP, factors=FACTORS, range_bias_m=0.07))
                for c, ns in zip(cube, RECEIVED_NS, strict=True)]
    radar = dataclasses.replace(RADAR, first_sample_delay_s=-2 * 0.07 / SPEED_OF_LIGHT)
    return Sent('xwr_raw', messages, {
        'samples': {'topic': '/radar_data', 'conjugate': True}, 'array': ARRAY,
        'radar': FMCW_KEYS, 'frames': {'latency_s': LATE_S}},
        samples, TRUE_M[2], radar, FRAME_NS, late_s=1e-3)


def infineon():
    """BGT60: real samples, one transmitter, stamps at receipt."""
    cube, samples = cubes(REAL, *TRUE_M[1], N)
    received = FRAME_NS + round(1e9 * (LOOPS * RAMP.chirp_s + LATE_S)) + JITTER_NS
    messages = [('bgt60tr13c_msgs/msg/DeviceConfig', '/bgt/device_config', START_NS,
                 drivers.device_config(RAMP, N, LOOPS))]
    messages += [('bgt60tr13c_msgs/msg/RawFrame', '/bgt/raw_frame', int(ns),
                  drivers.bgt60(c, int(ns))) for c, ns in zip(cube, received, strict=True)]
    return Sent('infineon', messages, {
        'samples': {'topic': '/bgt/raw_frame'}, 'array': {'rx_m': RX_M.tolist()},
        'radar': {'adc_start_s': 4e-6}, 'frames': {'latency_s': LATE_S}},
        samples, TRUE_M[1], REAL, FRAME_NS, late_s=1e-3)


def p440():
    """P440: a scan of three channels a message, without any time."""
    tx_m, rx_m = centres(0.0, 1, loops=1)
    cube, samples = cubes(SCANS, tx_m, rx_m, 512, loops=1)
    messages = [('std_msgs/msg/Float32MultiArray', '/uwb/scan',
                 int(ns) + round(1e9 * LATE_S) + int(wait), drivers.scan(c))
                for c, ns, wait in zip(cube, FRAME_NS, JITTER_NS, strict=True)]
    return Sent('p440', messages, {
        'samples': {'topic': '/uwb/scan', 'sizes': {'channel': 3}},
        'array': {'rx_m': RX_M.tolist()},
        'radar': {'waveform': 'passband', 'carrier_hz': 3.95e9, 'bandwidth_hz': 1.5e9,
                  'sample_rate_hz': 16e9, 'range_start_m': 3.5},
        'frames': {'period_s': RAMP.period_s, 'latency_s': LATE_S}},
        samples, (tx_m, rx_m), SCANS, FRAME_NS, late_s=1e-3)


DRIVERS = {'xwr': xwr, 'cpsl': cpsl, 'xwr_raw': xwr_raw, 'infineon': infineon, 'p440': p440}
