"""A job read, its recordings found and scanned, and the work divided into pieces.

- `job`: what is to be made, from a YAML file;
- `finding`: folders, globs, lists and STAC catalogues of recordings;
- `scanning`, `scans`: what a recording tells: its apertures, or why it is lost;
- `apertures`: how one image is divided, and what its pieces take;
- `division`, `plan`: all pieces of a job, and what they take together;
- `pieces`: what one task computes, and what it tells when it is done;
- `windows`: whole pixels of the map's lattice, and its tiles;
- `stored`: jobs and scans in the output folder.
"""

from .division import divide
from .finding import find_recordings, with_datum
from .job import IMAGE_FORMATS, SURFACES, Brightness, Job, JobError, Products, changed, read_job
from .pieces import (
    ArchiveDataError,
    CoherencePiece,
    ImagePiece,
    LooksPiece,
    MosaicPiece,
    Piece,
    PieceResult,
    ProductPiece,
    ScanPiece,
    StripPiece,
    SumPiece,
)
from .plan import ArchivePlan, ArchiveTooLargeError
from .scanning import scan_piece, scan_recording
from .scans import ApertureScan, Division, Loss, RecordingScan
from .stored import load_job, load_scan, load_scans, write_job, write_scan
from .windows import Window, union

__all__ = [
    'IMAGE_FORMATS', 'SURFACES', 'ApertureScan', 'ArchiveDataError', 'ArchivePlan',
    'ArchiveTooLargeError', 'Brightness', 'CoherencePiece', 'Division', 'ImagePiece', 'Job',
    'JobError', 'LooksPiece', 'Loss', 'MosaicPiece', 'Piece', 'PieceResult', 'ProductPiece',
    'Products', 'RecordingScan', 'ScanPiece', 'StripPiece', 'SumPiece', 'Window', 'changed',
    'divide', 'find_recordings', 'load_job', 'load_scan', 'load_scans', 'read_job', 'scan_piece',
    'scan_recording', 'union', 'with_datum', 'write_job', 'write_scan',
]
