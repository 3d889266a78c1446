"""Backprojection onto arbitrary points on the device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...planning.exact.points import ImagePoints, PointPlan
from .arrays import launch, xp
from .point_kernels import THREADS, add_points, bound_tiles
from .profiles import Profiles

_TOGETHER = 32  # echoes of a chunk of profiles come in multiples of this


class Points:
    """Pixels at any positions, prepared for adding any number of echoes.

    Parameters
    ----------
    plan : PointPlan
        How they are added.
    layers : sequence of ImagePoints
        Where the pixels are, one part of the image after the other.
    """

    def __init__(self, plan: PointPlan, layers: Sequence[ImagePoints]):
        self._plan, self._profiles = plan, Profiles(plan.window, plan.lattice, plan.range_m)
        self._tile = xp.asarray(np.array(plan.tile, np.int64))
        self._layers = [self._prepared(points) for points in layers]

    def _prepared(self, points: ImagePoints) -> tuple:
        """Coordinates, strides, size, tile and tiles of a layer, as the kernels take them."""
        (n_y, n_x), (height, width) = points.size, self._plan.tile
        tiles = xp.empty((-(-n_y // height) * -(-n_x // width), 4), np.float64)
        made = (*(xp.asarray(np.ascontiguousarray(c)) for c in points.coordinates),
                xp.asarray(points.strides.astype(np.int64)),
                xp.asarray(np.array(points.size, np.int64)), self._tile, tiles)
        launch(bound_tiles, -(-len(tiles) // THREADS), THREADS, *made)
        return made

    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, (K,) float32 array of the device; see `Lines.add`."""
        profiles, plan = self._profiles, self._plan
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        parts = image.reshape(len(self._layers), -1)
        own = THREADS // (plan.tile[0] * plan.tile[1])
        for rows in profiles.chunks(len(samples), _TOGETHER):
            planes = profiles.planes(samples[rows]).reshape(-1)
            for made, part in zip(self._layers, parts, strict=True):
                launch(add_points, -(-len(made[-1]) // own), THREADS, planes, profiles.n_cells,
                       centres[rows], *made, profiles.range_at(0), plan.lattice.step_m,
                       profiles.cycles_per_step, profiles.cycles_at(0), plan.reach_m, part)
