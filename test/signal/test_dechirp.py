# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""FMCW beat signals to range profiles, against closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.signal.dechirp import check_fmcw, fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.windows import window as window_weights
from sar_imaging.simulation.echoes import EchoSimulator, two_way_delays

RANGES_M = (3.1, 41.7, 88.25, 140.0)


def _radar(slope=5e12, **changes):
    """X band, 256 samples in 51 us: 256 MHz, 0.59 m; the residual video phase matters.

    At 140 m ``K tau^2 / 2`` is 2.2 cycles and the band is displaced by 1.8 % of its width.
    """
    given = {'start_frequency_hz': 9.5e9, 'slope_hz_per_s': slope, 'sample_rate_hz': 5e6,
             'n_samples': 256, 'adc_start_s': 6e-6} | changes
    return fmcw_parameters(**given)


def _block(radar, n, ranges_m, amplitudes=None):
    """One pulse per range, monostatic, a scatterer at that range."""
    samples = []
    for range_m, a in zip(ranges_m, amplitudes or [1.0] * len(ranges_m), strict=True):
        simulate = EchoSimulator(radar, n, compressed=False, points_m=[[range_m, 0.0, 0.0]],
                                 amplitudes=[a])
        samples.append(simulate(np.zeros((1, 1, 3)), np.zeros((1, 1, 3)))[0])
    count = np.arange(len(ranges_m))
    centres = np.zeros((len(ranges_m), 1, 3))
    return PulseBlock(radar, False, count, count, np.stack(samples), centres, centres)


def _delays(profiles):
    return (profiles.radar.first_sample_delay_s
            + np.arange(profiles.n_samples) / profiles.radar.sample_rate_hz)


def _ideal(raw, n, weights, delays, tau):
    """Correlation with the beat signal of every delay, written down in cycles."""
    slope, reference = raw.chirp_rate_hz_per_s, raw.first_sample_delay_s
    baseband = (np.arange(n) - (n - 1) / 2) * (raw.bandwidth_hz / n)
    at, late = delays - reference, tau - reference
    response = np.exp(2j * np.pi * np.outer(delays - tau, baseband)) @ weights / weights.sum()
    cycles = -raw.carrier_hz * tau + 0.5 * slope * (late**2 - at**2)
    return response * np.exp(2j * np.pi * (cycles % 1.0))


def _error_db(got, expected):
    return 10 * np.log10(np.sum(np.abs(got - expected) ** 2) / np.sum(np.abs(expected) ** 2))


def test_beat_signal_is_echo_times_conjugate_of_the_transmitted_ramp():
    # From the ramps themselves; the cycles of both reach 1e6, which float64 holds to 1e-10.
    radar, n, tau = _radar(), 256, 2 * 88.25 / SPEED_OF_LIGHT
    time_s = 6e-6 + np.arange(n) / 5e6

    def ramp_cycles(t):
        return 9.5e9 * t + 0.5 * 5e12 * t**2

    expected = np.exp(2j * np.pi * ((ramp_cycles(time_s - tau) - ramp_cycles(time_s)) % 1.0))
    got = _block(radar, n, [88.25]).samples[0, 0]
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)  # complex64


@pytest.mark.parametrize('slope', [5e12, -5e12])
@pytest.mark.parametrize('name', ['none', 'hamming'])
def test_complex_beat_becomes_the_correlation_with_the_beat_of_every_delay(slope, name):
    radar, n = _radar(slope), 256
    profiles = RangeCompressor(radar, n, window=name)(_block(radar, n, RANGES_M))
    assert profiles.compressed and profiles.radar.carrier_hz == radar.carrier_hz
    inside = slice(16, -17)  # what the guards repeat is one period later, with another phase
    for profile, range_m in zip(profiles.samples[:, 0], RANGES_M, strict=True):
        ideal = _ideal(radar, n, window_weights(name, n), _delays(profiles),
                       2 * range_m / SPEED_OF_LIGHT)
        assert _error_db(profile[inside], ideal[inside]) < -130.0  # complex64: measured -137 dB


@pytest.mark.parametrize('slope', [5e12, -5e12])
@pytest.mark.parametrize('real', [False, True])
@pytest.mark.parametrize('adc_start_s', [6e-6, 20e-6])
def test_peak_has_the_scatterers_range_amplitude_and_phase(slope, real, adc_start_s):
    radar, n = _radar(slope, real_samples=real, adc_start_s=adc_start_s), 256
    amplitudes = [0.5 * np.exp(1j * k) for k in range(3)]
    ranges = (41.7, 55.25, 70.0) if real else RANGES_M[1:]
    compressor = RangeCompressor(radar, n, window='taylor:6:60', oversampling=32.0)
    profiles = compressor(_block(radar, n, ranges, amplitudes))
    for profile, range_m, a in zip(profiles.samples[:, 0], ranges, amplitudes, strict=True):
        peak = np.argmax(np.abs(profile))
        tau = 2 * range_m / SPEED_OF_LIGHT
        assert abs(_delays(profiles)[peak] - tau) <= 0.51 / profiles.radar.sample_rate_hz
        expected = a * np.exp(-2j * np.pi * (radar.carrier_hz * tau % 1.0))
        # Between samples 1/64 of a cell: amplitude 4e-4, and the displaced band's phase
        # 2 pi K tau / 64 B = 2e-3; the mirror image of a real beat signal lies 60 dB lower.
        assert abs(profile[peak] - expected) < (4e-3 if real else 3e-3) * abs(a)


def test_residual_video_phase_left_in_would_show():
    raw = _block(_radar(), 256, [41.7])
    taken_for_stepped = dataclasses.replace(raw, radar=dataclasses.replace(
        raw.radar, waveform=Waveform.STEPPED_FREQUENCY, sample_rate_hz=raw.radar.bandwidth_hz))
    profiles = RangeCompressor.for_block(taken_for_stepped, oversampling=32.0)(taken_for_stepped)
    tau = 2 * 41.7 / SPEED_OF_LIGHT
    peak = profiles.samples[0, 0, np.abs(profiles.samples[0, 0]).argmax()]
    turned = np.angle(peak * np.exp(2j * np.pi * (raw.radar.carrier_hz * tau % 1.0)))
    assert turned == pytest.approx(np.pi * 5e12 * tau**2, abs=1e-3)  # 1.216 rad


def test_stretch_processing_refers_to_the_reference_delay():
    reference_s = 2 * 12_000.0 / SPEED_OF_LIGHT
    radar = _radar(reference_delay_s=reference_s)
    n, ranges = 256, (11_700.4, 12_000.0, 12_405.3)
    compressor = RangeCompressor(radar, n)
    profiles = compressor(_block(radar, n, ranges))
    delays = _delays(profiles)
    assert delays[0] < reference_s < delays[-1]
    assert delays[16] - reference_s == pytest.approx(reference_s - delays[-17], abs=2e-9)
    for profile, range_m in zip(profiles.samples[:, 0], ranges, strict=True):
        ideal = _ideal(radar, n, np.ones(n), delays, 2 * range_m / SPEED_OF_LIGHT)
        assert _error_db(profile[16:-17], ideal[16:-17]) < -130.0  # measured -138 dB


@pytest.mark.parametrize(('real', 'interval_m'), [(False, 150.0), (True, 75.0)])
def test_profile_covers_what_the_samples_tell_apart(real, interval_m):
    # c f_s / 2 K is 149.9 m for a complex converter; guards of 16 samples of 0.29 m besides.
    radar = _radar(real_samples=real)
    output = RangeCompressor(radar, 256).output_radar
    n = RangeCompressor(radar, 256).n_output
    assert -5.0 < output.range_start_m < -4.0
    assert n * output.sample_spacing_m == pytest.approx(interval_m + 9.3, abs=0.5)


@pytest.mark.parametrize('waveform', ['fmcw', 'lfm', 'compressed'])
def test_range_window_keeps_the_same_samples(waveform):
    if waveform == 'fmcw':
        radar, n, block = _radar(), 256, _block(_radar(), 256, [88.25])
    else:
        length_s = 0.0 if waveform == 'compressed' else 1e-6
        radar = dataclasses.replace(
            _radar(), waveform=Waveform.LFM, bandwidth_hz=100e6, sample_rate_hz=150e6,
            first_sample_delay_s=0.3e-6, pulse_length_s=length_s,
            chirp_rate_hz_per_s=1e14 if length_s else 0.0)
        n = 512
        compressed = waveform == 'compressed'
        simulate = EchoSimulator(radar, n, compressed=compressed, amplitudes=[1.0],
                                 points_m=[[88.25, 0.0, 0.0]])
        block = PulseBlock(radar, compressed, [0], [0], simulate(*np.zeros((2, 1, 1, 3))))
    whole = RangeCompressor.for_block(block)(block)
    cut = RangeCompressor.for_block(block, range_window_m=(80.0, 100.0))(block)
    assert cut.n_samples < 0.7 * whole.n_samples
    radar = cut.radar
    guard = 16 * radar.sample_spacing_m
    assert radar.range_start_m == pytest.approx(80.0 - guard, abs=1.1 * radar.sample_spacing_m)
    end = radar.range_start_m + (cut.n_samples - 1) * radar.sample_spacing_m
    assert end == pytest.approx(100.0 + guard, abs=1.1 * radar.sample_spacing_m)
    tau = 2 * 88.25 / SPEED_OF_LIGHT
    for profiles in (whole, cut):  # the same peak at the same delay
        delays = _delays(profiles)
        at = np.interp(tau, delays, np.abs(profiles.samples[0, 0]))
        assert at == pytest.approx(1.0, abs=0.15)  # straight line between samples at 2 per cell
    if waveform != 'fmcw':  # whose sampling follows from what is kept
        start = round((radar.first_sample_delay_s - whole.radar.first_sample_delay_s)
                      * radar.sample_rate_hz)
        np.testing.assert_array_equal(cut.samples[0, 0],
                                      whole.samples[0, 0, start:start + cut.n_samples])


@pytest.mark.parametrize('real', [False, True])
def test_image_of_a_wide_arc_focuses_in_place_and_in_phase(real):
    # A third of a circle of 30 m around the scatterer's neighbourhood: tau varies by 40 %, so
    # the residual video phase left in would turn by 0.27 cycles along the track.
    radar, n = _radar(slope=40e12, sample_rate_hz=20e6, real_samples=real), 256
    phi = np.linspace(-1.0, 1.0, 101)
    centres = np.stack([30 - 25 * np.cos(phi), 25 * np.sin(phi), 2 + 0 * phi], axis=1)[:, None]
    point = np.array([24.0, 3.0, 0.0])
    simulate = EchoSimulator(radar, n, compressed=False, points_m=[point], amplitudes=[1j])
    count = np.arange(phi.size)
    block = PulseBlock(radar, False, count, count, simulate(centres, centres), centres, centres)
    profiles = RangeCompressor.for_block(block, window='taylor:6:60')(block)
    [value] = exact_image(point[None], profiles)
    # A real converter's mirror image adds sidelobes of -60 dB.
    assert value / block.n_pulses == pytest.approx(1j, abs=2e-3 if real else 1e-4)
    delays = two_way_delays(centres, centres, point[None])
    assert np.ptp(0.5 * 40e12 * delays**2) > 0.26  # cycles left in


@pytest.mark.parametrize(('changes', 'message'), [
    ({'slope_hz_per_s': 0.0}, 'needs a ramp'), ({'n_samples': 1}, 'at least two samples'),
    ({'sample_rate_hz': -1.0}, 'must be positive')])
def test_impossible_ramps_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        _radar(**changes)


def test_other_number_of_samples_is_refused():
    with pytest.raises(ValueError, match='use fmcw_parameters'):
        RangeCompressor(_radar(), 128)


@pytest.mark.parametrize('limits', [(200.0, 300.0), (-20.0, -1.0)])
def test_range_window_beyond_the_unambiguous_interval_is_refused(limits):
    with pytest.raises(ValueError, match='lies outside'):
        RangeCompressor(_radar(), 256, range_window_m=limits)


def test_range_window_must_ascend():
    with pytest.raises(ValueError, match='nearest and a larger farthest'):
        RangeCompressor(_radar(), 256, range_window_m=(30.0, 20.0))


@pytest.mark.parametrize(('share', 'refused'), [
    (0.9905, False), (1.0095, False), (0.9895, True), (1.0105, True)])
def test_bandwidth_and_slope_may_differ_by_one_percent(share, refused):
    """As they do where a data sheet rounds the slope."""
    radar = _radar()
    # The limit counts from the bandwidth that is stated, not from what the samples sweep.
    radar = dataclasses.replace(radar, bandwidth_hz=radar.bandwidth_hz / share)
    if refused:
        with pytest.raises(ValueError, match='use fmcw_parameters'):
            check_fmcw(radar, 256)
    else:
        check_fmcw(radar, 256)


@pytest.mark.parametrize('slope', [5e12, -5e12])
def test_parameters_worked_out_by_hand(slope):
    radar = _radar(slope, n_samples=251, reference_delay_s=3e-7)
    # 6 us and half of 250 intervals of 0.2 us after the start of the ramp.
    assert radar.carrier_hz == pytest.approx(9.5e9 + slope * 31e-6, rel=1e-12)
    assert radar.bandwidth_hz == pytest.approx(5e12 * 251 * 0.2e-6, rel=1e-12)
    assert radar.pulse_length_s == pytest.approx(251 * 0.2e-6, rel=1e-12)
    assert (radar.chirp_rate_hz_per_s, radar.sample_rate_hz) == (slope, 5e6)
    assert radar.first_sample_delay_s == 3e-7 and radar.waveform is Waveform.FMCW
