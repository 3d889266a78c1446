"""What workers run: scans of recordings, and the pieces of products."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .jobs import (
    MosaicPiece,
    Piece,
    PieceResult,
    ProductPiece,
    ScanPiece,
    StripPiece,
    load_job,
    scan_piece,
)
from .products.compute import compute as compute_product


def compute(piece: Piece, output: Path) -> PieceResult:
    """Compute a piece of any kind and write what it makes.

    Parameters
    ----------
    piece : Piece
        Of any kind.
    output : Path
        Folder of the job, with ``job.json``.

    Returns
    -------
    PieceResult

    Raises
    ------
    ArchiveDataError, MemoryError, OSError
        See `products.compute.compute`.
    """
    if isinstance(piece, ScanPiece):
        return scan_piece(piece, load_job(output), output)
    return compute_product(piece, output)


def may_lack(piece: Piece, lost: Sequence[str]) -> bool:
    """Whether a piece is computed without some of what it needs.

    Strips, mosaics and their files are made of what is there; the catalogue and the report tell
    what is not. An image, its files and a coherence need all their parts.
    """
    if isinstance(piece, ProductPiece):
        if piece.product == 'catalogue':
            return True
        return not piece.product.startswith('image ') and len(lost) < len(set(piece.needs))
    return isinstance(piece, StripPiece | MosaicPiece) and len(lost) < len(set(piece.needs))
