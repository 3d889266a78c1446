"""How brightly each echo lights a point: an antenna pattern, and where it looked."""

from __future__ import annotations

import dataclasses

import numpy as np

from .pattern import AntennaPattern
from .pointing import Pointing


@dataclasses.dataclass(frozen=True, eq=False)
class Illumination:
    """Two-way amplitude of echoes, one of each pulse and channel, towards any point.

    Parameters
    ----------
    pattern : AntennaPattern
        Of all echoes.
    centre_m : (R, 3) float64
        Where each is seen from: the middle between its phase centres, metres.
    axes : (R, 3, 3) float64
        The antenna's right, boresight and up at each, as rows.
    """

    pattern: AntennaPattern
    centre_m: np.ndarray
    axes: np.ndarray

    @classmethod
    def of_pulses(cls, pattern: AntennaPattern, pointing: Pointing, tx_m, rx_m) -> Illumination:
        """Illumination by pulses with phase centres (P, C, 3), metres, pulse by pulse.

        Raises
        ------
        ValueError
            The pointing is for another number of pulses.
        """
        centre = 0.5 * (np.asarray(tx_m, np.float64) + rx_m)
        if len(pointing) != len(centre):
            raise ValueError(f'the pointing is for {len(pointing)} pulses, there are '
                             f'{len(centre)}; give every pulse its boresight')
        return cls(pattern, np.ascontiguousarray(centre.reshape(-1, 3)),
                   np.repeat(pointing.axes, centre.shape[1], axis=0))

    def select(self, rows) -> Illumination:
        """Some of the echoes, by slice, mask or integers."""
        return Illumination(self.pattern, self.centre_m[rows], self.axes[rows])

    def amplitude(self, points_m) -> np.ndarray:
        """(R, ...) float64 two-way amplitude of each echo at points (..., 3), metres."""
        points = np.asarray(points_m, np.float64)
        between = (slice(None), *[None] * (points.ndim - 1))
        return self.pattern.amplitude(points - self.centre_m[between], self.axes[between])
