# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Formats that radar engineers exchange, and where on the Earth their images are.

- `sicd`: complex images with all that is known of their acquisition;
- `geotiff`: maps for geographic information systems, and complex images on them;
- `quicklook`: PNG with a world file, and an overlay for globes;
- `stac`: items of catalogues;
- `reference_map`: maps of places that images are looked for in;
- `pose_graph`: loop closures as g2o files;
- `points`: detections as GeoJSON and CSV, and point clouds as PLY;
- `report`: pictures, tables and warnings in one HTML file;
- `acquisition`: radar and track of an image, without its samples.

The libraries that read and write them are an extra, ``pip install sar_imaging[formats]``. They
load when a file is written or read, not before, and nothing else in the package needs them.
"""

from .acquisition import Acquisition, ImageProduct
from .extras import MissingExtraError, require
from .geotiff import read_geotiff, write_geotiff
from .points import write_ply, write_points
from .quicklook import write_quicklook
from .sicd import read_sicd, sicd_grid, write_sicd
from .stac import write_stac_item

__all__ = ['Acquisition', 'ImageProduct', 'MissingExtraError', 'read_geotiff', 'read_sicd',
           'require', 'sicd_grid', 'write_geotiff', 'write_ply', 'write_points',
           'write_quicklook', 'write_sicd', 'write_stac_item']
