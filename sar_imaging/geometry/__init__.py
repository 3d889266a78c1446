"""Poses, phase centres and image grids: where the radar was and where the pixels are.

- `grids`, `polar`, `terrain`: pixels on a map, around an aperture, on the heights of the ground;
- `poses`, `alignment`: from the platform's odometry to phase centres;
- `earth`, `navigation`: where on the Earth the imaging frame stands, and satellite navigation;
- `half_paths`, `straight_track`, `track_prediction`, `map_edges`: what imagers need of a track and
  a map.
"""

from .earth import Datum
from .even_grids import PlaneGrid, VolumeGrid
from .grids import Grid, MapGrid
from .point_grids import PointGrid, TerrainGrid
from .polar import PolarGrid

__all__ = ['Datum', 'Grid', 'MapGrid', 'PlaneGrid', 'PointGrid', 'PolarGrid', 'TerrainGrid',
           'VolumeGrid']
