# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The recording of the demo: what a radar engineer looks for in an image, in numbers."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.recordings import read_blocks
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.scene import Clutter

BAG = pathlib.Path(__file__).parents[2] / 'bags' / 'countryside'


@pytest.fixture(scope='module')
def scenario():
    return SCENARIOS['countryside']()


@pytest.fixture(scope='module')
def image(scenario):
    profiles = RangeCompressor.for_block(block := concatenate(list(read_blocks(BAG))))(block)
    return np.abs(exact_image(scenario.grid, profiles))


@pytest.fixture(scope='module')
def patch(scenario, image):
    def cut(x_m, y_m):
        grid = scenario.grid
        return image[np.ix_((grid.y_m >= y_m[0]) & (grid.y_m < y_m[1]),
                            (grid.x_m >= x_m[0]) & (grid.x_m < x_m[1]))]
    return cut


def power_db(pixels):
    return 10 * np.log10(np.mean(np.square(pixels, dtype=float)))


MEADOW = ((-68.0, -30.0), (14.0, 24.0))


def test_speckle_is_fully_developed(patch):
    pixels = patch(*MEADOW)
    # Rayleigh: sqrt(4 / pi - 1) = 0.5227, and -4.29 dB at 1 / e of exceeding. 2,600 independent
    # cells of 0.38 m squared: 1.4 % of the ratio, 1 % of the share.
    assert pixels.std() / pixels.mean() == pytest.approx(0.5227, abs=0.02)
    above = np.mean(pixels**2 > np.mean(pixels**2))
    assert above == pytest.approx(np.exp(-1), abs=0.02)


@pytest.mark.parametrize(('x_m', 'y_m', 'level_db'), [
    ((20.0, 44.0), (-26.0, -23.0), -5.0),   # grass
    ((-60.0, -40.0), (49.5, 50.5), -10.0),  # farm track
])
def test_grounds_differ_as_they_should(patch, x_m, y_m, level_db):
    difference = power_db(patch(x_m, y_m)) - power_db(patch(*MEADOW))
    # 130 cells: 0.4 dB, two of them; noise 16 dB below the meadow lifts the track by 1 dB.
    assert difference == pytest.approx(level_db, abs=1.5)


def test_hall_lies_over_towards_the_radar_and_throws_a_shadow(patch):
    meadow = power_db(patch(*MEADOW))
    y = (21.0, 41.0)
    # 8 m of height come to lie 8 m x 500 / 896 = 4.5 m nearer: the wall of x = 30 m from 25.5 m.
    assert power_db(patch((25.6, 29.8), y)) > meadow + 3
    assert power_db(patch((21.0, 25.0), y)) < meadow - 3  # grass before it
    # The shadow of 44 m ends 8 m x 924 / 492 = 15 m behind; the noise is 16 dB below meadow.
    assert power_db(patch((45.0, 57.0), y)) < meadow - 14


def test_moving_cars_are_off_the_road_by_their_radial_speed(scenario, patch):
    aircraft_m, speed = np.array([-866.0, 0.0, 500.0]), 120.0
    cars = {}
    for mover in scenario.movers:
        cars.setdefault(mover.name.rpartition('_')[0], []).append(mover)
    assert len(cars) == 2
    for points in cars.values():
        place = np.mean([m.position_m for m in points], axis=0)
        velocity = np.array(points[0].velocity_m_per_s)
        sight = place - aircraft_m
        # Where a place at rest would have the same range rate (Raney 1971): v_r R / V astray.
        shift = -(sight @ velocity) / speed
        assert abs(shift) > 10
        here = ((place[0] - 1.0, place[0] + 1.0), (place[1] + shift - 3, place[1] + shift + 3))
        # Beside the road, brighter than all grounds; nothing is left where the car is.
        assert power_db(patch(*here)) > power_db(patch(*MEADOW)) + 5
        road = ((place[0] - 1.0, place[0] + 1.0), (place[1] - 2.0, place[1] + 2.0))
        assert power_db(patch(*road)) < power_db(patch(*MEADOW)) - 10


def test_clutter_is_checked():
    with pytest.raises(ValueError, match='three numbers each'):
        Clutter(np.zeros((3, 3)), np.zeros(4))
    with pytest.raises(ValueError, match='not finite'):
        Clutter(np.full((1, 3), np.nan), np.ones(1))
