# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the operations of plans cost on a device, and how long a plan takes there.

Plans are made with the processor's costs, so that they are the same everywhere; these tell where
a plan is done sooner.
"""

from __future__ import annotations

import dataclasses
import math
import os
from pathlib import Path

from ...memory import IMAGE_BYTES
from ...planning.afbp.plan import AfbpPlan
from ...planning.costs import CostModel
from ...planning.exact.backprojection import BackprojectionPlan

VARIABLE = 'SAR_IMAGING_DEVICE_COSTS'  # of the environment: file of measured costs
_SAMPLE_BYTES = 8


@dataclasses.dataclass(frozen=True)
class DeviceCosts(CostModel):
    """Costs of this backend's operations, nanoseconds of the device; names are of `CostModel`.

    The defaults were measured on an H100 with `tools/costs`. Those of a part, an image and a byte
    follow from whole images (`benchmarks/results/gpu.json`), whose end-to-end times they predict
    within 1.3 times: the host takes a millisecond to launch the kernels of a part.

    Attributes
    ----------
    transferred_byte : float
        Of samples to the device, and of an image from there.
    """

    line_pixel: float = 1.8e-3
    line_segment: float = 3e-2
    point_pixel: float = 4.9e-3
    upsampled_pixel: float = 5.9e-3
    upsampled_part: float = 1.3e6
    map_pixel: float = 8.2e-2
    profile_bin: float = 4.6e-3
    beam_bin: float = 2.2e-5
    beam_group: float = 1e-3
    beam_cell: float = 6e-3
    beam_pixel: float = 1.3e-2
    beam_segment: float = 1.3e-3
    weighed_image: float = 5.9e4
    amplitude_node: float = 1.3e-1
    coarse_pixel: float = 1.3e-2
    fine_pixel: float = 1e-3
    subaperture: float = 2.6e5
    profile_cell: float = 5.8e-2
    beam_run: float = 1.3e-3
    image: float = 3e6
    transferred_byte: float = 0.2


DEFAULT = DeviceCosts()


def device_costs() -> DeviceCosts:
    """Costs from the file that the environment names, or the default.

    Raises
    ------
    ValueError
        The file holds something else.
    """
    path = os.environ.get(VARIABLE)
    return DeviceCosts.read(Path(path)) if path else DEFAULT


def operations(plan: BackprojectionPlan | AfbpPlan) -> dict[str, float]:
    """How often a plan does the operations of `DeviceCosts`."""
    n_samples = (plan.route.resampling.n_padded if isinstance(plan, BackprojectionPlan)
                 else plan.subapertures.n_samples)
    n_echoes = plan.tx_m.size // 3
    return plan.operations | {
        'image': 1,  # sub-apertures are imaged many at a time
        'transferred_byte': _SAMPLE_BYTES * n_samples * n_echoes
        + IMAGE_BYTES * math.prod(plan.grid.shape)}


def seconds(plan: BackprojectionPlan | AfbpPlan) -> float:
    """Predicted time of the image of a plan, end to end: samples and image are the host's."""
    return device_costs().seconds(operations(plan))
