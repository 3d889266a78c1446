# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Reproducible noise and the track with its perturbations."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.simulation.noise import complex_gaussian, gaussian
from sar_imaging.simulation.trajectory import (
    POSITION_STEP_M,
    RasterScan,
    Trajectory,
    Vibration,
)


def test_noise_is_circular_with_variance_one():
    z = complex_gaussian(7, 0, 200_000)
    # Standard errors: 0.0016 of each mean, 0.0022 of the power, 0.0022 of the correlation.
    assert abs(z.mean()) < 0.01
    assert np.mean(np.abs(z) ** 2) == pytest.approx(1.0, abs=0.012)
    assert abs(np.mean(z**2)) < 0.012
    # Kurtosis of a Gaussian: E|z|^4 = 2 (E|z|^2)^2.
    assert np.mean(np.abs(z) ** 4) == pytest.approx(2.0, abs=0.06)
    assert np.std(gaussian(7, 0, 200_000)) == pytest.approx(1.0, abs=0.01)


def test_noise_depends_on_seed_and_stream_only():
    np.testing.assert_array_equal(complex_gaussian(1, 2, 50), complex_gaussian(1, 2, 90)[:50])
    for other in (complex_gaussian(1, 3, 5000), complex_gaussian(2, 2, 5000)):
        correlation = np.mean(complex_gaussian(1, 2, 5000) * other.conj())
        assert abs(correlation) < 0.06  # four standard errors


def test_noise_is_the_same_for_ever():
    # Recorded once: the recordings in bags/ depend on these numbers.
    expected = [(-0.8124316728165106+0.3768163922011614j),
                (-0.1573860078393802+0.9180045125809495j)]
    np.testing.assert_allclose(complex_gaussian(1, 2, 2), expected, rtol=1e-14)


def test_straight_track_is_centred_and_on_the_micrometre_grid():
    time = (np.arange(200) - 99.5) / 667
    track = Trajectory((0.0, 0.0, 3.0), (0.0, 200.0, 0.0)).positions(time)
    assert track.shape == (200, 3)
    np.testing.assert_allclose(track[:, 1], 200 * time, rtol=0, atol=POSITION_STEP_M / 2)
    np.testing.assert_array_equal(track[:, [0, 2]], np.tile([0.0, 3.0], (200, 1)))
    np.testing.assert_array_equal(track % POSITION_STEP_M, 0)


def test_perturbations_add_up_as_documented():
    time = np.linspace(-2, 2, 4001)
    straight = Trajectory((1.0, 2.0, 3.0), (0.0, 25.0, 0.0))
    bent = Trajectory(
        (1.0, 2.0, 3.0), (0.0, 25.0, 0.0), polynomial=((0.1, 0.0, -0.2), (0.0, 0.03, 0.0)),
        vibrations=(Vibration((0.0, 0.0, 0.05), 0.5, 0.25),), broadband_m=(0.001, 0.0, 0.0),
        seed=4)
    extra = bent.positions(time) - straight.positions(time)
    broadband = extra[:, 0] - 0.1 * time**2
    assert np.std(broadband) == pytest.approx(0.001, rel=0.05)
    np.testing.assert_allclose(extra[:, 1], 0.03 * time**3, rtol=0, atol=2 * POSITION_STEP_M)
    expected = -0.2 * time**2 + 0.05 * np.cos(np.pi * time)
    np.testing.assert_allclose(extra[:, 2], expected, rtol=0, atol=2 * POSITION_STEP_M)
    np.testing.assert_array_equal(bent.positions(time), bent.positions(time))


def test_a_raster_goes_there_and_back():
    scan = RasterScan((1.0, 2.0, 3.0), (0.25, 0.0, 0.0), (0.0, 0.0, 0.5), 3, 100.0)
    places = scan.positions(np.arange(8) / 100.0 - 0.035)
    assert places.tolist() == [
        [1.0, 2.0, 3.0], [1.25, 2.0, 3.0], [1.5, 2.0, 3.0],
        [1.5, 2.0, 3.5], [1.25, 2.0, 3.5], [1.0, 2.0, 3.5],
        [1.0, 2.0, 4.0], [1.25, 2.0, 4.0]]


@pytest.mark.parametrize(('n_per_row', 'rate_hz'), [(0, 1.0), (1, 0.0), (1, float('nan'))])
def test_a_raster_without_places_is_refused(n_per_row, rate_hz):
    with pytest.raises(ValueError, match='at least one place in a row and a positive rate'):
        RasterScan((0.0,) * 3, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), n_per_row, rate_hz)
