# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Accelerated fast backprojection (AFBP) of a whole aperture, Zhang et al. 2014.

Two stages with a seam between them: sub-apertures are backprojected onto a common polar grid, and
their spectra are joined. The fused image is wanted on a polar grid, or interpolated to a map.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from tqdm import tqdm

from .. import backends
from ..backends.edge_brightness import EdgeBrightness
from ..device_arrays import beside, on_device, to_host
from ..geometry.polar import PolarGrid
from ..planning.afbp.plan import AfbpPlan, plan_afbp
from ..planning.afbp.subapertures import SubaperturePlan
from ..planning.exact.pulse_power import PulsePower
from ..planning.plan import AFBP_SHARES, error_budget
from ..planning.profiles import PhaseHistory
from ..signal.pulses import PulseBlock
from .image import Report
from .methods import AFBP, Method

if TYPE_CHECKING:
    from ..backends.protocol import Backend

_logger = logging.getLogger(__name__)
_UNEVEN_DB = 3.0  # by which edges may be brighter without a word


class Afbp(Method):
    """AFBP: maps and polar grids that lie on one side of the track.

    `pulses_per_subaperture` sets the length of the sub-apertures; the quickest if left out.
    """

    NAME, OWN = AFBP, {'pulses_per_subaperture': None}
    ILLUMINATION = PHASE_HISTORIES = BACKENDS = True

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """See `Method`."""
        options = self.options
        plan = self._plan = plan_afbp(
            cast(Any, self.grid), self.radar, self.n_samples, tx_m, rx_m,
            target_db=options.target_db, compressed=options.compressed,
            weighting=options.weighting, illumination=self.illumination, **cast(Any, self.own))
        self._power: PulsePower | None = None  # made when the first image is
        self._backend: Any = backends.backend(options.backend, plan)
        self._stages: Any = None  # made when the first image is
        return self.planned(
            plan, shares_db=error_budget(options.target_db, AFBP_SHARES))

    @property
    def uses_device(self) -> bool:
        """See `Method`; of 'auto', what its plan was given to."""
        name = getattr(self._backend, '__name__', '').rpartition('.')[2]
        return super().uses_device or name == backends.CUDA

    def image(self, block: PulseBlock, onto: np.ndarray | None = None
              ) -> tuple[np.ndarray, Report]:
        """See `Method`.

        Predictions are for scenes that are as bright beyond their edges as within: where they are
        brighter there, the report says so. A map may lie in the larger memory of the polar image
        that it was made from; a copy of it lets go of the rest.
        """
        try:
            return self._image(block, onto)
        except backends.DeviceError as error:
            if self.options.backend != backends.AUTO:
                raise
            _logger.warning(f'{error}; the processor computes')
            self._backend, self._stages = backends.backend('cpu'), None
            block = dataclasses.replace(block, samples=to_host(block.samples))
            return self._image(block, onto)

    def _image(self, block: PulseBlock, onto: np.ndarray | None) -> tuple[np.ndarray, Report]:
        plan, backend = self._plan.subapertures, self._backend
        s = plan.sampling
        if block.n_pulses != s.pulses[-1].stop:
            raise ValueError(f'block has {block.n_pulses} pulses; the plan is for '
                             f'{s.pulses[-1].stop}')
        brightness = EdgeBrightness(plan.fusion_grid, s.coverage)
        form = self._together if hasattr(backend, 'ApertureFusion') else self._one_by_one
        with backends.compilation_helped(self._plan, block.n_samples):
            polar_image = form(plan, block, self.weights(block), brightness)
            samples = image_of_polar(self._plan, polar_image, backend, overwrite=True)
        if not on_device(block.samples if onto is None else onto):
            samples = to_host(samples)
        if onto is not None:
            onto += samples
            samples = onto
        report = self._judged(brightness.uneven_db)
        power, at_ends = self._power_of(block)
        return samples, dataclasses.replace(report, pulse_power=power, band_end_power=at_ends)

    def _power_of(self, block: PulseBlock) -> tuple[float, float]:
        if self._power is None:
            plan, band = self._plan, None if self.options.compressed else PhaseHistory(
                self.radar, self.n_samples, self.options.weighting)
            self._power = PulsePower.of_pixels(
                plan.grid, self.radar, self.n_samples, plan.tx_m.reshape(-1, 3),
                plan.rx_m.reshape(-1, 3), self.illumination, band)
        return self._power.of(self.weighted(block).samples.reshape(-1, self.n_samples))

    def _judged(self, uneven_db: float) -> Report:
        """The report of an image whose edges are so much brighter."""
        if uneven_db == 0.0:
            return self.report
        told = (f'what lies right beyond the edges is {uneven_db:.1f} dB brighter than the image, '
                'and so may be its error: image a larger grid',)
        return self.report.amid_bright(uneven_db, *(told if uneven_db > _UNEVEN_DB else ()))

    def _together(self, plan: SubaperturePlan, block: PulseBlock, weights: np.ndarray | None,
                  brightness: EdgeBrightness) -> np.ndarray:
        """Fused polar image by a backend that takes some sub-apertures at a time."""
        if self._stages is None:
            self._stages = self._backend.ApertureFusion(plan)
        return self._stages.polar_image(block, weights, brightness, progress=self.options.progress)

    def _one_by_one(self, plan: SubaperturePlan, block: PulseBlock, weights: np.ndarray | None,
                    brightness: EdgeBrightness) -> np.ndarray:
        """Fused polar image, sub-aperture by sub-aperture."""
        if self._stages is None:
            self._stages = (self._backend.SubapertureImager(plan),
                            self._backend.SpectrumFusion(plan.fusion_grid))
        (stage, fusion), s, image = self._stages, plan.sampling, None
        fusion.clear()
        for number, some in enumerate(tqdm(s.pulses, desc='sub-apertures', unit='sub-aperture',
                                           disable=not self.options.progress)):
            if plan.amplitudes is not None and number not in plan.amplitudes.seen:
                continue
            image = stage.image(number, block.select(some),
                                None if weights is None else weights[some], image)
            brightness.add(image)
            fusion.add(number, image, s.centre[number])
        return fusion.take_polar_image()


def image_of_polar(plan: AfbpPlan, polar_image: np.ndarray, backend: Backend, *,
                   overwrite: bool = False) -> np.ndarray:
    """Image on the grid of a plan from its fused polar image.

    Parameters
    ----------
    plan : AfbpPlan
        By which it was fused.
    polar_image : (2, n_alpha, n_range) float32
        From `backends.protocol.SpectrumFusion`.
    backend : Backend
        That fused it.
    overwrite : bool
        It is not needed any more: a map may be written over it.

    Returns
    -------
    (n_y, n_x) or (n_alpha, n_range) complex64
        On the device where a device fused it.
    """
    if not isinstance(plan.grid, PolarGrid):
        return backend.form_map(polar_image, plan.subapertures.fusion_grid, plan.grid,
                                overwrite=overwrite)
    polar = plan.subapertures.polar
    cycles = np.fmod(2 * (polar.range_m - polar.range_start_m)
                     / plan.subapertures.radar.wavelength_m, 1.0)
    samples = polar_image[0] + np.complex64(1j) * polar_image[1]
    return samples * beside(np.exp(2j * np.pi * cycles).astype(np.complex64), samples)
