"""Where satellite navigation says that its antenna was."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..earth import geographic_to_ecef


@dataclasses.dataclass(frozen=True)
class Fix:
    """Place of an antenna of satellite navigation at a time.

    Parameters
    ----------
    stamp_ns : int
        Time on the clock of the poses, nanoseconds.
    latitude_deg, longitude_deg : float
        Geodetic (WGS 84), degrees.
    height_m : float
        Above the WGS 84 ellipsoid, metres.
    std_m : float
        Standard deviation of the horizontal place along its worse axis, metres; NaN where the
        receiver does not tell.

    Examples
    --------
    >>> from sar_imaging.geometry.navigation import Fix
    >>> fix = Fix(stamp_ns=0, latitude_deg=0.0, longitude_deg=90.0, height_m=100.0, std_m=0.02)
    >>> fix.ecef_m.round(3).tolist()  # the equator's radius and 100 m along y
    [0.0, 6378237.0, 0.0]
    """

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    std_m: float = math.nan

    @property
    def ecef_m(self) -> np.ndarray:
        """(3,) float64 place in Earth-centred coordinates, metres."""
        return geographic_to_ecef(self.latitude_deg, self.longitude_deg, self.height_m)
