# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range compression against closed forms and direct sums."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import fft

from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.windows import window as window_weights
from sar_imaging.simulation.echoes import EchoSimulator

N_PULSE = 200  # samples


def _lfm_radar(direction=1.0, sample_rate_hz=600e6):
    length = N_PULSE / sample_rate_hz
    return RadarParameters(carrier_hz=10e9, bandwidth_hz=500e6, sample_rate_hz=sample_rate_hz,
                           first_sample_delay_s=2 * 950.0 / SPEED_OF_LIGHT,
                           pulse_length_s=length, chirp_rate_hz_per_s=direction * 500e6 / length)


def _block(radar, n_samples, samples_late, *, compressed=False, amplitudes=(1.0,)):
    """Echoes of scatterers `samples_late` (P, S) samples after the first, one pulse per row."""
    samples_late = np.atleast_2d(samples_late)
    delays = radar.first_sample_delay_s + samples_late / radar.sample_rate_hz
    positions = np.zeros((len(delays), 1, 3))
    blocks = []
    for row in delays:
        points = np.stack([SPEED_OF_LIGHT * row / 2, 0 * row, 0 * row], axis=1)
        simulate = EchoSimulator(radar, n_samples, compressed=compressed, points_m=points,
                                 amplitudes=np.resize(amplitudes, len(row)))
        blocks.append(simulate(positions[:1], positions[:1])[0])
    count = np.arange(len(delays))
    return PulseBlock(radar, compressed, count, count, np.stack(blocks), positions, positions)


def _delays(profiles):
    radar = profiles.radar
    return radar.first_sample_delay_s + np.arange(profiles.n_samples) / radar.sample_rate_hz


def _bins(radar, n_fft):
    """Frequencies of the FFT bins inside the band."""
    half = int(radar.bandwidth_hz / 2 / (radar.sample_rate_hz / n_fft))
    return np.arange(-half, half + 1) * (radar.sample_rate_hz / n_fft)


def _band_limited(frequency, weights, delays, tau, carrier_hz):
    """Ideal response sum_k w_k exp(j 2 pi f_k (t - tau)) / sum w times the carrier phase."""
    phase = np.exp(2j * np.pi * np.outer(delays - tau, frequency))
    return phase @ weights / weights.sum() * np.exp(-2j * np.pi * (carrier_hz * tau % 1.0))


def _error_db(got, expected):
    return 10 * np.log10(np.sum(np.abs(got - expected) ** 2) / np.sum(np.abs(expected) ** 2))


@pytest.mark.parametrize('name', ['none', 'hamming', 'taylor'])
@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_lfm_response_is_the_windows_at_any_delay(name, direction):
    radar, n = _lfm_radar(direction), 384
    late = np.linspace(10.0, 170.0, 6)[:, None]
    profiles = RangeCompressor(radar, n, window=name)(_block(radar, n, late))
    frequency = _bins(radar, fft.next_fast_len(n + N_PULSE))
    weights = window_weights(name, frequency.size)
    for pulse, tau in enumerate(radar.first_sample_delay_s + late[:, 0] / radar.sample_rate_hz):
        ideal = _band_limited(frequency, weights, _delays(profiles), tau, radar.carrier_hz)
        # What the ends of the record cut off the anti-alias filter's ringing: measured -62 dB
        # at the outermost delay, -73 dB on average.
        assert _error_db(profiles.samples[pulse, 0], ideal) < -58.0


@pytest.mark.parametrize('name', ['none', 'hamming'])
def test_peak_has_the_scatterers_delay_amplitude_and_phase(name):
    radar, late, amplitude = _lfm_radar(), 77.3, 0.4 * np.exp(0.7j)
    compressor = RangeCompressor(radar, 400, window=name, oversampling=32.0)
    profile = compressor(_block(radar, 400, late, amplitudes=(amplitude,)))
    tau = radar.first_sample_delay_s + late / radar.sample_rate_hz
    peak = np.argmax(np.abs(profile.samples[0, 0]))
    # The nearest of 32 samples per 1/B: amplitude within 1 - sinc(1/64) = 4e-4.
    assert abs(_delays(profile)[peak] - tau) <= 0.5 / profile.radar.sample_rate_hz
    expected = amplitude * np.exp(-2j * np.pi * (radar.carrier_hz * tau % 1.0))
    assert abs(profile.samples[0, 0, peak] - expected) < 1e-3 * abs(amplitude)


@pytest.mark.parametrize(('name', 'width', 'sidelobe_db'), [
    ('none', 0.8859, -13.26), ('hamming', 1.303, -42.67), ('hann', 1.441, -31.47),
    ('taylor:4:35', 1.184, -35.2), ('kaiser:6', 1.402, -43.8)])
def test_lfm_response_has_the_windows_width_and_sidelobes(name, width, sidelobe_db):
    radar = _lfm_radar()
    compressor = RangeCompressor(radar, 600, window=name, oversampling=32.0)
    profile = compressor(_block(radar, 600, 200.0))
    level = 20 * np.log10(np.abs(profile.samples[0, 0]))
    step = profile.radar.sample_rate_hz
    above = np.flatnonzero(level > level.max() - 3.0103)
    # Resolved to one of 32 samples per 1/B at both edges; sidelobes carry errors of -75 dB.
    assert (above[-1] - above[0]) / step * 500e6 == pytest.approx(width, abs=2.2 / 32)
    after = level[np.argmax(level):]
    null = np.argmax(np.diff(after) > 0)
    assert after[null:].max() - level.max() == pytest.approx(sidelobe_db, abs=0.2)


def test_whole_receive_window_is_kept_and_nothing_wraps_round():
    radar, n = _lfm_radar(), 384
    compressor = RangeCompressor(radar, n)
    profiles = compressor(_block(radar, n, [[0.0], [n - N_PULSE]]))
    assert profiles.n_samples == compressor.n_output
    assert profiles.radar.first_sample_delay_s == radar.first_sample_delay_s
    end = _delays(profiles)[-1] - radar.first_sample_delay_s
    last = (n - N_PULSE) / radar.sample_rate_hz
    assert 0 <= last - end < 1 / profiles.radar.sample_rate_hz
    magnitude = np.abs(profiles.samples[:, 0])
    assert magnitude[0].argmax() == 0 and magnitude[1].argmax() >= profiles.n_samples - 2
    # Whole pulses at either end of the record leave only distant sidelobes at the other.
    assert magnitude[0, -20:].max() < 0.01 and magnitude[1, :20].max() < 0.01


def test_output_rate_is_exact_and_at_least_what_was_asked():
    radar = _lfm_radar()
    for oversampling in (1.0, 1.5, 2.0, 3.3):
        output = RangeCompressor(radar, 384, oversampling=oversampling).output_radar
        assert 1.0 <= output.sample_rate_hz / (oversampling * radar.bandwidth_hz) < 1.05
        assert output == dataclasses.replace(radar, sample_rate_hz=output.sample_rate_hz)


@pytest.mark.parametrize('range_filter', ['equalised', 'matched'])
@pytest.mark.parametrize('name', ['none', 'hann'])
def test_snr_loss_is_what_white_noise_shows(range_filter, name):
    radar, n = _lfm_radar(), 1024
    compressor = RangeCompressor(radar, n, window=name, range_filter=range_filter)
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((64, 1, n, 2)).astype(np.float32).view(np.complex64)[..., 0]
    # At the delay of the first output sample, so that the peak falls between no two samples.
    block = _block(radar, n, np.zeros((64, 1)))
    peak = compressor(block).samples[0, 0, 0]
    output = compressor(dataclasses.replace(block, samples=noise)).samples
    assert abs(peak) == pytest.approx(1.0, abs=2e-3)
    # Matched filter: the signal to noise ratio of one sample times the samples of a pulse. The
    # noise has variance 2; 64 profiles hold some 44 000 independent numbers, 0.02 dB.
    snr = abs(peak) ** 2 / np.mean(np.abs(output) ** 2)
    loss_db = 10 * np.log10(N_PULSE / 2 / snr)
    assert compressor.snr_loss_db == pytest.approx(loss_db, abs=0.1)


def test_matched_filter_loses_less_than_equalising():
    radar = _lfm_radar()
    loss = {f: RangeCompressor(radar, 384, range_filter=f).snr_loss_db
            for f in ('matched', 'equalised')}
    assert 0 <= loss['matched'] < loss['equalised'] < 0.5


def test_channels_and_pulses_are_independent_and_linear():
    radar, n = _lfm_radar(), 384
    compressor = RangeCompressor(radar, n, window='hamming')
    one = _block(radar, n, [[20.25], [50.5], [111.0]])
    two = _block(radar, n, [[99.0], [20.0], [150.1]])
    both = dataclasses.replace(
        one, samples=np.stack([one.samples[:, 0], 2j * two.samples[:, 0],
                               one.samples[:, 0] + 2j * two.samples[:, 0]], axis=1),
        tx_m=np.zeros((3, 3, 3)), rx_m=np.zeros((3, 3, 3)))
    profiles = compressor(both)
    assert profiles.samples.shape == (3, 3, compressor.n_output)
    assert profiles.samples.dtype == np.complex64 and profiles.compressed
    first, second, total = np.moveaxis(profiles.samples, 1, 0)
    # complex64 FFTs round at 1e-7 of the sum of 384 samples.
    np.testing.assert_allclose(first, compressor(one).samples[:, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(second, 2j * compressor(two).samples[:, 0], rtol=0, atol=2e-6)
    np.testing.assert_allclose(total, first + second, rtol=0, atol=4e-6)
    np.testing.assert_array_equal(profiles.counter, one.counter)


# ------------------------------------------------------------------------- stepped frequency

def _stepped_radar(n):
    return RadarParameters(carrier_hz=9.6e9, bandwidth_hz=600e6, sample_rate_hz=600e6,
                           first_sample_delay_s=2 * 10_158.0 / SPEED_OF_LIGHT,
                           waveform=Waveform.STEPPED_FREQUENCY)


@pytest.mark.parametrize('n', [101, 128])
@pytest.mark.parametrize('name', ['none', 'hamming'])
def test_stepped_frequency_is_the_direct_sum(n, name):
    radar = _stepped_radar(n)
    offsets = np.array([-0.48, -0.1234, 0.0, 0.31]) * n / radar.bandwidth_hz
    amplitudes = np.array([1.0, 0.5j, -0.7, 0.3])
    tau = radar.first_sample_delay_s + offsets
    frequency = (np.arange(n) - (n - 1) / 2) * radar.bandwidth_hz / n
    phase = (radar.carrier_hz + frequency) * offsets[:, None]
    samples = amplitudes @ np.exp(-2j * np.pi * phase)
    block = PulseBlock(radar, False, [0], [0], samples[None, None])
    compressor = RangeCompressor(radar, n, window=name, oversampling=1.7)
    profile = compressor(block)
    weights = window_weights(name, n)
    expected = sum(a * _band_limited(frequency, weights, _delays(profile), t, radar.carrier_hz)
                   for a, t in zip(amplitudes, tau, strict=True))
    # complex64 throughout; the periodic ends included.
    np.testing.assert_allclose(profile.samples[0, 0], expected, rtol=0, atol=2e-6)
    half = n / radar.bandwidth_hz / 2
    assert _delays(profile)[0] < radar.first_sample_delay_s - half
    assert _delays(profile)[-1] > radar.first_sample_delay_s + half


def test_stepped_frequency_states_the_windows_snr_loss():
    compressor = RangeCompressor(_stepped_radar(256), 256, window='hamming')
    assert compressor.snr_loss_db == pytest.approx(1.344, abs=0.002)  # Harris 1978: 1.34 dB


# --------------------------------------------------------------------- compressed already

def _profile_radar(sample_rate_hz=400e6):
    return RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=sample_rate_hz,
                           first_sample_delay_s=2 * 9976.0 / SPEED_OF_LIGHT)


def test_profiles_that_need_nothing_pass_uncopied():
    block = _block(_profile_radar(), 126, 40.3, compressed=True)
    for oversampling in (1.0, 4 / 3):
        compressor = RangeCompressor.for_block(block, oversampling=oversampling)
        assert compressor(block) is block
        assert (compressor.output_radar, compressor.n_output) == (block.radar, block.n_samples)


@pytest.mark.parametrize('name', ['none', 'taylor'])
def test_profiles_are_weighted_and_resampled_exactly(name):
    radar = _profile_radar()
    block = _block(radar, 126, 40.3, compressed=True)
    profile = RangeCompressor.for_block(block, window=name)(block)
    frequency = _bins(radar, 126)
    tau = radar.first_sample_delay_s + 40.3 / radar.sample_rate_hz
    ideal = _band_limited(frequency, window_weights(name, 95), _delays(profile), tau, 10e9)
    assert profile.radar.sample_rate_hz >= 600e6
    np.testing.assert_allclose(profile.samples[0, 0], ideal, rtol=0, atol=1e-6)


@pytest.mark.parametrize('rate_hz', [300e6, 290e6])
@pytest.mark.parametrize('n', [125, 126])
def test_critically_sampled_profiles_keep_their_samples(n, rate_hz):
    """A band that is stated wider than the samples hold counts as all that they hold."""
    rng = np.random.default_rng(3)
    samples = rng.standard_normal((2, 1, n, 2)).astype(np.float32).view(np.complex64)[..., 0]
    block = PulseBlock(_profile_radar(rate_hz), True, [0, 1], [0, 1], samples)
    profile = RangeCompressor.for_block(block, oversampling=3.0 * rate_hz / 300e6)(block)
    assert profile.n_samples == 3 * n
    np.testing.assert_allclose(profile.samples[..., ::3], samples, rtol=0, atol=3e-6)


# ---------------------------------------------------------------------------------- refusals

def test_block_of_another_plan_is_refused():
    radar = _lfm_radar()
    compressor = RangeCompressor(radar, 384)
    block = _block(radar, 384, 10.0)
    for other in (dataclasses.replace(block, radar=_lfm_radar(-1.0)),
                  dataclasses.replace(block, samples=block.samples[..., :300]),
                  dataclasses.replace(block, compressed=True)):
        with pytest.raises(ValueError, match='plan anew with RangeCompressor.for_block'):
            compressor(other)


@pytest.mark.parametrize(('options', 'message'), [
    ({'n_samples': 199}, 'less than one pulse'), ({'oversampling': 0.9}, 'at least 1.0'),
    ({'oversampling': float('nan')}, 'at least 1.0'), ({'window': 'boxcar'}, 'unknown'),
    ({'range_filter': 'inverse'}, 'use one of equalised, matched'),
    ({'n_samples': 1, 'compressed': True}, 'at least two')])
def test_bad_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        RangeCompressor(_lfm_radar(), **{'n_samples': 384} | options)


@pytest.mark.parametrize('sample_rate_hz', [1e3, 5e3])
def test_profiles_that_no_memory_holds_are_refused(sample_rate_hz):
    # One flipped bit in the header of a message is enough.
    radar = dataclasses.replace(_lfm_radar(), sample_rate_hz=sample_rate_hz)
    with pytest.raises(ValueError, match='expected at most 16777216; correct bandwidth_hz'):
        RangeCompressor(radar, 384, compressed=True)
