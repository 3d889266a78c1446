"""What a worker does for each kind of piece."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from ..jobs import (
    CoherencePiece,
    ImagePiece,
    Job,
    MosaicPiece,
    Piece,
    PieceResult,
    ProductPiece,
    StripPiece,
    SumPiece,
    load_job,
)
from .aperture_images import form_image, sum_images
from .catalogue import write_catalogue
from .files import write_rasters, write_sicd_image
from .report import write_archive_report
from .tiles import coherence_tile, looks_tile


def _product(piece: ProductPiece, job: Job, output: Path) -> PieceResult:
    if piece.product == 'image sicd':
        return write_sicd_image(piece, job, output)
    if piece.product != 'catalogue':
        return write_rasters(piece, job, output)
    files = write_archive_report(output, job)
    told = write_catalogue(piece, job, output)
    return dataclasses.replace(told, files=(*files, *told.files))


_WORK: dict[type[Piece], Callable[[Piece, Job, Path], PieceResult]] = {
    ImagePiece: form_image, SumPiece: sum_images, StripPiece: looks_tile,
    MosaicPiece: looks_tile, CoherencePiece: coherence_tile, ProductPiece: _product}


def compute(piece: Piece, output: Path) -> PieceResult:
    """Compute a piece and write what it makes.

    Parameters
    ----------
    piece : Piece
        Of any kind but the scan.
    output : Path
        Folder of the job, with ``job.json`` and the scans.

    Returns
    -------
    PieceResult

    Raises
    ------
    ArchiveDataError
        The data are bad; trying again does not help.
    MemoryError
        The piece does not fit.
    OSError
        The disk is full, or something cannot be read.
    """
    return _WORK[type(piece)](piece, load_job(output), output)
