# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images that others are compared with."""

from __future__ import annotations

import numpy as np

from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal import PulseBlock


def exact_image(grid, block: PulseBlock, *, target_db: float = -80.0, **options) -> np.ndarray:
    """Samples of the image of a block by exact backprojection, see `plan_image`."""
    imager = plan_image(grid, block.radar, block.n_samples, method='exact', target_db=target_db,
                        **options)
    return imager(block).samples
