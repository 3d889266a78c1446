# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Spectra of many scatterers against the sum over each of them."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.signal.radar import RadarParameters
from sar_imaging.simulation import echoes
from sar_imaging.simulation.echoes import dense_spectrum


@pytest.mark.parametrize('n_bins', [255, 256])
def test_spectrum_is_that_of_the_sum_over_scatterers(n_bins):
    rng = np.random.default_rng(n_bins)
    # Before the reference, inside the interval that n_bins hold, and beyond it.
    delays_s = 6.6e-6 + rng.uniform(-1e-6, 2e-6, (2, 3, 400))
    amplitudes = rng.normal(size=400) + 1j * rng.normal(size=400)
    arguments = (10e9, -(n_bins - 1) / 2, n_bins, 500e6 / n_bins, delays_s, amplitudes, 6.6e-6)
    expected = echoes.scene_spectrum(*arguments)
    # Taylor's rest of 1e-12 of each amplitude, and 6.6e4 cycles of carrier in float64: 2e-11.
    assert np.abs(dense_spectrum(*arguments) - expected).max() < 1e-10 * np.abs(amplitudes).sum()


@pytest.mark.parametrize('compressed', [False, True])
def test_a_scene_has_the_same_echoes_however_many_are_simulated_at_once(monkeypatch, compressed):
    radar = RadarParameters(10e9, 400e6, 500e6, 6.6e-6, *(() if compressed else (2e-7, 2e15)))
    rng = np.random.default_rng(4)
    points = np.array([1000.0, 0.0, 0.0]) + rng.uniform(-3, 3, (300, 3))
    amplitudes = rng.normal(size=300) + 0j
    tx = rng.uniform(-1, 1, (3, 2, 3))
    simulator = echoes.EchoSimulator(radar, 256, compressed=compressed, points_m=points,
                                     amplitudes=amplitudes)
    one_by_one = simulator(tx, tx + 0.1)
    monkeypatch.setattr(echoes, 'DENSE', 300)
    together = simulator(tx, tx + 0.1)
    # The limit of the first test, spread over the samples.
    np.testing.assert_allclose(together, one_by_one, rtol=0, atol=1e-9 * np.abs(one_by_one).max())
