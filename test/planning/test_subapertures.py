# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the half paths to a polar grid, which say what of the profiles is needed."""

import numpy as np
import pytest

from sar_imaging.geometry.illumination import (
    AntennaPattern,
    Illumination,
    PatternCut,
    Pointing,
)
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.afbp.illumination import parabola, seen_subapertures
from sar_imaging.planning.afbp.subapertures import _bounds


@pytest.mark.parametrize('depth_m', [20.0, 200.0])
def test_bounds_hold_and_are_close(depth_m):
    n_range, n_alpha = 41, 61
    polar = PolarGrid((0.0, 0.0, 50.0), (1.0, 0.0), 1, 0.0, 400.0, depth_m / (n_range - 1),
                      n_range, -0.2, 0.4 / (n_alpha - 1), n_alpha)
    track = np.column_stack([np.linspace(-10, 10, 64), np.zeros(64), np.full(64, 50.0)])[:, None]
    points = polar.lines(*np.meshgrid(polar.range_m, polar.alpha))[0].reshape(-1, 3)
    path = np.linalg.norm(points - track, axis=-1)
    near, far = _bounds(polar, track, track)
    # What may lie between the samples adds 0.20 m measured, a step between directions and pulses.
    assert path.min() - 0.3 < near <= path.min() and path.max() <= far < path.max() + 0.3


def test_parabolas_of_a_platform_that_stands_still_are_constant():
    place = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 3.0]])
    found = np.array(parabola(place, np.tile([2.0, 5.0, 10.0], (4, 1))))
    # straight lines through the outer ones; constant where these are the same
    np.testing.assert_allclose(found[:, :3], [[2, 2, 5], [8, 8, 0], [0, 0, 0]], atol=1e-12)
    value = found[0, 3] + place[3] * (found[1, 3] + found[2, 3] * place[3])
    np.testing.assert_allclose(value, [2.0, 5.0, 10.0])


@pytest.mark.parametrize('pulse', range(32, 64, 3))
def test_one_pulse_that_lights_the_grid_makes_its_subaperture_seen(pulse):
    """Of 9 pulses of each that were looked at none lit the grid: the image was empty."""
    polar = PolarGrid((0.0, 0.0, 50.0), (1.0, 0.0), 1, 0.0, 1000.0, 0.5, 41, -0.002, 1e-4, 41)
    centre = np.zeros((96, 3))
    centre[:, 0], centre[:, 2] = np.linspace(-10.0, 10.0, 96), 50.0
    look = np.tile([1.0, 0.0, 0.0], (96, 1))
    look[pulse] = [0.0, 1.0, 0.0]
    pattern = AntennaPattern(PatternCut.gaussian(0.002))
    lit = Illumination.of_pulses(pattern, Pointing(look), centre[:, None], centre[:, None])
    cuts = [slice(0, 32), slice(32, 64), slice(64, 96)]
    assert seen_subapertures(polar, cuts, lit, 1) == {1}
