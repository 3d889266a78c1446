"""Images to cloud-optimised GeoTIFF and back."""

from __future__ import annotations

import os
import pathlib

import numpy as np

from ..geometry.earth import Datum
from ..imaging.image import Image
from .decibels import decibels, grey_levels, limits_db
from .extras import require
from .georeference import TOLERANCE_M, Georeference, georeference
from .product import ImageProduct
from .tags import image_from_text, image_to_text

COMPLEX, DECIBELS, QUICKLOOK = CONTENTS = 'complex', 'decibels', 'quicklook'
_TAG = 'SAR_IMAGING'


def write_geotiff(path: os.PathLike | str, image: Image, datum: Datum, *,
                  content: str = DECIBELS, crs=None) -> Georeference:
    """Write a map as a cloud-optimised GeoTIFF.

    Pixels stay where they were imaged: their places on the map projection are told by an affine
    transform, which may be turned against it. How far pixels lie from where it puts them is
    measured.

    Parameters
    ----------
    path : path
        File to write, such as ``image.tif``; complete or absent.
    image : Image
        On a `MapGrid`, a `TerrainGrid` or a level `PlaneGrid`; one image, not one for each
        channel.
    datum : Datum
        Place of the imaging frame on the Earth.
    content : str
        ``'decibels'``: float32 amplitude, dB, NaN where there is none; ``'quicklook'``: eight
        bits of it, 0 where there is none; ``'complex'``: complex64, every bit of the samples.
    crs : optional
        ``None``: UTM where the transform is exact to 2.5 mm, transverse Mercator about the image
        otherwise; ``'local'``: that one; or what pyproj takes for a CRS, such as ``25832``.

    Returns
    -------
    Georeference
        Projection, transform and its error.

    Raises
    ------
    ValueError
        The image is no map, or so large that no affine transform puts its pixels to their places
        on this projection.
    MissingExtraError
        rasterio or pyproj is not installed.
    """
    rasterio = require('rasterio', 'writing GeoTIFF')
    if content not in CONTENTS:
        raise ValueError(f'content={content!r}; expected one of {", ".join(CONTENTS)}')
    if np.ndim(image.samples) != 2:
        raise ValueError(f'image.samples.shape={image.shape}; expected (rows, columns): write '
                         'the image of each channel into a file of its own')
    place = georeference(image.grid, datum, crs)
    if place.error_m > TOLERANCE_M:
        raise ValueError(f'in {place.crs.name} pixels would lie up to {place.error_m:.3g} m from '
                         f'their places; {TOLERANCE_M} m are allowed: leave the CRS to us '
                         '(crs=None), or write the image in smaller pieces')
    band, nodata = _band(image.samples, content)
    transform = rasterio.transform.Affine(*place.corner_affine.ravel())
    profile = dict(driver='GTiff', height=band.shape[0], width=band.shape[1], count=1,
                   dtype=band.dtype, crs=place.crs.to_wkt(), transform=transform, nodata=nodata)
    tags = {_TAG: image_to_text(image, datum), 'CONTENT': content,
            'PLACE_ERROR_M': f'{place.error_m:.2g}'}
    _write_cog(rasterio, pathlib.Path(path), band, profile, tags)
    return place


def _band(samples: np.ndarray, content: str) -> tuple[np.ndarray, float | None]:
    """What the file holds, and the value that stands for nothing."""
    if content == COMPLEX:
        return np.asarray(samples, np.complex64), None
    levels = decibels(samples)
    if content == DECIBELS:
        return levels, float('nan')
    return grey_levels(levels, *limits_db(levels)), 0


def _write_cog(rasterio, path: pathlib.Path, band, profile: dict, tags: dict) -> None:
    shutil = require('rasterio.shutil', 'writing GeoTIFF')
    part = path.with_name(f'{path.name}.part')
    smooth = profile['dtype'] != np.complex64  # phases of neighbours would cancel
    try:
        with rasterio.MemoryFile() as memory:
            with memory.open(**profile) as plain:
                plain.write(band, 1)
                plain.update_tags(**tags)
            with memory.open() as plain:
                shutil.copy(plain, part, driver='COG', COMPRESS='DEFLATE', BIGTIFF='IF_SAFER',
                            PREDICTOR='YES' if smooth else 'NO',
                            RESAMPLING='AVERAGE' if smooth else 'NEAREST')
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def read_geotiff(path: os.PathLike | str) -> ImageProduct:
    """Read a complex GeoTIFF that `write_geotiff` wrote.

    Returns
    -------
    ImageProduct
        Samples, grid, carrier, report and datum as they were written.

    Raises
    ------
    ValueError
        The file is no GeoTIFF, holds no complex samples, or was written by something else.
    MissingExtraError
        rasterio is not installed.
    """
    rasterio = require('rasterio', 'reading GeoTIFF')
    try:
        with rasterio.open(path, driver='GTiff') as file:
            if file.count != 1 or file.dtypes[0] != 'complex64':
                raise ValueError(f'{path} holds {file.count} bands of {file.dtypes[0]}; expected '
                                 f'one of complex64, as content={COMPLEX!r} writes')
            text = file.tags().get(_TAG)
            if text is None:
                raise ValueError(f'{path} has no tag {_TAG}; expected a file of write_geotiff')
            samples = file.read(1)
    except rasterio.errors.RasterioError as error:
        raise ValueError(f'{path} cannot be read as GeoTIFF: {error}') from error
    image, datum = image_from_text(text, samples)
    return ImageProduct(image, datum)
