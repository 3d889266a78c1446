"""Time of AFBP's first stage: sub-aperture images from beams or directly, as is quicker."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from ...geometry.polar import PolarGrid
from ...geometry.track_frame import mean_centres
from ...signal.radar import RadarParameters
from ..costs import costs
from ..profiles.range_resampling import RangeResampling
from .beams import SLACK, BeamSampling, least_operations, plan_beams

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
    reach_m, padding_m : float
        As for `plan_beams`.
    n_weighed : callable, optional
        As of `BeamSampling`, of sub-apertures with some pulses; None where images from beams
        cannot be weighed well enough.
    """

    grid: PolarGrid
    span: float
    radar: RadarParameters
    lattice: RangeResampling
    tx_m: np.ndarray
    rx_m: np.ndarray
    target_db: float
    reach_m: float
    padding_m: float
    n_weighed: Callable[[Sequence[slice]], int | None] = lambda pulses: 0

    def cost(self, pulses, n_pixels) -> np.ndarray:
        """(K,) nanoseconds of all images of a cut into sub-apertures of about equally many pulses.

        `pulses` are their slices, `n_pixels`, (K,), the pixels of each image.
        """
        length = pulses[0].stop - pulses[0].start
        return len(pulses) * np.minimum(*self._costs(self._beams(pulses), length, n_pixels))

    def least_cost(self, pulses, n_pixels) -> np.ndarray:
        """What `cost` is not below, whatever the beams; found much more quickly."""
        n_echoes = (pulses[0].stop - pulses[0].start) * self.tx_m.shape[1]
        from_beams = costs().nanoseconds(least_operations(n_echoes, self.lattice, n_pixels))
        return len(pulses) * np.minimum(n_echoes * self.lattice.cost * n_pixels, from_beams)

    def choose_beams(self, pulses) -> BeamSampling | None:
        """Beams for images on `grid`; None where adding each pulse directly is quicker."""
        beams = self._beams(pulses)
        direct, from_beams = self._costs(beams, max(p.stop - p.start for p in pulses),
                                         self.grid.n_alpha * self.grid.n_range)
        return beams if from_beams < direct else None

    def _costs(self, beams, length, n_pixels):
        """Nanoseconds of an image: directly, and from beams."""
        n_echoes = length * self.tx_m.shape[1]
        from_beams = math.inf if beams is None else costs().nanoseconds(
            beams.operations(n_echoes, self.lattice, n_pixels, self.span))
        return n_echoes * self.lattice.cost * n_pixels, from_beams

    def _beams(self, pulses) -> BeamSampling | None:
        n_weighed = self.n_weighed(pulses)
        if n_weighed is None:
            return None
        # of echoes that share an image
        cuts = [tuple(c[pulses[i], number % n:: n].reshape(-1, 3) for c in (self.tx_m, self.rx_m))
                for number, i in enumerate(self._for_beams(pulses)) for n in [max(1, n_weighed)]]
        beams = plan_beams(self.grid, self.radar, self.lattice, cuts, self.target_db, self.reach_m,
                           self.padding_m)
        return beams and dataclasses.replace(beams, n_weighed=n_weighed)

    def _for_beams(self, pulses) -> list[int]:
        """Numbers of some sub-apertures, evenly, and of the widest where none is about as wide."""
        some = np.unique(np.linspace(0, len(pulses) - 1, _CUTS_FOR_BEAMS).round().astype(int))
        middles, first = mean_centres(self.tx_m, self.rx_m), [p.start for p in pulses]
        width = np.linalg.norm(np.maximum.reduceat(middles, first)
                               - np.minimum.reduceat(middles, first), axis=1)
        widest = int(width.argmax())
        return [*some, *[widest] * bool(width[widest] > SLACK * width[some].max())]
