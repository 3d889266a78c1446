"""What pieces compute on a worker, and what they write.

- `compute`: the work of each kind of piece;
- `aperture_images`, `surface`: images of apertures, and their error at some pixels;
- `tiles`: strips and mosaics, and coherence of pairs of passes;
- `files`: GeoTIFF and SICD for other programs;
- `catalogue`, `report`: where everything came from, and a picture;
- `provenance`: pixels of the mosaic against correlation from the recordings;
- `storage`: arrays on disk.
"""

from .compute import compute
from .provenance import PixelCheck, check_mosaic
from .report import write_archive_report

__all__ = ['PixelCheck', 'check_mosaic', 'compute', 'write_archive_report']
