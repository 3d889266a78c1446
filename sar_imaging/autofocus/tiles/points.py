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

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.autofocus.tiles import bright_points
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 40, 40, 0.5)
    >>> image = np.zeros(grid.shape)
    >>> image[10, 5], image[30, 20] = 2.0, 1.0
    >>> bright_points(image, grid, block, n=5).round(2).tolist()
    [[9992.75, 4.75, 0.0], [10000.25, -5.25, 0.0]]
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
