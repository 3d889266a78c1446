# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What this backend's operations cost, as measured on this machine and told to it."""

from __future__ import annotations

import os
from pathlib import Path

from ...planning.costs import DEFAULT, CostModel

VARIABLE = 'SAR_IMAGING_COSTS'  # of the environment: file of measured costs


def measured_costs() -> CostModel:
    """Costs from the file that the environment names, or the default.

    Raises
    ------
    ValueError
        The file holds something else.
    """
    path = os.environ.get(VARIABLE)
    return CostModel.read(Path(path)) if path else DEFAULT
