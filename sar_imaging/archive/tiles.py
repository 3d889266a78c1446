# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Mean power of many aperture images, and coherence of two passes, tile by tile without a seam.

A pixel counts a look of an aperture where it lies within the aperture's footprint and its image
has a value. Sums are in float64 and in the order of the apertures, so that a tile has the same
bits whoever computes it.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..exploitation.passes import PairStatistics, coherence_part, pair_statistics
from ..exploitation.passes.coherence import Reader
from .images import StoredImage
from .job import Job
from .pieces import ArchiveDataError, PieceResult, TilePiece
from .scans import restored, write_text
from .storage import COHERENCE, MOSAIC, STRIPS, TiledArray, image_array
from .windows import Window, inside

POWER, LOOKS = 'power', 'looks'
_ROWS_AT_ONCE = 256


def looks_tile(piece: TilePiece, job: Job, output: Path) -> PieceResult:
    """Mean power and number of looks of a tile, of the apertures whose images are complete."""
    power, looks, missing = mean_power([name for name, _ in piece.images], piece.tile, job, output)
    told = {'spacing_m': job.spacing_m, **(
        {} if job.radiometry is None else {'quantity': job.radiometry.quantity})}
    arrays = stored_looks(output, piece.subject, piece.extent, job.tile)
    for array, values, empty in zip(arrays, (power, looks), (float('nan'), 0), strict=True):
        array.create(values.dtype, empty, attributes=told)
        array.write(piece.tile, values, array.extent)
    return PieceResult(found={
        'missing': missing, 'pixels': int(np.count_nonzero(looks)),
        'looks': int(looks.sum(dtype=np.int64))})


def stored_looks(output: Path, strip: str, extent: Window,
                 tile: int) -> tuple[TiledArray, TiledArray]:
    """Arrays of power and looks of a strip, or of the mosaic where it has no name."""
    folder = output / STRIPS / strip if strip else output / MOSAIC
    return TiledArray(folder / POWER, extent, tile), TiledArray(folder / LOOKS, extent, tile)


def mean_power(names: Sequence[str], tile: Window, job: Job,
               output: Path) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Mean power of the images of some apertures on some pixels.

    Returns
    -------
    power : (rows, columns) float32
        Mean of ``|f|^2``, the brightness that the job wants; NaN without a look.
    looks : (rows, columns) uint16
        Number of images in it.
    missing : list of str
        Apertures whose images are not complete there.
    """
    total, looks = np.zeros(tile.shape), np.zeros(tile.shape, np.uint16)
    missing = []
    for name in names:
        image = StoredImage.open(output, name)
        common = None if image is None else tile.intersection(image.window)
        if common is None or not image.complete(output, common):
            missing.append(name)
            continue
        samples = image_array(output, name, image.window, job.tile).read(common)
        for rows in common.strips(_ROWS_AT_ONCE):
            _add(total[rows.within(tile)], looks[rows.within(tile)],
                 samples[rows.within(common)], covered(
                     image.footprint_m, np.arange(rows.row0, rows.row1)[:, None],
                     np.arange(rows.column0, rows.column1), job.spacing_m))
    with np.errstate(invalid='ignore'):
        return (np.divide(total, looks, out=np.full(tile.shape, np.nan, np.float32),
                          where=looks > 0, casting='unsafe'), looks, missing)


def _add(total: np.ndarray, looks: np.ndarray, samples: np.ndarray, counted: np.ndarray) -> None:
    power = np.square(samples.real, dtype=np.float64)
    power += np.square(samples.imag, dtype=np.float64)
    counted &= power > 0
    total += np.where(counted, power, 0.0)
    looks += counted


def covered(footprint_m: ArrayLike, row: np.ndarray, column: np.ndarray, spacing_m: float
            ) -> np.ndarray:
    """Which pixels of the lattice lie within a footprint, to a thousandth of a pixel."""
    return inside(footprint_m, column * spacing_m, -row * spacing_m, 1e-3 * spacing_m)


VALUES, PHASE = 'coherence', 'phase_rad'
_PART = 1024  # rows and columns that are compared at a time


def coherence_tile(piece: TilePiece, job: Job, output: Path) -> PieceResult:
    """Coherence and phase of a tile of a pair, of pixels that both images have."""
    (first, one), (second, other) = piece.images
    common = one.intersection(other)
    arrays = stored_coherence(output, piece.subject, piece.extent, job.tile)
    told = {'spacing_m': job.spacing_m, 'first': first, 'second': second}
    read = _reader(piece, job, output, common)
    pair = _statistics(piece, job, output, common, read)
    values, phase = np.full((2, *piece.tile.shape), np.nan, np.float32)
    wanted = piece.tile.intersection(common)
    for part in [] if wanted is None else wanted.tiles(min(_PART, job.tile)):
        part = part.intersection(wanted)
        cut = part.within(piece.tile)
        values[cut], phase[cut] = coherence_part(read, pair, *part.within(common))
    for array, found in zip(arrays, (values, phase), strict=True):
        array.create(np.float32, float('nan'), attributes=told | {'looks': pair.looks})
        array.write(piece.tile, found, array.extent)
    known = values[np.isfinite(values)]
    return PieceResult(found={
        'pixels': int(known.size), 'looks': pair.looks,
        'median': float(np.median(known)) if known.size else None})


def stored_coherence(output: Path, pair: str, extent: Window,
                     tile: int) -> tuple[TiledArray, TiledArray]:
    """Arrays of coherence and phase of a pair."""
    folder = output / COHERENCE / pair
    return TiledArray(folder / VALUES, extent, tile), TiledArray(folder / PHASE, extent, tile)


def _reader(piece: TilePiece, job: Job, output: Path, common: Window) -> Reader:
    """Function that reads rows and columns of both images, counted from the common window."""
    arrays = []
    for name, _ in piece.images:
        image = StoredImage.open(output, name)
        if image is None or not image.complete(output, common):
            raise ArchiveDataError(f'{piece.subject}: the image of {name} is not complete')
        arrays.append(image_array(output, name, image.window, job.tile))

    def read(rows: slice, columns: slice) -> tuple[np.ndarray, np.ndarray]:
        window = Window(common.row0 + rows.start, common.row0 + rows.stop,
                        common.column0 + columns.start, common.column0 + columns.stop)
        one, other = (array.read(window) for array in arrays)
        return one, other

    return read


def _statistics(piece: TilePiece, job: Job, output: Path, common: Window,
                read: Reader) -> PairStatistics:
    """What tiles need of the whole pair: measured by the first of them, read by the others.

    Two that begin at once both measure, and find the same.
    """
    images = [StoredImage.open(output, name) for name, _ in piece.images]
    marks = [*piece.marks, job.digest(),
             *(list(part.as_tuple) for image in images for part in image.parts)]
    path = output / COHERENCE / piece.subject / 'pair.json'
    if path.exists():
        told = json.loads(path.read_text())
        if told['marks'] == marks:
            return restored(PairStatistics, told['pair'])
    pair = pair_statistics(read, common.shape, job.products.coherence_window,
                           part=min(_PART, job.tile))
    write_text(path, json.dumps({'marks': marks, 'pair': dataclasses.asdict(pair)}))
    return pair
