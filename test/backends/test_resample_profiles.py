# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polynomials of profiles against the Fourier series of profiles."""

import dataclasses

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.profiles import Profiles
from sar_imaging.backends.reference.resample_profiles import profile_spectra, resample_profiles
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.profiles import PhaseHistory, RangeGate, RangeResampling
from sar_imaging.signal import SPEED_OF_LIGHT, RadarParameters, Waveform


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_samples=st.integers(100, 300), n_rows=st.integers(3, 6),
       history=st.booleans(), n_phases=st.integers(1, 4), finer=st.floats(1.3, 3.0),
       degree=st.integers(3, 5), segment=st.integers(0, 20))
def test_polynomials_are_the_profile(seed, n_samples, n_rows, history, n_phases, finer, degree,
                                     segment):
    """Anywhere within the ranges asked for, as exactly as the interpolator says."""
    rng = np.random.default_rng(seed)
    bandwidth_hz = 3e8
    radar = RadarParameters(bandwidth_hz * rng.uniform(2, 50), bandwidth_hz,
                            bandwidth_hz * (1.0 if history else 1.4), 2e-6,
                            waveform=Waveform.STEPPED_FREQUENCY if history else Waveform.LFM)
    samples = rng.standard_normal((n_rows, n_samples, 2)).view(complex)[..., 0]
    if history:
        source, n_padded = PhaseHistory(radar, n_samples, 'hamming'), n_samples
        lo_m, hi_m = -0.3 * source.period_m, 1.4 * source.period_m  # it repeats
    else:  # quiet at its ends, which widens the band by 4 bins
        samples[:, np.abs(np.fft.fftfreq(n_samples)) > 0.5 / 1.4 - 4 / n_samples] = 0.0
        samples = np.fft.ifft(samples) * np.hanning(n_samples) ** 2
        source = RangeGate.whole(radar, n_samples)
        n_padded = n_samples + int(rng.integers(0, 30))
        lo_m, hi_m = rng.uniform(-5, 15), (n_samples - 20) * radar.sample_spacing_m
    samples = samples.astype(np.complex64)
    resolution_m = SPEED_OF_LIGHT / 2 / bandwidth_hz
    period_m = n_padded * source.radar.sample_spacing_m
    n_cells = int(np.ceil(period_m * finer / resolution_m / n_phases))
    step_m = period_m / n_cells / n_phases
    interpolator = design_interpolator(resolution_m / step_m, degree=degree)
    resampling = RangeResampling(n_padded, n_cells, n_phases, segment, step_m, step_m * n_phases,
                                 interpolator, interpolator.error_db)
    limits = source.range_start_m + lo_m, source.range_start_m + hi_m
    profiles = Profiles(source, resampling, limits)
    planes = profiles.planes(samples).astype(float)
    pad = max(segment, 8)
    assert not planes[..., :pad].any() and not planes[..., -pad:].any()
    n = int((hi_m - lo_m) / resampling.cell_m) - 2
    cell = int(np.ceil((limits[0] - profiles.range_at(0)) / resampling.cell_m)) + np.arange(n)
    cell = cell[cell >= 0]  # no cell stands before those that hold signal; -1 would be the last
    t = rng.random((n_rows, n_phases, len(cell)))
    powers = t[..., None] ** np.arange(degree + 1)
    real, imag = np.split(np.moveaxis(planes[..., cell], 2, -1), 2, axis=-1)
    value = ((real + 1j * imag) * powers).sum(axis=-1)
    place = cell * n_phases + np.arange(n_phases)[:, None] + t
    spectra = profile_spectra(source, samples, n_padded)
    wanted = resample_profiles(source, spectra, profiles.range_at(0) + place * step_m)
    error_db = 20 * np.log10(np.linalg.norm(value - wanted) / np.linalg.norm(wanted))
    # Predicted for a flat band and places anywhere; that of few pieces of noise is not flat: 2 dB
    # more measured at most. float32 coefficients err by -130 dB.
    allowed = 10 ** ((interpolator.error_db + 4.0) / 10) + 10 ** -12.5
    assert error_db <= 10 * np.log10(allowed)


def test_a_profile_ends_where_its_samples_do():
    radar = RadarParameters(1e10, 3e8, 4.2e8, 2e-6)
    source = RangeGate.whole(radar, 64)
    spectra = profile_spectra(source, np.ones((1, 64), np.complex64), 64)
    beyond = np.array([[-0.1, 64.1]]) * radar.sample_spacing_m + source.range_start_m
    assert not resample_profiles(source, spectra, beyond).any()
    at = source.range_start_m + np.arange(64.0)[None] * radar.sample_spacing_m
    # constant samples lie at the carrier, within the band
    np.testing.assert_allclose(resample_profiles(source, spectra, at), 1.0, atol=1e-7)
    whole = dataclasses.replace(source, n_rise=8)
    assert abs(resample_profiles(whole, profile_spectra(whole, np.ones((1, 64)), 64), at)[0, 0]
               ) < 0.2
