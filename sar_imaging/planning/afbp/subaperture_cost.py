"""Time of AFBP's first stage: sub-aperture images from beams or directly, as is quicker."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..costs import CostModel, costs
from ..profiles.range_resampling import RangeResampling
from .beams import BeamSampling, least_cost, plan_beams

_CUTS_FOR_BEAMS = 5  # sub-apertures whose geometry is looked at


@dataclasses.dataclass(frozen=True)
class SubapertureCost:
    """What both ways of forming sub-aperture images depend on, but for the images' size.

    Attributes
    ----------
    grid : PolarGrid
        Of the images, or nearly.
    span : float
        Extent of the wanted pixels in direction cosine.
    tx_m, rx_m : (P, C, 3) float64
    target_db : float
        Wanted error of the images, dB.
    padding_m : float
        As for `plan_beams`.
    """

    grid: PolarGrid
    span: float
    radar: RadarParameters
    lattice: RangeResampling
    tx_m: np.ndarray
    rx_m: np.ndarray
    target_db: float
    range_m: tuple[float, float]
    padding_m: float
    _model: CostModel = dataclasses.field(default_factory=costs)
    _planned: dict[tuple[int, int], BeamSampling | None] = dataclasses.field(default_factory=dict)

    def cost(self, pulses, n_pixels: int) -> float:
        """Nanoseconds of all images of a cut into sub-apertures.

        Parameters
        ----------
        pulses : sequence of slice
            Of the sub-apertures, which are about equally long.
        n_pixels : int
            Of each image.
        """
        length = pulses[0].stop - pulses[0].start
        cut = length, len(pulses)
        if cut not in self._planned:
            self._planned[cut] = self._beams(pulses)
        return len(pulses) * min(self._costs(self._planned[cut], length, n_pixels))

    def least_cost(self, pulses, n_pixels: int) -> float:
        """What `cost` is not below, whatever the beams; found much more quickly."""
        n_rows = (pulses[0].stop - pulses[0].start) * self.tx_m.shape[1]
        return len(pulses) * min(
            n_rows * self.lattice.cost * n_pixels,
            least_cost(self._model, n_rows, self.lattice.n_padded, self.lattice.n_cells, n_pixels))

    def choose_beams(self, pulses, n_pixels: int) -> BeamSampling | None:
        """Beams for such images; None where adding each pulse directly is quicker."""
        beams = self._beams(pulses)
        direct, from_beams = self._costs(beams, max(p.stop - p.start for p in pulses), n_pixels)
        return beams if from_beams < direct else None

    def _costs(self, beams, length, n_pixels) -> tuple[float, float]:
        """Nanoseconds of an image: directly, and from beams."""
        n_rows, lattice = length * self.tx_m.shape[1], self.lattice
        return (n_rows * lattice.cost * n_pixels, math.inf if beams is None else beams.cost(
            n_rows, lattice.n_padded, lattice.n_cells, n_pixels, self.span))

    def _beams(self, pulses) -> BeamSampling | None:
        some = np.linspace(0, len(pulses) - 1, _CUTS_FOR_BEAMS).round().astype(int)
        cuts = [(self.tx_m[pulses[i]].reshape(-1, 3), self.rx_m[pulses[i]].reshape(-1, 3))
                for i in np.unique(some)]
        return plan_beams(self.grid, self.radar, self.lattice, self.lattice.n_padded, cuts,
                          self.target_db, self.range_m[1] - self.range_m[0], self.padding_m)
