# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 4: images of parts on coarse lines, summed on the lines of the whole."""

from __future__ import annotations

import numpy as np

from ...planning.exact.polar_image import AzimuthParts
from .farrow import neighbours


def upsample_azimuth(images: np.ndarray | list[np.ndarray], parts: AzimuthParts) -> np.ndarray:
    """Interpolate images of parts of the echoes to the lines of their sum, and add them.

    ``b(alpha) = sum_p exp(j f_p alpha) sum_k c_k(alpha) exp(-j f_p alpha_k) b_p(alpha_k)``: f_p is
    the middle of the part's band along direction, without which its image is slow enough for the
    few lines alpha_k. The weights c_k are those of `neighbours`, the same at all ranges.

    Parameters
    ----------
    images : sequence of (n_alpha_coarse, n_range) complex128
        Images of each part, on `parts.coarse`.
    parts : AzimuthParts
        From the plan.

    Returns
    -------
    (n_alpha, n_range) complex128
        On `parts.fine`.
    """
    coarse, fine = parts.coarse, parts.fine
    place = (fine.alpha - coarse.alpha_start) / coarse.alpha_spacing
    index, weights = neighbours(parts.interpolator, place, coarse.n_alpha)
    total = np.zeros((fine.n_alpha, fine.n_range), np.complex128)
    for image, frequency in zip(images, parts.frequency, strict=True):
        slow = image * np.exp(-1j * frequency * coarse.alpha)[:, None]
        read = np.einsum('lk,lkr->lr', weights, slow[index])
        total += read * np.exp(1j * frequency * fine.alpha)[:, None]
    return total
