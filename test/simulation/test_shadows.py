# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Shadows against the trigonometry of a flat earth."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.simulation.shadows import Box, Crown, transmission

RADAR_M = (-1e6, 0.0, 1e6)  # so far that its rays are parallel, 45 degrees above the horizon
BOX = Box((10.0, 14.0), (-3.0, 3.0), 8.0)


def line(x, y=0.0, z=0.0):
    x, y, z = np.broadcast_arrays(x, y, z)
    return np.stack([x, y, z], axis=-1).astype(float).reshape(-1, 3)


def test_shadow_of_a_box_is_as_long_as_it_is_high():
    x = np.arange(0.0, 40.0, 0.05)
    seen = transmission(line(x), RADAR_M, [BOX], [], 0.0)
    # From the front of the box to its height times cot 45 degrees behind its back; the
    # 0.05 m that a ray may touch, and the step of the points.
    dark = x[seen == 0]
    assert dark.min() == pytest.approx(10.0, abs=0.11)
    assert dark.max() == pytest.approx(22.0, abs=0.11)
    assert np.all((seen == 0) | (seen == 1)) and np.all(np.diff(np.flatnonzero(seen == 0)) == 1)


def test_a_box_throws_no_shadow_on_its_own_front_and_roof_nor_beside_it():
    front, roof = line(10.0, z=np.arange(0.0, 8.1, 0.5)), line(np.arange(10.0, 14.1, 0.5), z=8.0)
    beside = line(18.0, y=[-3.2, 3.2])
    behind = line(18.0, y=[-2.8, 2.8])
    above = line(18.0, z=[4.1])  # the ray that grazes the upper edge at the back is 4 m up here
    for points, seen in ((front, 1), (roof, 1), (beside, 1), (behind, 0), (above, 1)):
        np.testing.assert_array_equal(transmission(points, RADAR_M, [BOX], [], 0.0), seen)


def test_a_crown_weakens_by_the_path_through_it_and_back():
    crown = Crown((0.0, 0.0, 5.0), 2.0)
    through_middle, past, in_middle = line(5.0), line(-2.0), line(0.0, z=5.0)
    seen = transmission(np.concatenate([through_middle, past, in_middle]), RADAR_M, [], [crown],
                        2.5)
    # 4 m, nothing and 2 m of leaves, twice, at 2.5 dB per metre
    np.testing.assert_allclose(20 * np.log10(seen), [-20.0, 0.0, -10.0], atol=1e-4)
