# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Weighted correlation, what images with illumination are measured against."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.correlation import correlate, correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal import PulseBlock, RadarParameters
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.simulation.echoes import EchoSimulator

PATTERN = AntennaPattern(PatternCut.sinc(0.12), PatternCut.gaussian(0.5))


@pytest.fixture(scope='module')
def block():
    """Profiles of scatterers beside a track, with an antenna that looks a little ahead."""
    rng = np.random.default_rng(4)
    n = 16
    tx = np.zeros((n, 2, 3))
    tx[:, :, 0] = np.linspace(-12, 12, n)[:, None]
    tx[..., 2] = 20.0
    rx = tx + [[[0.0, 0, 0], [0.3, 0.0, 0.1]]]
    points = np.c_[rng.uniform(-8, 8, 12), rng.uniform(70, 90, 12), np.zeros(12)]
    radar = RadarParameters(9.6e9, 200e6, 300e6, 2 * 55 / 299792458.0)
    samples = EchoSimulator(radar, 128, compressed=True, points_m=points,
                            amplitudes=np.exp(2j * np.pi * rng.random(12)))(tx, rx)
    pointing = Pointing.beside_track(tx.mean(axis=1), 1, 0.2, 0.05)
    return PulseBlock(radar, True, np.arange(n), np.arange(n), samples, tx, rx, pointing=pointing)


POINTS = MapGrid((0.0, 80.0, 0.0), 9, 7, 1.5).points().reshape(-1, 3)


def test_correlation_is_the_weighted_sum_of_single_echoes(block):
    """Each echo by itself, times its amplitude: the definition."""
    lit = Illumination.of_pulses(PATTERN, block.pointing, block.tx_m, block.rx_m)
    weight = lit.amplitude(POINTS).reshape(block.n_pulses, block.n_channels, -1)
    assert 0.1 < (weight > 0).mean() < 0.9  # some are lit, some are not
    expected, by_spectra = 0, 0
    frequencies, spectra = band_spectrum(block)
    for m in range(block.n_pulses):
        for n in range(block.n_channels):
            one = dataclasses.replace(block.select([m]), samples=block.samples[m:m + 1, n:n + 1],
                                      tx_m=block.tx_m[m:m + 1, n:n + 1],
                                      rx_m=block.rx_m[m:m + 1, n:n + 1])
            expected = expected + weight[m, n] * correlate_profiles(one, POINTS)[0]
            by_spectra = by_spectra + weight[m, n] * correlate(
                frequencies, spectra[m:m + 1, n:n + 1], one.tx_m, one.rx_m, POINTS)
    for backend in ('cpu', 'reference'):
        found, covered = correlate_profiles(block, POINTS, illumination=PATTERN, backend=backend)
        np.testing.assert_allclose(found, expected, atol=1e-9 * abs(expected).max())
        found = correlate(frequencies, spectra, block.tx_m, block.rx_m, POINTS, illumination=lit,
                          backend=backend)
        np.testing.assert_allclose(found, by_spectra, atol=1e-9 * abs(by_spectra).max())
    assert covered.all()


def test_plan_image_correlates_with_illumination(block):
    grid = MapGrid((0.0, 80.0, 0.0), 9, 7, 1.5)
    imager = plan_image(grid, block.radar, block.n_samples, method='correlation',
                        illumination=PATTERN)
    expected, _ = correlate_profiles(block, POINTS, illumination=PATTERN)
    np.testing.assert_allclose(imager(block).samples.ravel(), expected,
                               atol=1e-6 * abs(expected).max())
    with pytest.raises(ValueError, match='Pointing.beside_track'):
        imager(dataclasses.replace(block, pointing=None))
    with pytest.raises(ValueError, match="'wavenumber' knows no illumination"):
        plan_image(grid, block.radar, block.n_samples, method='wavenumber', illumination=PATTERN)
