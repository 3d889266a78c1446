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

from ...geometry.illumination import Illumination
from ...signal.radar import RadarParameters
from ..error_budget import EXACT_SHARES, error_budget, total_db
from ..interpolators import LINE_DEGREE, design_interpolator
from ..lit_pairs import LEAST_DB, LitPairs
from ..profiles.range_gate import RangeGate
from ..profiles.range_resampling import (
    DRIFT_SLACK,
    ECHOES_PER_PASS,
    MOST_DRIFT,
    RangeResampling,
)
from .grid_lines import GridLines
from .lit_phasors import Echoes, ImageLines, SegmentPhasors

LINES = 32  # whose geometry is computed together; knots of every group begin anew
APART = (32, 16, 8, 4, 2, 1)  # lines between knots
_LEAST_SEGMENT = 8


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


def plan_lit_lines(illumination: Illumination, lines: GridLines, tx_m, rx_m,
                   radar: RadarParameters, window: RangeGate, lattice: RangeResampling,
                   target_db: float
                   ) -> tuple[RangeResampling | None, LitLines | None, dict[str, float]]:
    """As `plan_lit_segments`, for lines of a grid itself, and errors by cause, dB.

    Phase centres (R, 3) in metres; `lattice` reads the profiles, of which `window` is needed, for
    the lines without illumination.
    """
    lattice, lit, pairs = plan_lit_segments(
        illumination, ImageLines.of_grid(lines), Echoes(tx_m, rx_m, (0,), radar), lattice,
        target_db, error_budget(target_db, EXACT_SHARES)['illumination'])
    return lattice, lit, {} if lattice is None else {
        'ends of profiles': pairs.ends_db(window, lattice.oversampling(radar), tx_m, rx_m),
        'illumination': lit.predicted_error_db}


def plan_lit_segments(illumination: Illumination, lines: ImageLines, echoes: Echoes,
                      lattice: RangeResampling, profiles_db: float, lit_db: float
                      ) -> tuple[RangeResampling | None, LitLines | None, LitPairs]:
    """Knots over lines, with shorter segments where phasors or amplitudes bend much.

    Parameters
    ----------
    illumination : Illumination
        Of the echoes.
    lines, echoes :
        Of the image, and what is added to it.
    lattice : RangeResampling
        For the lines without illumination.
    profiles_db, lit_db : float
        Wanted errors of reading the profiles, and of the amplitudes, dB.

    Returns
    -------
    lattice : RangeResampling or None
        With the error of what is lit; None where no segments are short enough.
    lit : LitLines or None
        Likewise.
    pairs : LitPairs
        Of which the errors were told.
    """
    pairs = LitPairs.draw(illumination, lines.positions, (lines.n_lines, lines.n_pixels),
                          (LINES, max(lattice.segment // 2, 1)), flat=lines.flat)
    if not len(pairs):
        return lattice, LitLines(APART[0], pairs.share, LEAST_DB), pairs
    while True:
        phasors = SegmentPhasors(pairs, lines, echoes, lattice)
        fitted = _fitted(lattice, phasors, pairs, echoes.radar)
        lit = _fewest_knots(pairs, lines, phasors, lattice.segment, lit_db)
        if (fitted is not None and fitted.predicted_error_db <= profiles_db
                and lit.predicted_error_db <= lit_db):
            return fitted, lit, pairs
        if lattice.segment <= _LEAST_SEGMENT:
            return None, None, pairs
        lattice = dataclasses.replace(lattice, segment=lattice.segment // 2)


def _fitted(lattice, phasors, pairs, radar) -> RangeResampling | None:
    """A lattice with the error of the pairs; None where pixels drift too far for its segments."""
    furthest = float(phasors.drift.max())
    if furthest > MOST_DRIFT:
        return None
    if furthest > lattice.interpolator.margin + DRIFT_SLACK:
        lattice = dataclasses.replace(lattice, interpolator=design_interpolator(
            lattice.oversampling(radar), furthest, degree=LINE_DEGREE))
    read = lattice.interpolator.error_with_drift(phasors.drift) * pairs.amplitude ** 2
    return dataclasses.replace(lattice, predicted_error_db=total_db(
        pairs.error_db(read + phasors.squares)))


def _fewest_knots(pairs, lines, phasors, segment: int, wanted_db: float) -> LitLines:
    """Lines between knots that meet an error, or the best there are."""
    line, pixel = pairs.index
    half = max(segment // 2, 1)
    knot = (pixel // segment * segment)[:, None] + half * np.arange(3)
    expansion = pairs.error(phasors.squares)
    for apart in APART:
        first = line // apart * apart
        last = np.minimum(first + apart, lines.n_lines - 1)
        ends = [pairs.amplitude_at(lines.positions(at[:, None], knot)) for at in (first, last)]
        across = ((line - first) / np.maximum(last - first, 1))[:, None]
        values = ends[0] + across * (ends[1] - ends[0])
        error = pairs.error(phasors.lit_squares(values)) - expansion
        error_db = 10 * math.log10(max(error, 0.0) + 10 ** (LEAST_DB / 10))
        if error_db <= wanted_db:
            break
    return LitLines(apart, _share_of_tiles(pairs, lines, segment), error_db)


def _share_of_tiles(pairs: LitPairs, lines: ImageLines, segment: int) -> float:
    """Share of the pairs in tiles of which a part is lit, from pairs that are."""
    lit, along = pairs.amplitude > 0, 0.5 * np.array([-segment, segment])
    line, pixel = pairs.index
    dark = [np.mean(pairs.amplitude_at(lines.positions(
        line + step * LINES / 2, pixel + shift))[lit] == 0) for step in (-1, 1) for shift in along]
    # a pair half a tile off that is dark stands for one that is computed beyond the edge
    return min(1.0, pairs.share * (1 + float(np.mean(dark)))) if lit.any() else 0.0
