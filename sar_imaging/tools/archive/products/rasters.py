"""Cloud-optimised GeoTIFF of images, strips, mosaics and coherence, in bounded memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import sar_imaging
from sar_imaging.formats.decibels import decibels
from sar_imaging.formats.georeference import Georeference, georeference
from sar_imaging.formats.raster import write_cog
from sar_imaging.formats.tags import told_of
from sar_imaging.radiometry import QUANTITIES

from ..jobs import ArchiveDataError, Job, PieceResult, ProductPiece, Window
from .aperture_images import StoredImage
from .coherence_tiles import stored_coherence
from .looks import stored_looks
from .storage import TiledArray, image_array
from .surface import lattice_grid

_LARGEST_MISS_PX = 0.25  # of a pixel's place by the affine transform
_NO_DATUM = ('no GeoTIFF: neither the job nor a recording tells where on the Earth the map is; '
             'give datum')


def write_rasters(piece: ProductPiece, job: Job, output: Path) -> PieceResult:
    """Write the GeoTIFF files of a product."""
    start = time.perf_counter()
    if job.datum is None:
        return PieceResult(piece.key, 0.0, warnings=(_NO_DATUM,))
    layers = _LAYERS[piece.product](piece, job, output)
    window = piece.scans[0].window if piece.product == 'image geotiff' else piece.extent
    place = place_of(window, job)
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
    return PieceResult(piece.key, time.perf_counter() - start, files=tuple(files),
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
             values: Callable[[np.ndarray], np.ndarray]) -> Iterator:
    """Tiles that were written, as parts of a window."""
    for tile in window.tiles(array.tile):
        part = tile.intersection(window)
        if array.has(tile):
            yield part.within(window), values(array.read(part))


def _image(piece: ProductPiece, job: Job, output: Path) -> list[tuple]:
    [scan] = piece.scans
    image = StoredImage.open(output, scan.name)
    if image is None or not image.complete(output, scan.window):
        raise ArchiveDataError(f'the image of {scan.name} is not complete')
    array = image_array(output, scan.name, scan.window, job.tile)
    quantity = 'amplitude' if job.radiometry is None else job.radiometry.quantity
    return [(f'images/{scan.name}.tif', array,
             {'dtype': np.float32, 'names': (f'{quantity}, dB',), 'nodata': float('nan'),
              'tags': told_of(scan.radiometry)}, decibels)]


def _looks(piece: ProductPiece, job: Job, output: Path) -> list[tuple]:
    power, looks = stored_looks(output, piece.subject, piece.extent.on_tiles(job.tile), job.tile)
    name = f'strips/{piece.subject}' if piece.subject else 'mosaic'
    quantity = 'power' if job.radiometry is None else job.radiometry.quantity
    tags = {} if job.radiometry is None else {
        'QUANTITY': quantity, 'QUANTITY_MEANING': QUANTITIES[quantity]}
    return [(f'{name}.tif', power, {'dtype': np.float32, 'names': (f'mean {quantity}',),
                                    'nodata': float('nan'), 'tags': tags}, np.asarray),
            (f'{name}_looks.tif', looks, {'dtype': np.uint16, 'names': ('looks',)}, np.asarray)]


def _coherence(piece: ProductPiece, job: Job, output: Path) -> list[tuple]:
    values, phase = stored_coherence(output, piece.subject, piece.extent.on_tiles(job.tile),
                                     job.tile)
    name = f'coherence/{piece.subject}'
    return [(f'{name}.tif', values, {'dtype': np.float32, 'names': ('coherence',),
                                     'nodata': float('nan')}, np.asarray),
            # phases of neighbours would cancel
            (f'{name}_phase.tif', phase, {'dtype': np.float32, 'names': ('phase, rad',),
                                          'nodata': float('nan'), 'overviews': 'NEAREST'},
             np.asarray)]


_LAYERS = {'image geotiff': _image, 'strip geotiff': _looks, 'mosaic geotiff': _looks,
           'coherence geotiff': _coherence}
