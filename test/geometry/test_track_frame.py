# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Frame of a track: against directions that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry.track import main_axis, mean_centres, track_beside


@given(st.floats(0.0, 2 * np.pi), st.booleans(), st.floats(-1e5, 1e5))
def test_a_straight_track_beside_a_scene(heading_rad, left, offset_m):
    along = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    across = np.array([-along[1], along[0]]) * (1 if left else -1)
    centres = np.zeros((9, 3))
    centres[:, :2] = offset_m + np.linspace(-40.0, 40.0, 9)[:, None] * along
    track, side = track_beside(centres, offset_m + 500.0 * across)
    assert abs(track @ along) == pytest.approx(1.0, abs=1e-9)
    assert side == (1 if left else -1) * round(track @ along)


def test_a_track_that_is_a_point_looks_broadside():
    track, side = track_beside(np.array([[1.0, 2.0, 5.0]] * 3), (1.0, 102.0, 0.0))
    np.testing.assert_allclose(track, [-1.0, 0.0], atol=1e-12)
    assert side == -1


def test_axes_by_extent():
    places = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    axes, extents = main_axis(places + 7.0)
    np.testing.assert_allclose(np.abs(axes[:2]), [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(extents, np.sqrt([18.0, 2.0, 0.0]), atol=1e-12)


def test_mean_centres_of_channels():
    tx = np.arange(12.0).reshape(2, 2, 3)
    np.testing.assert_allclose(mean_centres(tx, tx + 2.0), [[2.5, 3.5, 4.5], [8.5, 9.5, 10.5]])
