"""How a polar image is interpolated to a map: neighbours, degree, and margin around the map."""

from __future__ import annotations

from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid

# Taps of the interpolation, and of that along direction where the spectrum is deapodised. Along
# range it cannot be: along a line of the map direction changes, too, and so does range's gain.
TAPS, DEAPODISED_TAPS = 14, 6
NOT_READ = 3  # pixels of the margin
DEGREE = 5  # of the polynomials
LEAST_RANGES = 16  # of the polar image: a vector of the kernels


def margin(taps: int) -> int:
    """Pixels that a polar grid must reach beyond a map on all sides."""
    return taps // 2 + 2 + NOT_READ


def range_axis(polar: PolarGrid, grid: MapGrid) -> int:
    """Map axis that follows range: 0 for x, 1 for y."""
    look = [c - o for c, o in zip(grid.centre_m[:2], polar.origin_m[:2], strict=True)]
    return int(abs(look[1]) > abs(look[0]))
