# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 8: a polar image on a map."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...planning.interpolators import Interpolator
from .farrow import neighbours


def polar_to_map(image: np.ndarray, polar: PolarGrid, grid: MapGrid, *, axis: int,
                 wavelength_m: float, between: Interpolator, along: Interpolator) -> np.ndarray:
    """Interpolate a polar image at range baseband to a map, and put its carrier back.

    Two passes of one dimension each. A row of the map at distance q beside the origin and h below
    it meets range r where it is ``p = sqrt(r^2 - q^2 - h^2)`` ahead, at direction cosine
    ``alpha = (p u_p + q u_q) / r`` with the track direction u. Interpolated there between lines,
    the row is known at all ranges, and is interpolated along them to its pixels.

    Parameters
    ----------
    image : (n_alpha, n_range) complex128
        Times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0 the first range.
    polar, grid : PolarGrid, MapGrid
        Polar grid and grid of the image and of the map, which it reaches beyond.
    axis : int
        Map axis that follows range: rows run along x (0) or y (1).
    wavelength_m : float
        At the carrier, metres.
    between, along : Interpolator
        Between lines and along them.

    Returns
    -------
    (n_y, n_x) complex128
    """
    ahead = (grid.x_m, grid.y_m)[axis] - polar.origin_m[axis]  # of the pixels of a row
    beside = ((grid.y_m, grid.x_m)[axis] - polar.origin_m[1 - axis])[:, None]  # of the rows
    across2 = beside ** 2 + polar.height_m ** 2
    meets = np.sign(ahead.mean()) * np.sqrt(np.maximum(polar.range_m ** 2 - across2, 0.0))
    alpha = (meets * polar.track[axis] + beside * polar.track[1 - axis]) / polar.range_m
    index, weights = neighbours(between, (alpha - polar.alpha_start) / polar.alpha_spacing,
                                polar.n_alpha)
    rows = np.einsum('qrk,qrk->qr', weights, image[index, np.arange(polar.n_range)[:, None]])
    beyond_m = np.sqrt(ahead ** 2 + across2) - polar.range_start_m
    index, weights = neighbours(along, beyond_m / polar.range_spacing_m, polar.n_range)
    pixels = np.einsum('qpk,qpk->qp', weights, rows[np.arange(len(rows))[:, None, None], index])
    pixels = pixels * np.exp(2j * np.pi * np.fmod(2 * beyond_m / wavelength_m, 1.0))
    return pixels if axis == 0 else pixels.T
