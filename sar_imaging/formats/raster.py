"""Maps of numbers, such as coherence and height, to cloud-optimised GeoTIFF."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Mapping

import numpy as np

from ..geometry.earth import Datum
from .extras import require
from .georeference import TOLERANCE_M, Georeference, georeference


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
    rasterio = require('rasterio', 'writing GeoTIFF')
    shutil = require('rasterio.shutil', 'writing GeoTIFF')
    for name, values in bands.items():
        if np.shape(values) != grid.shape:
            raise ValueError(f'band {name!r} has the shape {np.shape(values)}, its grid '
                             f'{grid.shape}')
    place = georeference(grid, datum, crs)
    if place.error_m > TOLERANCE_M:
        raise ValueError(f'in {place.crs.name} pixels would lie up to {place.error_m:.3g} m from '
                         f'their places; {TOLERANCE_M} m are allowed: write smaller pieces')
    profile = dict(driver='GTiff', height=grid.shape[0], width=grid.shape[1], count=len(bands),
                   dtype='float32', crs=place.crs.to_wkt(), nodata=float('nan'),
                   transform=rasterio.transform.Affine(*place.corner_affine.ravel()))
    path = pathlib.Path(path)
    part = path.with_name(f'{path.name}.part')
    try:
        with rasterio.MemoryFile() as memory:
            with memory.open(**profile) as plain:
                for number, (name, values) in enumerate(bands.items(), 1):
                    plain.write(np.asarray(values, np.float32), number)
                    plain.set_band_description(number, name)
            with memory.open() as plain:
                shutil.copy(plain, part, driver='COG', COMPRESS='DEFLATE', PREDICTOR='YES',
                            BIGTIFF='IF_SAFER', RESAMPLING='NEAREST')
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return place
