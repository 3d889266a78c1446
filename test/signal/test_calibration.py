# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Channel calibrations: applied to profiles and raw pulses, saved and loaded."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.signal.calibration import CalibrationError, ChannelCalibration
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

# The envelopes are late by up to 0.4 of a cell 1/B; phases and amplitudes are those of a board.
ERRORS = ChannelCalibration([1.0, 0.7, 1.6], [0.3, -2.2, 1.1], [0.0, 0.4 / 300e6, -0.25 / 300e6])


def _radar(kind):
    if kind == 'fmcw':
        return fmcw_parameters(start_frequency_hz=9.85e9, slope_hz_per_s=-5.859375e12,
                               sample_rate_hz=5e6, n_samples=256, adc_start_s=1e-6), 256
    start_s = 2 * 10.0 / SPEED_OF_LIGHT
    common = {'carrier_hz': 10e9, 'bandwidth_hz': 300e6, 'first_sample_delay_s': start_s}
    if kind == 'lfm':
        return RadarParameters(**common, sample_rate_hz=400e6, pulse_length_s=0.5e-6,
                               chirp_rate_hz_per_s=6e14), 512
    if kind == 'stepped':
        return RadarParameters(**common, sample_rate_hz=300e6,
                               waveform=Waveform.STEPPED_FREQUENCY), 128
    if kind == 'passband':
        return RadarParameters(**common | {'carrier_hz': 1e9}, sample_rate_hz=4e9,
                               waveform=Waveform.PASSBAND), 2000
    return RadarParameters(**common, sample_rate_hz=600e6), 256


def _block(kind, errors):
    """A scatterer at 30 m on channels with errors: the echo later, its carrier phase as told."""
    radar, n = _radar(kind)
    samples = []
    for g, phi, late_s in zip(errors.amplitude, errors.phase_rad, errors.delay_s, strict=True):
        point = [30.0 + SPEED_OF_LIGHT * late_s / 2, 0.0, 0.0]
        # The later echo turns at the carrier, too, which the phase of the calibration excludes.
        a = g * np.exp(1j * (phi + 2 * np.pi * radar.carrier_hz * late_s))
        simulate = EchoSimulator(radar, n, compressed=kind == 'compressed', points_m=[point],
                                 amplitudes=[a])
        samples.append(simulate(np.zeros((1, 1, 3)), np.zeros((1, 1, 3)))[0, 0])
    centres = np.zeros((1, len(samples), 3))
    return PulseBlock(radar, kind == 'compressed', [0], [0], np.array(samples)[None], centres,
                      centres)


def _error_db(got, expected):
    return 10 * np.log10(np.sum(np.abs(got - expected) ** 2) / np.sum(np.abs(expected) ** 2))


@pytest.mark.parametrize(('kind', 'limit_db'), [
    # float32: measured -130 to -140 dB
    ('stepped', -120.0), ('compressed', -120.0), ('passband', -120.0), ('lfm', -120.0),
    # bands displaced by K delta, 3e-5 of their width, leave other sidelobes: measured -63 dB
    ('fmcw', -55.0)])
def test_compression_removes_the_errors_of_every_waveform(kind, limit_db):
    block, ideal = _block(kind, ERRORS), _block(kind, ChannelCalibration.none(3))
    got = RangeCompressor.for_block(block, calibration=ERRORS)(block).samples
    expected = RangeCompressor.for_block(ideal)(ideal).samples
    assert _error_db(RangeCompressor.for_block(block)(block).samples, expected) > -3.0
    assert _error_db(got, expected) < limit_db


def test_profiles_are_calibrated_as_raw_pulses_are():
    block = _block('compressed', ERRORS)
    expected = _block('compressed', ChannelCalibration.none(3))
    assert _error_db(ERRORS.apply(block).samples, expected.samples) < -110.0
    # Without delays amplitude and phase suffice, as weights of a backprojector do.
    flat = dataclasses.replace(ERRORS, delay_s=np.zeros(3))
    block = _block('compressed', flat)
    assert _error_db(flat.apply(block).samples, expected.samples) < -110.0
    assert _error_db(block.samples * flat.weights[:, None], expected.samples) < -110.0


def test_two_calibrations_in_a_row_are_one():
    block = _block('compressed', ERRORS)
    other = ChannelCalibration([2.0, 1.0, 0.5], [3.0, -2.0, 0.1], [1e-9, 0.0, -2e-9])
    together = ERRORS.followed_by(other).apply(block).samples
    np.testing.assert_allclose(together, other.apply(ERRORS.apply(block)).samples, rtol=0,
                               atol=1e-6)


_NUMBERS = st.integers(1, 6).flatmap(lambda n: st.tuples(
    *(st.lists(values, min_size=n, max_size=n) for values in (
        st.floats(1e-6, 1e6), st.floats(-np.pi, np.pi), st.floats(-1e-3, 1e-3)))))


@given(numbers=_NUMBERS)
def test_files_keep_every_digit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp('calibration') / 'channels.yaml'
    calibration = ChannelCalibration(*numbers)
    calibration.save(path)
    loaded = ChannelCalibration.load(path)
    np.testing.assert_array_equal(loaded.amplitude, calibration.amplitude)
    np.testing.assert_allclose(loaded.phase_rad, calibration.phase_rad, rtol=4e-16)  # degrees
    np.testing.assert_array_equal(loaded.delay_s, calibration.delay_s)


def test_a_file_written_by_hand_is_read(tmp_path):
    path = tmp_path / 'channels.yaml'
    path.write_text('amplitude: [1, 0.5]\nphase_deg: [0, 90]\ndelay_s: [0, 1e-9]\n')
    loaded = ChannelCalibration.load(path)
    np.testing.assert_allclose(loaded.weights, [1, -2j], atol=1e-6)
    np.testing.assert_array_equal(loaded.delay_s, [0, 1e-9])


@pytest.mark.parametrize(('text', 'message'), [
    (None, 'cannot be read: No such file'), ('a: b\n{', 'line 2: it is no YAML: '),
    ('a', 'expected the lists'),
    ('amplitude: [1]\nphase_deg: [1]', 'expected the lists'),
    ('amplitude: 1\nphase_deg: [1]\ndelay_s: [1]', 'expected lists of numbers'),
    ('amplitude: [x]\nphase_deg: [1]\ndelay_s: [1]', 'expected lists of numbers'),
    ('amplitude: [[1]]\nphase_deg: [1]\ndelay_s: [1]', 'must be a string or a real number'),
    ('amplitude: [1]\nphase_deg: [1, 2]\ndelay_s: [1]', 'one number per channel'),
    ('amplitude: []\nphase_deg: []\ndelay_s: []', 'one number per channel'),
    ('amplitude: [0]\nphase_deg: [1]\ndelay_s: [1]', 'expected positive factors'),
    ('amplitude: [.nan]\nphase_deg: [1]\ndelay_s: [1]', 'not finite')])
def test_impossible_files_are_refused(tmp_path, text, message):
    path = tmp_path / 'channels.yaml'
    if text is not None:
        path.write_text(text)
    with pytest.raises(CalibrationError, match=message):
        ChannelCalibration.load(path)


@pytest.mark.parametrize('text', ['password: [hunter2', 'amplitude: [hunter2]\nphase_deg: [1]\n'
                                  'delay_s: [1]', 'amplitude: hunter2\nphase_deg: 1\ndelay_s: 1'])
def test_what_is_said_of_a_file_does_not_quote_it(tmp_path, text):
    """Who may set the parameter need not be one who may read the file."""
    path = tmp_path / 'secret'
    path.write_text(text)
    with pytest.raises(CalibrationError) as error:
        ChannelCalibration.load(path)
    assert 'hunter2' not in str(error.value) and 'secret' in str(error.value)


def test_large_files_are_not_read(tmp_path):
    path = tmp_path / 'large'
    path.write_bytes(bytes(1_000_001))
    with pytest.raises(CalibrationError, match='has 1 MB; expected at most 1 MB'):
        ChannelCalibration.load(path)


def test_other_blocks_are_refused():
    block = _block('compressed', ERRORS)
    two = ChannelCalibration.none(2)
    for use in (two.apply, RangeCompressor.for_block(block, calibration=two)):
        with pytest.raises(ValueError, match='3 channels, the calibration is for 2'):
            use(block)
    with pytest.raises(ValueError, match='give the calibration to the RangeCompressor'):
        ERRORS.apply(_block('stepped', ERRORS))
