"""A job read, its recordings found and scanned, and the work divided into pieces.

- `job`, `reading`: what is to be made, from a YAML file;
- `windows`: whole pixels of the map's lattice, and its tiles;
- `scans`: what a recording tells: its apertures, or why it is lost;
- `pieces`: what one task computes, and what it tells when it is done;
- `stored`: jobs and scans in the output folder.
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
from .reading import changed, read_job
from .scans import ApertureScan, Division, Loss
from .stored import load_job, load_scans, write_job, write_scans
from .windows import Window, union

__all__ = [
    'IMAGE_FORMATS', 'SURFACES', 'ApertureScan', 'ArchiveDataError', 'CoherencePiece', 'Division',
    'ImagePiece', 'Job', 'JobError', 'Loss', 'MosaicPiece', 'Piece', 'PieceResult',
    'ProductPiece', 'Products', 'ScanPiece', 'StripPiece', 'SumPiece', 'Window', 'changed',
    'load_job', 'load_scans', 'read_job', 'union', 'write_job', 'write_scans',
]
