"""How amplitudes of echoes are interpolated over image lines, and how well.

Computing an echo's amplitude at every pixel would take longer than backprojection. It is computed
at knots instead: along a line at both ends and in the middle of each segment, with a parabola
through them, and from line to line at every few lines, with a straight line between them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from ...geometry.half_paths import Paths
from ...geometry.illumination import Illumination
from ...signal.radar import RadarParameters
from ..error_budget import EXACT_SHARES, error_budget
from ..profiles.range_resampling import ECHOES_PER_PASS, RangeResampling

LINES = 32  # whose geometry is computed together; knots of every group begin anew
APART = (32, 16, 8, 4, 2, 1)  # lines between knots
_PAIRS = 4096  # of an echo and a pixel, at which amplitudes are looked at
_LIT_PAIRS = 1024  # enough for the error
_LEAST_LIT = 32  # with fewer the share is looked for among more pairs
MOST_PAIRS = 1 << 18
LEAST_DB = -160.0
_LEAST_SEGMENT = 8
_ROWS_FOR_TURNS = 256


@dataclasses.dataclass(frozen=True)
class LitLines:
    """Knots of amplitudes over lines.

    Attributes
    ----------
    apart : int
        Lines between knots, one of `APART`.
    share : float
        Of all pairs of an echo and a pixel, what is lit and computed.
    predicted_error_db : float
        Error of the image because amplitudes are interpolated, dB.
    """

    apart: int
    share: float
    predicted_error_db: float

    def n_bytes(self, n_lines: int, n_pixels: int, segment: int, n_layers: int = 1) -> int:
        """Memory of the knots' positions, in float64, and of a pass's amplitudes, in float32."""
        groups, segments, knots = (-(-n_lines // LINES), -(-n_pixels // segment),
                                   LINES // self.apart + 1)
        return groups * (knots * (2 * segments + 1) * (24 * n_layers + 4 * ECHOES_PER_PASS)
                         + segments * ECHOES_PER_PASS)


def knot_positions(locate: Callable, n_lines: int, n_pixels: int, segment: int, apart: int
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of the knots over some lines, and how lines lie between them.

    Parameters
    ----------
    locate : callable
        ``locate(pixel, line)`` gives positions (..., 3), metres, and their derivatives.
    n_lines, n_pixels, segment : int
        Size of the image, and pixels of a segment.
    apart : int
        Lines between knots.

    Returns
    -------
    positions : (3, G, 2 S + 1, K) float64
        Of G groups of `LINES` lines, at the ends and middles of S segments and at K lines, metres.
    knot, between : (G, LINES) int64, float32
        Knot before each line of a group, and the share of the next.
    """
    n_groups, half = -(-n_lines // LINES), segment // 2
    first = np.arange(n_groups)[:, None] * LINES
    # the last knot of a group lies on the first line of the next, or on the last one of all
    knots = np.minimum(first + np.arange(LINES // apart + 1) * apart, n_lines - 1)
    places = np.arange(2 * -(-n_pixels // segment) + 1) * half
    positions = locate(places[:, None], knots[:, None])[0]
    line = np.minimum(first + np.arange(LINES), n_lines - 1)
    knot = np.broadcast_to(np.arange(LINES) // apart, line.shape)
    before, after = (np.take_along_axis(knots, knot + i, axis=1) for i in (0, 1))
    between = np.where(after > before, (line - before) / np.maximum(after - before, 1), 0.0)
    return (np.ascontiguousarray(np.moveaxis(positions, -1, 0)), np.ascontiguousarray(knot),
            between.astype(np.float32))


def draw_pairs(illumination: Illumination, positions: Callable, shape: tuple[int, ...],
               most: int = MOST_PAIRS) -> tuple[np.ndarray, list[np.ndarray], float]:
    """Random pairs of an echo and a pixel that it lights, and the share of such pairs.

    Parameters
    ----------
    illumination : Illumination
        Of the echoes.
    positions : callable
        Positions (n, 3), metres, from arrays of numbers along each axis.
    shape : tuple of int
        Numbers along each axis.
    most : int
        Pairs after which no more are drawn.

    Returns
    -------
    echoes : (n,) int64
        Echoes; none where no pair was found.
    index : list of (n,) int64
        Pixels.
    share : float
    """
    rng, n, found, seen = np.random.default_rng(0), _PAIRS, [], 0
    while True:
        echoes = rng.integers(0, len(illumination.centre_m), n)
        index = [rng.integers(0, size, n) for size in shape]
        lit = np.flatnonzero(pair_amplitude(illumination, echoes, positions(*index)) > 0)
        found.append([a[lit] for a in (echoes, *index)])
        seen += n
        n_lit = sum(len(part[0]) for part in found)
        if n_lit >= _LEAST_LIT or seen >= most:
            echoes, *index = (np.concatenate(a)[:_LIT_PAIRS] for a in zip(*found, strict=True))
            return echoes, index, n_lit / seen
        n *= 4


def pair_amplitude(illumination: Illumination, echoes, points_m) -> np.ndarray:
    """(n, ...) amplitudes of echoes (n,), each at points (n, ..., 3), metres."""
    between = (slice(None), *[None] * (points_m.ndim - 2))
    return illumination.pattern.amplitude(points_m - illumination.centre_m[echoes][between],
                                          illumination.axes[echoes][between])


def plan_lit_lines(illumination: Illumination, locate: Callable, n_lines: int, n_pixels: int,
                   segment: int, half_turn_rad: float, wanted_db: float) -> LitLines:
    """Choose the fewest knots that meet an error, or the best there are.

    Parameters
    ----------
    illumination : Illumination
        Of the echoes.
    locate : callable
        ``locate(pixel, line)`` gives positions (..., 3), metres, and their derivatives.
    n_lines, n_pixels, segment : int
        Size of the image, and pixels of a segment.
    half_turn_rad : float
        Rms phase of an echo over half a segment, of what is expanded together with the amplitude.
    wanted_db : float
        Wanted error, dB.
    """
    def positions(line, pixel):
        return locate(pixel, line)[0]

    echoes, (line, pixel), share = draw_pairs(illumination, positions, (n_lines, n_pixels))
    if not len(echoes):
        return LitLines(APART[0], share, LEAST_DB)
    half, rng = max(segment // 2, 1), np.random.default_rng(1)
    # tiles of which a part is lit are computed whole
    wider = _share_of_tiles(illumination, positions, echoes, line, pixel, segment, share)
    for apart in APART:
        # pairs beside the lit ones, too: the pattern may end between two knots
        near = np.clip(line + rng.integers(-apart, apart + 1, len(echoes)), 0, n_lines - 1)
        along = np.clip(pixel + rng.integers(-half, half + 1, len(echoes)), 0, n_pixels - 1)
        first = near // apart * apart
        last = np.maximum(np.minimum(first + apart, n_lines - 1), first + 1)
        knot = (along // segment * segment)[:, None] + half * np.arange(3)
        ends = [pair_amplitude(illumination, echoes, positions(at[:, None], knot))
                for at in (first, last)]
        across = ((near - first) / (last - first))[:, None]
        values = ends[0] + across * (ends[1] - ends[0])
        f = (along - knot[:, 1]) / half
        slope, bend = 0.5 * (values[:, 2] - values[:, 0]), (
            0.5 * (values[:, 2] + values[:, 0]) - values[:, 1])
        true = pair_amplitude(illumination, echoes, positions(near, along))
        power = np.mean(true ** 2)
        wrong = np.mean((values[:, 1] + f * (slope + f * bend) - true) ** 2)
        # The product with the phasor's cubic is cut after the cubic, its quartic economised.
        turn = half_turn_rad
        wrong += (np.mean(slope ** 2) * (turn ** 3 / 6) ** 2
                  + np.mean(bend ** 2) * (turn ** 2 / 2) ** 2) / 128
        error_db = 10 * math.log10(wrong / max(power, 1e-300) + 10 ** (LEAST_DB / 10))
        if error_db <= wanted_db:
            break
    return LitLines(apart, wider, error_db)


def _share_of_tiles(illumination, positions, echoes, line, pixel, segment, share) -> float:
    """Share of the pairs in tiles of which a part is lit, from pairs that are."""
    along = 0.5 * np.array([-segment, segment])
    dark = [np.mean(pair_amplitude(illumination, echoes, positions(
        line + step * LINES / 2, pixel + shift)) == 0) for step in (-1, 1) for shift in along]
    # a pair half a tile off that is dark stands for one that is computed beyond the edge
    return min(1.0, share * (1 + float(np.mean(dark))))


def plan_lit_segments(illumination: Illumination, locate: Callable, size: tuple[int, int],
                      lattice: RangeResampling, paths: Paths, radar: RadarParameters,
                      target_db: float) -> tuple[RangeResampling | None, LitLines | None]:
    """Knots over lines, with shorter segments where amplitudes bend much; None where none do.

    Parameters
    ----------
    illumination, locate, size :
        Of the echoes, positions, and numbers of lines and pixels, see `plan_lit_lines`.
    lattice : RangeResampling
        For the lines without illumination.
    paths : Paths
        That it was planned for.
    radar : RadarParameters
        Of the profiles.
    target_db : float
        Of the whole image, dB.
    """
    wanted_db = error_budget(target_db, EXACT_SHARES)['illumination']
    wavenumber = radar.wavenumber_rad_per_m * lattice.spacing
    while True:
        turn = _half_turn(paths, wavenumber * lattice.segment / 2)
        lit = plan_lit_lines(illumination, locate, *size, lattice.segment, turn, wanted_db)
        if lit.predicted_error_db <= wanted_db:
            return lattice, lit
        if lattice.segment <= _LEAST_SEGMENT:
            return None, None
        lattice = dataclasses.replace(lattice, segment=lattice.segment // 2)


def _half_turn(paths: Paths, wavenumber: float) -> float:
    """Rms phase over half a segment by which echoes differ from the middle one of a pass."""
    slope, n = paths.derivatives[0], len(paths.length)
    some = np.linspace(0, n - 1, min(n, _ROWS_FOR_TURNS)).round().astype(int)
    beside = np.minimum(some + ECHOES_PER_PASS // 2, n - 1)
    difference = paths.of_lit(slope[some] - slope[beside], some)
    return float(wavenumber * np.sqrt(np.mean(difference ** 2))) if difference.size else 0.0
