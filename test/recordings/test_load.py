# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated data, stored as radars and loggers store them, come out as the pulses they were."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from sar_imaging.recordings import DescriptionError, load
from sar_imaging.recordings.times import EPOCH_NS
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator

N, P = 64, 12
FMCW = {'start_frequency_hz': 77e9, 'slope_hz_per_s': 30e12, 'sample_rate_hz': 4e6,
        'adc_start_s': 3e-6}
RADAR = fmcw_parameters(n_samples=N, **FMCW)
POINT = [1.0, 6.0, 0.2]
TX_M = np.array([[0.0, 0, 0], [0.008, 0, 0]])
RX_M = np.array([[0.02, 0, 0], [0.022, 0, 0], [0.024, 0, 0]])
TRACK = np.stack([0.01 * np.arange(P), 0 * np.arange(P), 1 + 0 * np.arange(P)], axis=-1)
SCENE = {'centre_m': [0, 6, 0], 'size_m': [4, 4], 'spacing_m': 0.05}


def array_of(position_m, tx_m=TX_M, rx_m=RX_M):
    """(P, C, 3) phase centres of all pairs, transmitter by transmitter."""
    return (position_m[:, None] + np.repeat(tx_m, len(rx_m), axis=0),
            position_m[:, None] + np.tile(rx_m, (len(tx_m), 1)))


def echoes(tx_m, rx_m, radar=RADAR, n=N, amplitude=1000.0):
    return EchoSimulator(radar, n, compressed=False, points_m=[POINT],
                         amplitudes=[amplitude])(tx_m, rx_m)


BLOCK_CENTRES = array_of(TRACK)
SAMPLES = echoes(*BLOCK_CENTRES).astype(np.complex64)  # (P, 6, N)


def described(tmp_path, **parts):
    base = {'samples': {'file': 'd.npz', 'variable': 's', 'axes': ['pulse', 'channel', 'sample']},
            'radar': {'waveform': 'fmcw', **FMCW}, 'times': {'interval_s': 0.1},
            'positions': {'line': {'first_m': TRACK[0].tolist(), 'last_m': TRACK[-1].tolist()}},
            'array': {'tx_m': TX_M.tolist(), 'rx_m': RX_M.tolist()}, 'scene': SCENE}
    for key, value in parts.items():
        if value is None:
            base.pop(key, None)
        elif isinstance(value, dict) and key in base:
            base[key] = {k: v for k, v in (base[key] | value).items() if v is not None}
        else:
            base[key] = value
    path = tmp_path / 'd.yaml'
    path.write_text(yaml.safe_dump(base))
    return path


def check(block: PulseBlock, samples=SAMPLES, atol=0.0):
    np.testing.assert_allclose(block.samples, samples, rtol=0, atol=atol)
    np.testing.assert_allclose(block.tx_m, BLOCK_CENTRES[0], atol=1e-12)
    np.testing.assert_allclose(block.rx_m, BLOCK_CENTRES[1], atol=1e-12)
    assert block.radar == RADAR


@pytest.mark.parametrize(('axes', 'conjugate'), [
    (['pulse', 'tx', 'rx', 'sample'], False), (['sample', 'rx', 'pulse', 'tx'], True),
    (['rx', 'sample', 'tx', 'pulse'], False), (['pulse', 'pulse', 'tx', 'rx', 'sample'], True)])
def test_axes_of_every_order_and_both_signs(tmp_path, axes, conjugate):
    shape = {'pulse': P, 'tx': 2, 'rx': 3, 'sample': N}
    stored = SAMPLES.reshape(*shape.values())
    if axes.count('pulse') == 2:
        stored = stored.reshape(3, 4, 2, 3, N)
    else:
        stored = stored.transpose([list(shape).index(a) for a in axes])
    np.savez(tmp_path / 'd.npz', s=stored.conj() if conjugate else stored)
    check(load(described(tmp_path, samples={'axes': axes, 'conjugate': conjugate})).block)


@pytest.mark.parametrize('iq', ['pairs', 'iiqq'])
@pytest.mark.parametrize('header', [0, 96])
def test_raw_whole_numbers_in_both_orders(tmp_path, iq, header):
    parts = np.stack([SAMPLES.real, SAMPLES.imag], axis=-1).round().astype('<i2')
    whole = parts[..., 0] + 1j * parts[..., 1]
    if iq == 'iiqq':
        parts = parts.reshape(P, 6, N // 2, 2, 2).swapaxes(-1, -2)
    (tmp_path / 'adc.bin').write_bytes(bytes(header) + np.ascontiguousarray(parts).tobytes())
    path = described(tmp_path, samples={
        'file': 'adc.bin', 'variable': None, 'dtype': 'int16', 'iq': iq, 'header_bytes': header,
        'sizes': {'channel': 6, 'sample': N}})
    check(load(path).block, whole)
    (tmp_path / 'adc.bin').write_bytes(bytes(header + 1000))
    with pytest.raises(DescriptionError, match='adc.bin holds 1000 bytes of samples; expected a '
                       'multiple of 1536, one pulse of 6 x 64 x 2 int16'):
        load(path)


def test_an_axis_of_its_own_for_i_and_q(tmp_path):
    np.savez(tmp_path / 'd.npz', s=np.stack([SAMPLES.real, SAMPLES.imag], axis=1))
    check(load(described(tmp_path, samples={
        'axes': ['pulse', 'iq', 'channel', 'sample'], 'iq': 'pairs'})).block)


def test_several_files_are_one_recording(tmp_path):
    np.savez(tmp_path / 'b1.npz', s=SAMPLES[:5], t=0.1 * np.arange(5), f=77e9)
    np.savez(tmp_path / 'b2.npz', s=SAMPLES[5:], t=0.1 * np.arange(5, P), f=77e9)
    block = load(described(tmp_path, samples={'file': 'b*.npz'},
                           radar={'start_frequency_hz': 'f'},
                           times={'interval_s': None, 'variable': 't'})).block
    check(block)
    np.testing.assert_array_equal(block.stamp_ns - EPOCH_NS, 100_000_000 * np.arange(P))


def test_times_in_nanoseconds_since_1970_stay_exact(tmp_path):
    stamp = 1_763_000_000_123_456_789 + 100_000_001 * np.arange(P)
    np.savez(tmp_path / 'd.npz', s=SAMPLES, t=stamp, n=[0, 1, *range(5, P + 3)])
    block = load(described(tmp_path, times={'interval_s': None, 'variable': 't', 'unit_s': 1e-9,
                                            'counter': 'n'})).block
    np.testing.assert_array_equal(block.stamp_ns, stamp)
    np.testing.assert_array_equal(block.counter, [0, 1, *range(5, P + 3)])


def test_fmcw_by_carrier_and_bandwidth(tmp_path):
    np.savez(tmp_path / 'd.npz', s=SAMPLES)
    path = described(tmp_path, radar={'waveform': 'fmcw', 'start_frequency_hz': None,
                                      'slope_hz_per_s': None, 'adc_start_s': None,
                                      'carrier_hz': RADAR.carrier_hz,
                                      'bandwidth_hz': RADAR.bandwidth_hz})
    radar = load(path).block.radar
    assert radar.carrier_hz == pytest.approx(RADAR.carrier_hz, rel=1e-14)
    assert radar.chirp_rate_hz_per_s == pytest.approx(30e12, rel=1e-14)


def test_phase_history_compensated_pulse_by_pulse_gets_one_reference(tmp_path):
    radar = RadarParameters(9.6e9, 256e6, 256e6, 0.0, waveform=Waveform.STEPPED_FREQUENCY)
    track_m = TRACK * [300.0, 1, 500] - [0, 4000.0, 0]
    frequency = 9.6e9 + 4e6 * (np.arange(N) - (N - 1) / 2)
    away = np.linalg.norm(track_m - POINT, axis=1) - np.linalg.norm(track_m, axis=1)
    history = np.exp(-4j * np.pi / SPEED_OF_LIGHT * frequency * away[:, None])
    ranges = np.linalg.norm(track_m, axis=1).astype(np.float32)
    np.savez(tmp_path / 'd.npz', s=history, f=frequency, p=track_m, r=ranges)
    path = described(
        tmp_path, samples={'axes': ['pulse', 'sample']}, array=None,
        radar={**dict.fromkeys(FMCW), 'waveform': 'stepped_frequency', 'frequencies_hz': 'f',
               'compensated_to_m': [0, 0, 0], 'compensated_range_m': 'r'},
        positions={'line': None, 'variable': 'p'})
    block = load(path).block
    expected = EchoSimulator(
        RadarParameters(9.6e9, 256e6, 256e6, block.radar.first_sample_delay_s,
                        waveform=radar.waveform), N, compressed=False, points_m=[POINT],
        amplitudes=[1.0])(block.tx_m, block.rx_m)
    np.testing.assert_allclose(block.samples, expected, atol=2e-5)
    np.savez(tmp_path / 'd.npz', s=history, f=frequency, p=track_m, r=ranges + 1)
    with pytest.raises(DescriptionError, match='it differs by 1.00.. m: correct '
                       'compensated_to_m'):
        load(path)
    uneven = 9.4e9 + 4e6 * np.arange(N) ** 1.01
    np.savez(tmp_path / 'd.npz', s=history, f=uneven, p=track_m, r=ranges)
    with pytest.raises(DescriptionError, match='expected a uniform grid'):
        load(path)


def flight(time_s):
    """A platform that turns and accelerates."""
    position = np.stack([2.0 * time_s + 0.5 * time_s**2, 0.1 * np.sin(3 * time_s),
                         1 + 0.2 * time_s], axis=-1)
    return position, Rotation.from_rotvec(np.outer(0.3 * time_s, [0, 0, 1]))


def test_transmitters_in_turn_are_where_the_platform_is_then(tmp_path):
    """TDM with poses on another clock: phase centres in closed form at each channel's time."""
    sent_s, pose_s = 0.5 + 0.02 * np.arange(P), np.arange(0.0, 1.5, 0.005)
    turn_s, offset_s, lever = 60e-6, 3.25, np.array([0.3, -0.1, 0.2])
    turns = np.array([1, 0])  # the second transmitter sends first
    centres = []
    for k in range(6):
        at = sent_s + turn_s * turns[k // 3]
        position, attitude = flight(at)
        centres.append([position + attitude.apply(lever + arm) for arm in
                        (TX_M[k // 3], RX_M[k % 3])])
    tx_m, rx_m = np.array(centres).transpose(1, 2, 0, 3)
    position, attitude = flight(pose_s)
    np.savez(tmp_path / 'd.npz', s=echoes(tx_m, rx_m), t=sent_s, pt=pose_s + offset_s,
             p=position, q=attitude.as_quat())
    path = described(
        tmp_path, positions=None, times={'interval_s': None, 'variable': 't'},
        poses={'times': 'pt', 'positions': 'p', 'quaternions': 'q'},
        alignment={'time_offset_s': offset_s, 'lever_arm_m': lever.tolist()},
        array={'turn_interval_s': turn_s, 'turn_order': turns.tolist()})
    loaded = load(path)
    assert loaded.poses is None and loaded.alignment is None
    # Cubic interpolation of poses every 5 ms: a micrometre; a turn moves the radar by 150 um.
    np.testing.assert_allclose(loaded.block.tx_m, tx_m, atol=2e-6)
    np.testing.assert_allclose(loaded.block.rx_m, rx_m, atol=2e-6)
    with pytest.raises(DescriptionError, match=r'need poses from 10.5\d* to .* correct '
                       r'alignment.time_offset_s .*; 2.75\d* to 4.0\d* s would fit'):
        load(path, changes={'alignment.time_offset_s': 10.0})
    with pytest.raises(DescriptionError, match='0.001 times those of the pulses, or 1000 times '
                       'those of the poses, would fit; correct times.unit_s'):
        load(path, changes={'times.unit_s': 1e3})
    with pytest.raises(DescriptionError, match='the pulses last 2.2 s, the poses 1.495 s'):
        load(path, changes={'times.unit_s': 10})


def test_poses_on_their_own_clock_stay_poses(tmp_path):
    pose_s = np.arange(0.0, 20.0, 0.01)
    position, attitude = flight(pose_s)
    np.savez(tmp_path / 'd.npz', s=SAMPLES[:, :1], pt=pose_s, p=position, q=attitude.as_quat())
    loaded = load(described(
        tmp_path, array=None, positions=None, times={'first_s': 6.0},
        poses={'times': 'pt', 'positions': 'p', 'quaternions': 'q'},
        alignment={'lever_arm_m': [0.1, 0, 0], 'range_bias_m': 0.3, 'time_offset_s': 2.0}))
    assert not loaded.block.has_positions and loaded.alignment.range_bias_m == 0.3
    assert loaded.alignment.tx_m.tolist() == [[0.1, 0, 0]]
    span_s = (loaded.poses.stamp_ns[[0, -1]] - EPOCH_NS) * 1e-9
    np.testing.assert_allclose(span_s, [5.0, 12.1], atol=0.011)  # three seconds around
    assert loaded.warnings == ()


def test_a_platform_that_rests_is_told(tmp_path):
    pose_s = np.arange(0.0, 20.0, 0.01)
    x = np.clip(pose_s - 6.5, 0.0, 1.0)
    np.savez(tmp_path / 'd.npz', s=SAMPLES[:, :1], pt=pose_s, zero=np.zeros((len(x), 3)),
             p=np.stack([x, 0 * x, 0 * x], axis=-1))
    path = described(tmp_path, array=None, positions=None,
                     times={'first_s': 6.0, 'interval_s': 0.3},
                     poses={'times': 'pt', 'positions': 'p'})
    [warning] = load(path).warnings
    assert 'moves from 6.5 to 7.5 s of the radar clock: times.use_s: [6.5, 7.5]' in warning
    assert load(path, changes={'times.use_s': [6.5, 7.5]}).warnings == ()
    [warning] = load(path, changes={'poses.positions': 'zero'}).warnings
    assert 'stands still while the radar sends' in warning


def test_poses_that_are_too_far_apart_are_told(tmp_path):
    pose_s = np.array([0.0, 2.0, 7.0, 7.1, 7.2, 9.0])
    np.savez(tmp_path / 'd.npz', s=SAMPLES[:, :1], pt=pose_s,
             p=np.stack([pose_s, 0 * pose_s, 0 * pose_s], axis=-1))
    path = described(tmp_path, array=None, positions=None, times={'first_s': 6.0},
                     poses={'times': 'pt', 'positions': 'p'})
    [warning] = load(path).warnings
    # those at 7.0 and 7.1 s have poses around them
    assert warning.startswith('10 of 12 pulses lie between poses that are up to 5 s apart; exp')


def test_times_in_a_file_of_their_own(tmp_path):
    np.savez(tmp_path / 'd.npz', s=SAMPLES)
    (tmp_path / 't.csv').write_text('gps\n' + ''.join(f'{100 * i}\n' for i in range(P)))
    block = load(described(tmp_path, times={
        'interval_s': None, 'file': 't.csv', 'variable': 'gps', 'unit_s': 1e-3})).block
    np.testing.assert_array_equal(block.stamp_ns - EPOCH_NS, 100_000_000 * np.arange(P))


def test_calibration_is_removed(tmp_path):
    errors = ChannelCalibration(np.linspace(0.8, 1.2, 6), np.linspace(-1, 1, 6), np.zeros(6))
    errors.save(tmp_path / 'c.yaml')
    wrong = SAMPLES * (errors.amplitude * np.exp(1j * errors.phase_rad))[:, None]
    np.savez(tmp_path / 'd.npz', s=wrong)
    path = described(tmp_path, calibration='c.yaml')
    check(load(path).block, atol=2e-3)  # complex64 of 1000
    ChannelCalibration(np.ones(6), np.zeros(6), np.full(6, 1e-10)).save(tmp_path / 'c.yaml')
    with pytest.raises(DescriptionError, match='give it to range_compression as'):
        load(path)
    ChannelCalibration.none(5).save(tmp_path / 'c.yaml')
    with pytest.raises(DescriptionError, match='calibration: .*6 channels'):
        load(path)


@pytest.mark.parametrize(('changes', 'message'), [
    ({'samples.axes': ['pulse', 'sample']}, 'samples.axes: expected 3 axes for the shape'),
    ({'samples.axes': ['pulse', 'rx', 'chan']}, 'samples.axes: expected a list of pulse, tx'),
    ({'samples.axes': ['pulses', 'channel', 'sample']}, 'pulses: did you mean pulse?'),
    ({'samples.scale': 0}, 'samples.scale: expected a factor other than 0'),
    ({'samples.axes': ['channel', 'rx', 'sample']}, 'samples.axes: expected an axis pulse'),
    ({'samples.axes': ['pulse', 'sample', 'sample']}, 'each axis once'),
    ({'samples.iq': 'iiqq'}, 'samples.iq: expected complex for complex numbers'),
    ({'samples.variable': 'x'}, 'd.npz has no variable x; it has b, s'),
    ({'samples.file': 'x.npz'}, 'holds no file x.npz; name the folder with the data'),
    ({'samples.file': ''}, 'is a folder; expected a file'),
    ({'samples.scale': 1e300}, '12 of 12 pulses hold NaN or infinity'),
    ({'samples.sha256': '12'}, 'expected the file that the description was made for'),
    ({'radar.slope_hz_per_s': 30}, 'MHz/us'),
    ({'radar.pulse_length_s': 1e-6}, 'no such key for the waveform fmcw, got 1e-06'),
    ({'radar.carrier_hz': 77e9}, 'not start_frequency_hz besides carrier_hz'),
    ({'radar.sample_rate': 4e6}, 'unknown key radar.sample_rate; did you mean sample_rate_hz?'),
    ({'radar.waveform': 'fmcw_real'}, 'samples.iq: expected real samples of the waveform'),
    ({'array.rx_m': [[0, 0, 0]]}, 'antennas for 6 channels'),
    ({'array.turn_order': [0, 1]}, 'array.turn_interval_s: expected seconds'),
    ({'array.turn_interval_s': 1e-4, 'array.turn_order': [0, 2]}, 'the turn of each transmitter'),
    ({'times.interval_s': -1}, 'times.interval_s: expected seconds from pulse to pulse'),
    ({'times.use_s': [50, 60]}, 'expected an interval with two pulses or more, within 0 to 1.1 s'),
    ({'times.use_s': [0, 0.05]}, 'expected an interval with two pulses or more'),
    ({'times.use_s': 3}, 'times.use_s: expected 2 numbers, got 3'),
    ({'times.variable': 'b', 'times.unit_s': 1}, 'a time of 1.7e+18 s; expected finite seconds'),
    ({'times.variable': 't'}, 'times: d.npz has no variable t; it has b, s'),
    ({'times.variable': 's'}, 's holds complex numbers'),
    ({'times': {}}, 'times.variable: expected the name of a variable with the times of'),
    ({'positions.arc': {}}, 'exactly one of variable, variables'),
    ({'alignment.time_offset_s': 1}, 'no offset for positions'),
    ({'poses.times': 't'}, 'either positions or poses'),
    ({'antenna': {'pattern': 'sinc', 'azimuth_width_deg': 9, 'pointing': {'kind': 'track'}}},
     'antenna.pointing: expected side of the kind track'),
    ({'scene.size_m': [-1, 1]}, 'scene.size_m: expected positive lengths'),
    ({'scene.spacing_m': 50}, 'scene.spacing_m: expected metres from pixel to pixel, at most'),
    ({'scene.spacing_m': 1e-6}, 'expected a map of at most 1e+10 pixels, got 1e-06; 4 m by 4 m'),
    ({'scene.spacing_m': True}, 'scene.spacing_m: expected numbers, or the name'),
    ({'scene.window': 'hanning'}, "scene.window: expected a window, got 'hanning'; window="),
    ({'scene.scatterers': {'a': [9, 9, 0]}}, 'expected a map with all scatterers'),
    ({'scene.scatterers': {'a': [9, 9]}}, 'scene.scatterers.a: expected [x, y, z] or')])
def test_what_does_not_fit_is_told_in_one_line(tmp_path, changes, message):
    np.savez(tmp_path / 'd.npz', s=SAMPLES, b=1.7e18 + np.arange(P))
    with pytest.raises(DescriptionError) as error:
        load(described(tmp_path), changes=changes)
    assert message in str(error.value) and '\n' not in str(error.value)


def test_positions_and_times_of_another_number_are_told(tmp_path):
    np.savez(tmp_path / 'd.npz', s=SAMPLES, p=TRACK[:5], t=np.arange(5.0), r=-np.arange(P))
    for part, message in ((
            {'positions': {'line': None, 'variable': 'p'}}, 'one position for each of 12 pulses'),
            ({'times': {'interval_s': None, 'variable': 't'}}, 'one time for each of 12 pulses'),
            ({'times': {'interval_s': None, 'variable': 'r'}}, 'times that ascend')):
        with pytest.raises(DescriptionError, match=message):
            load(described(tmp_path, **part))


def test_pulses_that_are_not_finite_are_left_out(tmp_path):
    samples = SAMPLES.copy()
    samples[3, 1, 2] = np.nan
    np.savez(tmp_path / 'd.npz', s=samples)
    loaded = load(described(tmp_path))
    left = np.delete(np.arange(P), 3)
    np.testing.assert_array_equal(loaded.block.samples, SAMPLES[left])
    np.testing.assert_allclose(loaded.block.tx_m, BLOCK_CENTRES[0][left], atol=1e-12)
    assert loaded.block.counter.tolist() == left.tolist()
    assert loaded.warnings == ('1 of 12 pulses hold NaN or infinity and are left out, the first '
                               'is number 3',)


def test_scene_without_a_grid_lies_around_its_scatterers(tmp_path):
    np.savez(tmp_path / 'd.npz', s=SAMPLES, places=[[0.0, 6, 1], [2.0, 8, 1]])
    scene = load(described(tmp_path, scene={'size_m': None, 'centre_m': None, 'spacing_m': None,
                                            'scatterers': 'places'})).scene
    assert scene.grid.centre_m == (1.0, 7.0, 1.0)
    assert [s['name'] for s in scene.scatterers] == ['reflector_1', 'reflector_2']
    with pytest.raises(DescriptionError, match='scene.size_m: expected the size'):
        load(described(tmp_path, scene=dict.fromkeys(SCENE)))
