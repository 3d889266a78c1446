# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""range_compression takes every waveform as it comes, cuts its range window, calibrates."""

from __future__ import annotations

import numpy as np
import pytest
from std_msgs.msg import Float32MultiArray

from msg_conversions import pulse_block, wire
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator


def _blocks():
    """One block of each waveform, and of a sonar: a scatterer at 21.5 m, two channels."""
    common = {'carrier_hz': 5e9, 'bandwidth_hz': 200e6, 'first_sample_delay_s': 0.05e-6}
    ramp = {'start_frequency_hz': 77e9, 'slope_hz_per_s': 10e12, 'sample_rate_hz': 5e6,
            'n_samples': 256, 'adc_start_s': 2e-6}
    radars = [
        (RadarParameters(**common, sample_rate_hz=250e6, pulse_length_s=0.5e-6,
                         chirp_rate_hz_per_s=4e14), 512, False),
        (RadarParameters(**common | {'first_sample_delay_s': 0.14e-6}, sample_rate_hz=200e6,
                         waveform=Waveform.STEPPED_FREQUENCY), 128, False),
        (fmcw_parameters(**ramp), 256, False),
        (fmcw_parameters(**ramp, real_samples=True), 256, False),
        (RadarParameters(**common | {'carrier_hz': 0.5e9}, sample_rate_hz=2e9,
                         waveform=Waveform.PASSBAND), 1024, False),
        (RadarParameters(**common, sample_rate_hz=300e6), 256, True),
        (RadarParameters(300e3, 60e3, 90e3, 2 * 20.0 / 1480.0, 2e-3, 3e7,
                         propagation_speed_m_per_s=1480.0), 1024, False)]
    for number, (radar, n, compressed) in enumerate(radars):
        simulate = EchoSimulator(radar, n, compressed=compressed, points_m=[[21.5, 0.0, 0.0]],
                                 amplitudes=[1.0])
        centres = np.zeros((3, 2, 3))
        centres[:, 1, 1] = 0.1
        counter = 10 * number + np.arange(3)
        yield PulseBlock(radar, compressed, 10**9 * (1 + counter), counter,
                         simulate(centres, centres), centres, centres)


def test_every_waveform_is_compressed_as_its_block_says(start_node, make_observer, tmp_path):
    calibration = ChannelCalibration([1.0, 0.5], [0.0, 1.2], [0.0, 0.4e-9])
    calibration.save(tmp_path / 'channels.yaml')
    node = start_node('range_compression', {
        'near_range': 15.0, 'far_range': 30.0,
        'calibration_file': str(tmp_path / 'channels.yaml')})
    observer = make_observer('pulse_blocks')
    observer.subscribe(Float32MultiArray, 'range_profiles')
    observer.wait(lambda: observer.joined, 'the subscription')
    node.wait_for_log('range_compression', 'subscriber on .*range_profiles joined')
    blocks = list(_blocks())
    observer.send(blocks)
    received = [pulse_block.from_message(m)
                for m in observer.wait_for('range_profiles', len(blocks))]
    for block, got in zip(blocks, received, strict=True):
        sent = wire.from_array(*wire.to_array(block))  # parameters as a message holds them
        expected = RangeCompressor.for_block(
            sent, calibration=calibration, range_window_m=(15.0, 30.0))(sent)
        assert got.compressed and got.radar.waveform == block.radar.waveform
        assert got.radar.propagation_speed_m_per_s == block.radar.propagation_speed_m_per_s
        assert got.radar.first_sample_delay_s == pytest.approx(
            expected.radar.first_sample_delay_s, rel=1e-12)
        np.testing.assert_array_equal(got.counter, block.counter)
        # The same plan and data; the threads of the FFT may differ in the last digit.
        np.testing.assert_allclose(got.samples, expected.samples, rtol=0, atol=1e-6)
        nearest = round((21.5 - got.radar.range_start_m) / got.radar.sample_spacing_m)
        # straight below the peak, at most half a sample of a quarter cell away
        assert np.abs(got.samples[0, 0, nearest]) > 0.8
    observer.wait_for_counters('range_compression', blocks_received=len(blocks),
                               blocks_rejected=0, errors=0)

    # A file that is none is refused when it is set, and the node goes on.
    (tmp_path / 'bad.yaml').write_text('amplitude: [1, 0]\nphase_deg: [0, 0]\ndelay_s: [0, 0]\n')
    done, reason = observer.set_parameter('range_compression', 'calibration_file',
                                          str(tmp_path / 'bad.yaml'))
    assert not done and 'expected positive factors' in reason
    # Without window and calibration: all that the samples reach.
    assert observer.set_parameter('range_compression', 'calibration_file', '') == (True, '')
    for name in ('near_range', 'far_range'):
        assert observer.set_parameter('range_compression', name, 0.0) == (True, '')
    observer.send(blocks[2:3])
    profiles = pulse_block.from_message(observer.wait_for('range_profiles', len(blocks) + 1)[-1])
    spacing_m = profiles.radar.sample_spacing_m
    assert profiles.n_samples * spacing_m == pytest.approx(75.0, abs=40 * spacing_m)
    # Uncalibrated, both channels peak alike; the calibration had doubled the second.
    peaks = np.abs(profiles.samples[0]).max(axis=1)
    assert peaks[1] == pytest.approx(peaks[0], rel=0.1)
    assert np.abs(received[2].samples[0, 1]).max() > 1.7 * peaks[1]
