# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images, strips, mosaics and coherence as cloud-optimised GeoTIFF, and images as SICD.

GeoTIFF is written in bounded memory. SICD wants a grid of its own: its images are formed anew.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import sar_imaging

from ..compilation import one_thread
from ..formats import Acquisition, sicd_grid, write_sicd
from ..formats.georeference import Georeference, georeference
from ..formats.geotiff import write_cog
from ..formats.quicklook import decibels
from ..formats.sicd.grid import sicd_axes
from ..formats.tags import told_of
from ..geometry.earth import Datum
from ..geometry.grids import PlaneGrid
from ..geometry.illumination import Pointing
from ..imaging.image import Image
from ..imaging.imager import plan_image
from ..imaging.methods import EXACT
from ..planning.costs import DEFAULT, using
from ..radiometry import QUANTITIES, BrightnessScale, KnotResponse
from ..recordings.pulse_source import (
    PulseSource as Source,
    acquisition_with_antenna,
    open_pulses,
    pointing_of,
)
from .division import BLOCK_SHARE, SICD_BYTES, room_bytes
from .images import StoredImage
from .job import Job
from .pieces import ArchiveDataError, PieceResult, ProductPiece
from .scans import ApertureScan
from .storage import TiledArray, image_array
from .tiles import stored_coherence, stored_looks
from .windows import Window, lattice_grid

# Name of a file, its array, options of `write_cog`, and what its values are
_Layer = tuple[str, TiledArray, dict[str, Any], Callable[[np.ndarray], np.ndarray]]
_LARGEST_MISS_PX = 0.25  # of a pixel's place by the affine transform


def write_rasters(piece: ProductPiece, job: Job, output: Path) -> PieceResult:
    """Write the GeoTIFF files of a product."""
    layers = _LAYERS[piece.product](piece, job, output)
    window, place = piece.extent, place_of(piece.extent, job)
    files = []
    for name, array, options, values in layers:
        path = output / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_cog(path, _windows(array, window, values), place, shape=window.shape, tags={
            'SAR_IMAGING_VERSION': sar_imaging.__version__,
            'PLACE_ERROR_M': f'{place.error_m:.2g}',
            'SPACING_M': f'{job.spacing_m:g}'} | options.pop('tags', {}),
            **{'overviews': 'AVERAGE', **options})
        files.append(name)
    return PieceResult(files=tuple(files),
                       found={'place_error_m': place.error_m, 'crs': place.crs.name})


def place_of(window: Window, job: Job) -> Georeference:
    """Projection and affine transform of a window of the map.

    Raises
    ------
    ArchiveDataError
        Pixels would lie more than a quarter of their spacing from where the transform puts them.
    """
    place = georeference(lattice_grid(window, job), job.datum, job.crs)
    if place.error_m > _LARGEST_MISS_PX * job.spacing_m:
        raise ArchiveDataError(
            f'{window.shape[1]} by {window.shape[0]} pixels of {job.spacing_m:g} m would lie up '
            f'to {place.error_m:.3g} m from their places in {place.crs.name}; '
            f'{_LARGEST_MISS_PX * job.spacing_m:.3g} m are allowed: divide the map by area_m, '
            'or leave out crs; the Zarr arrays are complete')
    return place


def _windows(array: TiledArray, window: Window,
             values: Callable[[np.ndarray], np.ndarray]
             ) -> Iterator[tuple[tuple[slice, slice], np.ndarray]]:
    """Tiles that were written, as parts of a window."""
    for tile in window.tiles(array.tile):
        part = tile.intersection(window)
        if array.has(tile):
            yield part.within(window), values(array.read(part))


def _raster_image(piece: ProductPiece, job: Job, output: Path) -> list[_Layer]:
    scan = piece.scan
    image = StoredImage.open(output, scan.name)
    if image is None or not image.complete(output, scan.window):
        raise ArchiveDataError(f'the image of {scan.name} is not complete')
    array = image_array(output, scan.name, scan.window, job.tile)
    quantity = 'amplitude' if job.radiometry is None else job.radiometry.quantity
    return [(f'images/{scan.name}.tif', array,
             {'dtype': np.float32, 'names': (f'{quantity}, dB',), 'nodata': float('nan'),
              'tags': told_of(scan.radiometry)}, decibels)]


def _looks(piece: ProductPiece, job: Job, output: Path) -> list[_Layer]:
    power, looks = stored_looks(output, piece.subject, piece.extent.on_tiles(job.tile), job.tile)
    name = f'strips/{piece.subject}' if piece.subject else 'mosaic'
    quantity = 'power' if job.radiometry is None else job.radiometry.quantity
    tags = {} if job.radiometry is None else {
        'QUANTITY': quantity, 'QUANTITY_MEANING': QUANTITIES[quantity]}
    return [(f'{name}.tif', power, {'dtype': np.float32, 'names': (f'mean {quantity}',),
                                    'nodata': float('nan'), 'tags': tags}, np.asarray),
            (f'{name}_looks.tif', looks, {'dtype': np.uint16, 'names': ('looks',)}, np.asarray)]


def _coherence(piece: ProductPiece, job: Job, output: Path) -> list[_Layer]:
    values, phase = stored_coherence(output, piece.subject, piece.extent.on_tiles(job.tile),
                                     job.tile)
    name = f'coherence/{piece.subject}'
    return [(f'{name}.tif', values, {'dtype': np.float32, 'names': ('coherence',),
                                     'nodata': float('nan')}, np.asarray),
            # phases of neighbours would cancel
            (f'{name}_phase.tif', phase, {'dtype': np.float32, 'names': ('phase, rad',),
                                          'nodata': float('nan'), 'overviews': 'NEAREST'},
             np.asarray)]


_LAYERS = {'image geotiff': _raster_image, 'strip geotiff': _looks, 'mosaic geotiff': _looks,
           'coherence geotiff': _coherence}


_ROWS_AT_ONCE = 64  # that are scaled


def write_sicd_image(piece: ProductPiece, job: Job, output: Path) -> PieceResult:
    """Form the image of an aperture on SICD's grid on the ground, and write it."""
    scan = piece.scan
    datum = scan.datum or job.datum
    source = open_pulses(scan.path, aperture=scan.aperture, datum=scan.datum)
    looks = pointing_of(source)
    acquisition = acquisition_with_antenna(source, looks)
    grid = _grid(scan, job, acquisition, datum)
    room = room_bytes(job)
    if SICD_BYTES * np.prod(grid.shape) > room:
        raise ArchiveDataError(
            f'SICD of {scan.name} has {grid.shape[1]} by {grid.shape[0]} pixels, which take '
            f'{SICD_BYTES * np.prod(grid.shape) / 1e9:.2g} GB; a worker has {room / 1e9:.2g} GB '
            'for it: allow more memory, or leave sicd out of products: images')
    with using(DEFAULT), one_thread():
        image = _image(source, grid, job.target_db, BLOCK_SHARE * room)
    image, factors = _calibrated(image, source, looks, job)
    path = output / 'images' / f'{scan.name}.nitf'
    path.parent.mkdir(parents=True, exist_ok=True)
    write_sicd(path, image, datum, acquisition,
               classification=source.collection.classification, **factors)
    return PieceResult(predicted_error_db=image.report.predicted_error_db,
                       warnings=image.report.warnings, files=(f'images/{scan.name}.nitf',))


def _image(source: Source, grid: PlaneGrid, target_db: float, n_bytes: float) -> Image:
    imager = plan_image(grid, *source.of_profiles(), method=EXACT, target_db=target_db,
                        illumination=source.illumination)
    image = imager.new_image()
    for block in source.profiles(n_bytes):
        imager.accumulate(block, image)
    return image


def _calibrated(image: Image, source: Source, looks: Pointing | None, job: Job
                ) -> tuple[Image, dict[str, object]]:
    """The image as the brightness that the job wants, and what SICD's scale factors need."""
    wanted = job.radiometry
    if wanted is None:
        return image, {}
    response = KnotResponse.of(
        image.grid, source.radar, source.tx_m, source.rx_m, pattern=source.illumination,
        pointing=looks, weighting=wanted.window if source.compressed else 'none')
    scale = BrightnessScale.of(response, wanted.constant, wanted.quantity)
    for first in range(0, len(image.samples), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        image.samples[rows] *= scale.factors(rows)
    return (dataclasses.replace(image, radiometry=scale.radiometry),
            {'response': response, 'constant': wanted.constant})


def _grid(scan: ApertureScan, job: Job, acquisition: Acquisition, datum: Datum | None
          ) -> PlaneGrid:
    """SICD's grid around the footprint, in the frame of the recording."""
    corners = np.array([(*corner, job.height_m) for corner in scan.footprint_m])
    if job.datum is not None and datum != job.datum:
        corners = datum.from_ecef(job.datum.to_ecef(corners))
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    for _ in range(2):  # the directions of the axes depend on the middle, a little
        axes = np.array(sicd_axes(acquisition, middle, 'ground'))
        along = (corners - middle) @ axes.T
        middle = middle + 0.5 * (along.min(axis=0) + along.max(axis=0)) @ axes
    return sicd_grid(acquisition, middle, *np.ptp(along, axis=0))
