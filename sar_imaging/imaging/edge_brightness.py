"""How bright what lies right beyond an image is, which AFBP's tapers do not keep out entirely."""

from __future__ import annotations

import math

import numpy as np

from .fusion_grid import FusionGrid

_STEP = 2  # lines and ranges from one that is looked at to the next


class EdgeBrightness:
    """Mean power of sub-aperture images in their guards and within them.

    Parameters
    ----------
    grid : FusionGrid
        Of the images.
    """

    def __init__(self, grid: FusionGrid):
        line, cell = (max(1, math.ceil(n)) for n in (grid.n_guard, grid.range_guard))
        inside = slice(line, -line, _STEP), slice(cell, -cell, _STEP)
        self._edges = [(slice(0, line), inside[1]), (slice(-line, None), inside[1]),
                       (inside[0], slice(0, cell)), (inside[0], slice(-cell, None))]
        self._inside, self._power = inside, np.zeros(5)

    def add(self, parts: np.ndarray) -> None:
        """Look at a sub-aperture image, (2, n_alpha, n_range) float32."""
        self._power += [_mean_square(parts[:, rows, columns])
                        for rows, columns in (*self._edges, self._inside)]

    @property
    def excess_db(self) -> float:
        """By how much the brightest of the four edges exceeds the mean within, dB."""
        edge, inside = self._power[:4].max(), self._power[4]
        if not edge > 0:
            return -math.inf
        return 10 * math.log10(edge / inside) if inside > 0 else math.inf


def _mean_square(values) -> float:
    return float(np.einsum('ijk,ijk->', values, values)) / max(values.size, 1)
