# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulated experiment of the spotlight letter."""

import dataclasses
import math

import numpy as np
import pytest

from benchmarks.reproduction.letter_scene import SIZES, spotlight_letter
from sar_imaging.quality import error_db
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.simulation.scene import positions_and_amplitudes


@pytest.fixture(scope='module')
def small():
    return spotlight_letter('small')


def test_letter_is_as_stated():
    letter = spotlight_letter()
    assert (letter.n_pulses, letter.n_samples) == (16384, 16384)
    assert letter.radar.bandwidth_hz == 1.16e9
    assert letter.radar.range_start_m == pytest.approx(letter.scene_centre_m[0])
    # 2100 pulses a second for 7.8 s is 16380 of them
    assert letter.n_pulses / 2100 == pytest.approx(7.8, abs=0.01)
    assert letter.aperture_m == pytest.approx(1049, abs=1)
    speed = letter.aperture_m / (letter.n_pulses / 2100)
    assert 100 < speed < 200  # of an aircraft, m/s


@pytest.mark.parametrize('size', SIZES)
def test_scene_is_unambiguous(size):
    letter = spotlight_letter(size)
    positions, _ = positions_and_amplitudes(letter.scatterers)
    centres = letter.phase_centres()
    paths = np.linalg.norm(positions[:, None] - centres[[0, -1], 0], axis=-1)
    half = letter.n_samples * letter.radar.range_resolution_m / 2
    assert np.abs(paths - letter.scene_centre_m[0]).max() < half
    # angle covered without ambiguity: wavelength / 2 pulse spacings
    span = letter.radar.wavelength_m / (2 * letter.pulse_spacing_m)
    assert np.ptp(positions[:, 1] / positions[:, 0]) < span
    inside = np.abs(positions[:, :2] - letter.scene_centre_m[:2]) < np.array(letter.scene_m) / 2
    assert inside.all()


def test_pair_differs_in_azimuth_only(small):
    one, two = (np.array(s.position_m) for s in small.scatterers[:2])
    assert np.linalg.norm(one - two) == pytest.approx(0.15)
    # same range from the middle of the aperture, so that their phase is what was asked for
    assert np.linalg.norm(one) - np.linalg.norm(two) == pytest.approx(0, abs=1e-8)
    assert small.scatterers[1].amplitude == pytest.approx(-1)
    assert spotlight_letter('small', pair_phase_deg=90).scatterers[1].amplitude == (
        pytest.approx(1j))


@pytest.mark.parametrize('n_samples', [None, 100])
def test_phase_history_agrees_with_the_echo_simulator(small, n_samples):
    """With as many frequencies as the experiment has, and with another number."""
    quiet = dataclasses.replace(small, noise_db=-math.inf, n_samples=n_samples or small.n_samples)
    positions, amplitudes = positions_and_amplitudes(small.scatterers)
    simulate = EchoSimulator(small.radar, quiet.n_samples, compressed=False, points_m=positions,
                             amplitudes=amplitudes)
    part = slice(1000, 1003)
    centres = small.phase_centres()[part]
    # measured -132 dB: float32 tables of phasors
    assert error_db(quiet.phase_history(part), simulate(centres, centres)[:, 0]) < -120


def test_recording_does_not_depend_on_how_it_is_sliced(small):
    few = dataclasses.replace(small, n_pulses=70)
    whole = np.empty((70, small.n_samples), np.complex64)
    seen = []
    few.record(whole, seen.append)
    assert sum(seen) == 70
    np.testing.assert_array_equal(whole[41:43], few.phase_history(slice(41, 43)))


def test_noise_has_the_level_stated(small):
    part = slice(0, 16)
    quiet = dataclasses.replace(small, noise_db=-math.inf).phase_history(part)
    noise = small.phase_history(part) - quiet
    # a unit scatterer grows by P K where the noise's deviation grows by its root
    level = 10 * math.log10(np.mean(np.abs(noise) ** 2) / (small.n_pulses * small.n_samples))
    assert level == pytest.approx(-70, abs=0.2)  # 32768 values: 0.6 % or 0.03 dB
