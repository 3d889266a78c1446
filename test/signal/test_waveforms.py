# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The LFM pulse, its spectrum and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.signal.radar import RadarParameters
from sar_imaging.signal.waveforms import check_lfm, lfm_spectrum, n_pulse_samples


def _radar(direction=1.0):
    return RadarParameters(carrier_hz=10e9, bandwidth_hz=500e6, sample_rate_hz=600e6,
                           first_sample_delay_s=6.5e-6, pulse_length_s=0.3e-6,
                           chirp_rate_hz_per_s=direction * 500e6 / 0.3e-6)


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_spectrum_is_the_fourier_integral(direction):
    radar = _radar(direction)
    n = 200_000  # midpoint rule: error of the second order in 1 / n, measured 1.4e-8
    time = (np.arange(n) + 0.5) * radar.pulse_length_s / n
    pulse = np.exp(1j * np.pi * radar.chirp_rate_hz_per_s
                   * (time - radar.pulse_length_s / 2) ** 2)
    frequency = np.array([-290e6, -250e6, -31.4e6, 0.0, 123e6, 250e6, 300e6])
    integral = np.array([np.sum(pulse * np.exp(-2j * np.pi * f * time)) for f in frequency])
    np.testing.assert_allclose(lfm_spectrum(frequency, radar),
                               integral * radar.pulse_length_s / n, rtol=0,
                               atol=1e-7 / np.sqrt(abs(radar.chirp_rate_hz_per_s)))


def test_whole_number_of_samples_is_not_rounded_up():
    radar = _radar()
    assert n_pulse_samples(radar) == 180
    assert n_pulse_samples(dataclasses.replace(radar, pulse_length_s=0.3001e-6)) == 181


@pytest.mark.parametrize(('change', 'message'), [
    ({'chirp_rate_hz_per_s': 1e15}, 'sweeps its bandwidth once'),
    ({'pulse_length_s': 0.0}, 'does not match'),
    ({'sample_rate_hz': 400e6}, 'at least the bandwidth'),
    ({'pulse_length_s': 1e-9, 'chirp_rate_hz_per_s': 5e17}, 'shorter than two samples')])
def test_contradictory_parameters_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        check_lfm(dataclasses.replace(_radar(), **change))
