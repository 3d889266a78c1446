# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images, and bands such as coherence and height, to cloud-optimised GeoTIFF and back.

`write_cog` takes whole bands, or window by window what is larger than memory.

Images are interpolated to the pixels of a map projection within the band that they have. From
pixel to pixel the carrier turns many times, so it is taken out first, ``exp(-j k_c D)`` with the
half path D of the middle of the aperture. What is left is band-limited about zero; it is
interpolated (Yen 1956, see `sar_imaging.quality.interpolation`), and the carrier of the new place
is put back.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from ..files import reading, replacing
from ..geometry.earth import SEMI_MAJOR_M, Datum
from ..geometry.grids import EvenGrid, Grid, PointGrid, TerrainGrid
from ..imaging.image import Image
from ..numpy_files import check_memory
from ..quality.interpolation import interpolate_image
from .acquisition import Acquisition, ImageProduct
from .extras import require
from .georeference import (
    TOLERANCE_M,
    Georeference,
    flat_grid,
    from_map,
    georeference,
    named_crs,
    to_map,
    utm_crs,
)
from .quicklook import decibels, grey_levels, limits_db
from .tags import image_from_text, image_to_text, quantity_of, told_of

_CACHE_BYTES = 1 << 27  # of GDAL's blocks, for bands larger than memory
_BLOCK = 512  # sides of the file's tiles, pixels


def write_raster(path: os.PathLike[str] | str, bands: Mapping[str, np.ndarray], grid: Grid,
                 datum: Datum, *, crs: Any = None) -> Georeference:
    """Write values on a map as float32 bands of one file.

    Parameters
    ----------
    path : path
        File to write, such as ``comparison.tif``; complete or absent.
    bands : mapping of str to (n_y, n_x) array
        Real values by the name of their band; NaN where there are none.
    grid : MapGrid, TerrainGrid or level PlaneGrid
        Where the pixels are.
    datum : Datum
        Place of the imaging frame on the Earth.
    crs : optional
        As in `write_geotiff`.

    Returns
    -------
    Georeference
        Projection, transform and its error.

    Raises
    ------
    ValueError
        A band has not the shape of the grid, or the grid is no map or too large for one affine
        transform.
    MissingExtraError
        rasterio or pyproj is not installed.
    """
    for name, values in bands.items():
        if np.shape(values) != grid.shape:
            raise ValueError(f'band {name!r} has the shape {np.shape(values)}, its grid '
                             f'{grid.shape}')
    place = georeference(grid, datum, crs)
    if place.error_m > TOLERANCE_M:
        raise ValueError(f'in {place.crs.name} pixels would lie up to {place.error_m:.3g} m from '
                         f'their places; {TOLERANCE_M} m are allowed: write smaller pieces')
    write_cog(path, np.stack([np.asarray(values, np.float32) for values in bands.values()]), place,
              names=tuple(bands), nodata=float('nan'))
    return place


def write_cog(path: os.PathLike[str] | str,
              values: np.ndarray | Iterable[tuple[tuple[slice, slice], np.ndarray]],
              place: Georeference, *, shape: tuple[int, int] | None = None, dtype: Any = None,
              names: Sequence[str] = ('',), units: Sequence[str] = (),
              nodata: float | None = None, tags: Mapping[str, str] | None = None,
              overviews: str = 'NEAREST') -> None:
    """Write bands, whole ones or window by window in some 300 MB of memory whatever their size.

    Beside the file stands one without compression meanwhile, so that twice its size and more is
    needed on the disk.

    Parameters
    ----------
    path : path
        File to write, complete or absent; BigTIFF where it has to be.
    values : array, or iterable of ((slice, slice), array)
        (rows, columns) or (bands, rows, columns); or windows: rows and columns, and their values.
        Pixels of no window hold `nodata`, or 0.
    place : Georeference
        Projection and transform.
    shape : (int, int)
        Rows and columns of all windows.
    dtype : dtype
        Data type of the values of windows, which GDAL knows.
    names, units : sequence of str
        Names and units of the bands, whose number the names tell.
    nodata : float, optional
        Value that stands for nothing.
    tags : mapping of str to str, optional
        Metadata of the file.
    overviews : str
        How GDAL makes the smaller images, such as ``'AVERAGE'``.

    Raises
    ------
    ValueError
        There are windows and no `shape`.
    MissingExtraError
        rasterio is not installed.
    """
    rasterio = require('rasterio', 'writing GeoTIFF')
    shutil = require('rasterio.shutil', 'writing GeoTIFF')
    if isinstance(values, np.ndarray):
        shape, dtype = values.shape[-2:], values.dtype
        values = [((slice(0, shape[0]), slice(0, shape[1])), values)]
    elif shape is None:
        raise ValueError('shape is missing; expected rows and columns of all windows')
    dtype = np.dtype(dtype)
    profile = dict(driver='GTiff', height=shape[0], width=shape[1], count=len(names), dtype=dtype,
                   crs=place.crs.to_wkt(), nodata=nodata, tiled=True, blockxsize=_BLOCK,
                   blockysize=_BLOCK, BIGTIFF='YES', SPARSE_OK='TRUE',
                   transform=rasterio.transform.Affine(*place.corner_affine.ravel()))
    predictor = {'f': '3', 'u': '2', 'i': '2'}.get(dtype.kind, 'NO')
    with replacing(path) as part, rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES, GDAL_NUM_THREADS='1'):
        plain = part.with_name(f'{part.name}.plain')
        with rasterio.open(plain, 'w', **profile) as file:
            for (rows, columns), own in values:
                height, width = own.shape[-2:]
                file.write(np.asarray(own, dtype).reshape(-1, height, width),
                           window=rasterio.windows.Window(columns.start, rows.start, width,
                                                          height))
            for number, name in enumerate(names, 1):
                file.set_band_description(number, name)
            if units:
                file.units = list(units)
            file.update_tags(**(tags or {}))
        shutil.copy(plain, part, driver='COG', COMPRESS='DEFLATE', LEVEL='1',
                    BIGTIFF='IF_SAFER', PREDICTOR=predictor, RESAMPLING=overviews,
                    SPARSE_OK='TRUE')


_ROUNDS = 3  # that find the point of the plane over a place; each gains two digits or more
_MOST_PIXELS = 40  # for each of the image; a narrow one that lies askew needs some
_PIXELS_AT_ONCE = 1 << 17  # pixels at a time


@dataclasses.dataclass(frozen=True, eq=False)
class MapPixels:
    """Square pixels of a map projection, row 0 in the north.

    Attributes
    ----------
    crs : pyproj.CRS
        The projection.
    affine : (2, 3) float64
        Takes ``(column, row, 1)`` of a pixel's middle to easting and northing.
    shape : (2,) int
        Rows and columns.
    """

    crs: object
    affine: np.ndarray
    shape: tuple[int, int]

    def points(self, grid: Any, datum: Datum, row: ArrayLike, column: ArrayLike) -> np.ndarray:
        """(..., 3) places on the surface of a grid that lie over pixels, imaging frame, metres."""
        index = np.stack([*np.broadcast_arrays(column, row), np.ones(np.shape(row))])
        east, north = np.tensordot(self.affine, index, 1)
        latitude, longitude = from_map(self.crs, east, north)
        height = np.full(np.shape(east), datum.height_m)
        for _ in range(_ROUNDS):
            points = datum.from_geographic(latitude, longitude, height)
            height = height + _surface(grid, points) - points[..., 2]
        return datum.from_geographic(latitude, longitude, height)


def covering_pixels(grid: Any, datum: Datum, crs: Any, spacing_m: float) -> MapPixels:
    """Pixels of a projection that cover an image.

    Their edges are multiples of the spacing, so that images beside each other share pixels.

    Raises
    ------
    ValueError
        The edge of the map runs through the image, or the map is stretched there.
    """
    rows, columns = grid.shape
    row, column = np.meshgrid(np.linspace(-0.5, rows - 0.5, 17),
                              np.linspace(-0.5, columns - 0.5, 17), indexing='ij')
    flat = getattr(grid, 'map_grid', grid)
    step = flat.steps_m
    edge = np.array(flat.origin_m) + row[..., None] * step[0] + column[..., None] * step[1]
    latitude, longitude, _ = datum.to_geographic(edge)
    east, north = to_map(crs, latitude, longitude)
    spacing = np.full(2, spacing_m)
    if crs.is_geographic:
        spacing = np.degrees(spacing_m / SEMI_MAJOR_M) / np.array(
            [np.cos(np.radians(latitude.mean())), 1.0])
    low = np.floor(np.array([east.min(), north.min()]) / spacing).astype(int)
    high = np.ceil(np.array([east.max(), north.max()]) / spacing).astype(int)
    affine = np.array([[spacing[0], 0.0, (low[0] + 0.5) * spacing[0]],
                       [0.0, -spacing[1], (high[1] - 0.5) * spacing[1]]])
    shape = (int(high[1] - low[1]), int(high[0] - low[0]))
    if math.prod(shape) > _MOST_PIXELS * (math.prod(grid.shape) + 1000):
        raise ValueError(f'in {crs.name} the image would need {shape[0]} by {shape[1]} pixels, '
                         f'here it has {grid.shape[0]} by {grid.shape[1]}: it lies on the edge '
                         'of this map, or far outside; choose another CRS')
    return MapPixels(crs, affine, shape)


def resample(image: Image, datum: Datum, acquisition: Acquisition,
             pixels: MapPixels) -> np.ndarray:
    """Samples of an image at the pixels of a map.

    Parameters
    ----------
    image : Image
        On a map, on terrain, or on a level plane; sampled at 1.25 times its bandwidth or more.
    datum : Datum
        Datum of its frame.
    acquisition : Acquisition
        Acquisition of its pulses.
    pixels : MapPixels
        Where samples are wanted.

    Returns
    -------
    (rows, columns) complex64
        With the carrier, as backprojection onto these pixels gives; 0 outside the image.
    """
    grid = image.grid
    baseband = np.empty(grid.shape, np.complex64)
    columns = np.arange(grid.shape[1])
    for first in range(0, grid.shape[0], max(1, _PIXELS_AT_ONCE // grid.shape[1])):
        rows = np.arange(first, min(first + max(1, _PIXELS_AT_ONCE // grid.shape[1]),
                                    grid.shape[0]))
        carrier = _carrier(acquisition, grid.positions(rows[:, None], columns))
        baseband[rows] = image.samples[rows] * carrier.conj()
    out = np.zeros(pixels.shape, np.complex64)
    for first in range(0, out.size, _PIXELS_AT_ONCE):
        last = min(first + _PIXELS_AT_ONCE, out.size)
        row, column = np.divmod(np.arange(first, last), out.shape[1])
        points = pixels.points(grid, datum, row, column)
        at = _index(grid, points)
        inside = ((at >= 0) & (at <= np.array(grid.shape) - 1)).all(axis=-1)
        values = interpolate_image(baseband, *at[inside].T)
        out[row[inside], column[inside]] = values * _carrier(acquisition, points[inside])
    return out


def _carrier(acquisition: Acquisition, points: np.ndarray) -> np.ndarray:
    """``exp(+j k_c D)`` of the middle of the aperture, complex128; 1 where a place is unknown."""
    middle = acquisition.n_pulses // 2
    path = sum(np.linalg.norm(points - centre[middle], axis=-1)
               for centre in (acquisition.tx_m, acquisition.rx_m))
    cycles = path / acquisition.radar.wavelength_m
    return np.exp(2j * np.pi * np.nan_to_num(cycles - np.round(cycles)))


def _index(grid: Any, points: np.ndarray) -> np.ndarray:
    """(..., 2) fractional row and column of places, found in the horizontal."""
    flat = getattr(grid, 'map_grid', grid)
    offset = points[..., :2] - np.array(flat.origin_m)[:2]
    return offset @ np.linalg.inv(flat.steps_m[:, :2])


def _surface(grid: EvenGrid, points: np.ndarray) -> np.ndarray:
    """Height z of the plane or of the terrain under places; of the nearest known edge outside."""
    if isinstance(grid, TerrainGrid):
        heights = np.nan_to_num(grid.height_m, nan=float(np.nanmean(grid.height_m)))
        at = np.moveaxis(_index(grid, points), -1, 0)
        return ndimage.map_coordinates(heights, at, order=1, mode='nearest')
    normal = np.cross(*grid.steps_m)
    offset = points - np.array(grid.origin_m)
    return grid.origin_m[2] - (offset[..., :2] @ normal[:2]) / normal[2]


COMPLEX, DECIBELS, QUICKLOOK = CONTENTS = 'complex', 'decibels', 'quicklook'
_LARGEST_RATIO = 1032  # of what DEFLATE compresses
_TAG, _RESAMPLED = 'SAR_IMAGING', 'RESAMPLED'


def write_geotiff(path: os.PathLike[str] | str, image: Image, datum: Datum, *,
                  content: str = DECIBELS, crs: Any = None,
                  acquisition: Acquisition | None = None, north_up: bool = False
                  ) -> Georeference:
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


def _placed(image: Image, datum: Datum, crs: Any, acquisition: Acquisition | None, north_up: bool
            ) -> tuple[Georeference, np.ndarray]:
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
    flat = flat_grid(image.grid)
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


def read_geotiff(path: os.PathLike[str] | str) -> ImageProduct:
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
