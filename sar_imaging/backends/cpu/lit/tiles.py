"""Amplitudes of echoes at the knots of image lines, tile by tile: which tiles they light.

A tile is a segment of `planning.exact.lit_lines.LINES` lines. Most tiles are dark for most echoes
of a stripmap; they are told by the corners of larger blocks. The directions beyond one end of a
pattern, behind the antenna among them, form a convex cone: where all corners of a flat block lie
in the same cone, so does the block.
"""

from __future__ import annotations

import numpy as np

from ....compilation import njit, numba
from ..illumination import LitEchoes, two_way_amplitude

_BLOCK = 8  # segments that are looked at together
_AZIMUTH_ABOVE, _AZIMUTH_BELOW, _ELEVATION_ABOVE, _ELEVATION_BELOW, _BEHIND = 1, 2, 4, 8, 16


class LitTiles:
    """Amplitudes of some echoes over the tiles of a layer of lines.

    Parameters
    ----------
    echoes : LitEchoes
        All echoes that are added.
    positions : (3, G, 2 S + 1, K) float64
        Of the knots, see `planning.exact.lit_lines.knot_positions`.
    knot, between : (G, LINES) int64, float32
        Knot before each line of a group, and the share of the next.
    """

    def __init__(self, echoes: LitEchoes, positions, knot, between):
        self._echoes, self._positions = echoes, positions
        self._knot, self._between, self._ends = knot, between, _cones(echoes)

    def amplitudes(self, echoes: slice) -> tuple[np.ndarray, ...]:
        """What the compiled loop over the lines needs for some of the echoes.

        Returns
        -------
        lit : (R, G, S) uint8
            1 where an echo lights a part of a tile.
        any_lit : (G, S) uint8
            1 where one of them does.
        amplitude : (R, G, 2 S + 1, K) float32
            At the knots, of lit tiles alone.
        knot, between :
            As given.
        """
        numbers = np.arange(*echoes.indices(len(self._echoes.centre)))
        _, n_groups, n_places, n_knots = self._positions.shape
        lit = np.zeros((len(numbers), n_groups, n_places // 2), np.uint8)
        amplitude = np.empty((len(numbers), n_groups, n_places, n_knots), np.float32)
        _light_tiles(self._echoes, self._ends, self._positions, numbers, lit, amplitude)
        return lit, lit.any(axis=0).view(np.uint8), amplitude, self._knot, self._between


def _cones(echoes: LitEchoes) -> np.ndarray:
    """Ends of the pattern, none where the cone beyond it would not be convex."""
    ends = echoes.ends
    ends[0] = ends[0] if ends[0] >= 0 else 2.0
    ends[1] = ends[1] if ends[1] <= 0 else -2.0
    return ends


@njit(inline='always')
def dark_cones(lit, ends, echo, x, y, z):
    """In which of the cones beyond the ends of a pattern a position lies, bit by bit."""
    x, y, z = x - lit.centre[echo, 0], y - lit.centre[echo, 1], z - lit.centre[echo, 2]
    axes = lit.axes
    right = x * axes[echo, 0, 0] + y * axes[echo, 0, 1] + z * axes[echo, 0, 2]
    ahead = x * axes[echo, 1, 0] + y * axes[echo, 1, 1] + z * axes[echo, 1, 2]
    up = x * axes[echo, 2, 0] + y * axes[echo, 2, 1] + z * axes[echo, 2, 2]
    distance = np.sqrt(right * right + ahead * ahead + up * up)
    found = 0
    if right > ends[0] * distance:
        found |= _AZIMUTH_ABOVE
    if right < ends[1] * distance:
        found |= _AZIMUTH_BELOW
    if up * ends[2] - ahead * ends[3] > 0.0:
        found |= _ELEVATION_ABOVE
    if up * ends[4] - ahead * ends[5] < 0.0:
        found |= _ELEVATION_BELOW
    if ahead <= 0.0:
        found |= _BEHIND
    return found


@njit(parallel=True, error_model='numpy')
def _light_tiles(echoes, ends, positions, wanted, lit, amplitude):
    n_groups, n_places, n_knots = positions.shape[1:]
    n_segments = n_places // 2
    for group in numba.prange(n_groups):
        for number in range(len(wanted)):
            echo = wanted[number]
            for start in range(0, n_segments, _BLOCK):
                stop = min(start + _BLOCK, n_segments)
                dark = 31
                for p in range(2 * start, 2 * stop + 1, 2 * (stop - start)):
                    for k in range(0, n_knots, n_knots - 1):
                        dark &= dark_cones(echoes, ends, echo, positions[0, group, p, k],
                                           positions[1, group, p, k], positions[2, group, p, k])
                if dark != 0:
                    continue
                for p in range(2 * start, 2 * stop + 1):
                    for k in range(n_knots):
                        amplitude[number, group, p, k] = two_way_amplitude(
                            echoes, echo, positions[0, group, p, k], positions[1, group, p, k],
                            positions[2, group, p, k])
                for segment in range(start, stop):
                    brightest = np.float32(0.0)
                    for p in range(2 * segment, 2 * segment + 3):
                        for k in range(n_knots):
                            brightest = max(brightest, amplitude[number, group, p, k])
                    if brightest > 0.0:
                        lit[number, group, segment] = 1
