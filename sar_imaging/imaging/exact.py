# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Multichannel backprojection with the exact two-way path of every channel.

Rosenberg & Gray, equations 13 to 17 and 19: each range profile is read at the distance of each
pixel, its carrier phase is restored, and all pulses and channels are summed. The paper applies
the phase of a channel's offset to the profile read at the reference antenna's delay; here every
channel is read at its own delay, which needs no approximation.

`planning.exact.backprojection` tells the three ways that lead to this sum.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import backends
from ..device_arrays import contiguous, zeros_beside
from ..memory import IMAGE_BYTES
from ..planning.exact.backprojection import (
    LEAST_TARGET_DB,
    BackprojectionPlan,
    plan_backprojection,
)
from ..planning.exact.points import ImagePoints, pixels_of
from ..planning.exact.pulse_power import PulsePower
from ..planning.plan import EXACT_SHARES, error_budget
from ..planning.profiles import OutOfReach, PhaseHistory
from ..signal.pulses import PulseBlock, check_profiles
from .image import Report
from .methods import EXACT, Method

if TYPE_CHECKING:
    from ..backends.protocol import Backprojection


class Exact(Method):
    """Backprojection: any grid, any track.

    A position with a NaN is no pixel; its value stays as it is, 0 in a new image. Ranges outside
    a profile contribute nothing.
    """

    NAME, TERRAIN, ILLUMINATION, BACKENDS = EXACT, True, True, True
    PHASE_HISTORIES = True  # that cover the image

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        radar, target_db = self.radar, self.options.target_db
        self._band = None if self.options.compressed else PhaseHistory(
            radar, self.n_samples, self.options.weighting)
        if self._band is None and radar.sample_rate_hz < 1.25 * radar.bandwidth_hz:
            raise ValueError(
                f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
                f'{radar.bandwidth_hz:g} Hz; sample them at 1.25 times the bandwidth or more '
                '(parameter oversampling of the range compression)')
        if not LEAST_TARGET_DB <= target_db <= -20.0:
            raise ValueError(f'target_db={target_db}; expected -100 to -20 dB, float32 '
                             'arithmetic reaches -100 dB')
        self._pixels = pixels_of(self.grid)
        self._backend = backends.backend(self.options.backend)
        self._sum: Backprojection | None = None
        self._plan: BackprojectionPlan | None = None
        self._power: PulsePower | None = None  # made when the first image is

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """See `Method`; memory serves plans in turn."""
        self._power = None
        if not tx_m.size or isinstance(self._pixels, ImagePoints) and self._pixels.empty:
            self._sum = None
            return self.describe()
        try:
            plan = self._plan = plan_backprojection(
                self._pixels, (self._band or self).radar, self.n_samples, _echoes(tx_m),
                _echoes(rx_m), self.options.target_db, self.illumination, band=self._band,
                groups=getattr(self._backend, 'GROUPS', False), before=self._plan)
        except OutOfReach:
            if self.illumination is None:
                raise
            self._sum = None  # a part of a stripmap that lights nothing of the grid
            return self.describe()
        before = self._sum or getattr(self.like, '_sum', None)
        self._sum = self._backend.Backprojection(plan, before and before.memory)
        return self.planned(
            plan, shares_db=error_budget(self.options.target_db, EXACT_SHARES),
            n_bytes=plan.n_bytes + IMAGE_BYTES * math.prod(self.grid.shape))

    @property
    def uses_device(self) -> bool:
        """See `Method`; of 'auto', what its plan was given to."""
        return super().uses_device or getattr(self._sum, 'name', '') == backends.CUDA

    def image(self, block: PulseBlock, onto: np.ndarray | None = None
              ) -> tuple[np.ndarray, Report]:
        """See `Method`; takes no memory for another image."""
        check_profiles(block, self.radar, self.n_samples, compressed=self.options.compressed)
        assert block.tx_m is not None and block.rx_m is not None  # as was checked
        onto = zeros_beside(self.grid.shape, block.samples) if onto is None else onto
        if self._sum is not None:
            samples = contiguous(self.weighted(block).samples).reshape(-1, self.n_samples)
            centres = _echoes(block.tx_m), _echoes(block.rx_m)
            self._sum.add(samples, *centres, onto)
            if self._power is None:
                self._power = PulsePower.of_pixels(self._pixels, self.radar, self.n_samples,
                                                   *centres, self.illumination, self._band)
            power, at_ends = self._power.of(samples)
            return onto, dataclasses.replace(self.report, pulse_power=power,
                                             band_end_power=at_ends)
        return onto, self.report


def _echoes(centres_m: np.ndarray) -> np.ndarray:
    """(R, 3) float64 phase centres, one echo for each pulse and channel."""
    return np.ascontiguousarray(centres_m, np.float64).reshape(-1, 3)
