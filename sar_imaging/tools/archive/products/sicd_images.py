"""Images of apertures as SICD, formed anew on the grid that SICD wants."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np

from sar_imaging.formats import Acquisition, sicd_grid, write_sicd
from sar_imaging.formats.sicd.grid import sicd_axes
from sar_imaging.geometry.grids import PlaneGrid
from sar_imaging.geometry.illumination import Pointing
from sar_imaging.imaging.image import Image
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import EXACT
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.radiometry import BrightnessScale, KnotResponse

from ...products.antenna import lit_acquisition, pointing_of
from ...products.sources import Source, open_source
from ..jobs import ApertureScan, ArchiveDataError, Job, PieceResult, ProductPiece
from ..jobs.division import SICD_BYTES
from ..jobs.prediction import BLOCK_SHARE, room_bytes
from .aperture_images import one_thread

_ROWS_AT_ONCE = 64  # that are scaled


def write_sicd_image(piece: ProductPiece, job: Job, output: Path) -> PieceResult:
    """Form the image of an aperture on SICD's grid on the ground, and write it."""
    start = time.perf_counter()
    [scan] = piece.scans
    datum = scan.datum or job.datum
    if datum is None:
        return PieceResult(piece.key, 0.0, warnings=(
            'no SICD: neither the job nor the recording tells where on the Earth it is; give '
            'datum',))
    source = open_source(scan.path, aperture=scan.aperture, datum=scan.datum)
    looks = pointing_of(source)
    acquisition = lit_acquisition(source, looks)
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
    return PieceResult(piece.key, time.perf_counter() - start,
                       predicted_error_db=image.report.predicted_error_db,
                       warnings=image.report.warnings, files=(f'images/{scan.name}.nitf',))


def _image(source: Source, grid: PlaneGrid, target_db: float, n_bytes: float):
    compressor = source.compressor()
    radar, n = ((source.radar, source.n_samples) if compressor is None
                else (compressor.output_radar, compressor.n_output))
    imager = plan_image(grid, radar, n, method=EXACT, target_db=target_db,
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


def _grid(scan: ApertureScan, job: Job, acquisition: Acquisition, datum) -> PlaneGrid:
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
