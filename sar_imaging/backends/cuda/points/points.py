"""Pixels at any positions to which range profiles are added: their geometry on the device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....geometry.illumination import Illumination
from ....planning.exact.illumination import knot_numbers
from ....planning.exact.points import ImagePoints, PointPlan
from ..arrays import launch, pairs, xp
from ..illumination import Antennas
from ..profiles import Profiles
from ..tiles import rows_of_points
from ..transfers import in_pieces
from .kernels import BLOCK, THREADS, add_lit_points, add_points, bound_tiles

_TOGETHER = 32  # echoes of a chunk of profiles come in multiples of this


class Points:
    """Pixels at any positions, prepared for adding any number of echoes.

    Parameters
    ----------
    plan : PointPlan
        How they are added.
    layers : sequence of ImagePoints
        Where the pixels are, one part of the image after the other.
    rows : slice, optional
        Rows of the layers, if not all; from the first of a tile on.
    """

    def __init__(self, plan: PointPlan, layers: Sequence[ImagePoints], rows: slice | None = None):
        self._plan, self._profiles = plan, Profiles(plan.window, plan.lattice, plan.range_m)
        self._tile = xp.asarray(np.array(plan.tile, np.int64))
        rows = rows or slice(0, layers[0].size[0])
        self._knots = [plan.lit and _Knots(points, rows, plan) for points in layers]
        self._layers = [self._prepared(rows_of_points(points, rows)) for points in layers]

    def _prepared(self, points: ImagePoints) -> tuple:
        """Coordinates, strides, size, tile and tiles of a layer, as the kernels take them."""
        (n_y, n_x), (height, width) = points.size, self._plan.tile
        tiles = xp.empty((-(-n_y // height) * -(-n_x // width), 4), np.float64)
        made = (*(xp.asarray(np.ascontiguousarray(c)) for c in points.coordinates),
                xp.asarray(points.strides.astype(np.int64)),
                xp.asarray(np.array(points.size, np.int64)), self._tile, tiles)
        launch(bound_tiles, -(-len(tiles) // THREADS), THREADS, *made)
        return made

    def add(self, samples, tx_m, rx_m, image, illumination: Illumination | None = None) -> None:
        """Add echoes to an image, (K,) float32 array of the device; see `Lines.add`."""
        profiles, plan = self._profiles, self._plan
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        parts = image.reshape(len(self._layers), -1)
        own = BLOCK // (plan.tile[0] * plan.tile[1])
        antennas = illumination and Antennas(illumination)
        n_bytes = max(0 if knots is None else knots.echo_bytes for knots in self._knots)
        for echoes, some in in_pieces(samples, profiles.chunks(len(samples), _TOGETHER, n_bytes)):
            planes = pairs(profiles.planes(some))
            for made, part, knots in zip(self._layers, parts, self._knots, strict=True):
                blocks = -(-len(made[-1]) // own)
                given = (planes, profiles.n_cells, centres[echoes], *made, profiles.range_at(0),
                         plan.lattice.step_m, profiles.cycles_per_step, profiles.cycles_at(0),
                         plan.reach_m, part)
                if knots is None:
                    launch(add_points, blocks, THREADS, *given)
                else:
                    launch(add_lit_points, blocks, THREADS, *given,
                           *knots.lit_by(antennas, echoes))


class _Knots:
    """Where amplitudes of echoes are found over some rows of a layer of points.

    Attributes
    ----------
    echo_bytes : int
        Memory that the amplitudes of an echo take.
    """

    def __init__(self, points: ImagePoints, rows: slice, plan: PointPlan):
        (n_y, n_x), (height, _), (degree, _) = points.size, plan.tile, plan.lit.degree
        down, across = (knot_numbers(*sizes) for sizes in zip(points.size, plan.tile,
                                                              plan.lit.degree, strict=True))
        down = down[rows.start // height * degree:-(-rows.stop // height) * degree + 1]
        if plan.lit.each:
            down = down[:0]  # none is read
        positions = points.positions(down[:, None], across).reshape(-1, 3)
        self._positions = xp.asarray(np.ascontiguousarray(positions.T))
        self._how = xp.asarray(np.array([*plan.lit.degree, len(across), plan.lit.each,
                                         n_y - rows.start, n_x], np.int64))
        self.echo_bytes = 4 * len(positions)

    def lit_by(self, antennas: Antennas, echoes: slice) -> tuple:
        """The last arguments of `add_lit_points`."""
        return (antennas.at_knots(self._positions, echoes), self._how, antennas.axes[echoes],
                antennas.table.astype(np.float32), antennas.place.astype(np.float32),
                antennas.ends)
