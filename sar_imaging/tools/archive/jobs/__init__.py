"""A job read, its recordings found and scanned, and the work divided into pieces.

- `job`: what is to be made, from a YAML file;
- `windows`: whole pixels of the map's lattice, and its tiles;
- `scans`: what a recording tells: its apertures, or why it is lost;
- `pieces`: what one task computes, and what it tells when it is done.
"""

from .job import IMAGE_FORMATS, SURFACES, Job, JobError, Products
from .pieces import (
    ArchiveDataError,
    CoherencePiece,
    ImagePiece,
    MosaicPiece,
    Piece,
    PieceResult,
    ProductPiece,
    ScanPiece,
    StripPiece,
    SumPiece,
)
from .scans import ApertureScan, Division, Loss
from .windows import Window, union

__all__ = [
    'IMAGE_FORMATS', 'SURFACES', 'ApertureScan', 'ArchiveDataError', 'CoherencePiece', 'Division',
    'ImagePiece', 'Job', 'JobError', 'Loss', 'MosaicPiece', 'Piece', 'PieceResult',
    'ProductPiece', 'Products', 'ScanPiece', 'StripPiece', 'SumPiece', 'Window', 'union',
]
