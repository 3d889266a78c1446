# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Windows of the lattice: pixels, tiles and grids; surfaces beside the curvature of the Earth."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.archive.windows import Window, surface_z, union
from sar_imaging.geometry import Datum

numbers = st.integers(-5000, 5000)
windows = st.builds(lambda r, c, n, m: Window(r, r + n, c, c + m), numbers, numbers,
                    st.integers(1, 300), st.integers(1, 300))


@given(windows, st.sampled_from([0.1, 0.25, 3.0]))
def test_grids_lie_on_the_lattice(window, spacing):
    grid = window.grid(spacing, 7.0)
    assert grid.shape == window.shape
    rows, columns = np.arange(window.row0, window.row1), np.arange(window.column0, window.column1)
    # whole pixels of the lattice but for rounding
    np.testing.assert_allclose(grid.x_m / spacing, columns, atol=1e-8)
    np.testing.assert_allclose(-grid.y_m / spacing, rows, atol=1e-8)
    assert grid.z_m == 7.0
    corners = grid.points()[::max(1, grid.n_y - 1), ::max(1, grid.n_x - 1)].reshape(-1, 3)
    assert Window.around(corners, spacing) == window


@given(windows, st.sampled_from([7, 64, 2048]))
def test_tiles_cover_a_window_once(window, tile):
    parts = [window.intersection(t) for t in window.tiles(tile)]
    assert None not in parts
    assert sum(p.n_pixels for p in parts) == window.n_pixels
    assert all(v % tile == 0 for t in window.tiles(tile) for v in t.as_tuple)
    assert union(window.tiles(tile)) == window.on_tiles(tile)
    assert union(parts) == window


@given(windows, windows)
def test_intersections_index_both_arrays(one, other):
    common = one.intersection(other)
    pixels = [{(r, c) for r in (w.row0, w.row1 - 1) for c in (w.column0, w.column1 - 1)}
              for w in (one, other)]
    if common is None:
        assert not pixels[0] & pixels[1]
        return
    rows, columns = np.arange(one.row0, one.row1), np.arange(one.column0, one.column1)
    at_rows, at_columns = common.within(one)
    assert (rows[at_rows][0], rows[at_rows][-1] + 1) == (common.row0, common.row1)
    assert (columns[at_columns][0], columns[at_columns][-1] + 1) == (common.column0,
                                                                     common.column1)
    assert common == other.intersection(one) == common.intersection(one)


def test_a_window_has_pixels():
    with pytest.raises(ValueError, match='at least one pixel'):
        Window(3, 3, 0, 4)


@pytest.mark.parametrize('height_m', [0.0, 300.0, -40.0])
def test_a_surface_is_at_its_height_and_falls_with_distance(height_m):
    datum = Datum(45.0, 7.0, 250.0)
    assert surface_z(0.0, 0.0, datum, height_m) == pytest.approx(height_m, abs=1e-6)
    distance = 10e3
    drop = height_m - surface_z(distance, 0.0, datum, height_m)
    # d^2 / 2R with radii of curvature of 6,335 to 6,400 km, and 4 m of 7.8 m more or less
    assert drop == pytest.approx(distance**2 / (2 * 6378e3), rel=0.01)
