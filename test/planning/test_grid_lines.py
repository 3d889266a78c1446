# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines of a map run along the axis that range follows, and away from the track."""

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.planning.exact.backprojection import GridLines
from sar_imaging.signal import RadarParameters

RADAR = RadarParameters(10e9, 300e6, 400e6, 1e-6)


@pytest.mark.parametrize(('look', 'axis', 'sign'), [
    ((1.0, 0.1), 0, 1), ((-1.0, 0.2), 0, -1), ((0.1, 1.0), 1, -1), ((-0.2, -1.0), 1, 1)])
def test_lines_run_away_from_the_track(look, axis, sign):
    """Rows of a map run down, along -y."""
    grid = MapGrid((10.0, -20.0, 0.0), 70, 40, 0.5)
    look = np.array(look)
    middle = np.append(np.array(grid.centre_m[:2]) - 300.0 * look, 80.0)
    along = np.array([-look[1], look[0], 0.0])
    track = middle + np.linspace(-15, 15, 9)[:, None] * along
    lines = GridLines(grid, track, track)
    assert (lines.n_pixels, lines.n_lines) == ((70, 40), (40, 70))[axis]
    assert lines.paths(track, track, RADAR).derivatives[0].min() > 0
    position, step, *_ = lines.locate(0)(np.arange(2), np.arange(1))
    wanted = [(sign * 0.5, 0.0, 0.0), (0.0, -sign * 0.5, 0.0)][axis]
    np.testing.assert_allclose(step.reshape(-1, 3)[0], wanted)
    np.testing.assert_allclose(np.diff(position, axis=0).reshape(-1, 3)[0], wanted, atol=1e-12)
    path = np.linalg.norm(grid.points().reshape(-1, 3) - track[:, None], axis=-1)
    near, far = lines.range_m
    assert path.min() - 3.0 < near <= path.min() and path.max() <= far < path.max() + 3.0
