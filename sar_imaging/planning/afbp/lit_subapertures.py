"""Amplitudes of a sub-aperture's pulses: a parabola of the place along the track, pixel by pixel.

Beams sum the pulses of a sub-aperture before a pixel is known, so that its pulses cannot be
weighed one by one. But the pulse at the place u along the track has the frequency ``-k u`` from
beam to beam. With an amplitude ``w(u) = A + B u + C u^2``, A, B and C by pixel, the weighted sum
is that of the image, its first and its second derivative along direction, which the interpolation
between beams yields. The parabola goes through the amplitudes of three pulses.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np

from ...geometry.illumination import AntennaPattern, Illumination
from ...geometry.polar import PolarGrid
from ...geometry.track_frame import mean_centres
from ...signal.pulses import PulseBlock
from ...signal.radar import RadarParameters
from ..echo_power import echo_power
from ..error_budget import AFBP_SHARES, error_budget
from ..exact.lit_lines import LitLines, plan_lit_segments
from ..exact.lit_phasors import Echoes, ImageLines
from ..lit_pairs import MOST_PAIRS, LitPairs, bounded_ratio, pair_amplitude
from ..profiles.range_resampling import RangeResampling
from .beams import BeamSampling
from .sampling import cut_pulses, pieces_between_gaps

NODES = tuple(0.5 + 0.5 * x for x in (-math.sqrt(0.6), 0.0, math.sqrt(0.6)))  # of Gauss' rule
NODES_APART = 0.1  # of their span, at least, that nodes lie apart along the track
KNOTS_APART = (16, 8, 4, 2, 1)  # segments along range
_KNOT_SHARE, _LEAST = 0.2, 1e-16  # of the error of amplitudes for knots along range
_PAIRS = 1 << 14  # at which a sub-aperture is looked at while pulses arrive
_LOOKED_AT = 33, 9  # directions and ranges, to tell which sub-apertures see the grid


@dataclasses.dataclass(frozen=True, eq=False)
class LitSubapertures:
    """How the images of a plan's sub-apertures are weighed.

    Attributes
    ----------
    illumination : Illumination
        Of the echoes of the aperture.
    seen : frozenset of int
        Sub-apertures that light a part of the grid; the others add nothing.
    apart : int
        Segments between knots along range, of images from beams.
    lines : LitLines or None
        Of images to which pulses are added directly.
    power : float
        Mean square of the amplitude over all pulses and pixels.
    predicted_error_db : float
        Error of the image by it, dB.
    """

    illumination: Illumination
    seen: frozenset[int]
    apart: int
    lines: LitLines | None
    power: float
    predicted_error_db: float

    def n_bytes(self, coarse: PolarGrid, segment: int) -> int:
        """Memory that amplitudes take, with so many ranges of `coarse` to a segment, bytes."""
        if self.lines is not None:
            return self.illumination.n_bytes + self.lines.n_bytes(*coarse.shape, segment)
        # of each knot three coordinates in float64, and three coefficients in float32
        return self.illumination.n_bytes + coarse.n_alpha * 36 * (
            -(-coarse.n_range // (self.apart * segment)) + 1)

    def of_subaperture(self, polar: PolarGrid, radar: RadarParameters, tx_m, rx_m,
                       illumination: Illumination) -> tuple[float, float]:
        """Power of a sub-aperture's echoes and error of their amplitudes.

        Both are relative to the power of the echoes that were planned for; arguments are as of
        `LitError`.
        """
        found = LitError(polar, radar, tx_m, rx_m, illumination, _PAIRS)
        wrong = found.share * found.mean_square([slice(0, len(tx_m))])
        return tuple(v / max(self.power, _LEAST) for v in (found.power, wrong))


class AmplitudeNodes(NamedTuple):
    """Three pulses of a sub-aperture through whose amplitudes parabolas go.

    Seen from the mean phase centre of their channels: parabolas through one channel of each would
    bend as the channels lie, where an antenna is steered.

    Parameters
    ----------
    illumination : Illumination
        Of the three, one echo of each.
    tx_m, rx_m : (3, 3) float64
        Their phase centres, means of the channels', metres.
    """

    illumination: Illumination
    tx_m: np.ndarray
    rx_m: np.ndarray

    @classmethod
    def of_block(cls, pattern: AntennaPattern, block: PulseBlock) -> AmplitudeNodes:
        """Nodes of a sub-aperture's pulses, with pointing."""
        nodes = node_pulses(block.n_pulses)
        ends = [centres[nodes].sum(axis=1) / block.tx_m.shape[1]
                for centres in (block.tx_m, block.rx_m)]
        pointing = block.pointing and block.pointing.select(nodes)
        return cls(Illumination.of_pulses(pattern, pointing, *(c[:, None] for c in ends)), *ends)


def lit_budget_db(target_db: float) -> float:
    """Largest error of the amplitudes, dB."""
    return error_budget(target_db, AFBP_SHARES)['illumination']


@functools.lru_cache(maxsize=64)
def node_pulses(n_pulses: int) -> np.ndarray:
    """(3,) int64 pulses of a sub-aperture through whose amplitudes the parabola goes."""
    return np.rint(np.array(NODES) * n_pulses - 0.5).astype(np.int64).clip(0, n_pulses - 1)


def parabola(place, value) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients of the parabolas through three points each, (..., 3) places and values.

    A straight line through the outer ones where the middle one is near one of them, as where a
    platform stands still; constant where the outer ones are the same.
    """
    x, y = np.moveaxis(place, -1, 0), np.moveaxis(value, -1, 0)
    same = np.abs(x[2] - x[0]) < 1e-12
    least = NODES_APART * np.abs(x[2] - x[0])
    near = ~((np.abs(x[1] - x[0]) > least) & (np.abs(x[2] - x[1]) > least))
    x = np.where(same, np.array([-1.0, 0.0, 1.0]).reshape(3, *[1] * (x.ndim - 1)), x)
    y = np.where(same, y[1], y)
    middle = 0.5 * (x[0] + x[2]), 0.5 * (y[0] + y[2])
    x1, y1 = (np.where(near, m, v[1]) for m, v in zip(middle, (x, y), strict=True))
    first = (y1 - y[0]) / (x1 - x[0])
    c = ((y[2] - y1) / (x[2] - x1) - first) / (x[2] - x[0])
    b = first - c * (x[0] + x1)
    return y[0] - x[0] * (b + c * x[0]), b, c


class LitError:
    """Predicted error of parabolas over sub-apertures of any length, from random lit pairs.

    Parameters
    ----------
    polar : PolarGrid
        Of the images.
    radar, tx_m, rx_m, illumination :
        Of the aperture, phase centres (P, C, 3), metres, and the illumination of their P C echoes.
    most_pairs : int
        With how many to look for lit ones.
    """

    def __init__(self, polar: PolarGrid, radar: RadarParameters, tx_m, rx_m,
                 illumination: Illumination, most_pairs: int = MOST_PAIRS):
        self._polar, self._illumination, self._radar = polar, illumination, radar
        self._tx_m, self._rx_m = tx_m, rx_m
        self._n_channels = tx_m.shape[1]
        middles = mean_centres(tx_m, rx_m)
        self._along = (middles - middles.mean(axis=0))[:, :2] @ np.array(polar.track)
        pairs = LitPairs.draw(illumination, polar.positions, polar.shape, most=most_pairs)
        self._echoes, self._points = pairs.echoes, pairs.points_m
        self.share, self.power = pairs.share, pairs.power
        centre, beside = polar.locate(polar.n_range // 2, polar.n_alpha // 2)[:2]
        sides = beside * polar.n_range, polar.n_alpha * polar.alpha_spacing * polar.by_direction(
            polar.range_m[polar.n_range // 2], polar.alpha[polar.n_alpha // 2])
        self._weight = echo_power(tx_m.reshape(-1, 3), rx_m.reshape(-1, 3), centre, sides, radar)
        low, high = radar.wavenumbers_rad_per_m
        self._ratio = np.random.default_rng(2).uniform(
            low, high, len(self._echoes)) / radar.wavenumber_rad_per_m

    def short_enough(self, lengths, target_db: float) -> tuple[int, ...]:
        """Those of some lengths of sub-apertures whose parabolas leave the target to the rest.

        Raises
        ------
        ValueError
            None is short enough.
        """
        pieces = pieces_between_gaps(mean_centres(self._tx_m, self._rx_m))
        most = (1 - _KNOT_SHARE) * 10 ** (lit_budget_db(target_db) / 10)
        found = tuple(n for n in lengths if self.error(cut_pulses(pieces, n)) <= most)
        if not found:
            raise ValueError(f'the illumination of the scene changes too much over {lengths[0]} '
                             f'pulses for target_db={target_db:g}; use exact backprojection')
        return found

    def plan(self, coarse: PolarGrid, lattice: RangeResampling, beams: BeamSampling | None,
             pulses, target_db: float) -> tuple[RangeResampling, LitSubapertures]:
        """How images of sub-apertures are weighed, and how their lines read the profiles.

        Parameters
        ----------
        coarse : PolarGrid
            Of the images.
        lattice, beams :
            As planned without illumination.
        pulses : sequence of slice
            Of the sub-apertures.
        target_db : float
            Of the fused image, dB.

        Raises
        ------
        ValueError
            Amplitudes change too much from pixel to pixel.
        """
        lit, n_channels = self._illumination, self._n_channels
        seen = seen_subapertures(coarse, pulses, lit, n_channels)
        wanted = 10 ** (lit_budget_db(target_db) / 10)
        if beams is not None:
            apart, along = self.knots(coarse, beams.segment, _KNOT_SHARE * wanted)
            error = self.error(pulses) + along
            return lattice, LitSubapertures(lit, seen, apart, None, self.power,
                                            10 * math.log10(error + _LEAST))
        starts = tuple(p.start * n_channels for p in pulses)
        lattice, lines, _ = plan_lit_segments(
            lit, ImageLines.of_polar(coarse), Echoes(self._tx_m.reshape(-1, 3),
                                                     self._rx_m.reshape(-1, 3), starts,
                                                     self._radar),
            lattice, max(lattice.predicted_error_db, error_budget(
                target_db, AFBP_SHARES)['sub-aperture images']), lit_budget_db(target_db))
        if lines is None:
            raise ValueError('amplitudes change too much from pixel to pixel of the sub-aperture '
                             'images; use exact backprojection')
        return lattice, LitSubapertures(lit, seen, 1, lines, self.power,
                                        lines.predicted_error_db)

    def error(self, pulses) -> float:
        """Mean square relative to the power of the image; `pulses` are the sub-apertures'."""
        wrong, power, echoes = self._squares(pulses)
        # echoes of a platform that stands still add up coherently
        weight = self._weight[echoes]
        return bounded_ratio(weight * wrong, weight * power)

    def mean_square(self, pulses) -> float:
        """Of errors, over pulses of sub-apertures that light a point."""
        wrong = self._squares(pulses)[0]
        return float(wrong.mean()) if len(wrong) else 0.0

    def _squares(self, pulses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) of errors and of amplitudes, and of which echoes."""
        starts = np.array([p.start for p in pulses])
        stops = np.array([p.stop for p in pulses])
        pulses, channel = np.divmod(self._echoes, self._n_channels)
        which = np.searchsorted(starts, pulses, 'right') - 1
        start, length = starts[which], stops[which] - starts[which]
        # any pulse of a sub-aperture of which one lights the point
        pulse = start + np.random.default_rng(3).integers(0, length)
        node = start[:, None] + np.rint(np.array(NODES) * length[:, None] - 0.5).astype(
            int).clip(0, length[:, None] - 1)
        value = np.stack([self._amplitude(node[:, i], channel) for i in range(3)], axis=-1)
        middle = self._along[start + length // 2]
        a, b, c = parabola(self._along[node] - middle[:, None], value)
        # Derivatives count wavenumbers, of which the carrier's is meant.
        u = self._ratio * (self._along[pulse] - middle)
        true = self._amplitude(pulse, channel)
        return (a + u * (b + u * c) - true) ** 2, true ** 2, pulse * self._n_channels + channel

    def _amplitude(self, pulse, channel) -> np.ndarray:
        return pair_amplitude(self._illumination, pulse * self._n_channels + channel,
                              self._points)

    def knots(self, coarse: PolarGrid, segment: int, wanted: float) -> tuple[int, float]:
        """Segments between knots along range, and the error of straight lines between them."""
        rng = np.random.default_rng(4)
        r, alpha = self._polar.from_map(self._points[:, 0], self._points[:, 1])
        error, power = 0.0, max(np.mean(self._amplitude(
            *np.divmod(self._echoes, self._n_channels)) ** 2), 1e-300)
        for apart in KNOTS_APART:
            length = apart * segment * coarse.range_spacing_m
            share = rng.uniform(0, 1, len(r))
            first = np.maximum(r - share * length, coarse.range_start_m)
            before, after, true = (pair_amplitude(self._illumination, self._echoes, coarse.lines(
                at, alpha)[0]) for at in (first, first + length, r))
            share = (r - first) / length
            error = float(np.nanmean((before + share * (after - before) - true) ** 2) / power)
            if error <= wanted:
                break
        return apart, error


def seen_subapertures(coarse: PolarGrid, pulses, illumination: Illumination, n_channels: int
                      ) -> frozenset[int]:
    """Numbers of the sub-apertures of which some pulse lights a part of a grid."""
    points = coarse.lines(*coarse.sampled(_LOOKED_AT[1], max(_LOOKED_AT[0], coarse.n_alpha)))[0]
    return frozenset(
        number for number, p in enumerate(pulses)
        if (illumination.select(np.array([p.start, (p.start + p.stop) // 2, p.stop - 1])
                                * n_channels).amplitude(points) > 0).any())
