# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
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
from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from ...geometry.illumination import AntennaPattern, Illumination
from ...geometry.polar import PolarGrid
from ...geometry.track import mean_centres
from ...signal.pulses import PulseBlock
from ...signal.radar import RadarParameters
from ..echo_pixels import MOST_PAIRS, EchoPixels, bounded_ratio
from ..echo_power import echo_power
from ..exact.illumination import Echoes, ImageLines, LineAmplitudes, plan_weighed_segments
from ..plan import AFBP_SHARES, error_budget
from ..profiles import RangeResampling
from .beams import BeamSampling

NODES = tuple(0.5 + 0.5 * x for x in (-math.sqrt(0.6), 0.0, math.sqrt(0.6)))  # of Gauss' rule
NODES_APART = 0.1  # of their span, at least, that nodes lie apart along the track
_LEAST = 1e-16
_PAIRS = 1 << 14  # at which a sub-aperture is looked at while pulses arrive
_LOOKED_AT = 9  # directions and ranges, to tell which sub-apertures see the grid


@final
@dataclasses.dataclass(frozen=True, eq=False)
class SubapertureAmplitudes:
    """How the images of a plan's sub-apertures are weighed.

    Attributes
    ----------
    illumination : Illumination
        Illumination of the echoes of the aperture.
    seen : frozenset of int
        Sub-apertures that light a part of the grid; the others add nothing.
    lines : LineAmplitudes or None
        Lines of images to which pulses are added directly.
    power : float
        Mean square of the amplitude over all pulses and pixels.
    predicted_error_db : float
        Error of the image by it, dB.
    by_channel : bool
        Images from beams are made channel by channel.
    """

    illumination: Illumination
    seen: frozenset[int]
    lines: LineAmplitudes | None
    power: float
    predicted_error_db: float
    by_channel: bool = False

    def n_nodes(self, coarse: PolarGrid, segment: int) -> int:
        """Nodes of the amplitudes of an image from beams: the ends of segments of its lines."""
        return coarse.n_alpha * (-(-coarse.n_range // segment) + 1)

    def n_bytes(self, coarse: PolarGrid, segment: int) -> int:
        """Memory that amplitudes take, with so many ranges of `coarse` to a segment, bytes."""
        if self.lines is not None:
            return self.illumination.n_bytes + self.lines.n_bytes(*coarse.shape, segment)
        # of each node three coordinates in float64, and three coefficients in float32
        return self.illumination.n_bytes + 36 * self.n_nodes(coarse, segment)

    def of_subaperture(self, polar: PolarGrid, radar: RadarParameters, tx_m: np.ndarray,
                       rx_m: np.ndarray, illumination: Illumination) -> tuple[float, float]:
        """Power of a sub-aperture's echoes and error of their amplitudes.

        Both are relative to the power of the echoes that were planned for; arguments are as of
        `AmplitudeError`.
        """
        found = AmplitudeError(polar, radar, tx_m, rx_m, illumination, self.predicted_error_db,
                               _PAIRS)
        if self.lines is not None:  # which err alike wherever the antenna looks
            wrong = found.power * 10 ** (self.predicted_error_db / 10)
        else:
            wrong = found.share * found.mean_square([slice(0, len(tx_m))], self.by_channel)
        planned = max(self.power, _LEAST)
        return found.power / planned, wrong / planned


class AmplitudeNodes(NamedTuple):
    """Three pulses of a sub-aperture through whose amplitudes parabolas go.

    Parameters
    ----------
    illumination : Illumination
        Illumination of the three, one echo of each.
    tx_m, rx_m : (3, 3) float64
        Phase centres of the echoes, metres.
    """

    illumination: Illumination
    tx_m: np.ndarray
    rx_m: np.ndarray


def amplitude_nodes(pattern: AntennaPattern, block: PulseBlock, n_weighed: int
                    ) -> tuple[AmplitudeNodes, ...]:
    """Nodes of each image that makes one of a sub-aperture, see `BeamSampling.n_weighed`.

    All channels together are seen from their mean phase centre.
    """
    assert block.tx_m is not None and block.rx_m is not None  # as was checked
    nodes = node_pulses(block.n_pulses)
    tx_m, rx_m = block.tx_m[nodes], block.rx_m[nodes]
    if n_weighed == 1:
        tx_m, rx_m = (c.sum(axis=1, keepdims=True) / block.n_channels for c in (tx_m, rx_m))
    pointing = block.pointing and block.pointing.select(nodes)
    return tuple(AmplitudeNodes(Illumination.of_pulses(
        pattern, pointing, tx_m[:, c:c + 1], rx_m[:, c:c + 1]), tx_m[:, c], rx_m[:, c])
        for c in range(n_weighed))


@functools.lru_cache(maxsize=64)
def node_pulses(n_pulses: int) -> np.ndarray:
    """(3,) int64 pulses of a sub-aperture through whose amplitudes the parabola goes."""
    return np.rint(np.array(NODES) * n_pulses - 0.5).astype(np.int64).clip(0, n_pulses - 1)


def parabola(place: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


@final
class AmplitudeError:
    """Predicted error of parabolas over sub-apertures of any length, from random lit pairs.

    Parameters
    ----------
    polar : PolarGrid
        Polar grid of the images.
    radar, tx_m, rx_m, illumination :
        Of the aperture, phase centres (P, C, 3), metres, and the illumination of their P C echoes.
    target_db : float
        Target error of the fused image, dB.
    most_pairs : int
        With how many to look for lit ones.

    Attributes
    ----------
    budget_db : float
        Largest error of the amplitudes, dB.
    """

    def __init__(self, polar: PolarGrid, radar: RadarParameters, tx_m: np.ndarray,
                 rx_m: np.ndarray, illumination: Illumination, target_db: float,
                 most_pairs: int = MOST_PAIRS):
        shares = error_budget(target_db, AFBP_SHARES)
        self.budget_db, self._images_db = shares['illumination'], shares['sub-aperture images']
        self._polar, self._illumination, self._radar = polar, illumination, radar
        self._tx_m, self._rx_m = tx_m, rx_m
        self._n_channels = tx_m.shape[1]
        middles = mean_centres(tx_m, rx_m)
        track, origin = np.array(polar.track), middles.mean(axis=0)[:2]
        self._along = (middles[:, :2] - origin) @ track
        # of each echo, and what its pulse's nodes see
        self._places = (illumination.centre_m[:, :2] - origin) @ track
        self._middles = Illumination(illumination.pattern, middles,
                                     illumination.axes[::self._n_channels])
        pairs = EchoPixels.draw(illumination, polar.positions, polar.shape, most=most_pairs)
        self._echoes, self._points = pairs.echoes, pairs.points_m
        self.share, self.power = pairs.share, pairs.power
        centre, beside = polar.locate(polar.n_range // 2, polar.n_alpha // 2)[:2]
        sides = beside * polar.n_range, polar.n_alpha * polar.alpha_spacing * polar.by_direction(
            polar.range_m[polar.n_range // 2], polar.alpha[polar.n_alpha // 2])
        self._weight = echo_power(tx_m.reshape(-1, 3), rx_m.reshape(-1, 3), centre, sides, radar)
        low, high = radar.wavenumbers_rad_per_m
        self._ratio = np.random.default_rng(2).uniform(
            low, high, len(self._echoes)) / radar.wavenumber_rad_per_m

    def n_weighed(self, pulses: Sequence[slice]) -> int | None:
        """In how few images from beams echoes are weighed well enough, see `BeamSampling`.

        `pulses` are those of the sub-apertures. None where parabolas miss the budget even channel
        by channel.
        """
        most = 10 ** (self.budget_db / 10)
        if self.error(pulses) <= most:
            return 1
        by_channel = self._n_channels > 1 and self.error(pulses, by_channel=True) <= most
        return self._n_channels if by_channel else None

    def plan(self, coarse: PolarGrid, resampling: RangeResampling, beams: BeamSampling | None,
             pulses: Sequence[slice]) -> tuple[RangeResampling, SubapertureAmplitudes]:
        """How images of sub-apertures are weighed, and how their lines read the profiles.

        Parameters
        ----------
        coarse : PolarGrid
            Polar grid of the images.
        resampling, beams :
            As planned without illumination.
        pulses : sequence of slice
            Pulses of the sub-apertures.

        Raises
        ------
        ValueError
            Amplitudes change too much from pixel to pixel.
        """
        illumination, n_channels = self._illumination, self._n_channels
        seen = seen_subapertures(coarse, pulses, illumination, n_channels)
        if beams is not None:
            error = (self.error(pulses, beams.n_weighed > 1)
                     + self._along_range(coarse, beams.segment * coarse.range_spacing_m))
            return resampling, SubapertureAmplitudes(illumination, seen, None, self.power,
                                                     10 * math.log10(error + _LEAST),
                                                     beams.n_weighed > 1)
        starts = tuple(p.start * n_channels for p in pulses)
        fitted, lines, _ = plan_weighed_segments(
            illumination, ImageLines.of_polar(coarse),
            Echoes(self._tx_m.reshape(-1, 3), self._rx_m.reshape(-1, 3), starts, self._radar),
            resampling, max(resampling.predicted_error_db, self._images_db), self.budget_db)
        if fitted is None or lines is None:
            raise ValueError('amplitudes change too much from pixel to pixel of the sub-aperture '
                             'images; use exact backprojection')
        return fitted, SubapertureAmplitudes(illumination, seen, lines, self.power,
                                             lines.predicted_error_db)

    def error(self, pulses: Sequence[slice], by_channel: bool = False) -> float:
        """Mean square relative to the power of the image; `pulses` are the sub-apertures'."""
        wrong, power, echoes = self._squares(pulses, by_channel)
        # echoes of a platform that stands still add up coherently
        weight = self._weight[echoes]
        return bounded_ratio(weight * wrong, weight * power)

    def mean_square(self, pulses: Sequence[slice], by_channel: bool) -> float:
        """Of errors, over pulses of sub-apertures that light a point."""
        wrong = self._squares(pulses, by_channel)[0]
        return float(wrong.mean()) if len(wrong) else 0.0

    def _squares(self, pulses: Sequence[slice], by_channel: bool
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) of errors and of amplitudes, and of which echoes."""
        starts = np.array([p.start for p in pulses])
        stops = np.array([p.stop for p in pulses])
        number, channel = np.divmod(self._echoes, self._n_channels)
        which = np.searchsorted(starts, number, 'right') - 1
        start, length = starts[which], stops[which] - starts[which]
        # any pulse of a sub-aperture of which one lights the point
        pulse = start + np.random.default_rng(3).integers(0, length)
        node = start[:, None] + np.rint(np.array(NODES) * length[:, None] - 0.5).astype(
            int).clip(0, length[:, None] - 1)
        # channel by channel, or all channels seen from their middle
        seen, places, first = (self._illumination, self._places, channel) if by_channel else (
            self._middles, self._along, 0)
        step = self._n_channels if by_channel else 1
        value = np.stack([seen.of_pairs(n * step + first, self._points) for n in node.T],
                         axis=-1)
        middle = places[(start + length // 2) * step + first]
        a, b, c = parabola(places[node * step + np.reshape(first, (-1, 1))] - middle[:, None],
                           value)
        echoes = pulse * self._n_channels + channel
        # Derivatives count wavenumbers, of which the carrier's is meant.
        u = self._ratio * (self._places[echoes] - middle)
        true = self._illumination.of_pairs(echoes, self._points)
        return (a + u * (b + u * c) - true) ** 2, true ** 2, echoes

    def _along_range(self, coarse: PolarGrid, length_m: float) -> float:
        """Error of straight lines over segments along range, relative to the image's power."""
        r, alpha = self._polar.from_map(self._points[:, 0], self._points[:, 1])
        first = np.maximum(r - np.random.default_rng(4).uniform(0, length_m, len(r)),
                           coarse.range_start_m)
        before, after, true = (self._illumination.of_pairs(self._echoes, coarse.at(
            at, alpha)) for at in (first, first + length_m, r))
        wrong = before + (r - first) / length_m * (after - before) - true
        return bounded_ratio(wrong ** 2, true ** 2)


def seen_subapertures(coarse: PolarGrid, pulses: Sequence[slice], illumination: Illumination,
                      n_channels: int) -> frozenset[int]:
    """Numbers of the sub-apertures of which some pulse lights a part of a grid.

    Every pulse is looked at: narrow beams may light the grid between any two of them.
    """
    points = coarse.lines(*coarse.sampled(_LOOKED_AT, _LOOKED_AT))[0]
    known = dataclasses.replace(illumination, foreseen=False)
    return frozenset(
        number for number, p in enumerate(pulses)
        if known.select(slice(p.start * n_channels, p.stop * n_channels, n_channels)).may_light(
            points, (_LOOKED_AT,) * 2) is not None)
