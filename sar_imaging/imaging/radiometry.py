# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the squared magnitude of a calibrated image is, its unit and its level of noise."""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Radiometry:
    """What the squared magnitude of a calibrated image is.

    Attributes
    ----------
    quantity : str
        Such as ``'sigma0'``; see `sar_imaging.radiometry.QUANTITIES`.
    gain_m : float
        Gain of the radar constant, metres times the unit of the range profiles.
    noise_equivalent_db : float
        Median over the pixels of the brightness that noise alone has, dB; NaN if not known.
    incidence_deg : float
        Median incidence angle, degrees; NaN of volumes, which have no surface.

    Examples
    --------
    >>> from sar_imaging.imaging.radiometry import Radiometry
    >>> print(Radiometry('sigma0', 6.25e6, -31.24, 54.71))
    sigma0, noise-equivalent -31.2 dB, incidence 54.7 degrees
    >>> Radiometry('rcs', 6.25e6, -31.2, 54.7).unit
    'm^2'
    """

    quantity: str
    gain_m: float
    noise_equivalent_db: float
    incidence_deg: float

    @property
    def unit(self) -> str:
        """Of the squared magnitude: square metres, or 1 for those by square metre."""
        return 'm^2' if self.quantity == 'rcs' else '1'

    def __str__(self) -> str:
        noise = ('not known' if math.isnan(self.noise_equivalent_db)
                 else f'{self.noise_equivalent_db:.1f} dB')
        incidence = ('' if math.isnan(self.incidence_deg)
                     else f', incidence {self.incidence_deg:.1f} degrees')
        return f'{self.quantity}, noise-equivalent {noise}{incidence}'
