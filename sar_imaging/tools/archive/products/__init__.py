"""What pieces compute on a worker, and what they write.

- `compute`: the work of each kind of piece;
- `aperture_images`, `pulses`, `surface`: images of apertures, and their error at some pixels;
- `looks`: strips and mosaics;
- `storage`: arrays on disk.
"""

from .compute import compute

__all__ = ['compute']
