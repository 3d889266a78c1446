"""Coherence of two passes over the same pixels, tile by tile without a seam."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path

import numpy as np

from sar_imaging.exploitation.passes import (
    PairStatistics,
    PhasePlane,
    coherence_part,
    pair_statistics,
)

from ..jobs import ArchiveDataError, CoherencePiece, Job, PieceResult, Window
from ..jobs.stored import write_text
from .aperture_images import StoredImage
from .storage import COHERENCE, TiledArray, image_array

VALUES, PHASE = 'coherence', 'phase_rad'
_PART = 1024  # rows and columns that are compared at a time


def coherence_tile(piece: CoherencePiece, job: Job, output: Path) -> PieceResult:
    """Coherence and phase of a tile of a pair, of pixels that both images have."""
    start = time.perf_counter()
    common = piece.first.window.intersection(piece.second.window)
    if common is None:
        raise ArchiveDataError(f'{piece.pair}: the images have no pixel in common')
    arrays = stored_coherence(output, piece.pair, piece.extent, job.tile)
    told = {'spacing_m': job.spacing_m, 'first': piece.first.name, 'second': piece.second.name}
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
    return PieceResult(piece.key, time.perf_counter() - start, found={
        'pixels': int(known.size), 'looks': pair.looks,
        'median': float(np.median(known)) if known.size else None})


def stored_coherence(output: Path, pair: str, extent: Window,
                     tile: int) -> tuple[TiledArray, TiledArray]:
    """Arrays of coherence and phase of a pair."""
    folder = output / COHERENCE / pair
    return TiledArray(folder / VALUES, extent, tile), TiledArray(folder / PHASE, extent, tile)


def _reader(piece: CoherencePiece, job: Job, output: Path, common: Window):
    """Function that reads rows and columns of both images, counted from the common window."""
    arrays = []
    for scan in (piece.first, piece.second):
        image = StoredImage.open(output, scan.name)
        if image is None or not image.complete(output, common):
            raise ArchiveDataError(f'{piece.pair}: the image of {scan.name} is not complete')
        arrays.append(image_array(output, scan.name, image.window, job.tile))

    def read(rows: slice, columns: slice):
        window = Window(common.row0 + rows.start, common.row0 + rows.stop,
                        common.column0 + columns.start, common.column0 + columns.stop)
        return tuple(array.read(window) for array in arrays)

    return read


def _statistics(piece: CoherencePiece, job: Job, output: Path, common: Window,
                read) -> PairStatistics:
    """What tiles need of the whole pair: measured by the first of them, read by the others.

    Two that begin at once both measure, and find the same.
    """
    images = [StoredImage.open(output, scan.name) for scan in (piece.first, piece.second)]
    marks = [piece.first.fingerprint, piece.second.fingerprint, job.digest(),
             *(list(part.as_tuple) for image in images for part in image.parts)]
    path = output / COHERENCE / piece.pair / 'pair.json'
    if path.exists():
        told = json.loads(path.read_text())
        if told['marks'] == marks:
            return PairStatistics(**told['pair'] | {
                'shape': tuple(told['pair']['shape']),
                'plane': PhasePlane(**told['pair']['plane'] | {'slope_rad_per_px': tuple(
                    told['pair']['plane']['slope_rad_per_px'])})})
    pair = pair_statistics(read, common.shape, job.products.coherence_window,
                           part=min(_PART, job.tile))
    write_text(path, json.dumps({'marks': marks, 'pair': dataclasses.asdict(pair)}))
    return pair
