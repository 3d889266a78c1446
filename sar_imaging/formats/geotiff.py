"""Images to cloud-optimised GeoTIFF and back."""

from __future__ import annotations

import dataclasses
import os

import numpy as np

from ..files import reading
from ..geometry.earth import Datum
from ..geometry.grids import PointGrid
from ..imaging.image import Image
from ..numpy_files import check_memory
from .acquisition import Acquisition, ImageProduct
from .decibels import decibels, grey_levels, limits_db
from .extras import require
from .georeference import TOLERANCE_M, Georeference, georeference, named_crs, utm_crs
from .raster import write_cog
from .resampling import MapPixels, covering_pixels, resample
from .tags import image_from_text, image_to_text, quantity_of, told_of

COMPLEX, DECIBELS, QUICKLOOK = CONTENTS = 'complex', 'decibels', 'quicklook'
_LARGEST_RATIO = 1032  # of what DEFLATE compresses
_TAG, _RESAMPLED = 'SAR_IMAGING', 'RESAMPLED'


def write_geotiff(path: os.PathLike | str, image: Image, datum: Datum, *,
                  content: str = DECIBELS, crs=None, acquisition: Acquisition | None = None,
                  north_up: bool = False) -> Georeference:
    """Write a map as a cloud-optimised GeoTIFF.

    Pixels stay where they were imaged: their places on the map projection are told by an affine
    transform, which may be turned against it. How far pixels lie from where it puts them is
    measured; 2.5 mm are allowed. With `north_up`, or where no transform is as exact as that, the
    image is interpolated to square pixels of the projection.

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
        Bands are named by what their squared magnitude is, see `sar_imaging.radiometry`.
    crs : optional
        ``None``: UTM where the transform is exact to 2.5 mm, transverse Mercator about the image
        otherwise; ``'local'``: that one; or what pyproj takes for a CRS, such as ``25832``.
    acquisition : Acquisition, optional
        Pulses of the image, which interpolation needs.
    north_up : bool
        Square pixels along easting and northing, whose edges are multiples of their spacing.

    Returns
    -------
    Georeference
        Projection, transform and its error.

    Raises
    ------
    ValueError
        The image is no map, or needs interpolation and has no acquisition.
    MissingExtraError
        rasterio or pyproj is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.formats import write_geotiff
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((0.0, 0.0, 0.0), 64, 48, 0.5)
    >>> image = Image(np.ones(grid.shape, np.complex64), grid, 10e9, Report('exact', '', -60.0))
    >>> place = write_geotiff('map.tif', image, Datum(47.0, 8.0, 450.0))
    >>> place.crs.to_epsg(), place.error_m < 0.0025  # metres
    (32632, True)
    """
    if content not in CONTENTS:
        raise ValueError(f'content={content!r}; expected one of {", ".join(CONTENTS)}')
    if np.ndim(image.samples) != 2:
        raise ValueError(f'image.samples.shape={image.shape}; expected (rows, columns): write '
                         'the image of each channel into a file of its own')
    place, samples = _placed(image, datum, crs, acquisition, north_up)
    band, nodata = _band(samples, content)
    tags = {_TAG: image_to_text(image, datum), 'CONTENT': content,
            'PLACE_ERROR_M': f'{place.error_m:.2g}', **told_of(image.radiometry)}
    if samples is not image.samples:
        tags[_RESAMPLED] = 'YES'
    quantity = quantity_of(image)
    # phases of neighbours would cancel
    write_cog(path, band, place, nodata=nodata, tags=tags,
              names=[quantity], units=[_unit(image, content)],
              overviews='NEAREST' if content == COMPLEX else 'AVERAGE')
    return place


def _unit(image: Image, content: str) -> str:
    """Unit of a band."""
    unit = '1' if image.radiometry is None else image.radiometry.unit
    if content == COMPLEX:
        return f'sqrt({unit})' if unit != '1' else unit
    return 'dB' if content == DECIBELS else ''


def _placed(image: Image, datum: Datum, crs, acquisition: Acquisition | None,
            north_up: bool) -> tuple[Georeference, np.ndarray]:
    """Place of an image on a map, and its samples there."""
    place = georeference(image.grid, datum, crs)
    if not north_up and place.error_m <= TOLERANCE_M:
        return place, image.samples
    if acquisition is None:
        reason = 'north_up interpolates' if north_up else (
            f'in {place.crs.name} pixels would lie up to {place.error_m:.3g} m from their '
            f'places, {TOLERANCE_M} m are allowed')
        raise ValueError(f'{reason}: give the acquisition, whose carrier interpolation takes out')
    if crs is None:
        place = georeference(image.grid, datum, utm_crs(image.grid, datum))
    flat = getattr(image.grid, 'map_grid', image.grid)
    spacing = float(np.linalg.norm(flat.steps_m, axis=1).min())
    pixels = covering_pixels(image.grid, datum, place.crs, spacing)
    return (Georeference(place.crs, pixels.affine, 0.0),
            resample(image, datum, acquisition, pixels))


def _band(samples: np.ndarray, content: str) -> tuple[np.ndarray, float | None]:
    """What the file holds, and the value that stands for nothing."""
    if content == COMPLEX:
        return np.asarray(samples, np.complex64), None
    levels = decibels(samples)
    if content == DECIBELS:
        return levels, float('nan')
    return grey_levels(levels, *limits_db(levels)), 0


def read_geotiff(path: os.PathLike | str) -> ImageProduct:
    """Read a complex GeoTIFF that `write_geotiff` wrote.

    Parameters
    ----------
    path : path
        File of ``content='complex'``.

    Returns
    -------
    ImageProduct
        Samples, grid, carrier, report and datum as they were written; the places of samples that
        were interpolated are a `PointGrid`.

    Raises
    ------
    ValueError
        The file is no GeoTIFF, holds no complex samples, or was written by something else.
    FileNotFoundError
        There is none.
    MissingExtraError
        rasterio is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.formats import read_geotiff, write_geotiff
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((0.0, 0.0, 0.0), 64, 48, 0.5)
    >>> image = Image(np.full(grid.shape, 3 + 4j, np.complex64), grid, 10e9,
    ...               Report('exact', '', -60.0))
    >>> _ = write_geotiff('complex.tif', image, Datum(47.0, 8.0, 450.0), content='complex')
    >>> back = read_geotiff('complex.tif')
    >>> back.image.grid == grid, complex(back.image.samples[0, 0]), back.datum.latitude_deg
    (True, (3+4j), 47.0)
    """
    rasterio = require('rasterio', 'reading GeoTIFF')
    with reading(path, 'GeoTIFF'):
        with rasterio.open(path, driver='GTiff') as file:
            if file.count != 1 or file.dtypes[0] != 'complex64':
                raise ValueError(f'it holds {file.count} bands of {file.dtypes[0]}; expected '
                                 f'one of complex64, as content={COMPLEX!r} writes')
            text = file.tags().get(_TAG)
            if text is None:
                raise ValueError(f'it has no tag {_TAG}; expected a file of write_geotiff')
            if 8 * file.height * file.width > _LARGEST_RATIO * os.path.getsize(path):
                raise ValueError(f'it tells of {file.height} rows of {file.width} samples, '
                                 f'more than {os.path.getsize(path)} bytes can hold')
            check_memory('the image', 8 * file.height * file.width)
            samples = file.read(1)
            resampled, crs, transform = _RESAMPLED in file.tags(), file.crs, file.transform
        image, datum = image_from_text(text, samples, resampled=resampled)
    if resampled:
        affine = np.array(transform).reshape(3, 3)[:2]
        affine[:, 2] += 0.5 * (affine[:, 0] + affine[:, 1])
        pixels = MapPixels(named_crs(crs.to_wkt()), affine, samples.shape)
        points = pixels.points(image.grid, datum, *np.indices(samples.shape))
        image = dataclasses.replace(image, grid=PointGrid(points))
    return ImageProduct(image, datum)
