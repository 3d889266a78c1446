# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a platform as a file or a recording holds them."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from .track import Poses, PoseTrack


@dataclasses.dataclass(frozen=True, eq=False)
class PoseTable:
    """Poses of a platform, as they were measured.

    It stands for a `PoseTrack` with the usual limits wherever one is asked for, as by `locate`.

    Parameters
    ----------
    stamp_ns : (N,) int64
        Times on the poses' clock, nanoseconds.
    position_m : (N, 3) float64
        Metres, in the frame `frame_id`, z up.
    quaternion : (N, 4) float64
        x, y, z, w: turns body vectors into the frame of the positions.
    frame_id, child_frame_id : str
        Frame of the positions and name of the body.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry.poses import PoseTable
    >>> ms = 1_000_000
    >>> poses = PoseTable(np.arange(20) * 50 * ms, np.zeros((20, 3)),
    ...                   np.tile([0.0, 0.0, 0.0, 1.0], (20, 1)))
    >>> poses.select(poses.stamp_ns > 850 * ms).stamp_ns.tolist()
    [900000000, 950000000]
    >>> poses.sample(np.array([25 * ms])).position_m.tolist()
    [[0.0, 0.0, 0.0]]
    """

    stamp_ns: np.ndarray
    position_m: np.ndarray
    quaternion: np.ndarray
    frame_id: str = 'map'
    child_frame_id: str = 'base_link'

    def select(self, index: np.ndarray) -> PoseTable:
        """Some of the poses."""
        return dataclasses.replace(self, stamp_ns=self.stamp_ns[index],
                                   position_m=self.position_m[index],
                                   quaternion=self.quaternion[index])

    def track(self, **limits: Any) -> PoseTrack:
        """The track of all these poses; limits as of `PoseTrack`."""
        track = PoseTrack(**limits, capacity=max(len(self.stamp_ns), 1))
        for pose in zip(self.stamp_ns.tolist(), self.position_m.tolist(),
                        self.quaternion.tolist(), strict=True):
            track.add(*pose)
        track.finish()
        return track

    @functools.cached_property
    def _usual(self) -> PoseTrack:
        return self.track()

    def sample(self, stamp_ns: np.ndarray, *, final: bool = False) -> Poses:
        """As `PoseTrack.sample`."""
        return self._usual.sample(stamp_ns, final=final)

    def between(self, first_ns: int, last_ns: int
                ) -> tuple[np.ndarray, np.ndarray, Rotation, np.ndarray]:
        """As `PoseTrack.between`."""
        return self._usual.between(first_ns, last_ns)
