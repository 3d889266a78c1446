# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How bright what lies right beyond an image is, which AFBP's tapers do not keep out entirely."""

from __future__ import annotations

import math

import numpy as np

from ..device_arrays import beside, on_device, to_host
from ..planning.afbp.polar_grids import UnifiedPolarGrids
from ..planning.aliasing_error import EVERYTHING, PixelDensity, density_at

_UNEVEN_DB = 1.0  # by which edges are brighter than an even scene's by chance
_MOST_DB = 100.0  # of an image that is empty
_STEP = 2  # lines and ranges from one that is looked at to the next


class EdgeBrightness:
    """Mean power of sub-aperture images in their guards and where the image is wanted.

    Parameters
    ----------
    grid : UnifiedPolarGrids
        Grid of the images.
    coverage : PixelDensity
        What of the image is wanted.
    """

    def __init__(self, grid: UnifiedPolarGrids, coverage: PixelDensity = EVERYTHING) -> None:
        line, cell = (  # a line between two guards belongs to the image, be it in part
            max(1, min(math.ceil(guard), (n - 1) // 2)) for guard, n in (
                (grid.n_guard, grid.n_coarse), (grid.range_guard, grid.n_coarse_range)))
        inside = slice(line, -line, _STEP), slice(cell, -cell, _STEP)
        self._edges = [(slice(0, line), inside[1]), (slice(-line, None), inside[1]),
                       (inside[0], slice(0, cell)), (inside[0], slice(-cell, None))]
        self._inside, self._power = inside, np.zeros(5)
        self._shape = grid.n_coarse, grid.n_coarse_range
        self._wanted = [density_at(
            (np.arange(n)[some] - guard + 0.5) / max(n - 2 * guard, 1), density)
            for density, n, guard, some in (
                (coverage.along_alpha, grid.n_coarse, line, inside[0]),
                (coverage.along_range, grid.n_coarse_range, cell, inside[1]))]

    def add(self, image: np.ndarray) -> None:
        """Look at a sub-aperture image, (2, n_alpha, n_range) float32, real and imaginary part.

        It may be an array of a device.
        """
        if on_device(image):  # few operations, and one number of each edge comes back
            lines, ranges = (beside(values, image) for values in self.factors)
            power = (image * image).sum(axis=0)
            self.add_power(to_host(((lines @ power) * ranges).sum(axis=1)))
            return
        self._power[:4] += [_mean_square(image[:, lines, ranges]) for lines, ranges in self._edges]
        inside = image[(slice(None), *self._inside)]
        lines, ranges = self._wanted
        self._power[4] += float(np.einsum('ijk,ijk,k->j', inside, inside, ranges) @ lines) / max(
            len(image) * lines.sum() * ranges.sum(), 1e-30)

    @property
    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """(5, n_alpha), (5, n_range) float32 whose products weigh a pixel's power in each mean."""
        lines, ranges = (np.zeros((5, n), np.float32) for n in self._shape)
        for k, (line, cell) in enumerate(self._edges):
            lines[k, line], ranges[k, cell] = 1.0, 1.0
        lines[4, self._inside[0]], ranges[4, self._inside[1]] = self._wanted
        total = np.maximum(2 * lines.sum(axis=1) * ranges.sum(axis=1), np.float32(1e-30))
        return lines / total[:, None], ranges

    def add_power(self, power: np.ndarray) -> None:
        """Count sub-aperture images by the sums that `factors` say, (5,), of all of them."""
        self._power += power

    @property
    def excess_db(self) -> float:
        """By how much the brightest of the four edges exceeds the mean within, dB."""
        edge, inside = self._power[:4].max(), self._power[4]
        if not edge > 0:
            return -math.inf
        return 10 * math.log10(edge / inside) if inside > 0 else math.inf

    @property
    def uneven_db(self) -> float:
        """By how much the error exceeds that of an evenly bright scene, dB; 0 where it is one."""
        return min(self.excess_db, _MOST_DB) if self.excess_db > _UNEVEN_DB else 0.0


def _mean_square(values: np.ndarray) -> float:
    return float(np.einsum('ijk,ijk->', values, values)) / max(values.size, 1)
