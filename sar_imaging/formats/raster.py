"""Bands of numbers, such as coherence and height, to cloud-optimised GeoTIFF.

`write_cog` takes whole bands, or window by window what is larger than memory.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np

from ..files import replacing
from ..geometry.earth import Datum
from .extras import require
from .georeference import TOLERANCE_M, Georeference, georeference

_CACHE_BYTES = 1 << 27  # of GDAL's blocks, for bands larger than memory
_BLOCK = 512  # sides of the file's tiles, pixels


def write_raster(path: os.PathLike | str, bands: Mapping[str, np.ndarray], grid, datum: Datum, *,
                 crs=None) -> Georeference:
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


def write_cog(path: os.PathLike | str, values, place: Georeference, *,
              shape: tuple[int, int] | None = None, dtype=None, names: Sequence[str] = ('',),
              units: Sequence[str] = (), nodata: float | None = None,
              tags: Mapping[str, str] | None = None, overviews: str = 'NEAREST') -> None:
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
        Of the values of windows, which GDAL knows.
    names, units : sequence of str
        Of the bands, whose number the names tell.
    nodata : float, optional
        Value that stands for nothing.
    tags : mapping of str to str, optional
        Metadata of the file.
    overviews : str
        How GDAL makes the smaller images, such as ``'AVERAGE'``.

    Raises
    ------
    MissingExtraError
        rasterio is not installed.
    """
    rasterio = require('rasterio', 'writing GeoTIFF')
    shutil = require('rasterio.shutil', 'writing GeoTIFF')
    if isinstance(values, np.ndarray):
        shape, dtype = values.shape[-2:], values.dtype
        values = [((slice(0, shape[0]), slice(0, shape[1])), values)]
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
