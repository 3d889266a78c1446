# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Unified polar coordinates."""

import numpy as np
import pytest

from sar_imaging.geometry.polar import PolarGrid

GRID = PolarGrid((100.0, -40.0, 300.0), (0.6, 0.8), -1, 20.0, 700.0, 0.5, 11, -0.1, 0.02, 9)


def test_points_have_their_coordinates():
    position, *_ = GRID.lines(GRID.range_m, GRID.alpha[:, None])
    offset = position - np.array(GRID.origin_m)
    r = np.linalg.norm(offset, axis=-1)
    np.testing.assert_allclose(r, np.broadcast_to(GRID.range_m, r.shape), atol=1e-9)
    np.testing.assert_allclose(offset[..., :2] @ GRID.track / r,
                               np.broadcast_to(GRID.alpha[:, None], r.shape), atol=1e-12)
    assert (position[..., 2] == 20.0).all()
    assert (offset[..., :2] @ GRID.across > 0).all()


def test_from_map_is_the_inverse():
    position, *_ = GRID.lines(GRID.range_m, GRID.alpha[:, None])
    r, alpha = GRID.from_map(position[..., 0], position[..., 1])
    np.testing.assert_allclose(r, np.broadcast_to(GRID.range_m, r.shape), atol=1e-9)
    np.testing.assert_allclose(alpha, np.broadcast_to(GRID.alpha[:, None], r.shape), atol=1e-12)


@pytest.mark.parametrize(('range_m', 'alpha'), [(720.0, 0.07), (310.0, -0.4)])
def test_derivatives_by_range(range_m, alpha):
    # Five points: h^4 / 30 of the fifth derivative is below 1e-9 of the first; where the line
    # bends most (310 m) one derivative grows on the other by 1 / 13 m.
    step = 2e-3 * (range_m - 280.0)
    at = [GRID.lines(range_m + k * step, alpha) for k in (-2, -1, 0, 1, 2)]
    for order in range(4):
        difference = (at[0][order] - 8 * at[1][order] + 8 * at[3][order] - at[4][order]) / (
            12 * step)
        np.testing.assert_allclose(difference, at[2][order + 1], rtol=1e-4, atol=1e-14)


@pytest.mark.parametrize(('range_m', 'alpha'), [(720.0, 0.07), (310.0, -0.3)])
def test_derivative_by_direction(range_m, alpha):
    step = 1e-5
    before, after = (GRID.lines(range_m, alpha + d)[0] for d in (-step, step))
    # Central difference: rounding of 1e-13 m over the step.
    np.testing.assert_allclose((after - before) / (2 * step), GRID.by_direction(range_m, alpha),
                               rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(('change', 'message'), [
    ({'n_range': 0}, 'expected at least one each'),
    ({'range_start_m': 280.0}, 'does not reach the plane'),
    ({'range_start_m': -5.0}, 'does not reach the plane'),
    # At 300 m the plane 280 m below is reached where the cosine is below 0.359, at either end.
    ({'range_start_m': 300.0, 'alpha_start': 0.2, 'alpha_spacing': 0.02},
     'at alpha=0.3600 does not reach the plane'),
    ({'range_start_m': 300.0, 'alpha_start': -0.36}, 'at alpha=0.3600 does not reach the plane'),
])
def test_impossible_grids_are_refused(change, message):
    fields = {name: getattr(GRID, name) for name in GRID.__dataclass_fields__} | change
    with pytest.raises(ValueError, match=message):
        PolarGrid(**fields)


def test_a_single_point_is_a_grid():
    grid = PolarGrid(GRID.origin_m, GRID.track, 1, 20.0, 700.0, 0.5, 1, 0.1, 0.02, 1)
    assert (grid.range_m.tolist(), grid.alpha.tolist()) == ([700.0], [0.1])


@pytest.mark.parametrize('first', [-0.358, 0.198])
def test_grids_that_just_reach_the_plane_are_possible(first):
    fields = {name: getattr(GRID, name) for name in GRID.__dataclass_fields__}
    grid = PolarGrid(**fields | {'range_start_m': 300.0, 'alpha_start': first})
    assert np.isfinite(grid.lines(grid.range_m, grid.alpha[:, None])[0]).all()
