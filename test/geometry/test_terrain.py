# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Heights from a file at the pixels of a map, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.terrain import Terrain

GRID = MapGrid((10.0, -5.0, 3.0), 9, 7, 0.5)


def plane(x, y):
    return 2.0 + 0.3 * x - 0.1 * y + 0.05 * x * y  # what bilinear interpolation keeps


def raster(x, y):
    return Terrain(x, y, plane(np.array(x), np.array(y)[:, None]))


@given(order_x=st.booleans(), order_y=st.booleans(),
       x=st.lists(st.floats(0.1, 3.0), min_size=8, max_size=20),
       y=st.lists(st.floats(0.1, 3.0), min_size=6, max_size=20))
def test_heights_are_bilinear_whatever_the_order_and_spacing_of_the_raster(order_x, order_y, x, y):
    x, y = np.cumsum([7.0, *x]), np.cumsum([-8.0, *y])
    terrain = raster(x[::-1] if order_x else x, y[::-1] if order_y else y)
    points = GRID.points()
    edge = 1e-9  # sums of tenths round
    inside = ((points[..., 0] <= x[-1] + edge) & (points[..., 1] <= y[-1] + edge)
              & (points[..., 0] >= x[0] - edge) & (points[..., 1] >= y[0] - edge))
    if not inside.any():
        with pytest.raises(ValueError, match='none of its known heights'):
            terrain.heights(GRID)
        return
    heights = terrain.heights(GRID)
    np.testing.assert_array_equal(np.isfinite(heights), inside)
    np.testing.assert_allclose(heights[inside],
                               plane(points[..., 0], points[..., 1])[inside], rtol=1e-9)


def test_a_raster_on_the_pixels_themselves_is_taken_as_it_is():
    heights = np.random.default_rng(0).normal(size=GRID.shape)
    heights[2, 3] = np.nan
    np.testing.assert_allclose(Terrain(GRID.x_m, GRID.y_m, heights).heights(GRID), heights)


def test_a_file_is_read_as_it_was_written(tmp_path):
    terrain = raster([0.0, 5.0, 20.0], [0.0, -20.0])
    terrain.save(tmp_path / 'hill.npz')
    loaded = Terrain.load(tmp_path / 'hill.npz')
    for name in ('x_m', 'y_m', 'height_m'):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(terrain, name))
    # Whole numbers are numbers too.
    np.savez(tmp_path / 'whole.npz', x_m=[0, 5], y_m=[0, 5], height_m=np.eye(2, dtype=np.int16))
    assert Terrain.load(str(tmp_path / 'whole.npz')).height_m.dtype == float


@pytest.mark.parametrize(('arrays', 'message'), [
    ({'x_m': [0, 1], 'y_m': [0, 1]}, 'has no height_m'),
    ({'x_m': [0, 1], 'y_m': [0, 1], 'height_m': np.zeros((2, 3))}, r'expected \(2, 2\)'),
    ({'x_m': [0, 0], 'y_m': [0, 1], 'height_m': np.zeros((2, 2))}, 'x_m .* ascending'),
    ({'x_m': [0, 1], 'y_m': [0], 'height_m': np.zeros((1, 2))}, 'y_m .* two or more'),
    ({'x_m': [0, 1], 'y_m': [0, np.nan], 'height_m': np.zeros((2, 2))}, 'y_m .* finite'),
    ({'x_m': [0, 1], 'y_m': [0, 1], 'height_m': np.full((2, 2), np.nan)}, 'nothing but NaN'),
    ({'x_m': [0, 1], 'y_m': [0, 1], 'height_m': [[0, np.inf], [0, 0]]}, 'infinities'),
    ({'x_m': [0, 1], 'y_m': [0, 1], 'height_m': [['a', 'b'], ['c', 'd']]}, 'numbers')])
def test_impossible_arrays_are_refused_with_the_name_of_the_file(tmp_path, arrays, message):
    np.savez(tmp_path / 'bad.npz', **arrays)
    with pytest.raises(ValueError, match=rf'(?s)bad\.npz.*{message}'):
        Terrain.load(tmp_path / 'bad.npz')


def test_other_files_are_refused(tmp_path):
    np.save(tmp_path / 'array.npy', np.zeros((2, 2)))
    (tmp_path / 'text.npz').write_text('x y z')
    (tmp_path / 'empty.npz').write_bytes(b'')
    (tmp_path / 'cut.npz').write_bytes(b'PK\x03\x04 and no more')
    for name in ('array.npy', 'text.npz', 'empty.npz', 'cut.npz', 'absent.npz'):
        with pytest.raises(ValueError, match=name):
            Terrain.load(tmp_path / name)


def test_terrain_beside_the_grid_is_refused_with_both_extents():
    with pytest.raises(ValueError, match='x 100 to 200 m .* grid of x 8 to 12 m'):
        raster([100.0, 200.0], [-10.0, 10.0]).heights(GRID)
