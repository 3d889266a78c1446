# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the pixels of an image lie on a map of the Earth: its projection and affine transform.

A plane of our Cartesian frame is no plane of any map projection: the Earth curves away from it,
and a projection has convergence and a scale of its own. Over a small image all of that is linear,
and an affine transform takes it up: pixels stay as they were imaged. What is left grows with the
square or cube of the size; it is measured here for every image.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.earth import FLATTENING, SEMI_MAJOR_M, Datum
from ..geometry.grids import EvenGrid, Grid
from .extras import require

LOCAL = 'local'
TOLERANCE_M = 0.0025  # of pixels that stay as they are: half of half a centimetre
_N_CHECKED = 33  # pixels along each axis whose places are compared
_STEEPEST = 1e-3  # slope of a plane that counts as level


@dataclasses.dataclass(frozen=True, eq=False)
class Georeference:
    """Map projection of an image and the way from its pixels to it.

    Attributes
    ----------
    crs : pyproj.CRS
        The projection.
    affine : (2, 3) float64
        Takes ``(column, row, 1)`` of a pixel's middle to easting and northing (longitude and
        latitude, degrees, where the CRS is geographic).
    error_m : float
        Largest distance of a pixel from where the transform puts it.
    """

    crs: Any
    affine: np.ndarray
    error_m: float

    @property
    def corner_affine(self) -> np.ndarray:
        """(2, 3) the same for the outer corner of pixel ``[0, 0]``, as GDAL counts."""
        out = self.affine.copy()
        out[:, 2] -= 0.5 * (out[:, 0] + out[:, 1])
        return out


def georeference(grid: Grid, datum: Datum, crs: Any = None) -> Georeference:
    """The projection and affine transform of a map or level plane.

    Parameters
    ----------
    grid : MapGrid, TerrainGrid or PlaneGrid
        Level, or on terrain.
    datum : Datum
        Place of its frame.
    crs : optional
        ``None``: UTM (UPS near the poles) where that is exact to 2.5 mm, a transverse Mercator
        projection about the middle of the image otherwise; ``'local'``: that projection; or
        anything that pyproj takes for a CRS, such as ``32632`` or ``'EPSG:25832'``.

    Returns
    -------
    Georeference

    Raises
    ------
    ValueError
        The image is no map, or there is no such CRS.
    """
    check_level(grid)
    if crs is not None:
        return _fitted(grid, datum, local_crs(grid, datum) if crs == LOCAL else named_crs(crs))
    found = _fitted(grid, datum, utm_crs(grid, datum))
    if found.error_m > TOLERANCE_M:
        found = _fitted(grid, datum, local_crs(grid, datum))
    return found


def flat_grid(grid: Grid) -> EvenGrid:
    """Map or plane of the pixels of an image; terrain without its heights.

    Raises
    ------
    ValueError
        They lie on neither.
    """
    flat = getattr(grid, 'map_grid', grid)
    if not isinstance(flat, EvenGrid) or len(flat.shape) != 2:
        raise ValueError(f'the image lies on a {type(grid).__name__}; expected a MapGrid, a '
                         'TerrainGrid or a PlaneGrid: form the image on one of them')
    return flat


def check_level(grid: Grid) -> None:
    """Raise ValueError unless a grid is a map, terrain or a level plane."""
    if hasattr(grid, 'map_grid'):  # on heights
        return
    advice = 'form the image on a MapGrid, or write it as SICD'
    if not isinstance(grid, EvenGrid) or len(grid.shape) != 2:
        raise ValueError(f'the image lies on a {type(grid).__name__}; expected a MapGrid, a '
                         f'TerrainGrid or a level PlaneGrid: {advice}')
    slopes = np.abs(grid.steps_m[:, 2]) / np.linalg.norm(grid.steps_m, axis=1)
    if slopes.max() > _STEEPEST:
        raise ValueError(f'the plane of the image rises by {100 * slopes.max():.3g} %; a map is '
                         f'level: {advice}')


def utm_crs(grid: Grid, datum: Datum) -> Any:
    """UTM zone of the middle of an image, or UPS beyond 84 degrees north and 80 south."""
    latitude, longitude, _ = _middle(grid, datum)
    if latitude > 84 or latitude < -80:
        return named_crs(32661 if latitude > 0 else 32761)
    zone = min(int((longitude + 180) // 6) + 1, 60)
    return named_crs((32600 if latitude >= 0 else 32700) + zone)


def local_crs(grid: Grid, datum: Datum) -> Any:
    """Transverse Mercator projection of WGS 84 about the middle of an image."""
    crs = require('pyproj.crs', 'a map projection')
    conversions = require('pyproj.crs.coordinate_operation', 'a map projection')
    latitude, longitude, _ = _middle(grid, datum)
    return crs.ProjectedCRS(
        conversions.TransverseMercatorConversion(latitude, longitude, 0.0, 0.0, 1.0),
        name='Transverse Mercator about the image')


def named_crs(crs: Any) -> Any:
    """CRS of what pyproj takes for one.

    Raises
    ------
    ValueError
        It takes nothing of the kind.
    """
    pyproj = require('pyproj', 'a map projection')
    try:
        found = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError as error:
        raise ValueError(f'crs={crs!r}; expected an EPSG number such as 32632, "local", or what '
                         f'pyproj takes for a CRS ({error})') from None
    if not (found.is_projected or found.is_geographic):
        raise ValueError(f'crs={crs!r} is a {found.type_name}; expected a projected or a '
                         'geographic CRS')
    return found


def to_map(crs: Any, latitude_deg: ArrayLike, longitude_deg: ArrayLike
           ) -> tuple[np.ndarray, np.ndarray]:
    """Easting and northing of geographic places on WGS 84."""
    return _transformer(crs, inverse=False).transform(longitude_deg, latitude_deg)


def from_map(crs: Any, easting: ArrayLike, northing: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude, degrees, of places on a map."""
    longitude, latitude = _transformer(crs, inverse=True).transform(easting, northing)
    return latitude, longitude


def _transformer(crs: Any, *, inverse: bool) -> Any:
    pyproj = require('pyproj', 'a map projection')
    ends = (crs, pyproj.CRS(4326)) if inverse else (pyproj.CRS(4326), crs)
    return pyproj.Transformer.from_crs(*ends, always_xy=True)


def _middle(grid: Grid, datum: Datum) -> tuple[float, ...]:
    place = np.nan_to_num(grid.positions(*(np.array(n // 2) for n in grid.shape)))
    return tuple(float(part) for part in datum.to_geographic(place))


def _fitted(grid: Grid, datum: Datum, crs: Any) -> Georeference:
    """Least squares over pixels of the whole image, its corners among them."""
    index = [np.unique(np.linspace(0, n - 1, _N_CHECKED).round().astype(int)) for n in grid.shape]
    row, column = (part.ravel() for part in np.meshgrid(*index, indexing='ij'))
    places = grid.positions(row, column)
    known = np.isfinite(places).all(axis=-1)
    row, column = row[known], column[known]
    latitude, longitude, _ = datum.to_geographic(places[known])
    east, north = to_map(crs, latitude, longitude)
    if not (np.isfinite(east).all() and np.isfinite(north).all()):
        raise ValueError(f'{crs.name} does not cover the image; choose another CRS')
    scale = [max(n - 1, 1) for n in grid.shape]
    design = np.column_stack([column / scale[1], row / scale[0], np.ones(len(row))])
    offset = np.array([east.mean(), north.mean()])  # for the digits of the fit
    solution = np.linalg.lstsq(design, np.column_stack([east, north]) - offset, rcond=None)[0]
    affine = solution.T / [scale[1], scale[0], 1.0]
    affine[:, 2] += offset
    mapped = affine @ np.stack([column, row, np.ones(len(row))])
    return Georeference(crs, affine, _distance(from_map(crs, *mapped), (latitude, longitude)))


def _distance(places: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> float:
    """Largest distance on the ellipsoid between near places, metres."""
    latitude = np.radians(others[0])
    root = np.sqrt(1 - FLATTENING * (2 - FLATTENING) * np.sin(latitude) ** 2)
    meridian = SEMI_MAJOR_M * (1 - FLATTENING) ** 2 / root ** 3
    turn = (places[1] - others[1] + 180) % 360 - 180
    north = meridian * np.radians(places[0] - others[0])
    east = SEMI_MAJOR_M / root * np.cos(latitude) * np.radians(turn)
    return float(np.hypot(north, east).max(initial=0.0))
