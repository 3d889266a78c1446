"""Choose the bright points of an image that autofocus uses."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...signal.pulses import PulseBlock

_APART = 4.0  # bright points stand so many range resolutions apart
_FAINTEST_DB = -30.0  # of a bright point, relative to the brightest


def bright_points(image, grid: MapGrid, block: PulseBlock, n: int) -> np.ndarray:
    """Positions of the brightest pixels of an image, apart from each other.

    Parameters
    ----------
    image : (n_y, n_x) array
        Image.
    grid : MapGrid
        Its pixels.
    block : PulseBlock
        Its pulses; their bandwidth says how far points stand apart.
    n : int
        How many at most.

    Returns
    -------
    (K, 3) float64
        Brightest first, metres; none fainter than -30 dB of the brightest.
    """
    power = np.square(np.abs(image), dtype=np.float64)
    faintest = power.max() * 10 ** (_FAINTEST_DB / 10)
    half = max(2, round(_APART * block.radar.range_resolution_m / grid.spacing_m))
    points = []
    while len(points) < n:
        row, column = np.unravel_index(power.argmax(), power.shape)
        if power[row, column] <= faintest:
            break
        points.append((grid.x_m[column], grid.y_m[row], grid.z_m))
        power[max(0, row - half):row + half + 1, max(0, column - half):column + half + 1] = 0.0
    return np.array(points).reshape(-1, 3)
