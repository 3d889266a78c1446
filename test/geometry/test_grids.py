# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pixel positions of map grids."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry import MapGrid

coordinates = st.floats(-1e6, 1e6)


@given(coordinates, coordinates, st.integers(1, 40), st.integers(1, 40), st.floats(0.01, 100))
def test_north_up_and_centred(x, y, n_x, n_y, spacing):
    grid = MapGrid((x, y, 7.0), n_x, n_y, spacing)
    points = grid.points()
    assert points.shape == (n_y, n_x, 3) == (*grid.shape, 3)
    np.testing.assert_allclose(points.mean(axis=(0, 1)), [x, y, 7.0], atol=1e-8)
    if n_x > 1 and n_y > 1:
        np.testing.assert_allclose(points[0, 1] - points[0, 0], [spacing, 0, 0], atol=1e-8)
        np.testing.assert_allclose(points[1, 0] - points[0, 0], [0, -spacing, 0], atol=1e-8)


@given(st.integers(0, 29), st.integers(0, 19))
def test_positions_and_pixels_are_inverse(column, row):
    grid = MapGrid((1e4, -50.0, 0.0), 30, 20, 0.1)
    found = grid.to_pixels(*grid.points()[row, column, :2])
    np.testing.assert_allclose(found, (row, column), atol=1e-9)


def test_from_size_includes_both_edges():
    grid = MapGrid.from_size((10.0, 0.0, 0.0), 6.0, 30.0, 0.1)
    assert grid.shape == (301, 61)
    np.testing.assert_allclose([grid.x_m[0], grid.x_m[-1]], [7.0, 13.0])
    np.testing.assert_allclose([grid.y_m[0], grid.y_m[-1]], [15.0, -15.0])


@pytest.mark.parametrize(('arguments', 'message'), [
    (((0, 0), 1, 1, 1.0), 'expected three finite numbers'),
    (((0, 0, np.nan), 1, 1, 1.0), 'expected three finite numbers'),
    (((0, 0, 0), 0, 1, 1.0), 'at least one pixel'),
    (((0, 0, 0), 1, 1, 0.0), 'must be positive'),
    (((0, 0, 0), 1, 1, np.inf), 'must be positive and finite'),
])
def test_impossible_grids_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        MapGrid(*arguments)
    if message == 'must be positive':
        with pytest.raises(ValueError, match=message):
            MapGrid.from_size(arguments[0], 5.0, 5.0, arguments[3])
