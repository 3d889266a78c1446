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
from ..profiles.range_resampling import ECHOES_PER_PASS
from .lit_lines import LEAST_DB, draw_pairs, pair_amplitude

# Time of a point and echo over that without illumination, by the points of a tile (measured)
_DEARER = {256: 1.1, 64: 1.3, 16: 2.8}
_PARABOLAS, _EACH = 0.1, 1.6  # more for parabolas, and for an amplitude at each point
_LEAST_TILE = 64  # points, below which those at each point take no longer


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
                    tiles, wanted_db: float) -> tuple[tuple[int, int], LitPoints]:
    """Choose the largest tile over which straight lines or parabolas meet an error.

    Where none does, amplitudes are found at each point, in the first tile. `positions` gives
    points (n, 3), metres, from rows and columns of the image; `tiles` are the rows and columns of
    those to choose from.
    """
    echoes, index, share = draw_pairs(illumination, positions, shape)
    dearer = _DEARER[math.prod(tiles[0])] + _EACH
    large = [tile for tile in tiles if math.prod(tile) >= _LEAST_TILE]
    for tile in large if len(echoes) else ():
        for order in (1, 2):
            degree = tuple(order * (side > 1) for side in tile)
            error_db, dark = _error_db(illumination, positions, shape, echoes, index, tile, degree)
            if error_db <= wanted_db:
                return tile, LitPoints(
                    degree, False, min(1.0, share * (1 + dark)),
                    _DEARER[math.prod(tile)] + _PARABOLAS * (order - 1), total_db(error_db))
    return tiles[0], LitPoints((0, 0), True, share, dearer, LEAST_DB)


def _error_db(illumination, positions, shape, echoes, index, tile, degree) -> tuple[float, float]:
    """Error of interpolated amplitudes, dB, and the share of dark corners of lit tiles."""
    rng = np.random.default_rng(1)
    weights, knots, near = [], [], []
    for i, side, size, order in zip(index, tile, shape, degree, strict=True):
        first = i // side * side
        last = np.minimum(first + side, size - 1)
        at = rng.integers(first, np.minimum(first + side, size))
        near.append(at)
        some = [first + (last - first) * part // max(order, 1) for part in range(order + 1)]
        weights.append(_lagrange(at, some))
        knots.append(some)
    true = pair_amplitude(illumination, echoes, positions(*near))
    found, dark = np.zeros(len(echoes)), []
    for row, v in zip(knots[0], weights[0], strict=True):
        for column, u in zip(knots[1], weights[1], strict=True):
            value = pair_amplitude(illumination, echoes, positions(row, column))
            found = found + v * u * value
            dark.append(value == 0)
    known = np.isfinite(found + true)
    power = np.mean(true[known] ** 2) if known.any() else 0.0
    if power == 0:
        return math.inf, 0.0
    wrong = np.mean((found - true)[known] ** 2) / power
    return 10 * math.log10(wrong + 10 ** (LEAST_DB / 10)), float(np.mean(dark))


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
