# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Published methods are judged by the pulses of an image, as exact backprojection is.

What is bright beyond an image, or beyond the profiles, brings an error that no plan can foresee.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np

from ..geometry.grids import EvenGrid, Grid
from ..imaging.image import Report
from ..imaging.methods import Method
from ..planning.echo_power import chance_db, echoes_alike
from ..planning.exact.points import ImagePoints, extent, pixels_of, resolved_cells
from ..planning.exact.pulse_power import PulsePower
from ..planning.plan import Plan, total_db
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters


class JudgedPlan(Plan):
    """Plan of the pixels of `grid` and of echoes from `tx_m` and `rx_m`, (P, C, 3), metres."""

    grid: Any
    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray

    @functools.cached_property
    def pixels(self) -> EvenGrid | ImagePoints:
        """Those of the image."""
        return pixels_of(self.grid)

    @property
    def echoes_m(self) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) phase centres of the echoes, metres."""
        return self.tx_m.reshape(-1, 3), self.rx_m.reshape(-1, 3)

    @property
    def echoes_alike(self) -> float:
        """Mean number of echoes that an image does not tell apart, see `planning.echo_power`."""
        return echoes_alike(*self.echoes_m, *extent(self.pixels), self.radar)


class JudgedMethod(Method):
    """A method whose plan is a `JudgedPlan`."""

    def image(self, block: PulseBlock, onto: np.ndarray | None = None
              ) -> tuple[np.ndarray, Report]:
        """See `Method`; the report has the power of the pulses, and errors that these tell."""
        samples, report = super().image(block, onto)
        plan: Any = report.plan
        echoes = self.weighted(block).samples.reshape(-1, plan.n_samples)
        at_pixels = PulsePower.of_pixels(plan.pixels, plan.radar, plan.n_samples, *plan.echoes_m)
        power, at_ends = at_pixels.of(echoes)
        if not power or report.predicted_error_db is None:
            return samples, report
        told = {cause: 10 * math.log10(max(error / power, 1e-30))
                for cause, error in self.errors_of(echoes, at_pixels).items()}
        return samples, dataclasses.replace(
            report, pulse_power=power, band_end_power=at_ends,
            errors_db={**report.errors_db, **told},
            predicted_error_db=total_db(report.predicted_error_db, *told.values()))

    def errors_of(self, echoes: np.ndarray, at_pixels: PulsePower) -> dict[str, float]:
        """Mean power by cause that the errors of some echoes, (R, N) complex64, have in a pixel.

        They are taken to add up as noise does. `at_pixels` tells the power of the echoes.
        """
        return {}


def may_err_db(grid: Grid, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
               of_many_db: float) -> float:
    """By how much an image may err more than predicted by chance, dB; see `chance_db`."""
    return chance_db(resolved_cells(pixels_of(grid), tx_m.reshape(-1, 3), rx_m.reshape(-1, 3),
                                    radar), of_many_db)
