# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""SICD, the format of complex radar images (NGA.STND.0024): written, read, and its grid.

- `grid`: planes whose rows lead away from the radar, on which images are formed;
- `writer`, `reader`: our images to files and back;
- `layout`, `track`, `metadata`: what a file tells, from the acquisition;
- `container`: the NITF file around its XML and its pixels.
"""

from .grid import sicd_grid
from .reader import read_sicd
from .writer import write_sicd

__all__ = ['read_sicd', 'sicd_grid', 'write_sicd']
