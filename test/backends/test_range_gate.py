# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Windows of range profiles against whole ones, on noise that fills them."""

import numpy as np
import pytest
import scipy.fft

from sar_imaging.backends.cpu.profiles import Profiles, cut_profiles
from sar_imaging.backends.reference.resample_profiles import profile_spectra
from sar_imaging.planning.profiles import RangeGate, plan_point_resampling
from sar_imaging.signal import RadarParameters

N, NEEDED = 4096, (1500.0, 2000.0)  # samples; half paths within the profile, metres


def _radar(oversampling):
    return RadarParameters(10e9, 150e6 / oversampling, 150e6, 0.0)


def _noise(radar):
    """(2, N) profiles of clutter in the radar's band."""
    rng = np.random.default_rng(2)
    frequency = scipy.fft.fftfreq(N, 1 / radar.sample_rate_hz)
    spectrum = rng.standard_normal((2, N)) + 1j * rng.standard_normal((2, N))
    return scipy.fft.ifft(spectrum * (np.abs(frequency) <= radar.bandwidth_hz / 2))


@pytest.mark.parametrize('oversampling', [1.2, 4 / 3, 2.0])
def test_samples_within_the_window_are_those_of_the_whole_profile(oversampling):
    """Beside the cut the change is below -88 dB (measured: -92 to -97 dB)."""
    radar = _radar(oversampling)
    window = RangeGate.around(radar, N, NEEDED)
    assert window.n_samples < 0.4 * N and window.n_rise and window.n_fall
    profiles = _noise(radar)
    # the filter that Profiles applies, at the same samples
    out = np.empty((2, window.n_samples), complex)
    cut_profiles(window, profiles, out)
    taper = _filtered(out, oversampling) - _filtered(
        profiles, oversampling)[:, window.first:window.first + window.n_samples]
    first, last = (round(r / radar.sample_spacing_m) - window.first for r in NEEDED)
    edge = np.r_[first:first + 20, last - 20:last]
    error = np.mean(np.abs(taper[:, edge]) ** 2) / np.mean(np.abs(profiles) ** 2)
    assert 10 * np.log10(error) < -88.0


def _filtered(samples, oversampling):
    spectrum = scipy.fft.fft(samples)
    beyond = 2 * np.abs(scipy.fft.fftfreq(samples.shape[1])) * oversampling - 1
    gain = np.cos(0.5 * np.pi * np.clip(beyond / (oversampling - 1), 0, 1)) ** 2
    return scipy.fft.ifft(spectrum * gain)


def test_polynomials_agree_with_those_of_the_whole_profile():
    radar = _radar(2.0)
    samples = _noise(radar).astype(np.complex64)
    values = []
    for window in (RangeGate.around(radar, N, NEEDED), RangeGate.whole(radar, N)):
        resampling = plan_point_resampling(window, -90.0)
        profiles = Profiles(window, resampling, NEEDED)
        planes = profiles.planes(samples)[:, 0]
        place = np.linspace(1510.0, 1990.0, 500)
        v = (place - profiles.range_at(0)) / resampling.step_m
        n, t = np.floor(v).astype(int), v - np.floor(v)
        terms = planes[:, :, n]
        values.append(sum((terms[:, q] + 1j * terms[:, 4 + q]) * t ** q for q in range(4)))
    error = np.mean(np.abs(values[0] - values[1]) ** 2) / np.mean(np.abs(values[1]) ** 2)
    # Both interpolate with errors below -90 dB, on different range grids; measured -90 dB.
    assert 10 * np.log10(error) < -86.0


@pytest.mark.parametrize('range_m', [(-500.0, 5000.0), (0.0, 4000.0), (9000.0, 9100.0),
                                     (-900.0, -800.0)])
def test_the_whole_profile_is_taken_where_a_window_gains_nothing(range_m):
    radar = _radar(2.0)
    assert RangeGate.around(radar, N, range_m) == RangeGate.whole(radar, N)


@pytest.mark.parametrize('range_m', [(-500.0, 500.0), (3900.0, 5000.0)])
def test_zeros_lead_a_profile_that_the_image_leaves(range_m):
    """A filtered profile rings on before its first sample; errors of its ends stay the same."""
    radar = _radar(1.5)
    whole, window = (RangeGate.around(radar, N, range_m, lead) for lead in (0, 32))
    if range_m[0] > 0:  # cut where it begins: nothing rings there
        assert window == whole
        return
    assert (window.first, window.n_samples) == (-32, whole.n_samples + 32)
    np.testing.assert_allclose(window.end_error(radar.range_start_m + np.arange(-40.0, 900.0, 3)),
                               whole.end_error(radar.range_start_m + np.arange(-40.0, 900.0, 3)))
    samples, (short, long) = _noise(radar), (np.empty((2, N + 64), complex) for _ in range(2))
    cut_profiles(whole, samples, short)
    cut_profiles(window, samples, long)
    np.testing.assert_array_equal(long[:, 32:], short[:, :-32])
    assert not long[:, :32].any()
    np.testing.assert_allclose(profile_spectra(window, samples, N + 64), np.fft.fftshift(
        np.fft.fft(long) * window.gain(N + 64), axes=-1))
    # what rings falls with the distance: measured -80 dB where the window begins
    ringing = np.abs(_filtered(long, 1.5)) ** 2 / np.mean(np.abs(samples) ** 2)
    assert 10 * np.log10(ringing[:, 0].mean()) < -75.0


def test_a_window_at_the_end_of_the_profile_keeps_that_end():
    radar = _radar(2.0)
    window = RangeGate.around(radar, N, (0.0, 300.0))
    assert window.first == 0 and window.n_rise == 0 and window.n_fall > 0
    out = np.empty((1, N), complex)
    cut_profiles(window, np.ones((1, N)), out)
    assert out[0, 0] == 1.0 and not out[0, window.n_samples:].any()
