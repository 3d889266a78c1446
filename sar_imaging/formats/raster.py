"""Bands of numbers, such as coherence and height, to cloud-optimised GeoTIFF.

`write_raster` and `write_cog` take whole bands; `write_large_cog` takes a band larger than memory,
window by window.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

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
    write_cog(path, [np.asarray(values, np.float32) for values in bands.values()], place,
              names=tuple(bands), nodata=float('nan'))
    return place


def write_cog(path: os.PathLike | str, bands: Sequence[np.ndarray], place: Georeference, *,
              names: Sequence[str] = (), units: Sequence[str] = (), nodata: float | None = None,
              tags: Mapping[str, str] | None = None, overviews: str = 'NEAREST') -> None:
    """Write bands of one shape and type.

    Parameters
    ----------
    path : path
        File to write.
    bands : sequence of (rows, columns) array
        Of a type that GDAL knows.
    place : Georeference
        Projection and transform.
    names : sequence of str
        Of the bands.
    units : sequence of str
        Of the bands.
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
    (height, width), dtype = bands[0].shape, bands[0].dtype
    profile = dict(driver='GTiff', height=height, width=width, count=len(bands), dtype=dtype,
                   crs=place.crs.to_wkt(), nodata=nodata,
                   transform=rasterio.transform.Affine(*place.corner_affine.ravel()))
    path = pathlib.Path(path)
    part = path.with_name(f'{path.name}.part')
    try:
        with rasterio.MemoryFile() as memory:
            with memory.open(**profile) as plain:
                for number, band in enumerate(bands, 1):
                    plain.write(band, number)
                for number, name in enumerate(names, 1):
                    plain.set_band_description(number, name)
                if units:
                    plain.units = list(units)
                plain.update_tags(**(tags or {}))
            with memory.open() as plain:
                shutil.copy(plain, part, driver='COG', COMPRESS='DEFLATE', BIGTIFF='IF_SAFER',
                            PREDICTOR='NO' if np.iscomplexobj(bands[0]) else 'YES',
                            RESAMPLING=overviews)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_large_cog(path: os.PathLike | str, shape: tuple[int, int], dtype,
                    windows: Iterable[tuple[tuple[slice, slice], np.ndarray]],
                    place: Georeference, *, name: str = '', nodata: float | None = None,
                    tags: Mapping[str, str] | None = None, overviews: str = 'AVERAGE') -> None:
    """Write one band that comes window by window, in some 300 MB of memory whatever its size.

    Beside the file stands one without compression meanwhile, so that twice its size and more is
    needed on the disk.

    Parameters
    ----------
    path : path
        File to write, complete or absent; BigTIFF where it has to be.
    shape : (int, int)
        Rows and columns.
    dtype : dtype
        Of the values, which GDAL knows.
    windows : iterable of ((slice, slice), array)
        Rows and columns, and their values; pixels of no window hold `nodata`, or 0.
    place, nodata, tags, overviews :
        As in `write_cog`.
    name : str
        Of the band.

    Raises
    ------
    MissingExtraError
        rasterio is not installed.
    """
    rasterio = require('rasterio', 'writing GeoTIFF')
    shutil = require('rasterio.shutil', 'writing GeoTIFF')
    path = pathlib.Path(path)
    plain, part = (path.with_name(f'{path.name}.{end}') for end in ('plain.part', 'part'))
    dtype = np.dtype(dtype)
    profile = dict(driver='GTiff', height=shape[0], width=shape[1], count=1, dtype=dtype,
                   crs=place.crs.to_wkt(), nodata=nodata, tiled=True, blockxsize=_BLOCK,
                   blockysize=_BLOCK, BIGTIFF='YES', SPARSE_OK='TRUE',
                   transform=rasterio.transform.Affine(*place.corner_affine.ravel()))
    predictor = {'f': '3', 'u': '2', 'i': '2'}.get(dtype.kind, 'NO')
    try:
        with rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES, GDAL_NUM_THREADS='1'):
            with rasterio.open(plain, 'w', **profile) as file:
                for (rows, columns), values in windows:
                    file.write(np.asarray(values, dtype), 1, window=rasterio.windows.Window(
                        columns.start, rows.start, values.shape[1], values.shape[0]))
                file.set_band_description(1, name)
                file.update_tags(**(tags or {}))
            shutil.copy(plain, part, driver='COG', COMPRESS='DEFLATE', LEVEL='1',
                        BIGTIFF='IF_SAFER', PREDICTOR=predictor, RESAMPLING=overviews,
                        SPARSE_OK='TRUE')
        part.replace(path)
    finally:
        for file in (plain, part):
            file.unlink(missing_ok=True)
