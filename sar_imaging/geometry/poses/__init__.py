# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a platform on their own clock: kept, judged, and interpolated.

- `table`: poses as a file or a recording holds them;
- `track`: poses in order, as they come, with their gaps, outliers and jumps, and between them;
- `motion`: whether a pose continues the motion of those before.
"""

from .motion import Departure
from .table import PoseTable
from .track import (
    Poses as Poses,
    PoseStatus as PoseStatus,
    PoseTrack,
    PoseVerdict as PoseVerdict,
)

__all__ = ['Departure', 'PoseTable', 'PoseTrack']
