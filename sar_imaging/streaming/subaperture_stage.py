"""Computes a live plan: images of single sub-apertures as their pulses arrive."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ..backends import AUTO, backend as find_backend
from ..device_arrays import on_device
from ..planning.afbp.edge_brightness import EdgeBrightness
from ..planning.afbp.lit_subapertures import seen_subapertures
from ..planning.afbp.live import LivePlan
from ..signal.pulses import PulseBlock
from ..signal.pulses.apertures import AperturePulses, ApertureStatistics

if TYPE_CHECKING:
    from ..backends.protocol import Backend


@dataclasses.dataclass
class LiveStatistics(ApertureStatistics):
    """Counts of `LiveSubapertures`; `images` are those of sub-apertures."""

    plans: int = 0
    plans_anew: int = 0
    plan_seconds: float = 0.0


class SubapertureStage:
    """Backprojects sub-apertures by the `LivePlan` of their aperture.

    Parameters
    ----------
    plan : LivePlan
        What is computed.
    backend : str or Backend
        As for `plan_image`.
    """

    def __init__(self, plan: LivePlan, backend: str | Backend = AUTO):
        self.plan = plan
        self._imager = find_backend(backend).SubapertureImager(plan.subapertures)

    def image(self, block: PulseBlock) -> tuple[np.ndarray, float]:
        """Backproject the range profiles of a sub-aperture.

        Returns
        -------
        image : (n_alpha, n_range) complex64
            On the coarse grid of the plan, at range baseband; on the device where a device formed
            it.
        uneven_db : float
            By how much its error exceeds the predicted one, because what lies right beyond the
            edges is brighter than the image, dB.

        Raises
        ------
        ValueError
            The block does not match the plan.
        """
        plan = self.plan.subapertures
        lit = plan.illumination_of(block)
        if lit and not seen_subapertures(plan.coarse, [slice(0, block.n_pulses)], lit,
                                         plan.n_channels):
            return np.zeros((plan.coarse.n_alpha, plan.coarse.n_range), np.complex64), 0.0
        parts = self._imager.image(0, block)
        if on_device(parts):
            image = parts[0] + np.complex64(1j) * parts[1]
        else:
            image = np.empty(parts.shape[1:], np.complex64)
            image.real, image.imag = parts
        brightness = EdgeBrightness(plan.fusion_grid, plan.sampling.coverage)
        brightness.add(parts)
        return image, brightness.uneven_db


@dataclasses.dataclass
class Target:
    """An image to be: apertures that it is made of, and the plan of their sub-apertures."""

    first: int  # aperture
    n_apertures: int
    sequence: int
    apertures: list[AperturePulses] = dataclasses.field(default_factory=list)
    stage: SubapertureStage | None = None
    revision: int = 0
    waits: bool = False  # for the whole track
    refused: bool = False

    def window(self, aperture: AperturePulses, part: slice
               ) -> tuple[np.ndarray, np.ndarray] | None:
        """Phase centres (P, C, 3) of the sliding aperture that ends with a sub-aperture, metres.

        None where apertures do not slide. The first ones of a stream are as short as they are.
        """
        if self.n_apertures == 1:
            return None
        stop = aperture.first + part.stop
        found = []
        for other in self.apertures:
            number = other.first + np.arange(len(other.seen))
            some = other.seen & (number < stop) & (number >= stop - len(aperture.seen))
            found.append((other.tx_m[some], other.rx_m[some]))
        return tuple(map(np.concatenate, zip(*found, strict=True)))
