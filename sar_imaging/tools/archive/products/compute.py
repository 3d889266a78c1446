"""What a worker does for each kind of piece."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..jobs import (
    ImagePiece,
    Job,
    MosaicPiece,
    Piece,
    PieceResult,
    StripPiece,
    SumPiece,
    load_job,
)
from .aperture_images import form_image, sum_images
from .looks import looks_tile

_WORK: dict[type[Piece], Callable[[Piece, Job, Path], PieceResult]] = {
    ImagePiece: form_image, SumPiece: sum_images, StripPiece: looks_tile,
    MosaicPiece: looks_tile}


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
