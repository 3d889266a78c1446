"""Satellite navigation: the datum of a frame from fixes, and poses of platforms without odometry.

A `Fix` says where on the Earth an antenna was. `DatumSearch` compares fixes with places in the
imaging frame, `FixPoses` brings them into it.
"""

from .datum_search import DatumSearch, FoundDatum, datum_through
from .fix_poses import FixPoses, FramePose
from .fixes import Fix

__all__ = ['DatumSearch', 'Fix', 'FixPoses', 'FoundDatum', 'FramePose', 'datum_through']
