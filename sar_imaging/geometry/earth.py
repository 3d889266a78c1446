# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the imaging frame stands on the Earth: `Datum`, and WGS 84 coordinates of its points.

Everything inside the package stays in the local Cartesian frame, float64 metres. A datum carries
points and vectors from there to Earth-centred, Earth-fixed (ECEF) coordinates and to latitude,
longitude and ellipsoidal height, and back.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

# WGS 84 (NGA.STND.0036, table 3.1)
SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
_ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
_LOWEST_M, _HIGHEST_M = -12_000.0, 1e7  # heights that a frame on the Earth can have


@dataclasses.dataclass(frozen=True)
class Datum:
    """Place and heading of the imaging frame's origin on the WGS 84 ellipsoid.

    The frame's z axis points along the ellipsoid's normal there. With heading 0 its x axis points
    east and its y axis north (ENU).

    Parameters
    ----------
    latitude_deg : float
        Geodetic latitude of the origin, degrees, north positive.
    longitude_deg : float
        Longitude of the origin, degrees, east positive; kept within -180 to 180.
    height_m : float
        Ellipsoidal height of the origin, metres; not above mean sea level.
    heading_deg : float
        Bearing of the frame's y axis, degrees clockwise from true north.

    Raises
    ------
    ValueError
        A value is not finite, or no such place exists.

    Examples
    --------
    >>> from sar_imaging.geometry import Datum
    >>> datum = Datum(47.0, 8.0, 450.0)
    >>> latitude, longitude, height = datum.to_geographic([[0.0, 1000.0, 0.0]])
    >>> print(f'{latitude[0]:.5f} {longitude[0]:.5f}, {height[0]:.2f} m')
    47.00899 8.00000, 450.08 m
    >>> x, y, z = datum.from_geographic(47.01, 8.01, 450.0)
    >>> print(f'{x:.1f} m east, {y:.1f} m north, {z:.2f} m up')
    760.5 m east, 1111.8 m north, -0.14 m up
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = float(getattr(self, field.name))
            if not math.isfinite(value):
                raise ValueError(f'{field.name}={value}; expected a finite number')
            object.__setattr__(self, field.name, value)
        if not -90.0 <= self.latitude_deg <= 90.0:
            raise ValueError(f'latitude_deg={self.latitude_deg:g}; expected -90 to 90 degrees '
                             '(are latitude and longitude exchanged?)')
        if not -180.0 <= self.longitude_deg <= 360.0:
            raise ValueError(f'longitude_deg={self.longitude_deg:g}; expected -180 to 360 degrees')
        if not _LOWEST_M <= self.height_m <= _HIGHEST_M:
            raise ValueError(f'height_m={self.height_m:g}; expected metres above the WGS 84 '
                             f'ellipsoid, {_LOWEST_M:g} to {_HIGHEST_M:g}')
        if not -360.0 <= self.heading_deg <= 360.0:
            raise ValueError(f'heading_deg={self.heading_deg:g}; expected -360 to 360 degrees')
        if self.longitude_deg > 180.0:
            object.__setattr__(self, 'longitude_deg', self.longitude_deg - 360.0)

    @property
    def origin_ecef_m(self) -> np.ndarray:
        """(3,) float64 origin of the frame in ECEF coordinates, metres."""
        return geographic_to_ecef(self.latitude_deg, self.longitude_deg, self.height_m)

    @property
    def axes_ecef(self) -> np.ndarray:
        """(3, 3) float64 unit vectors of the frame's x, y and z axis in ECEF, one to a row."""
        lat, lon, heading = np.radians([self.latitude_deg, self.longitude_deg, self.heading_deg])
        east = np.array([-math.sin(lon), math.cos(lon), 0.0])
        north = np.array([-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon),
                          math.cos(lat)])
        up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon),
                       math.sin(lat)])
        return np.stack([math.cos(heading) * east - math.sin(heading) * north,
                         math.sin(heading) * east + math.cos(heading) * north, up])

    def to_ecef(self, points_m: ArrayLike) -> np.ndarray:
        """ECEF coordinates of (..., 3) points of the frame, float64 metres."""
        return self.vectors_to_ecef(points_m) + self.origin_ecef_m

    def from_ecef(self, points_m: ArrayLike) -> np.ndarray:
        """Points of the frame from (..., 3) ECEF coordinates, float64 metres."""
        return self.vectors_from_ecef(np.asarray(points_m, np.float64) - self.origin_ecef_m)

    def vectors_to_ecef(self, vectors: ArrayLike) -> np.ndarray:
        """Components along the ECEF axes of (..., 3) vectors of the frame, such as velocities."""
        return np.asarray(vectors, np.float64) @ self.axes_ecef

    def vectors_from_ecef(self, vectors: ArrayLike) -> np.ndarray:
        """Components along the frame's axes of (..., 3) vectors given in ECEF."""
        return np.asarray(vectors, np.float64) @ self.axes_ecef.T

    def to_geographic(self, points_m: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Latitude and longitude, degrees, and ellipsoidal height, metres, of (..., 3) points."""
        return ecef_to_geographic(self.to_ecef(points_m))

    def from_geographic(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike,
                        height_m: ArrayLike) -> np.ndarray:
        """(..., 3) points of the frame from geographic coordinates, float64 metres."""
        return self.from_ecef(geographic_to_ecef(latitude_deg, longitude_deg, height_m))


def geographic_to_ecef(latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
                       ) -> np.ndarray:
    """ECEF coordinates from geodetic latitude, longitude (degrees) and ellipsoidal height.

    Parameters
    ----------
    latitude_deg, longitude_deg, height_m : (...) array_like
        Broadcast together; degrees and metres.

    Returns
    -------
    (..., 3) float64
        Metres.
    """
    lat, lon = (np.radians(np.asarray(a, np.float64)) for a in (latitude_deg, longitude_deg))
    height = np.asarray(height_m, np.float64)
    normal = SEMI_MAJOR_M / np.sqrt(1 - _ECCENTRICITY2 * np.sin(lat)**2)
    across = (normal + height) * np.cos(lat)
    return np.stack(np.broadcast_arrays(
        across * np.cos(lon), across * np.sin(lon),
        (normal * (1 - _ECCENTRICITY2) + height) * np.sin(lat)), axis=-1)


def ecef_to_geographic(points_m: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Geodetic latitude, longitude (degrees) and ellipsoidal height (metres) of ECEF points.

    Bowring (Survey Review 23, 1976), his step repeated until what is left is rounding, for points
    from 5000 km below the ellipsoid to the height of satellites.

    Parameters
    ----------
    points_m : (..., 3) array_like
        Metres.

    Returns
    -------
    latitude_deg, longitude_deg, height_m : (...) float64
        Longitudes within -180 to 180.
    """
    x, y, z = np.moveaxis(np.asarray(points_m, np.float64), -1, 0)
    across = np.hypot(x, y)
    reduced = np.arctan2(z, (1 - FLATTENING) * across)  # latitude on the auxiliary sphere
    for _ in range(4):
        latitude = np.arctan2(
            z + _ECCENTRICITY2 / (1 - FLATTENING) * SEMI_MAJOR_M * np.sin(reduced)**3,
            across - _ECCENTRICITY2 * SEMI_MAJOR_M * np.cos(reduced)**3)
        reduced = np.arctan2((1 - FLATTENING) * np.sin(latitude), np.cos(latitude))
    # along the normal, which is as exact at the poles as at the equator
    sine, cosine = np.sin(latitude), np.cos(latitude)
    height = (across * cosine + z * sine
              - SEMI_MAJOR_M * np.sqrt(1 - _ECCENTRICITY2 * sine**2))
    return np.degrees(latitude), np.degrees(np.arctan2(y, x)), height
