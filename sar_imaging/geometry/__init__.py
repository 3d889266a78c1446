# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses, phase centres and image grids: where the radar was and where the pixels are.

- `grids`, `polar`, `terrain`: pixels on a map, around an aperture, on the heights of the ground;
- `poses`, `alignment`: from the platform's odometry to phase centres;
- `earth`, `navigation`: where on the Earth the imaging frame stands, and satellite navigation;
- `half_paths`, `track`: what imagers need of phase centres;
- `illumination`, `antenna`: how brightly echoes light points, and what a data sheet tells of it.
"""

from .earth import Datum
from .grids import Grid, MapGrid, PlaneGrid, PointGrid, TerrainGrid, VolumeGrid
from .polar import PolarGrid

__all__ = ['Datum', 'Grid', 'MapGrid', 'PlaneGrid', 'PointGrid', 'PolarGrid', 'TerrainGrid',
           'VolumeGrid']
