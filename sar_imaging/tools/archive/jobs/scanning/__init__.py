"""Recordings scanned: their apertures, what of the map these see, and how bright they make it.

- `recording`: the scan of a recording;
- `footprint`: what of the map an aperture tells something about;
- `brightness`: what samples of its image are multiplied by.
"""

from .footprint import OutOfSightError, footprint, moved
from .recording import scan_piece, scan_recording

__all__ = ['OutOfSightError', 'footprint', 'moved', 'scan_piece', 'scan_recording']
