"""How amplitudes of echoes are interpolated over tiles of points, and how well.

They are computed at knots on the edges of the tiles, and for parabolas also in their middle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from ...geometry.illumination import Illumination
from ..error_budget import total_db
from ..lit_pairs import LitPairs
from ..profiles.range_resampling import ECHOES_PER_PASS

# Time of a point and echo over that without illumination, by the points of a tile (measured)
_DEARER = {256: 1.1, 64: 1.3, 16: 2.8}
_PARABOLAS, _EACH = 0.1, 1.6  # more for parabolas, and for an amplitude at each point
_LEAST_TILE = 64  # points, below which those at each point take no longer
# Rms error of the sines of angles in float32; 0.5e-8 to 2.3e-8 were measured
_ROUNDING, _STEP = 3e-8, 1e-3  # and step for derivatives, of a cut


@dataclasses.dataclass(frozen=True)
class LitPoints:
    """How amplitudes are found at points.

    Attributes
    ----------
    degree : (int, int)
        Of the interpolation along the rows and columns of a tile; 0 along an axis of one point.
    each : bool
        At each point by itself instead.
    share : float
        Of all pairs of an echo and a point, what is lit and computed.
    dearer : float
        Time of such a pair over that of a pair without illumination.
    predicted_error_db : float
        Error of the image because amplitudes are interpolated, dB.
    """

    degree: tuple[int, int]
    each: bool
    share: float
    dearer: float
    predicted_error_db: float

    def n_bytes(self, shape: tuple[int, int], tile: tuple[int, int]) -> int:
        """Memory of the knots' positions, in float64, and of a pass's amplitudes, in float32."""
        return math.prod(len(knot_numbers(*sizes)) for sizes in zip(
            shape, tile, self.degree, strict=True)) * (24 + 4 * ECHOES_PER_PASS)


def knot_numbers(size: int, side: int, degree: int) -> np.ndarray:
    """(K,) int64 numbers of the points of an axis that are knots of its tiles.

    A tile's last knot is the first point of the next tile, or the last of all.
    """
    if degree == 0:
        return np.zeros(1, np.int64)
    first = np.arange(0, size, side)
    last = np.minimum(first + side, size - 1)
    knots = [first + (last - first) * part // degree for part in range(degree)]
    return np.append(np.stack(knots, axis=1).ravel(), size - 1)


def plan_lit_points(illumination: Illumination, positions: Callable, shape: tuple[int, int],
                    tiles, wanted_db: float) -> tuple[tuple[int, int], LitPoints, LitPairs]:
    """Choose the largest tile over which straight lines or parabolas meet an error.

    Where none does, amplitudes are found at each point, in the first tile. Returned are also the
    pairs of an echo and a point that tell the error. `positions` gives points (n, 3), metres, from
    rows and columns of the image; `tiles` are the rows and columns of those to choose from.
    """
    pairs = draw_points(illumination, positions, shape, tiles[0])
    dearer = _DEARER[math.prod(tiles[0])] + _EACH
    rounded_db = _rounded_db(pairs)
    large = [tile for tile in tiles if math.prod(tile) >= _LEAST_TILE]
    for tile in large if len(pairs) else ():
        for order in (1, 2):
            degree = tuple(order * (side > 1) for side in tile)
            error_db, dark = tile_error_db(pairs, positions, shape, tile, degree)
            if error_db <= wanted_db:
                return tile, LitPoints(
                    degree, False, min(1.0, pairs.share * (1 + dark)),
                    _DEARER[math.prod(tile)] + _PARABOLAS * (order - 1),
                    total_db(error_db, rounded_db)), pairs
    return tiles[0], LitPoints((0, 0), True, pairs.share, dearer, rounded_db), pairs


def draw_points(illumination: Illumination, positions: Callable, shape: tuple[int, int],
                tile: tuple[int, int]) -> LitPairs:
    """Pairs of an echo and a point in tiles that may be lit; positions as of `plan_lit_points`."""
    def clipped(*index):
        return positions(*(np.clip(i, 0, size - 1).astype(np.int64)
                           for i, size in zip(index, shape, strict=True)))

    return LitPairs.draw(illumination, clipped, shape, tile, flat=False)


def tile_error_db(pairs: LitPairs, positions: Callable, shape: tuple[int, int],
                  tile: tuple[int, int], degree: tuple[int, int]) -> tuple[float, float]:
    """Error of interpolated amplitudes, dB, and the share of dark corners of lit tiles."""
    weights, knots = [], []
    for at, side, size, order in zip(pairs.index, tile, shape, degree, strict=True):
        first = at // side * side
        last = np.minimum(first + side, size - 1)
        some = [first + (last - first) * part // max(order, 1) for part in range(order + 1)]
        weights.append(_lagrange(at, some))
        knots.append(some)
    found, dark, lit = np.zeros(len(pairs)), [], pairs.amplitude > 0
    for row, v in zip(knots[0], weights[0], strict=True):
        for column, u in zip(knots[1], weights[1], strict=True):
            value = pairs.amplitude_at(positions(row, column))
            found = found + v * u * value
            dark.append(value[lit] == 0)
    return (pairs.error_db((found - pairs.amplitude) ** 2),
            float(np.mean(dark)) if lit.any() else 0.0)


def _rounded_db(pairs: LitPairs) -> float:
    """Error because angles off boresight are computed in float32, dB."""
    squares, lit = np.zeros(len(pairs)), pairs.illumination
    distance = np.linalg.norm(pairs.points_m - lit.centre_m[pairs.echoes], axis=1)
    for axis, cut in ((0, lit.pattern.azimuth), (2, lit.pattern.elevation)):
        step = _STEP * cut.step * (len(cut.amplitude) - 1)
        moved = (step * distance)[:, None] * lit.axes[pairs.echoes, axis]
        ahead, behind = (pairs.amplitude_at(pairs.points_m + m) for m in (moved, -moved))
        squares += (_ROUNDING * (ahead - behind) / (2 * step)) ** 2
    return pairs.error_db(squares)


def _lagrange(at, knots) -> list[np.ndarray]:
    """Weights of values at one to three knots, as the compiled loops have them."""
    if len(knots) == 1:
        return [np.ones(len(at))]
    length = np.maximum(knots[-1] - knots[0], 1)
    t = (at - knots[0]) / length
    if len(knots) == 2:
        return [1 - t, t]
    m = (knots[1] - knots[0]) / length
    bent = knots[1] > knots[0]  # three points at least
    m = np.where(bent, m, 0.5)
    first, second = t / m, t * (t - m) / (1 - m)
    # w0 + (w1 - w0) t / m + (w2 - w1) (t (t - m)) / (1 - m) - (w1 - w0) t (t - m) / m
    weights = (1 - first + t * (t - m) / m, first - second - t * (t - m) / m, second)
    return [np.where(bent, w, straight)
            for w, straight in zip(weights, (1 - t, 0 * t, t), strict=True)]
