# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Band spectra against the signal model."""

import numpy as np
import pytest

from sar_imaging.signal import PulseBlock, RadarParameters, Waveform
from sar_imaging.signal.spectra import (
    band_spectrum,
    phase_history_frequencies,
    resampled_from_spectrum,
)


def _block(radar, compressed, samples):
    samples = np.asarray(samples)[None, None]
    return PulseBlock(radar, compressed, [0], [0], samples)


def test_profile_gives_the_phase_of_its_delay():
    n, rate, start, delay = 120, 400e6, 6.6e-6, 6.74e-6
    radar = RadarParameters(10e9, 300e6, rate, start)
    f = np.fft.fftfreq(n, 1 / rate)
    model = np.where(np.abs(f) <= 150e6, np.exp(-2j * np.pi * (10e9 + f) * delay), 0)
    profile = np.fft.ifft(model * np.exp(2j * np.pi * f * start), norm='forward')
    frequencies, spectra = band_spectrum(_block(radar, True, profile))
    assert len(frequencies) == 91 and frequencies[45] == 10e9
    # complex64 samples
    np.testing.assert_allclose(spectra[0, 0], np.exp(-2j * np.pi * frequencies * delay),
                               atol=1e-5)


def test_phase_history_is_referred_to_zero_delay():
    radar = RadarParameters(9.6e9, 600e6, 600e6, 6.7e-5, waveform=Waveform.STEPPED_FREQUENCY)
    frequencies = phase_history_frequencies(9.6e9, 600e6, 32)
    # 32 frequencies around the carrier, as equally spaced as the band is divided into.
    np.testing.assert_allclose(frequencies, 9.6e9 + (2 * np.arange(32) - 31) * 600e6 / 64)
    delay = 6.71e-5
    history = np.exp(-2j * np.pi * frequencies * (delay - 6.7e-5))
    found, spectra = band_spectrum(_block(radar, False, history))
    np.testing.assert_array_equal(found, frequencies)
    np.testing.assert_allclose(spectra[0, 0], np.exp(-2j * np.pi * frequencies * delay),
                               atol=1e-5)


def test_raw_chirps_must_be_compressed_first():
    radar = RadarParameters(10e9, 300e6, 400e6, 0.0, 1e-6, 3e14)
    with pytest.raises(ValueError, match='raw LFM pulses.*apply range compression first'):
        band_spectrum(_block(radar, False, np.zeros(8)))


@pytest.mark.parametrize(('n', 'n_out'), [(16, 40), (17, 34), (40, 16), (16, 16)])
def test_resampling_keeps_a_tone(n, n_out):
    tone = np.exp(2j * np.pi * 3 * np.arange(n) / n)[None].astype(np.complex64)
    found = resampled_from_spectrum(np.fft.fft(tone).astype(np.complex64), n_out)
    expected = np.exp(2j * np.pi * 3 * np.arange(n_out) / n_out)[None]
    np.testing.assert_allclose(found, expected, atol=1e-5)  # complex64
