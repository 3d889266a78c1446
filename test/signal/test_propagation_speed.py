# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Waves in the ground, in water and in air: one number of the radar, and everything scales."""

from __future__ import annotations

import dataclasses
import math

import pytest

from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters

RADAR = {'carrier_hz': 1e9, 'bandwidth_hz': 800e6, 'sample_rate_hz': 2e9,
         'first_sample_delay_s': 1e-9}
SONAR = {'carrier_hz': 300e3, 'bandwidth_hz': 60e3, 'sample_rate_hz': 100e3,
         'first_sample_delay_s': 0.02, 'propagation_speed_m_per_s': 1480.0}


def test_light_unless_told_otherwise():
    assert RadarParameters(**RADAR).propagation_speed_m_per_s == SPEED_OF_LIGHT == 299_792_458.0


def test_lengths_are_those_of_the_waves():
    radar = RadarParameters(**SONAR)
    assert radar.wavelength_m == pytest.approx(1480 / 300e3)
    assert radar.shortest_wavelength_m == pytest.approx(1480 / 330e3)
    assert radar.wavenumber_rad_per_m == pytest.approx(4 * math.pi * 300e3 / 1480)
    assert radar.half_band_rad_per_m == pytest.approx(4 * math.pi * 30e3 / 1480)
    assert radar.range_resolution_m == pytest.approx(1480 / 2 / 60e3)
    assert radar.sample_spacing_m == pytest.approx(1480 / 2 / 100e3)
    assert radar.range_start_m == pytest.approx(14.8)


@pytest.mark.parametrize('speed, text', [
    (0.0, 'must be positive'), (-1480.0, 'must be positive'), (math.nan, 'not finite'),
    (math.inf, 'not finite'), (299_792_459.0, 'expected 10 to 2.99792e.08 m/s'),
    (1.48, 'meant in km/s: pass propagation_speed_m_per_s=1480'),
    (0.1, 'meant in m/ns: pass propagation_speed_m_per_s=1e.08')])
def test_impossible_speeds_are_refused(speed, text):
    with pytest.raises(ValueError, match=f'propagation_speed_m_per_s=.*{text}'):
        RadarParameters(**RADAR, propagation_speed_m_per_s=speed)


@pytest.mark.parametrize('change, text', [
    ({'carrier_hz': 77.0}, "is not a sonar's; .*meant in kHz: pass carrier_hz=77000"),
    ({'bandwidth_hz': 4.0}, "is not a sonar's; .*meant in kHz: pass bandwidth_hz=4000"),
    ({'first_sample_delay_s': 200.0}, "is not a sonar's; .*meant in ms: pass .*=0.2"),
    ({'chirp_rate_hz_per_s': 0.02}, "is not a sonar's; .*meant in kHz/ms: .*=20000")])
def test_units_of_a_sonar_are_recognised(change, text):
    RadarParameters(**SONAR)
    with pytest.raises(ValueError, match=text):
        RadarParameters(**SONAR | change)


def test_chirping_sonar():
    """A ramp of 60 kHz in 1 s from 270 kHz: Hz and Hz/s that no radar has."""
    ramp = {'start_frequency_hz': 270e3, 'slope_hz_per_s': 60e3, 'sample_rate_hz': 1e3,
            'n_samples': 1000}
    radar = fmcw_parameters(**ramp, propagation_speed_m_per_s=1480.0)
    assert radar.carrier_hz == pytest.approx(300e3, rel=1e-3)
    assert radar.range_resolution_m == pytest.approx(1480 / 2 / 60e3)
    with pytest.raises(ValueError, match="start_frequency_hz=270000 Hz is not a radar's"):
        fmcw_parameters(**ramp)


def test_the_numbers_of_a_sonar_are_no_radar():
    with pytest.raises(ValueError, match="carrier_hz=300000 Hz is not a radar's"):
        dataclasses.replace(RadarParameters(**SONAR), propagation_speed_m_per_s=SPEED_OF_LIGHT)
