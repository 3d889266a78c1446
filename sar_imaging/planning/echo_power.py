"""Which echoes an image's power comes from: those that see a scene alike add up coherently.

The power of n echoes at different places grows as n, that of n echoes at one place as n squared.
Where a platform stops, or comes by again, what is read of those echoes decides the error of the
image, be they few.
"""

from __future__ import annotations

import numpy as np

from ..geometry.half_paths import half_paths
from ..signal.radar import RadarParameters


def echo_power(tx_m, rx_m, centre_m, sides_m, radar: RadarParameters) -> np.ndarray:
    """(R,) float64 share that each echo has in the power of an image, relative to the mean.

    It is the number of echoes whose local frequencies in the image differ by less than the image
    resolves, along range by less than the band of a pulse. The image has its middle at
    `centre_m`, (3,), and extends along `sides_m`, (2, 3), metres.
    """
    sides = np.asarray(sides_m, float)
    slopes = half_paths(tx_m, rx_m, np.asarray(centre_m, float)[None], *sides[:, None])[1:, :, 0]
    cycles = 2 / radar.wavelength_m * slopes.T  # over each side
    middle = cycles.mean(axis=0)
    length = max(float(np.hypot(*middle)), 1e-12)
    along = middle / length
    band = max(length * radar.bandwidth_hz / radar.carrier_hz, 1.0)
    place = np.stack([cycles @ [-along[1], along[0]], cycles @ along / band])
    # Echoes are shared out to the four neighbouring cells, and read from there as they came in.
    cell = np.floor(place)
    within = place - cell
    cell = (cell - cell.min(axis=1, keepdims=True)).astype(np.int64)
    width = cell[1].max() + 2
    keys = [(cell[0] + i) * width + cell[1] + j for i in (0, 1) for j in (0, 1)]
    shares = np.concatenate([np.abs(1 - i - within[0]) * np.abs(1 - j - within[1])
                             for i in (0, 1) for j in (0, 1)])
    _, number = np.unique(np.concatenate(keys), return_inverse=True)
    count = np.bincount(number, shares)[number] * shares
    weight = count.reshape(4, -1).sum(axis=0)
    return weight / weight.mean()
