"""Backprojection of one sub-aperture onto its coarse polar grid, from beams or directly."""

from __future__ import annotations

import numpy as np

from ...planning.afbp.subapertures import SubaperturePlan
from ...signal.pulses import PulseBlock
from .beams.subaperture import BeamformedSubaperture
from .lines import PolarLines
from .memory import aligned_empty
from .profiles import Profiles


class SubapertureImager:
    """Images of the sub-apertures of a plan, see `backends.protocol.SubapertureImager`."""

    def __init__(self, plan: SubaperturePlan):
        self.plan = plan
        self._lines = BeamformedSubaperture(plan) if plan.beams else PolarLines(
            plan.coarse, Profiles(plan.source, plan.lattice, plan.range_m),
            plan.lit and plan.lit.lines)

    def image(self, number: int, block: PulseBlock, weights=None, out=None) -> np.ndarray:
        """Backproject one sub-aperture, see `backends.protocol.SubapertureImager`."""
        plan = self.plan
        plan.check_block(number, block)
        shape = (2, plan.coarse.n_alpha, plan.coarse.n_range)
        image = aligned_empty(shape, np.float32) if out is None else out
        if weights is not None:
            weights = np.repeat(weights, plan.n_channels)
        self._lines.fill(block.samples.reshape(-1, plan.n_samples), block.tx_m.reshape(-1, 3),
                         block.rx_m.reshape(-1, 3), image, weights, plan.weighed_by(block))
        return image
