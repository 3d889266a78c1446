# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 2: backprojection onto the lines of a polar grid, along which range grows."""

from __future__ import annotations

import numpy as np

from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...planning.profiles import PhaseHistory, RangeGate
from .project_points import project_points


def project_lines(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int,
                  tx_m: np.ndarray, rx_m: np.ndarray, polar: PolarGrid,
                  illumination: Illumination | None = None) -> np.ndarray:
    """Polar image of some echoes at range baseband.

    ``b(r, alpha) = exp(-j k (r - r_0)) sum_r w_r s_r(D_r) exp(+j k D_r)``, ``k = 4 pi / lambda``,
    with the half paths D_r, and the amplitudes w_r, 1 without illumination, to the point of the
    plane at distance r and direction cosine alpha from the grid's origin (Zhang et al., equation
    6). At range baseband it varies slowly along r.

    Parameters
    ----------
    source, samples, n_padded, tx_m, rx_m, illumination :
        As for `project_points`.
    polar : PolarGrid
        Pixels.

    Returns
    -------
    (n_alpha, n_range) complex128
    """
    points_m = polar.lines(polar.range_m, polar.alpha[:, None])[0]
    cycles = 2 * (polar.range_m - polar.range_start_m) / source.radar.wavelength_m
    return (project_points(source, samples, n_padded, tx_m, rx_m, points_m, illumination)
            * np.exp(-2j * np.pi * np.fmod(cycles, 1.0)))
