# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images as items of a SpatioTemporal Asset Catalog (STAC 1.1, extensions sar and projection)."""

from __future__ import annotations

import json
import os
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..files import replacing
from ..geometry.earth import Datum
from ..geometry.track import main_axis, side_of
from ..imaging.image import Image
from ..signal.radar import RadarParameters
from .acquisition import UNKNOWN, Acquisition, date_of
from .extras import require
from .georeference import flat_grid
from .quicklook import image_corners
from .sicd.grid import sicd_axes, support

SAR = 'https://stac-extensions.github.io/sar/v1.3.0/schema.json'
PROJECTION = 'https://stac-extensions.github.io/projection/v2.0.0/schema.json'

# Lower and upper edge, GHz (README of the sar extension)
_BANDS = {'P': (0.25, 0.5), 'L': (1, 2), 'S': (2, 4), 'C': (4, 8), 'X': (8, 12.5),
          'Ku': (12.5, 18), 'K': (18, 26.5), 'Ka': (26.5, 40)}
_POLARISATIONS = ('HH', 'VV', 'HV', 'VH')
_ZARR = 'application/vnd+zarr'
_MEDIA = {'.tif': 'image/tiff; application=geotiff; profile=cloud-optimized',
          '.png': 'image/png', '.kml': 'application/vnd.google-earth.kml+xml',
          '.nitf': 'application/vnd.nitf', '.ntf': 'application/vnd.nitf',
          '.json': 'application/json', '.html': 'text/html'}
_ROLES = {'.png': ['overview'], '.kml': ['overview'], '.json': ['metadata'],
          '.html': ['metadata']}


def write_stac_item(path: os.PathLike[str] | str, image: Image, datum: Datum,
                    acquisition: Acquisition,
                    assets: Mapping[str, os.PathLike[str] | str], *, name: str = '') -> Any:
    """Write the STAC item of an image and its files, for catalogues.

    Parameters
    ----------
    path : path
        File to write, such as ``image.json``.
    image : Image
        On a map, on terrain or on a plane.
    datum : Datum
        Place of the imaging frame on the Earth.
    acquisition : Acquisition
        Pulses of the image.
    assets : mapping of str to path
        Files of the image by a key of each, such as ``{'complex': 'image.nitf'}``; they exist.
    name : str
        Identifier of the item; the name of the file unless told.

    Returns
    -------
    pystac.Item
        The item, as it was written.

    Raises
    ------
    ValueError
        There is no file of the image, or it lies on no map and no plane, or on an upright one.
    FileNotFoundError
        One of them does not exist.
    MissingExtraError
        pystac is not installed.

    Examples
    --------
    >>> from sar_imaging import MapGrid, plan_image
    >>> from sar_imaging.formats import Acquisition, write_geotiff, write_stac_item
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.recordings import read_blocks
    >>> block, datum = next(read_blocks('bags/spotlight')), Datum(47.0, 8.0, 450.0)
    >>> image = plan_image(MapGrid((0.0, 0.0, 0.0), 32, 32, 0.5), block.radar, block.n_samples,
    ...                    compressed=False)(block)
    >>> _ = write_geotiff('map.tif', image, datum)
    >>> item = write_stac_item('image.json', image, datum, Acquisition.of(block),
    ...                        {'map': 'map.tif'})
    >>> item.id, item.properties['sar:frequency_band'], list(item.assets)
    ('image', 'X', ['map'])
    """
    pystac = require('pystac', 'writing a STAC item')
    path = pathlib.Path(path).absolute()
    if not assets:
        raise ValueError('assets is empty; expected at least one file of the image')
    times = [date_of(acquisition.stamp_ns[i]) for i in (0, acquisition.n_pulses // 2, -1)]
    geometry, bbox = footprint(image_corners(image.grid, datum))
    item = pystac.Item(
        id=name or path.stem, geometry=geometry, bbox=bbox, datetime=times[1],
        start_datetime=times[0], end_datetime=times[2],
        properties=_properties(image, acquisition), stac_extensions=[SAR])
    for key, file in assets.items():
        file = pathlib.Path(file).absolute()
        if not file.is_file():
            raise FileNotFoundError(f'{file} of asset {key!r} does not exist; write it first')
        add_asset(item, key, file, path.parent)
    with replacing(path) as part:
        part.write_text(json.dumps(item.to_dict(include_self_link=False), indent=1) + '\n')
    return item


def add_asset(item: Any, key: str, file: pathlib.Path, folder: pathlib.Path) -> None:
    """Add a file, or a folder of Zarr, to an item that lies in a folder."""
    pystac = require('pystac', 'writing a STAC item')
    suffix = file.suffix.lower()
    extra = projection(file) if suffix == '.tif' else {}
    if extra and PROJECTION not in item.stac_extensions:
        item.stac_extensions.append(PROJECTION)
    item.add_asset(key, pystac.Asset(
        os.path.relpath(file, folder), media_type=_ZARR if file.is_dir() else _MEDIA.get(suffix),
        roles=_ROLES.get(suffix, ['data']), extra_fields=extra))


def radar_properties(radar: RadarParameters) -> dict[str, Any]:
    """What is known of the radar, in words of the sar extension."""
    found = {'sar:instrument_mode': 'spotlight', 'sar:product_type': 'SLC',
             'sar:center_frequency': radar.carrier_hz / 1e9,
             'sar:bandwidth': radar.bandwidth_hz / 1e9}
    for band, (low, high) in _BANDS.items():
        if low <= radar.carrier_hz / 1e9 < high:
            found['sar:frequency_band'] = band
    return found


def _properties(image: Image, acquisition: Acquisition) -> dict[str, Any]:
    """What is known of radar and image, in words of the sar extension."""
    grid = flat_grid(image.grid)
    middle = np.asarray(grid.positions(grid.shape[0] // 2, grid.shape[1] // 2))
    axes = sicd_axes(acquisition, middle, 'ground')
    resolution = [support(acquisition, middle, axis).width_m for axis in axes]
    steps = grid.steps_m  # those nearest to range and to azimuth
    along = np.abs(steps @ axes[0])
    spacing = np.linalg.norm(steps, axis=1)[np.argsort(-along)]
    found = {'platform': acquisition.collector.lower(), **radar_properties(acquisition.radar),
             'sar:resolution_range': resolution[0], 'sar:resolution_azimuth': resolution[1],
             'sar:pixel_spacing_range': float(spacing[0]),
             'sar:pixel_spacing_azimuth': float(spacing[1]),
             'sar:looks_range': 1, 'sar:looks_azimuth': 1,
             'sar:observation_direction': _side(acquisition, middle)}
    polarisation = acquisition.polarisation.replace(':', '')
    if polarisation in _POLARISATIONS:
        found['sar:polarizations'] = [polarisation]
    if acquisition.collector == UNKNOWN:
        del found['platform']
    return found


def _side(acquisition: Acquisition, middle: np.ndarray) -> str:
    """Whether the radar looks to the left of its flight or to the right."""
    track = acquisition.centre_m[:, :2]
    ahead = main_axis(track)[0][0]
    ahead = ahead * np.copysign(1.0, (track[-1] - track[0]) @ ahead)
    return 'left' if side_of(ahead, middle[:2] - track.mean(axis=0)) > 0 else 'right'


def projection(path: pathlib.Path) -> dict[str, Any]:
    """Projection, transform and size of a GeoTIFF, in words of the projection extension."""
    rasterio = require('rasterio', 'reading GeoTIFF')
    with rasterio.open(path) as file:
        crs, code = file.crs, file.crs.to_epsg()
        found = {'proj:shape': [file.height, file.width],
                 'proj:transform': list(file.transform)[:6]}
    if code is not None:
        return {'proj:code': f'EPSG:{code}', **found}
    pyproj = require('pyproj', 'a map projection')
    return {'proj:code': None, 'proj:wkt2': pyproj.CRS(crs.to_wkt()).to_wkt(), **found}


def footprint(corners: np.ndarray) -> tuple[dict[str, Any], list[float]]:
    """Geometry and bounding box of a counter-clockwise or clockwise quadrangle.

    One that crosses the date line is cut there, and its box has the larger longitude first
    (RFC 7946, sections 3.1.9 and 5.2).
    """
    latitude, longitude = corners.T
    turned = longitude[0] + (longitude - longitude[0] + 180) % 360 - 180
    ring = np.column_stack([turned, latitude])
    x, y = ring.T
    if x @ np.roll(y, -1) - y @ np.roll(x, -1) < 0:  # clockwise
        ring = ring[::-1]
    wrapped = (ring[:, 0] + 180) % 360 - 180
    box = [float(part) for part in (ring[:, 0].min(), latitude.min(), ring[:, 0].max(),
                                    latitude.max())]
    line = 180.0 if box[2] > 180 else -180.0
    if -180 <= box[0] and box[2] <= 180:
        return {'type': 'Polygon', 'coordinates': [_closed(ring)]}, box
    if np.ptp(wrapped) < 180:  # all of it beyond the line
        return footprint(np.column_stack([latitude, wrapped]))
    beyond, short = _cut(ring, line, 1), _cut(ring, line, -1)
    beyond[:, 0] -= 360 if line > 0 else 0
    short[:, 0] += 360 if line < 0 else 0
    box[0], box[2] = float(short[:, 0].min()), float(beyond[:, 0].max())
    return {'type': 'MultiPolygon', 'coordinates': [[_closed(short)], [_closed(beyond)]]}, box


def _closed(ring: np.ndarray) -> list[list[float]]:
    return [*ring.tolist(), ring[0].tolist()]


def _cut(ring: np.ndarray, line: float, side: int) -> np.ndarray:
    """The part of a convex ring at longitudes beyond a line (+1), or short of it (-1)."""
    out = []
    for one, two in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if side * (one[0] - line) >= 0:
            out.append(one)
        if (one[0] - line) * (two[0] - line) < 0:
            share = (line - one[0]) / (two[0] - one[0])
            out.append(one + share * (two - one))
    return np.array(out)
