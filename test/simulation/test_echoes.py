# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Echoes against independent formulas."""

from __future__ import annotations

import dataclasses
import math
from decimal import Decimal, localcontext

import numpy as np
import pytest

from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator, anti_alias_gain, quantise, two_way_delays

TX = np.array([[[1.25, -29.5, 500.0], [1.25, -29.5, 500.0]], [[0.75, 4.5, 501.5]] * 2])
RX = TX + np.array([[0.0, -0.03, 0.0], [0.0, 0.015, 0.25]])
POINTS = np.array([[866.0, 3.5, 0.0], [871.25, -8.5, 2.0]])
AMPLITUDES = np.array([1.0, 0.4 - 0.3j])


def _lfm_radar(sample_rate_hz=600e6):
    return RadarParameters(carrier_hz=10e9, bandwidth_hz=500e6, sample_rate_hz=sample_rate_hz,
                           first_sample_delay_s=2 * 900.0 / SPEED_OF_LIGHT,
                           pulse_length_s=0.4e-6, chirp_rate_hz_per_s=500e6 / 0.4e-6)


def _exact_cycles(frequency_hz, tx, rx, point, reference_delay_s=0.0):
    """Cycles f (tau - reference), reduced, with 50 decimal digits; f a whole number."""
    with localcontext() as context:
        context.prec = 50

        def distance(a):
            return sum((Decimal(float(u)) - Decimal(float(v))) ** 2
                       for u, v in zip(a, point, strict=True)).sqrt()

        tau = (distance(tx) + distance(rx)) / Decimal(SPEED_OF_LIGHT)
        return float(Decimal(frequency_hz) * (tau - Decimal(reference_delay_s)) % 1)


def _simulate(radar, n, points=POINTS, amplitudes=AMPLITUDES, compressed=False):
    simulate = EchoSimulator(radar, n, compressed=compressed, points_m=points,
                             amplitudes=amplitudes)
    return simulate(TX, RX)


def _cells():
    return [(m, n) for m in range(TX.shape[0]) for n in range(TX.shape[1])]


def test_delays_are_exact():
    delays = two_way_delays(TX, RX, POINTS)
    assert delays.shape == (2, 2, 2)
    for m, n in _cells():
        for p, point in enumerate(POINTS):
            cycles = 10e9 * delays[m, n, p] % 1.0
            difference = cycles - _exact_cycles(10**10, TX[m, n], RX[m, n], point)
            # A delay of 6.7 us is held to 8e-22 s: 1e-11 cycles at 10 GHz, a few roundings.
            assert abs((difference + 0.5) % 1 - 0.5) < 1e-10


def test_stepped_frequency_is_the_direct_sum():
    n = 50
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=500e6, sample_rate_hz=500e6,
                            first_sample_delay_s=2 * 1000.0 / SPEED_OF_LIGHT,
                            waveform=Waveform.STEPPED_FREQUENCY)
    samples = _simulate(radar, n)
    for m, c in _cells():
        for k in (0, 7, 49):  # frequencies that are whole numbers of hertz
            f = int(10e9 + (k - 24.5) * 10e6)
            expected = sum(a * np.exp(-2j * np.pi * _exact_cycles(
                f, TX[m, c], RX[m, c], x, radar.first_sample_delay_s))
                for a, x in zip(AMPLITUDES, POINTS, strict=True))
            assert abs(samples[m, c, k] - expected) < 1e-8


def test_compressed_profile_is_the_sum_of_dirichlet_kernels():
    n = 250
    radar = dataclasses.replace(_lfm_radar(), first_sample_delay_s=2 * 980.0 / SPEED_OF_LIGHT)
    samples = _simulate(radar, n, compressed=True)
    n_bins = 2 * math.floor(250e6 / (600e6 / n)) + 1  # 209
    for m, c in _cells():
        expected = 0
        for a, x in zip(AMPLITUDES, POINTS, strict=True):
            tau = (math.dist(TX[m, c], x) + math.dist(RX[m, c], x)) / SPEED_OF_LIGHT
            turn = np.pi * (np.arange(n) - (tau - radar.first_sample_delay_s) * 600e6) / n
            kernel = np.sin(n_bins * turn) / (n_bins * np.sin(turn))
            cycles = _exact_cycles(10**10, TX[m, c], RX[m, c], x)
            expected = expected + a * kernel * np.exp(-2j * np.pi * cycles)
        np.testing.assert_allclose(samples[m, c], expected, rtol=0, atol=1e-8)


def test_profile_is_flat_in_its_band_and_empty_outside():
    samples = _simulate(_lfm_radar(), 500, POINTS[:1], [1.0], compressed=True)
    spectrum = np.abs(np.fft.fft(samples))
    n_bins = 2 * math.floor(250e6 / (600e6 / 500)) + 1
    inside = np.abs(np.fft.fftfreq(500, 1 / 600e6)) <= 250e6
    assert inside.sum() == n_bins
    np.testing.assert_allclose(spectrum[..., inside], 500 / n_bins, rtol=1e-9)
    assert spectrum[..., ~inside].max() < 1e-9


def test_raw_echo_has_the_spectrum_of_the_delayed_chirp():
    radar, n = _lfm_radar(), 1024
    samples = _simulate(radar, n, POINTS[:1], [1.0])[1, 1]
    tau = (math.dist(TX[1, 1], POINTS[0]) + math.dist(RX[1, 1], POINTS[0])) / SPEED_OF_LIGHT
    carrier = np.exp(-2j * np.pi * _exact_cycles(10**10, TX[1, 1], RX[1, 1], POINTS[0]))
    # The chirp by its definition, integrated by the midpoint rule.
    fine = (np.arange(100_000) + 0.5) * radar.pulse_length_s / 100_000
    chirp = np.exp(1j * np.pi * radar.chirp_rate_hz_per_s * (fine - radar.pulse_length_s / 2)**2)
    time = radar.first_sample_delay_s + np.arange(n) / radar.sample_rate_hz
    for f in (-249e6, -100.3e6, 0.0, 17e6, 249e6):
        expected = np.sum(chirp * np.exp(-2j * np.pi * f * (fine + tau))) * (fine[1] - fine[0])
        got = np.sum(samples * np.exp(-2j * np.pi * f * time)) / radar.sample_rate_hz
        # Relative to the band's level; the filter's ringing beyond the record is 1e-4 of it.
        level = 1 / np.sqrt(radar.chirp_rate_hz_per_s)
        assert abs(got - expected * carrier) < 3e-4 * level


def test_raw_echo_is_the_chirp_itself_away_from_its_ends():
    radar = _lfm_radar(2000e6)  # a wide filter hardly touches the pulse
    samples = _simulate(radar, 3000, POINTS[:1], [1.0])[0, 0]
    tau = (math.dist(TX[0, 0], POINTS[0]) + math.dist(RX[0, 0], POINTS[0])) / SPEED_OF_LIGHT
    time = radar.first_sample_delay_s + np.arange(3000) / 2000e6 - tau
    middle = np.abs(time - radar.pulse_length_s / 2) < 0.3 * radar.pulse_length_s
    expected = np.exp(1j * np.pi * radar.chirp_rate_hz_per_s
                      * (time - radar.pulse_length_s / 2) ** 2
                      - 2j * np.pi * _exact_cycles(10**10, TX[0, 0], RX[0, 0], POINTS[0]))
    # What the filter takes from the sharp edges rings at 1e-4 this far inside.
    np.testing.assert_allclose(samples[middle], expected[middle], rtol=0, atol=1e-3)
    outside = (time < -0.1e-6) | (time > radar.pulse_length_s + 0.1e-6)
    assert np.abs(samples[outside]).max() < 2e-3


def test_echoes_add():
    radar = _lfm_radar()
    both = _simulate(radar, 700)
    parts = [_simulate(radar, 700, POINTS[[i]], AMPLITUDES[[i]]) for i in range(2)]
    np.testing.assert_allclose(both, parts[0] + parts[1], rtol=0, atol=1e-12)
    assert not np.any(_simulate(radar, 700, POINTS[:0], AMPLITUDES[:0]))


def test_pulse_cut_by_the_record_does_not_wrap_round():
    radar, n = _lfm_radar(), 1200
    whole = _simulate(radar, n, POINTS[:1], [1.0])
    late = dataclasses.replace(radar, first_sample_delay_s=radar.first_sample_delay_s
                               + 520 / radar.sample_rate_hz)
    # The same echoes recorded from within the pulse on.
    np.testing.assert_allclose(_simulate(late, n - 520, POINTS[:1], [1.0]), whole[..., 520:],
                               rtol=0, atol=1e-3)
    assert np.abs(whole[..., 520]).min() > 0.5


@pytest.mark.parametrize('compressed', [True, False])
@pytest.mark.parametrize('distance_m', [500.0, 1500.0])
def test_scatterer_outside_the_record_is_refused(compressed, distance_m):
    with pytest.raises(ValueError, match='record holds'):
        _simulate(_lfm_radar(), 500, np.array([[distance_m, 0.0, 0.0]]), [1.0], compressed)


def test_profile_too_coarse_for_its_band_is_refused():
    radar = dataclasses.replace(_lfm_radar(), sample_rate_hz=400e6)
    with pytest.raises(ValueError, match='sample faster'):
        _simulate(radar, 500, compressed=True)


def test_anti_alias_filter_is_flat_in_the_band_and_closed_at_half_the_rate():
    gain = anti_alias_gain(np.array([-300e6, -275e6, -250e6, 0.0, 100e6, 250e6, 300e6]),
                           _lfm_radar())
    np.testing.assert_allclose(gain, [0, 0.5, 1, 1, 1, 1, 0], atol=1e-12)


def test_quantised_samples_are_whole_steps():
    rng = np.random.default_rng(1)
    samples = rng.normal(size=200) * 0.3 + 1j * rng.normal(size=200) * 0.3
    got = quantise(samples, 14, 2.0)
    assert got.dtype == np.complex64
    step = 2.0 / 2**13
    parts = got.view(np.float32).astype(float) / step
    np.testing.assert_array_equal(parts, np.rint(parts))
    np.testing.assert_allclose(got, samples, rtol=0, atol=step / np.sqrt(2) * 1.001)


def test_quantiser_clips_and_has_one_zero():
    got = quantise(np.array([5 - 5j, -1e-9 - 1e-9j]), 8, 1.0)
    assert got[0] == 1 - 2**-7 - 1j
    assert not np.signbit(got[1].real) and not np.signbit(got[1].imag)


@pytest.mark.parametrize(('bits', 'full_scale', 'message'), [
    (25, 1.0, 'expected 2 to 24'), (1, 1.0, 'expected 2 to 24'), (14, 3.0, 'power of two'),
    (14, 0.0, 'power of two'), (14, -2.0, 'power of two')])
def test_impossible_quantisers_are_refused(bits, full_scale, message):
    with pytest.raises(ValueError, match=message):
        quantise(np.zeros(1, complex), bits, full_scale)
