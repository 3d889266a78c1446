# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of images for people, in decibels: PNG with a world file, and KML for globes."""

from __future__ import annotations

import math
import os
import pathlib
from typing import Any
from xml.sax import saxutils

import numpy as np

from ..files import filling
from ..geometry.earth import Datum
from ..geometry.grids import Grid
from ..imaging.image import Image
from .extras import require
from .georeference import check_level, flat_grid, georeference
from .tags import quantity_of

_BELOW_CLUTTER_DB = 5.0
_LEAST_RANGE_DB, _MOST_RANGE_DB = 30.0, 60.0
_WHITE = 0.999  # of the pixels are darker
_LEAST_UPWARD = 0.01  # cosine between the normal of a plane and the vertical


def decibels(samples: np.ndarray) -> np.ndarray:
    """float32 amplitude, dB; NaN where a sample is 0 or not finite."""
    power = np.square(samples.real, dtype=np.float64) + np.square(samples.imag, dtype=np.float64)
    known = np.isfinite(power) & (power > 0)
    out = np.full(samples.shape, np.nan, np.float32)
    out[known] = 10 * np.log10(power[known])
    return out


def limits_db(levels_db: np.ndarray) -> tuple[float, float]:
    """What becomes black and what white.

    White is what a thousandth of the pixels exceeds. Black is 5 dB below the median, which is
    the clutter, but 30 to 60 dB below white.

    Returns
    -------
    black, white : float
        dB; -60 and 0 for an image without any known level.
    """
    known = levels_db[np.isfinite(levels_db)]
    if not known.size:
        return -_MOST_RANGE_DB, 0.0
    white = float(np.quantile(known, _WHITE))
    black = float(np.median(known)) - _BELOW_CLUTTER_DB
    return float(np.clip(black, white - _MOST_RANGE_DB, white - _LEAST_RANGE_DB)), white


def grey_levels(levels_db: np.ndarray, black_db: float, white_db: float) -> np.ndarray:
    """uint8 of decibels: 1 for black and less, 255 for white and more, 0 for NaN."""
    scaled = 1 + 254 * (levels_db - black_db) / (white_db - black_db)
    return np.where(np.isfinite(levels_db), np.clip(np.rint(scaled), 1, 255), 0).astype(np.uint8)


_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
  <GroundOverlay>
    <name>{name}</name>
    <description>{levels}</description>
    <Icon><href>{picture}</href></Icon>
    <altitudeMode>clampToGround</altitudeMode>
    <gx:LatLonQuad><coordinates>{corners}</coordinates></gx:LatLonQuad>
  </GroundOverlay>
</kml>
"""


def image_corners(grid: Grid, datum: Datum) -> np.ndarray:
    """(4, 2) latitude and longitude, degrees, of the outer corners of an image.

    Lower left, lower right, upper right, upper left as the image is drawn, row 0 on top. Those of
    a sloping plane are carried along its normal onto the horizontal through its middle, as SICD
    does it.

    Raises
    ------
    ValueError
        The image lies on no map and no plane, or on an upright one.
    """
    flat = flat_grid(grid)
    rows, columns = flat.shape
    index = np.array([[rows, 0], [rows, columns], [0, columns], [0, 0]]) - 0.5
    places = np.array(flat.origin_m) + index @ flat.steps_m
    normal = np.cross(flat.steps_m[0], flat.steps_m[1])
    if abs(normal[2]) < _LEAST_UPWARD * np.linalg.norm(normal):
        raise ValueError('the plane of the image is upright, and has no outline on a map: form '
                         'the image on a MapGrid')
    height = places[:, 2] - places[:, 2].mean()
    places = places - (height / normal[2])[:, None] * normal
    latitude, longitude, _ = datum.to_geographic(places)
    return np.column_stack([latitude, longitude])


def write_quicklook(path: os.PathLike[str] | str, image: Image, datum: Datum, *, crs: Any = None
                    ) -> list[pathlib.Path]:
    """Write an image as a PNG picture in decibels that says where on the Earth it lies.

    White is what a thousandth of the pixels exceeds; black is 5 dB below the median, within 30
    to 60 dB below white; 0 is where there is no image. Beside ``image.png`` come ``image.pgw``
    (its affine transform), ``image.prj`` (the projection that goes with that) and ``image.kml``
    (an overlay by its four corners, which says what black and white are).

    Parameters
    ----------
    path : path
        Path of the picture, ending in ``.png``.
    image : Image
        On a map, on terrain or on a level plane.
    datum : Datum
        Place of the imaging frame on the Earth.
    crs : optional
        Coordinate system of the world file, as for `write_geotiff`.

    Returns
    -------
    list of pathlib.Path
        The files, the picture first.

    Raises
    ------
    ValueError
        The path does not end in ``.png``, or the image is no map.
    MissingExtraError
        rasterio or pyproj is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.formats import write_quicklook
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((0.0, 0.0, 0.0), 64, 48, 0.5)
    >>> noise = np.random.default_rng(1).standard_normal((2, *grid.shape))
    >>> image = Image((noise[0] + 1j * noise[1]).astype(np.complex64), grid, 10e9,
    ...               Report('exact', '', -60.0))
    >>> [path.name for path in write_quicklook('map.png', image, Datum(47.0, 8.0, 450.0))]
    ['map.png', 'map.pgw', 'map.prj', 'map.kml']
    """
    rasterio = require('rasterio', 'writing PNG')
    shutil = require('rasterio.shutil', 'writing PNG')
    path = pathlib.Path(path)
    if path.suffix.lower() != '.png':
        raise ValueError(f'path={path}; expected a name that ends in .png')
    if np.ndim(image.samples) != 2:
        raise ValueError(f'image.samples.shape={image.shape}; expected (rows, columns): write '
                         'the image of each channel into a file of its own')
    check_level(image.grid)
    place = georeference(image.grid, datum, crs)
    levels = decibels(image.samples)
    limits = limits_db(levels)
    grey = grey_levels(levels, *limits)
    with filling(path.parent) as folder:
        parts = [folder / path.name, *((folder / path.name).with_suffix(suffix)
                                       for suffix in ('.pgw', '.prj', '.kml'))]
        with rasterio.MemoryFile() as memory:
            transform = rasterio.transform.Affine(*place.corner_affine.ravel())
            with memory.open(driver='GTiff', height=grey.shape[0], width=grey.shape[1], count=1,
                             dtype='uint8', transform=transform) as plain:
                plain.write(grey, 1)
            with memory.open() as plain:
                shutil.copy(plain, parts[0], driver='PNG')
        pathlib.Path(f'{parts[0]}.aux.xml').unlink(missing_ok=True)  # what the others tell
        parts[1].write_text(_world_file(place.affine))
        parts[2].write_text(place.crs.to_wkt('WKT1_ESRI') + '\n')
        parts[3].write_text(_overlay(path, image_corners(image.grid, datum),
                                     _levels(image, *limits)))
    return [path.with_name(part.name) for part in parts]


def _world_file(affine: np.ndarray) -> str:
    """Six lines: what a column and a row add to x and y, and the middle of the first pixel."""
    (a, b, x), (d, e, y) = affine
    return ''.join(f'{value!r}\n' for value in map(float, (a, d, b, e, x, y)))


def _levels(image: Image, black_db: float, white_db: float) -> str:
    """What the greys of a picture are."""
    told = image.radiometry
    noise = '' if told is None or math.isnan(told.noise_equivalent_db) else (
        f'; noise-equivalent {told.noise_equivalent_db:.1f} dB')
    unit = ' m^2' if told is not None and told.quantity == 'rcs' else ''
    return (f'{quantity_of(image)} from {black_db:.1f} dB{unit} (black) to {white_db:.1f} '
            f'dB{unit} (white){noise}')


def _overlay(path: pathlib.Path, corners: np.ndarray, levels: str) -> str:
    coordinates = ' '.join(f'{longitude:.9f},{latitude:.9f},0' for latitude, longitude in corners)
    return _KML.format(name=saxutils.escape(path.stem), picture=saxutils.escape(path.name),
                       corners=coordinates, levels=saxutils.escape(levels))
