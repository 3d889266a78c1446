# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Antenna patterns and pointing: closed forms, conventions, and what is refused."""

import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.illumination import (
    AntennaPattern,
    Illumination,
    PatternCut,
    Pointing,
)
from sar_imaging.signal import PulseBlock, RadarParameters
from sar_imaging.signal.pulses import concatenate

CUTS = {'uniform': PatternCut.uniform, 'gaussian': PatternCut.gaussian,
        'cosine': PatternCut.cosine, 'sinc': PatternCut.sinc}


@pytest.mark.parametrize('name', CUTS)
@given(width=st.floats(0.005, 0.9))
def test_half_power_of_one_way_lies_at_half_the_width(name, width):
    cut = CUTS[name](width)
    # the table's points lie closer than a thousandth of what is lit
    assert cut.width_rad == pytest.approx(width, rel=3e-3)
    assert float(cut.at(width / 2)) == pytest.approx(0.5, abs=1e-3)
    assert float(cut.at(0.0)) == pytest.approx(1.0, abs=1e-9)
    assert cut.two_way_width_rad < width
    low, high = cut.cutoff_rad
    assert cut.at(1.0001 * high) == 0 and cut.at(1.0001 * low) == 0
    # it ends smoothly: no pixel appears at once
    assert float(cut.at(0.999 * high)) < 1e-3
    assert float(cut.at(np.pi)) == 0.0


def test_formulas_of_the_cuts():
    angle = np.linspace(-0.1, 0.1, 401)
    # tables of 1025 points are linear to 4e-6 of the peak or so
    np.testing.assert_allclose(PatternCut.gaussian(0.1).at(angle), 2.0 ** -(20 * angle) ** 2,
                               atol=1e-5)
    np.testing.assert_allclose(PatternCut.cosine(0.2).at(angle),
                               np.cos(np.pi * angle / 0.4) ** 2, atol=1e-5)
    # An aperture of 20 wavelengths: half power where sinc^2 = 1/2, at 0.443 / 20
    width = 2 * np.arcsin(0.44294647 / 20)
    expected = np.where(abs(angle) < np.arcsin(1 / 20), np.sinc(20 * np.sin(angle)) ** 2, 0.0)
    np.testing.assert_allclose(PatternCut.sinc(width).at(angle), expected, atol=1e-5)
    table = PatternCut.measured([-0.1, -0.02, 0.05, 0.1], [0.0, 0.8, 1.0, 0.2])
    np.testing.assert_allclose(table.at([-0.1, -0.02, 0.05, 0.1]), [0.0, 0.8, 1.0, 0.2],
                               atol=2e-3)
    assert table.at(0.1001) == 0.0


@given(azimuth=st.floats(-1.2, 1.2), elevation=st.floats(-1.2, 1.2), range_m=st.floats(1, 1e6),
       seed=st.integers(0, 99))
def test_angles_are_counted_from_the_antennas_axes(azimuth, elevation, range_m, seed):
    """Azimuth is out of the plane of boresight and up, elevation within it."""
    turn = Rotation.random(random_state=seed)
    ahead, up = turn.apply([0, 1, 0]), turn.apply([0, 0, 1])
    right = np.cross(ahead, up)
    look = (np.sin(azimuth) * right + np.cos(azimuth) * (np.cos(elevation) * ahead
                                                         + np.sin(elevation) * up))
    pattern = AntennaPattern(PatternCut.measured([-1.5, 1.5], [0.2, 1.0]),
                             PatternCut.measured([-1.5, 1.5], [1.0, 0.1]))
    centre = np.array([[[10.0, -20.0, 5.0]]])
    lit = Illumination.of_pulses(pattern, Pointing([ahead], up), centre, centre)
    expected = (0.2 + 0.8 * (azimuth + 1.5) / 3) * (1.0 - 0.9 * (elevation + 1.5) / 3)
    found = lit.amplitude(centre[0] + range_m * look)
    assert found.shape == (1, 1)
    # the tables of sines are coarse far off boresight
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert lit.amplitude(centre[0] - range_m * look)[0, 0] == 0.0  # behind the antenna


def test_pointings_look_where_they_say():
    along = np.linspace(0, 100, 51)
    track = np.stack([along, np.zeros(51), np.full(51, 30.0)], axis=1)
    left = Pointing.beside_track(track, 1, depression_rad=0.3)
    np.testing.assert_allclose(left.boresight, np.tile([0, np.cos(0.3), -np.sin(0.3)], (51, 1)),
                               atol=1e-12)
    squinted = Pointing.beside_track(track, -1, 0.0, squint_rad=0.2)
    np.testing.assert_allclose(squinted.boresight[7], [np.sin(0.2), -np.cos(0.2), 0], atol=1e-12)
    spot = Pointing.steered(track, [50.0, 200.0, 0.0])
    cross = np.cross(spot.boresight, np.array([50.0, 200.0, 0.0]) - track)
    np.testing.assert_allclose(cross, 0.0, atol=1e-10)
    turning = Pointing.rotating([0.0, 0.25], 2 * np.pi)
    np.testing.assert_allclose(turning.boresight, [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    quarter = Rotation.from_euler('z', [[0], [90]], degrees=True)
    for attitude in (quarter, quarter.as_quat()):
        bolted = Pointing.fixed(attitude, [1, 0, 0], [0, 0, 1])
        np.testing.assert_allclose(bolted.boresight, [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    for pointing in (left, squinted, spot, turning):
        axes = pointing.axes  # right-handed and orthonormal
        np.testing.assert_allclose(axes @ axes.swapaxes(1, 2) - np.eye(3), 0.0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=1e-12)


def test_all_of_it_travels_and_compares(tmp_path):
    pattern = AntennaPattern(PatternCut.sinc(0.1), PatternCut.gaussian(0.4))
    pointing = Pointing.steered(np.random.default_rng(1).normal(size=(5, 3)), [0, 900.0, 0])
    centres = np.zeros((5, 2, 3))
    lit = Illumination.of_pulses(pattern, pointing, centres, centres)
    again = pickle.loads(pickle.dumps(lit))
    points = np.random.default_rng(2).normal(size=(4, 3)) + [0, 900.0, 0]
    np.testing.assert_array_equal(again.amplitude(points), lit.amplitude(points))
    assert pointing.same_as(Pointing.join([pointing.select(slice(0, 2)),
                                           pointing.select(slice(2, 5))]))
    assert not pointing.same_as(pointing.select([0, 1, 2, 4, 3]))
    with pytest.raises(dataclasses.FrozenInstanceError):
        pointing.up = 0


def test_blocks_carry_the_pointing_of_their_pulses():
    radar = RadarParameters(10e9, 100e6, 150e6, 1e-6)
    pointing = Pointing.rotating(np.arange(6) / 10, 1.0)
    centres = np.arange(18.0).reshape(6, 1, 3)
    block = PulseBlock(radar, True, np.arange(6), np.arange(6), np.zeros((6, 1, 8)), centres,
                       centres, pointing=pointing)
    parts = [block.select(slice(0, 2)), block.select(np.arange(2, 6))]
    assert concatenate(parts).pointing.same_as(pointing)
    assert not block.matches(dataclasses.replace(block, pointing=None))
    with pytest.raises(ValueError, match='pointing is for 3 pulses, the block has 6'):
        dataclasses.replace(block, pointing=pointing.select(slice(0, 3)))


@pytest.mark.parametrize('call, message', [
    (lambda: PatternCut.gaussian(0.0), 'expected a width between 0 and pi'),
    (lambda: PatternCut.gaussian(1.5), 'smaller width or cutoff_rad'),
    (lambda: PatternCut.uniform(0.1, 0.2), 'at most width_rad'),
    (lambda: PatternCut.measured([0.1, 0.0], [1, 1]), 'ascending angles'),
    (lambda: PatternCut.measured([0.0, 0.1], [1, -1]), 'none negative'),
    (lambda: PatternCut(0.0, 0.1, [0.0, 0.0]), 'not all zero'),
    (lambda: PatternCut(0.0, 1.0, [1.0, 1.0, 1.0]), 'between -1 and 1'),
    (lambda: AntennaPattern(0.1), 'azimuth is a float'),
    (lambda: Pointing([1.0, 0.0, 0.0]), r'expected \(P, 3\)'),
    (lambda: Pointing([[0.0, 0.0, 0.0]]), 'boresight of pulse 0 has no length'),
    (lambda: Pointing([[0.0, 0.0, -1.0]]), 'pass another up'),
    (lambda: Pointing([[1.0, 0.0, np.nan]]), 'NaN'),
    (lambda: Pointing([[1.0, 0.0, 0.0]], [[0, 0, 1.0]] * 2), 'up.shape'),
    (lambda: Pointing.fixed([[0.0, 0, 0, 2]], [1, 0, 0]), 'unit quaternions'),
    (lambda: Pointing.beside_track(np.zeros((4, 3)), 1), 'Pointing.fixed'),
    (lambda: Pointing.beside_track(np.eye(3), 2), 'side=2'),
    (lambda: Illumination.of_pulses(AntennaPattern(PatternCut.sinc(0.1)), Pointing(np.eye(3)[:2]),
                                    np.zeros((3, 1, 3)), np.zeros((3, 1, 3))),
     'for 2 pulses, there are 3'),
])
def test_wrong_input_is_told(call, message):
    with pytest.raises(ValueError, match=message):
        call()
