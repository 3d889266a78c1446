# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Corrected trajectories for apertures imaged already: only what they touch is redone."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..backends import AUTO, backend as find_backend
from ..device_arrays import to_host
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..imaging.afbp import image_of_polar
from ..imaging.image import Image, Report
from ..imaging.imager import plan_image
from ..imaging.methods import AFBP
from ..planning.afbp.plan import AfbpPlan
from ..planning.afbp.subapertures import Limits
from ..planning.plan import total_db
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters

if TYPE_CHECKING:
    from ..backends.protocol import Backend


class RevisableImage:
    """AFBP image of an aperture whose phase centres may be corrected afterwards.

    Profiles and the contribution of every sub-aperture are kept. A correction backprojects the
    sub-apertures whose phase centres differ, and no other; the image then equals, bit for bit,
    that of doing all of them again on the same polar grids. Where a correction leaves what those
    grids were planned for, by more than a wavelength, the aperture is planned and imaged anew.

    Parameters
    ----------
    grid, target_db :
        As for `plan_image`; a map or a polar grid.
    block : PulseBlock
        Range profiles of the aperture with phase centres; its samples are kept, not copied.
    pulses_per_subaperture : int, optional
        Length of the sub-apertures; the quickest if left out. A correction of few pulses costs
        whole sub-apertures.
    backend : str or Backend
        As for `plan_image`.

    Attributes
    ----------
    block : PulseBlock
        The aperture with its present phase centres.
    plans_made : int
        How often the aperture was planned.

    Raises
    ------
    ValueError
        The geometry does not allow the target, or the block has no phase centres.
    """

    def __init__(self, grid: MapGrid | PolarGrid, block: PulseBlock, *, target_db: float = -50.0,
                 pulses_per_subaperture: int | None = None, backend: str | Backend = AUTO):
        self._asked: dict[str, Any] = {'method': AFBP, 'target_db': target_db, 'backend': backend,
                       'pulses_per_subaperture': pulses_per_subaperture}
        if not block.has_positions:
            raise ValueError('the block has no phase centres; expected transmit and receive '
                             'position of every pulse and channel')
        self._backend = find_backend(backend)
        self._grid, self.block, self.plans_made = grid, block, 0
        self._image_anew()

    @property
    def n_subapertures(self) -> int:
        """Number of sub-apertures."""
        return self.plan.subapertures.n_subapertures

    @property
    def _report(self) -> Report:
        assert self._imager.report is not None  # planned for phase centres
        return self._imager.report

    @property
    def plan(self) -> AfbpPlan:
        """Plan of the present image."""
        plan = self._report.plan
        assert isinstance(plan, AfbpPlan)  # as it asks for
        return plan

    def image(self) -> Image:
        """The present image."""
        samples = to_host(image_of_polar(self.plan, self._fusion.polar_image(), self._backend))
        return Image(samples, self._grid, self.block.radar.carrier_hz, self._report,
                     int(np.sort(self.block.stamp_ns)[self.block.n_pulses // 2]),
                     np.sort(self.block.counter.astype(np.int64)))

    def revise(self, tx_m: ArrayLike, rx_m: ArrayLike) -> tuple[int, ...]:
        """Correct the phase centres of all pulses of the aperture, (P, C, 3), metres.

        Returns
        -------
        tuple of int
            Sub-apertures that were backprojected: all of them when the aperture was planned anew.

        Raises
        ------
        ValueError
            There are not as many phase centres as before, one is not finite, or no plan meets
            the target with them; the image then stays as it was.
        """
        before, block = self.block, dataclasses.replace(
            self.block, tx_m=np.asarray(tx_m, np.float64), rx_m=np.asarray(rx_m, np.float64))
        pairs = list(zip(block.centres_m, before.centres_m, strict=True))
        touched = [number for number, some in enumerate(self._cuts)
                   if not all(np.array_equal(now[some], then[some]) for now, then in pairs)]
        found = {number: self._centre(block, number) for number in touched}
        centres = {number: centre_m for number, centre_m in found.items() if centre_m is not None}
        self.block = block
        if len(centres) < len(found):
            try:
                self._image_anew()
            except ValueError:
                self.block = before
                raise
            return tuple(range(self.n_subapertures))
        for number, centre_m in centres.items():
            self._add(number, centre_m)
        return tuple(touched)

    def _image_anew(self) -> None:
        block = self.block
        self._imager = plan_image(self._grid, block.radar, block.n_samples, block.tx_m,
                                  block.rx_m, **self._asked)
        self.plans_made += 1
        plan = self.plan.subapertures
        self._planned_db = total_db(*(e for e in self.plan.errors_db.values() if e == e))
        self._within = dataclasses.replace(plan, limits=_widened(plan.limits, block.radar))
        self._stage = self._backend.SubapertureImager(plan)
        self._fusion = self._backend.SpectrumFusion(plan.fusion_grid, keep=True)
        self._cuts = plan.sampling.pulses
        for number, centre_m in enumerate(plan.sampling.centre):
            self._add(number, float(centre_m))

    def _centre(self, block: PulseBlock, number: int) -> float | None:
        """Middle of a sub-aperture's band; None where the plan does not suit it."""
        some = self._cuts[number]
        try:
            tx_m, rx_m = block.centres_m
            centre_m, error_db, within = self._within.check(tx_m[some], rx_m[some])
        except ValueError:
            return None
        return centre_m if within and error_db <= self._planned_db + 1.0 else None

    def _add(self, number: int, centre_m: float) -> None:
        part = self.block.select(self._cuts[number])
        self._fusion.add(number, self._stage.image(number, part), centre_m)


def _widened(limits: Limits, radar: RadarParameters) -> Limits:
    """Limits for phase centres that moved by a wavelength, which no sampling notices."""
    near, far = limits.range_m
    move = radar.wavelength_m
    angle_rad = move / near
    slope = limits.slope[0] - angle_rad, limits.slope[1] + angle_rad
    return Limits((near - move, far + move), slope,
                  limits.slope_m + move,
                  limits.half_range + 2 * radar.wavenumber_rad_per_m * angle_rad)
