# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Movers and jammers against delays computed directly."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.simulation.jammer import Jammer
from sar_imaging.simulation.movers import Mover, mover_echoes

RADAR = RadarParameters(10e9, 150e6, 200e6, 2 * 900.0 / SPEED_OF_LIGHT)
N_SAMPLES = 256


def _centres(n_pulses=6, n_channels=3):
    tx = np.zeros((n_pulses, n_channels, 3))
    tx[..., 1] = np.arange(n_pulses)[:, None] * 0.1
    rx = tx.copy()
    rx[..., 1] += np.arange(n_channels) * 0.2
    return tx, rx


def test_mover_echoes_are_those_of_a_scatterer_put_there_pulse_by_pulse():
    tx, rx = _centres()
    time_s = np.linspace(-0.4, 0.4, len(tx))
    mover = Mover('car', (980.0, 20.0, -5.0), (-12.0, 7.0, 1.0), 0.5 + 0.2j)
    echoes = mover_echoes([mover], RADAR, N_SAMPLES, compressed=True, tx_m=tx, rx_m=rx,
                          time_s=time_s)
    for pulse, place in enumerate(mover.positions(time_s)):
        still = EchoSimulator(RADAR, N_SAMPLES, compressed=True, points_m=place[None],
                              amplitudes=np.array([mover.amplitude]))
        one = slice(pulse, pulse + 1)
        # Float64 delays: 1e-13 m of path turn a 10 GHz carrier by 4e-11.
        np.testing.assert_allclose(echoes[one], still(tx[one], rx[one]), rtol=0, atol=1e-9)


def test_radial_velocity_is_the_rate_of_the_distance():
    mover = Mover('car', (300.0, 400.0, 0.0), (3.0, -1.0, 2.0))
    h = 1e-4
    ahead, behind = (np.linalg.norm(mover.positions(t) - [1.0, 2.0, 50.0]) for t in (h, -h))
    # Central difference: truncation of h^2, rounding of 1e-13 / h.
    assert mover.radial_velocity_m_per_s([1.0, 2.0, 50.0]) == pytest.approx(
        (ahead - behind) / (2 * h), abs=1e-8)


def test_no_movers_no_echoes():
    tx, rx = _centres()
    echoes = mover_echoes([], RADAR, N_SAMPLES, compressed=True, tx_m=tx, rx_m=rx,
                          time_s=np.zeros(len(tx)))
    assert echoes.shape == (*tx.shape[:2], N_SAMPLES) and not echoes.any()


@pytest.mark.parametrize('values', [
    {'position_m': (0.0, 1.0)}, {'velocity_m_per_s': (0.0, np.nan, 0.0)},
    {'amplitude': complex('inf')}])
def test_impossible_movers_are_refused(values):
    fields = {'name': 'car', 'position_m': (0.0,) * 3, 'velocity_m_per_s': (0.0,) * 3} | values
    with pytest.raises(ValueError, match="'car'"):
        Mover(**fields)


def test_jammer_has_its_power_band_and_delays():
    _, rx = _centres(n_pulses=40)
    counter = np.arange(40)
    jammer = Jammer('jammer', (4000.0, 900.0, 10.0), std=3.0, seed=5)
    samples = jammer.samples(RADAR, N_SAMPLES, rx, counter)
    # 40 x 193 independent complex numbers: the mean power is good to 1.1 %.
    assert np.mean(np.abs(samples) ** 2) == pytest.approx(9.0, rel=0.05)
    spectra = np.fft.fft(samples)
    frequency = np.fft.fftfreq(N_SAMPLES, 1 / RADAR.sample_rate_hz)
    assert np.abs(spectra[..., np.abs(frequency) > 75.1e6]).max() < 1e-9 * np.abs(spectra).max()
    # Channel 2 against channel 0: the path from the jammer, in envelope and carrier.
    inside = np.abs(frequency) < 75e6
    delay = np.diff(np.linalg.norm(rx[0, [0, 2]] - jammer.position_m, axis=1))[0] / SPEED_OF_LIGHT
    expected = np.exp(-2j * np.pi * (RADAR.carrier_hz + frequency[inside]) * delay)
    np.testing.assert_allclose(spectra[0, 2, inside] / spectra[0, 0, inside], expected,
                               atol=1e-8)


def test_jammer_noise_belongs_to_the_counter():
    _, rx = _centres(n_pulses=8)
    jammer = Jammer('jammer', (4000.0, 900.0, 10.0), std=1.0)
    whole = jammer.samples(RADAR, N_SAMPLES, rx, np.arange(8))
    part = jammer.samples(RADAR, N_SAMPLES, rx[3:5], np.arange(3, 5))
    np.testing.assert_array_equal(whole[3:5], part)
    assert not np.allclose(whole[0], whole[1])
