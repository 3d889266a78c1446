# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ghosts of a scatterer, against those that an image of its echoes has."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.ambiguities import azimuth_warnings, flight_warnings
from sar_imaging.planning.profiles import some_pixels
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters

RADAR = RadarParameters(10e9, 50e6, 80e6, 2 * 900.0 / SPEED_OF_LIGHT)
GRID = MapGrid((1000.0, 0.0, 0.0), 16, 240, 0.5)  # 120 m along the track


def told(step_m, n_channels=1, width_m=0.0, order=None, pattern=None):
    """Warnings of a straight track whose channels follow each other."""
    n = 64
    centre = np.zeros((n, n_channels, 3))
    centre[..., 1] = ((np.arange(n) - n / 2) * step_m)[:, None] + np.arange(n_channels) * width_m
    centre = centre if order is None else centre[order]
    pulses = PulseBlock(RADAR, True, np.arange(n), np.arange(n), np.zeros(
        (n, n_channels, 100), np.complex64), centre, centre,
        pointing=Pointing.steered(centre.mean(axis=1), np.array(GRID.centre_m)))
    report = plan_image(GRID, RADAR, 100, centre, centre, method='exact', illumination=pattern,
                        pointing=pulses.pointing).report
    return [w for w in report.warnings if 'ambiguous' in w]


def number_before(text, unit):
    words = text.replace(',', '').split()
    return next(float(a) for a, b in zip(words, words[1:], strict=False) if b == unit)


def test_a_ghost_is_where_and_as_bright_as_in_an_image():
    """lambda R / 2 d = 30 m for pulses 0.5 m apart."""
    [warning] = told(0.5)
    away_m = number_before(warning, 'm')
    assert away_m == pytest.approx(30.0, rel=0.03)
    y = (np.arange(64) - 32) * 0.5
    scatterer, x = -away_m / 2, np.sqrt(1e6)
    path = np.hypot(x, y - scatterer)
    place = np.linspace(-40, 40, 1601)
    image = [abs(np.sum(np.exp(4j * np.pi / RADAR.wavelength_m * (np.hypot(x, y - p) - path))))
             for p in place]
    beyond = place > scatterer + 5.0
    ghost = int(np.argmax(np.where(beyond, image, 0)))
    assert place[ghost] - scatterer == pytest.approx(away_m, abs=0.5)
    # the walk through ranges, 64 * 0.5 m * 0.03 of 3 m, costs 1.2 dB
    level_db = -20 * np.log10(image[ghost] / max(image))
    assert number_before(warning, 'dB') == pytest.approx(level_db, abs=2.0)


@pytest.mark.parametrize('right', [
    {'step_m': 0.1}, {'step_m': 0.5, 'n_channels': 5, 'width_m': 0.1},
    {'step_m': 0.1, 'order': np.random.default_rng(0).permutation(64)},
    {'step_m': 0.5, 'pattern': AntennaPattern(PatternCut.uniform(0.012))}])
def test_right_recordings_are_not_accused(right):
    """Fine steps, channels between the pulses, any order, an antenna that lights less."""
    assert told(**right) == []


def test_the_spacing_that_is_told_has_no_ghosts():
    [warning] = told(0.5)
    step_m = number_before(warning[warning.index('every'):], 'm')
    assert told(step_m) == []


def test_few_places_and_a_look_ahead_tell_nothing():
    points = some_pixels(GRID)
    centre = np.zeros((64, 3))
    assert azimuth_warnings(points, centre, centre, RADAR) == ()
    centre[:, 0] = np.arange(64) * 0.5  # towards the scene
    assert azimuth_warnings(points, centre, centre, RADAR) == ()


@pytest.mark.parametrize(('interval_s', 'expected'), [
    (1e-3, ''), (1e-9, ''), (6e-6, '1 more pulses'), (2.1e-6, '3 more pulses')])
def test_pulses_in_flight_are_told(interval_s, expected):
    """1 km is 6.7 us there and back; stamps closer than a profile, 1.25 us, are none of pulses."""
    n, stamps = 16, (np.arange(16) * interval_s * 1e9).astype(np.int64)
    block = PulseBlock(RADAR, True, stamps, np.arange(n), np.zeros((n, 1, 100), np.complex64),
                       np.zeros((n, 1, 3)), np.zeros((n, 1, 3)))
    place = np.array([GRID.centre_m])
    told = ' '.join(flight_warnings(place, block, None))
    assert told.startswith(expected) and bool(told) == bool(expected)
    assert flight_warnings(place, block, AntennaPattern(PatternCut.uniform(0.1))) == ()
    if expected:
        image = plan_image(GRID, RADAR, 100, method='exact')(dataclasses.replace(
            block, tx_m=block.tx_m + np.arange(n)[:, None, None] * [0, 0.1, 0],
            rx_m=block.rx_m + np.arange(n)[:, None, None] * [0, 0.1, 0]))
        assert told in image.report.warnings
