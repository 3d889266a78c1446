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


def test_derivatives_by_range():
    step = 1e-3
    before, here, after = (GRID.lines(720.0 + d, 0.07) for d in (-step, 0.0, step))
    for order in range(4):  # central differences: rounding of 1e-13 m over the step
        difference = (after[order] - before[order]) / (2 * step)
        np.testing.assert_allclose(difference, here[order + 1], atol=1e-9)


@pytest.mark.parametrize(('change', 'message'), [
    ({'n_range': 0}, 'expected at least one each'),
    ({'range_start_m': 280.0}, 'does not reach the plane'),
    ({'range_start_m': -5.0}, 'does not reach the plane'),
])
def test_impossible_grids_are_refused(change, message):
    fields = {name: getattr(GRID, name) for name in GRID.__dataclass_fields__} | change
    with pytest.raises(ValueError, match=message):
        PolarGrid(**fields)
