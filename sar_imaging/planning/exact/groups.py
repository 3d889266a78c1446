# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images from groups of echoes: how a map is divided among polar images around a track.

A group of echoes is imaged on a polar grid around its own middle and interpolated to the map. Each
group is divided into parts with a few lines each, which are interpolated to the lines of the
group. On a polar grid around the middle of the whole aperture parts far from there would need many
lines, and near the antenna all would: the more groups, the fewer lines, and the more often the map
is added to. `group_geometry` has the formulas; the number of groups and parts is that with the
least predicted time. Where no frame suits the map as a whole, its halves are tried in turn, and
what remains is imaged point by point.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...geometry.grids import MapGrid
from ...memory import IMAGE_BYTES
from ...signal.radar import RadarParameters
from ..costs import costs
from ..echo_power import echo_powers
from ..interpolators import (
    Interpolator,
    design_interpolator,
    known_errors,
    least_oversampling,
    margin,
    sufficient_interpolators,
)
from ..plan import EXACT_SHARES, PASSES_DB, Plan, error_budget, total_db
from ..profiles import PhaseHistory, RangeGate, RangeResampling, plan_point_resampling
from ..transform_lengths import row_length
from .group_geometry import (
    LOBATTO,
    SEEN,
    Extents,
    Places,
    bent_rows,
    direction_bends,
    direction_slopes,
    extents_of,
    frames_of,
    in_frames,
    places_of,
    range_derivatives,
    slopes_beyond,
)
from .points import ImagePoints, PointPlan, plan_even_points

if TYPE_CHECKING:
    from ...geometry.grids import EvenGrid

DEGREE = 5  # of interpolators between lines and along them
#: Group of echoes as kernels take it: its echoes, its frame and its grids.
GROUP = np.dtype([(name, np.int64) for name in (
    'first', 'end', 'axis', 'n_alpha', 'n_range', 'n_coarse')] + [(name, np.float64) for name in (
        'x_m', 'y_m', 'track_x', 'track_y', 'height_m', 'least', 'range_m', 'alpha',
        'alpha_spacing', 'coarse', 'coarse_spacing')])
QUAD, VECTOR = 4, 16  # lines that kernels sum together, and ranges of their longest vectors
# Echoes by which errors are predicted, of all groups, of each at least: two in a part or more.
# A third of them told 0.7 dB too little of nineteen parts.
_SOME, _FEW = 132, 44
_SEEK = 5  # echoes of a group by which the number of groups is sought
_WAVENUMBERS = 5  # of the band, at which errors are looked up
_SLACK, _FINER = 1.01, 0.999
_CHANGE = 0.02  # of s along half a segment, over its value where its continuation begins
_MOST_ENDS = 0.6  # of a target, that ends of profiles may take
_LEFT_DB = 1.0  # of what profiles may err, for expansions along segments
_NEARER = 0.35  # of the taps: how far beside a pixel interpolators read with weight
_BEGIN = 0.95  # of the least f / r of the map, where its continuation begins
_SEGMENTS = (256, 128, 64, 32, 16)
_LEAST_ECHOES = 4  # of a part
_PARTS = np.array(list(itertools.accumulate(  # numbers of parts to choose from
    range(30), lambda n, _: math.ceil(1.35 * n), initial=1)))
_LEAST_SIDE = 40  # pixels of a part of a map
_CHEAP = 0.5  # of the time by points: not worth dividing
_WORTH_DIVIDING_NS = 1e8  # of time by points: twenty times what planning takes
_MOST_GROUPS, _TRIES = 64, 3
_ALIKE = 0.05  # change of the time of an image, beyond which its groups are sought anew
_MOST_PHASES, _COST_PHASE = 8, 1.5e-3  # positions within a cell; what one more takes, in segments
_LEAST_RANGE = 0.2  # of a polar grid, over that of the map
_SEGMENT, _USUAL_PHASES, _COARSER = 64, 2, 1.05  # what costs are sought with


class Lengths(NamedTuple):
    """Lengths of interpolators that an error needs.

    Attributes
    ----------
    degree : int
        Least degree of the polynomials of the profiles.
    taps, part_taps : int
        Neighbours of each pass to the map, and between lines of parts.
    """

    degree: int
    taps: int
    part_taps: int


#: By the error above which they are the quickest, dB.
LENGTHS = {-50.0: Lengths(3, 8, 8), -68.0: Lengths(3, 10, 8), -math.inf: Lengths(4, 14, 10)}
_MOST_DEGREE = LENGTHS[-math.inf].degree  # whose errors are known


def lengths_for(target_db: float) -> Lengths:
    """Lengths with which images at an error are quickest."""
    return next(lengths for least, lengths in LENGTHS.items() if target_db > least)


@dataclasses.dataclass(frozen=True, eq=False)
class GroupedMap:
    """A map, or a part of one, that is imaged from groups of echoes.

    Attributes
    ----------
    grid : MapGrid
        Its pixels.
    corner : (int, int)
        Row and column of its first pixel in the whole map.
    groups : (G,) GROUP
        Groups, in order.
    frequency : (G, P) float64
        Middle of the band of each part's image along direction, radians per unit of alpha.
    tx, rx : (E, 3) float64
        X, Y and c of the echoes in the frame of their group, see `group_geometry`.
    resampling : RangeResampling
        How lines read the profiles.
    range_m : (float, float)
        Least and largest half path that is read, metres.
    between, along, parts : Interpolator
        Between lines of a group and along them, to the map; and between lines of parts.
    errors_db : mapping of str to float
        Predicted error by cause, dB.
    operations : mapping of str to float
        How often the operations of `CostModel` are done.
    """

    grid: MapGrid
    corner: tuple[int, int]
    groups: np.ndarray
    frequency: np.ndarray
    tx: np.ndarray
    rx: np.ndarray
    resampling: RangeResampling
    range_m: tuple[float, float]
    between: Interpolator
    along: Interpolator
    parts: Interpolator
    errors_db: Mapping[str, float]
    operations: Mapping[str, float]

    @property
    def n_parts(self) -> int:
        """Parts of each group."""
        return self.frequency.shape[1]

    @property
    def cost(self) -> float:
        """Nanoseconds of the image."""
        return costs().nanoseconds(self.operations)

    @property
    def n_bytes(self) -> int:
        """Memory that adding the echoes takes besides the image, bytes."""
        g = self.groups
        return IMAGE_BYTES * int((g['n_range'] * (g['n_alpha'] + self.n_parts * g['n_coarse'])
                                  ).max())


@dataclasses.dataclass(frozen=True, eq=False)
class GroupPlan(Plan):
    """How echoes are added to a map group by group.

    Attributes
    ----------
    maps : tuple of GroupedMap
        The map, or parts of it.
    rest : tuple of ((int, int), MapGrid)
        Corners and pixels of the parts that are imaged point by point.
    points : PointPlan or None
        How these are.
    window : RangeGate or PhaseHistory
        Part of the profiles that is needed.
    sought_ns : float
        Time of the parts of the map when the numbers of groups and parts were sought.
    """

    maps: tuple[GroupedMap, ...]
    rest: tuple[tuple[tuple[int, int], MapGrid], ...]
    points: PointPlan | None
    window: RangeGate | PhaseHistory
    errors_db: Mapping[str, float]
    sought_ns: float

    method = 'groups'

    @property
    def resampling(self) -> RangeResampling:
        """How profiles are read, of the first part of the map."""
        return self.maps[0].resampling

    def operations(self, grid: EvenGrid | ImagePoints, n_echoes: int) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        found = [one.operations for one in self.maps]
        if self.points is not None:
            found += [self.points.operations(part, n_echoes) for _, part in self.rest]
        names = {name: None for counts in found for name in counts}
        return {name: sum(counts.get(name, 0.0) for counts in found) for name in names} | {
            'image': 1}

    def n_bytes(self, grid: EvenGrid | ImagePoints) -> int:
        """Memory that adding the echoes takes besides the image, bytes."""
        return max(one.n_bytes for one in self.maps) + sum(
            IMAGE_BYTES * math.prod(grid.shape) for _, grid in self.rest)

    def __str__(self) -> str:
        counts = sorted({len(one.groups) for one in self.maps})
        n = f'{counts[0]} to {counts[-1]}' if len(counts) > 1 else f'{counts[0]}'
        parts = sorted({one.n_parts for one in self.maps})
        p = f'{parts[0]} to {parts[-1]}' if len(parts) > 1 else f'{parts[0]}'
        text = (f'pulses are added in {n} group{"s" * (n != "1")}, whose polar images of {p} '
                f'part{"s" * (p != "1")} each are interpolated to the map')
        share = 1 - sum(math.prod(grid.shape) for _, grid in self.rest) / (
            sum(math.prod(one.grid.shape) for one in self.maps)
            + sum(math.prod(grid.shape) for _, grid in self.rest))
        return text if not self.rest else (
            f'{text} over {100 * share:.0f} % of it; elsewhere point by point')


# What takes as long as so many coefficients of a pixel, or lines that it is made of: its phasor.
_PHASOR_COEFFICIENTS, _PHASOR_TAPS = 5, 4


def _counts(grid: MapGrid, sizes: np.ndarray | Mapping[str, np.ndarray], n_echoes: np.ndarray,
            n_lines: np.ndarray, n_parts: int | np.ndarray, segment: int, n_planes: int,
            taps: tuple[int, int], crossed: np.ndarray) -> dict[str, np.ndarray]:
    """(G, ...) operations of each group but for the profiles.

    `sizes` has ``n_alpha``, ``n_range`` and ``axis`` of the groups, `crossed` is as of
    `_crossed`.
    """
    n_range, n_alpha, axis = (sizes[name] for name in ('n_range', 'n_alpha', 'axis'))
    lines = n_echoes * n_lines
    rows = np.where(axis == 0, grid.n_y, grid.n_x)
    return {'part_coefficient': lines * n_range * (n_planes + _PHASOR_COEFFICIENTS),
            'part_segment': lines * -(-n_range // segment),
            'summed_tap': n_parts * n_alpha * n_range * (taps[0] + _PHASOR_TAPS),
            'grouped_pixel': np.full(n_range.shape, math.prod(grid.shape)),
            'grouped_tap': taps[1] * rows * n_range * crossed, 'group': np.ones(n_range.shape)}


def _crossed(places: Places, spacing: float | np.ndarray, alpha_spacing: np.ndarray) -> np.ndarray:
    """(G,) lines that the ranges of a vector start from, as rows of the map cross them."""
    return 1 + 0.5 * VECTOR * np.abs(places.by_range).mean(axis=1) * spacing / alpha_spacing


class _Unsuited(Exception):
    """Groups do not suit a map."""


class Echoes:
    """Echoes of a radar that are divided into groups.

    Parameters
    ----------
    tx_m, rx_m : (E, 3) float64
        Phase centres, metres.
    radar : RadarParameters
        Radar parameters of their profiles.
    window : RangeGate or PhaseHistory
        Part of these that is needed.
    target_db : float
        Wanted error, dB.
    """

    def __init__(self, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
                 window: RangeGate | PhaseHistory, target_db: float):
        same = tx_m is rx_m or np.array_equal(tx_m, rx_m)
        self.paths = [tx_m] if same else [tx_m, rx_m]
        self.centres_m = tx_m if same else 0.5 * (tx_m + rx_m)
        self.radar, self.window, self.lengths = radar, window, lengths_for(target_db)
        budget = error_budget(target_db, EXACT_SHARES)
        self.target, self.profiles_db = 10 ** (target_db / 10), budget['range profiles'] - _LEFT_DB
        self.parts_db = budget['azimuth upsampling']
        self.pass_db = budget['polar to map'] - PASSES_DB
        self.points = plan_point_resampling(window, target_db)
        low, high = radar.wavenumbers_rad_per_m
        self.wavenumbers = low + (high - low) * LOBATTO[_WAVENUMBERS][0]

    def __len__(self) -> int:
        return len(self.centres_m)

    def edges(self, n_groups: int) -> np.ndarray:
        """(G + 1,) first echo of each group, and their number."""
        return np.arange(n_groups + 1) * len(self) // n_groups

    def resampling(self, pitch_m: float, slopes: tuple[float, float]) -> RangeResampling:
        """How lines read the profiles: ranges `pitch_m` apart or less.

        `slopes` are the least and the largest derivative of a half path by range. Polynomials of
        a higher degree where these need fewer phases: a phase takes more time than they do.
        """
        found = [one for degree in range(self.lengths.degree, _MOST_DEGREE + 1)
                 if (one := self._resampling(degree, pitch_m, slopes)) is not None]
        if not found:
            raise _Unsuited
        return min(found, key=lambda one: one.n_phases)  # the first of several

    def _resampling(self, degree: int, pitch_m: float, slopes: tuple[float, float]
                    ) -> RangeResampling | None:
        """The quickest with polynomials of a degree; None where none meets the target."""
        window, radar, errors = self.window, self.radar, _profile_errors(degree)
        middle, spacing = 0.5 * sum(slopes), window.radar.sample_spacing_m
        best, least = None, math.inf
        n_padded = window.n_samples if window.periodic else row_length(window.n_samples)
        for phases in range(1, _MOST_PHASES + 1):
            n_cells = row_length(math.ceil(n_padded * spacing / (pitch_m * middle)), (phases,))
            step = n_padded * spacing / (n_cells * phases)
            oversampling = radar.range_resolution_m / step
            row = errors[max(min(int(10 * oversampling + 1e-9), 39) - 13, 0)]
            if oversampling < 1.3 or row[0] > self.profiles_db:
                continue
            drift = max(abs(s / middle - 1) for s in slopes) * phases
            for segment in _SEGMENTS:
                margin = max(0, math.ceil((drift * segment / 2 - 0.03) / 0.05 - 1e-9))
                cost = 1 / segment + _COST_PHASE * phases
                if margin < len(row) and row[margin] <= self.profiles_db:
                    if cost < least:
                        least, best = cost, RangeResampling(
                            n_padded, n_cells, phases, segment, step, step * phases / middle,
                            design_interpolator(min(int(10 * oversampling + 1e-9), 39) / 10,
                                                0.05 * margin + 0.03, degree=degree),
                            row[margin])
                    break
        return best


class Survey:
    """Local frequencies of the images of groups on a map, and how finely these are sampled.

    Arrays (G, M, ...) have a row of echoes for each group, as long as the largest is; smaller ones
    repeat their last echo.

    Parameters
    ----------
    echoes : Echoes
        All of them.
    grid : MapGrid
        The map.
    first, end : (G,) int64
        Echoes of each group.
    seek : bool
        A few of them will do, and groups may not suit.

    Attributes
    ----------
    counts : (G,) int64
        Echoes of each group that are looked at.
    centres : list of (G, M, 3) float64
        Their phase centres, see `in_frames`.
    row : (G, 1) int64
        Numbers of the groups.
    some : (G, Q) int64
        Those of their echoes by which errors are predicted.
    fine : (G,) bool
        Groups whose frame suits the map.
    """

    def __init__(self, echoes: Echoes, grid: MapGrid, first: np.ndarray, end: np.ndarray, *,
                 seek: bool = False):
        self.echoes, self.grid, self.n_echoes = echoes, grid, end - first
        if seek:
            number = first[:, None] + _evenly(end - first, _SEEK)
            self.counts = np.full(len(first), number.shape[1])
            starts, number = np.arange(len(first)) * number.shape[1], number.ravel()
        else:
            self.counts, starts, number = self.n_echoes, first, slice(None)
        centres_m = echoes.centres_m[number]
        self.frames = frames_of(grid, centres_m, starts, self.counts)
        self.in_frames = [in_frames(self.frames, p[number], self.counts) for p in echoes.paths]
        self.row = np.arange(len(first))[:, None]
        column = np.minimum(np.arange(self.counts.max()), self.counts[:, None] - 1)
        self.centres = [c[starts[:, None] + column] for c in self.in_frames]
        self.places = places_of(grid, self.frames, 3 if seek else 5)
        self.fine = self.places.seen.copy()
        self.some = _evenly(self.counts, max(_FEW, _SOME // len(first)))
        sides_m = grid.spacing_m * np.array([[grid.n_x, 0, 0], [0, grid.n_y, 0]])
        weight = np.ones((1, 1, 1)) if seek else echo_powers(
            echoes.paths[0], echoes.paths[-1], grid.centre_m, sides_m, echoes.radar
            )[:, starts[:, None] + self.some]
        ends_halved = np.ones(self.some.shape[1])
        ends_halved[[0, -1]] = 0.5
        self._weight = weight * ends_halved * np.ones((len(first), 1))
        side = LOBATTO[3 if seek else 5][1]
        self._places_weight = np.multiply.outer(side, side).ravel()
        self._sample(seek)

    def _sample(self, seek: bool) -> None:
        """Spacings of ranges and directions, and the interpolators of both passes to the map."""
        places, taps, k = self.places, self.echoes.lengths.taps, self.echoes.wavenumbers
        carrier = self.echoes.radar.wavenumber_rad_per_m
        self.slopes = direction_slopes(places, self.centres)
        self.by_range = range_derivatives(places, self.of_echoes(self.some), 1 if seek else 4)
        few = self.few = self.slopes[self.row, self.some]
        rows = self.rows = self.by_range[1] + few * places.by_range[:, None]
        self.fine &= self.by_range[1].min(axis=(1, 2)) > 0
        if not (self.fine.any() if seek else self.fine.all()):
            raise _Unsuited
        half = _SLACK * np.maximum(np.abs(few).max(axis=(1, 2)) * k[-1], 1e-9)
        half_range = _SLACK * _off_carrier(rows, k, carrier)
        self.bends = None if seek else direction_bends(places, self.of_echoes(self.some))
        self._directions, self._ranges = (few, 0.0, self.bends), (rows, carrier)
        self.between = self._fitting(half, *self._directions)
        self.along = self._fitting(half_range, *self._ranges)
        self.alpha_spacing = np.pi / (half * self.between.oversampling)
        self.pitch_m = _FINER * np.pi / (half_range * self.along.oversampling)
        for _ in range(3):  # rows are read nearer than their pixels, where directions change more
            bent, reached = bent_rows(self.frames, places, _NEARER * taps * self.pitch_m)
            self.fine &= reached
            there = _SLACK * _off_carrier(rows + few * bent[:, None], k, carrier)
            wanted = _FINER * np.pi / (np.maximum(there, half_range) * self.along.oversampling)
            if (self.pitch_m <= _SLACK * wanted)[self.fine].all():
                break
            self.pitch_m = np.minimum(self.pitch_m, 0.5 * (self.pitch_m + wanted))

    def of_echoes(self, number: np.ndarray) -> list[np.ndarray]:
        """Phase centres (G, Q, 3) of echoes (G, Q) of the groups."""
        return [c[self.row, number] for c in self.centres]

    def _fitting(self, half: np.ndarray, *band: Any) -> Interpolator:
        """Interpolator of a pass to the map whose bands, as of `error_db`, are (G,) `half`."""
        wanted_db = self.echoes.pass_db
        for found in sufficient_interpolators(wanted_db, taps=self.echoes.lengths.taps,
                                              degree=DEGREE):
            # much of the power may lie where the band ends
            if self.error_db(found, np.pi / (half * found.oversampling), *band) <= wanted_db:
                return found
        raise _Unsuited

    def passes_db(self, alpha_spacing: np.ndarray, spacing: float) -> tuple[float, float]:
        """Errors between lines and along them as they lie in the end, dB."""
        return (self.error_db(self.between, alpha_spacing, *self._directions),
                self.error_db(self.along, np.full(1, spacing), *self._ranges))

    def error_db(self, interpolator: Interpolator, spacing: np.ndarray, slopes: np.ndarray,
                 middle: float | np.ndarray = 0.0, bends: np.ndarray | None = None) -> float:
        """Mean error of reading samples of groups that suit, (G,) `spacing` apart, dB.

        `slopes` and `bends` are derivatives of half paths, (G, Q, S); the frequencies of samples
        are less `middle`, radians per unit.
        """
        k, spacing = self.echoes.wavenumbers, spacing[:, None, None]
        cycles = (np.multiply.outer(k, slopes) - middle) * (spacing / (2 * np.pi))
        error = interpolator.error_at(cycles) if bends is None else interpolator.error_of_chirps(
            cycles, bends * (0.5 * self.echoes.radar.wavenumber_rad_per_m * spacing * spacing))
        weight = LOBATTO[len(error)][1]
        return 10 * math.log10(self.mean(np.tensordot(weight, error, 1)) + 1e-16)

    def mean(self, values: np.ndarray) -> float:
        """Mean of values (G, Q, S) of groups that suit."""
        by_echo = np.where(self.fine[:, None], values @ self._places_weight, 0.0).ravel()
        weight = (self._weight * self.fine[:, None]).reshape(len(self._weight), -1)
        return float((weight @ by_echo / weight.sum(axis=1)).max())


def _off_carrier(slope: np.ndarray, k: np.ndarray, carrier: float) -> np.ndarray:
    """(G,) largest frequency of slopes (G, Q, S) by range, less that of the carrier."""
    return np.maximum(k[-1] * slope.max(axis=(1, 2)) - carrier,
                      carrier - k[0] * slope.min(axis=(1, 2)))


def _evenly(counts: np.ndarray, n: int) -> np.ndarray:
    """(G, n or fewer) numbers below counts, (G,), the first and the last among them."""
    n = min(n, int(counts.min()))
    return ((counts[:, None] - 1) * np.arange(n) + (n - 1) // 2) // max(n - 1, 1)


class Grids:
    """Polar grids of surveyed groups.

    Parameters
    ----------
    survey : Survey
        The groups; those whose rows do not reach where they are read suit no more.
    spacing : (G,) float64
        Of the ranges, metres.

    Attributes
    ----------
    range_m, alpha : (G,) float64
        First range, metres, and first direction.
    alpha_spacing, n_alpha, n_range, extent : (G,)
        Of the lines; `extent` from the first to the last.
    bent : (G,) bool
        Groups with echoes so far ahead that the continuation beside the map matters.
    room : (G,) float64
        How far beside the map lines of bent groups are read; without end of others. There s is as
        far below zero as the continuation begins above it. Further out it grows steeply: of a
        platform that stands still few lines would do for the map, and those beside it erred 10 dB
        more than predicted.
    """

    def __init__(self, survey: Survey, spacing: np.ndarray):
        self._survey, self.spacing, taps = survey, spacing, survey.echoes.lengths.taps
        edge, top = margin(taps), survey.echoes.wavenumbers[-1]
        self.extents: Extents = extents_of(survey.grid, survey.frames, edge * spacing)
        self.least, ends, ranges = _BEGIN * self.extents.least, *self.extents[1::-1]
        self.bent = top * np.max([np.abs(c[..., 1]).max(axis=1) for c in survey.centres],
                                 axis=0) > 1.0
        survey.fine &= self.extents.reached & (self.extents.least > SEEN)
        height = survey.frames.height_m[:, None] / self.extents.corner_m
        far = np.sqrt(np.maximum(1 - height ** 2 + self.least[:, None] ** 2, 0.0))
        self.room = np.where(self.bent, np.maximum((far - np.abs(ends)).min(axis=1), 1e-6), np.inf)
        wide = np.ptp(ends, axis=1)
        alpha_spacing = np.minimum(np.minimum(survey.alpha_spacing, np.maximum(wide, 1e-6)),
                                   self.room / edge)
        resolved = np.pi / (survey.alpha_spacing * survey.between.oversampling)
        for _ in range(3):  # lines beside the map are read, too, where frequencies are higher
            there = np.abs(self.beside(_NEARER * taps * alpha_spacing[:, None])).max(axis=(1, 2))
            wanted = np.pi / (np.maximum(_SLACK * top * there, resolved)
                              * survey.between.oversampling)
            if (alpha_spacing <= _SLACK * wanted)[survey.fine].all():
                break
            alpha_spacing = np.clip(wanted, 0.5 * alpha_spacing, alpha_spacing)
        self.alpha_spacing = alpha_spacing
        self.n_alpha = _whole(wide / alpha_spacing, 2 * edge + 1, QUAD)
        self.n_range = _whole(np.ptp(ranges, axis=1) / spacing, 2 * edge + 1, VECTOR)
        self.alpha, self.range_m = ends[:, 0] - edge * alpha_spacing, ranges[:, 0] - edge * spacing
        self.extent = (self.n_alpha - 1) * alpha_spacing
        survey.fine &= self.range_m > _LEAST_RANGE * ranges[:, 0]

    @property
    def longest_m(self) -> float:
        """Longest half of a segment of a line that bent groups allow, metres.

        Along it s may change by a share of what it is where its continuation begins: beneath an
        antenna lines pass from the continuation into the map within a segment, whose expansion
        knows one side alone.
        """
        fall = 2 * self._survey.frames.height_m ** 2 / self.range_m ** 3
        longest = _CHANGE * self.least ** 2 / np.maximum(fall, 1e-12)
        return float(np.where(self.bent, longest, np.inf).min())

    def beside(self, away: np.ndarray) -> np.ndarray:
        """(G, M, 2 N) slopes by direction so far, (G, N), beside the map on either side."""
        ends = (self.extents.alpha[:, :, None] + np.array([[-1.0], [1.0]]) * away[:, None])
        corner_m = np.broadcast_to(self.extents.corner_m[:, :, None], ends.shape)
        shape = len(ends), -1
        return slopes_beyond(corner_m.reshape(shape), ends.reshape(shape), self._survey.centres,
                             self._survey.frames, self.least)


def _whole(sizes: np.ndarray, more: int, step: int) -> np.ndarray:
    """(G,) int64 multiples of a step that hold sizes (G,) and more."""
    sizes = np.ceil(np.where(sizes < 1e9, sizes, 1e9)).astype(np.int64) + more  # of NaN, too
    return -(-sizes // step) * step


class Bands:
    """Bands of the images of parts along direction.

    Parameters
    ----------
    survey, grids : Survey, Grids
        The groups and their grids.
    starts : (G, P) int64
        First of the looked-at echoes of each part.

    Attributes
    ----------
    middle : (G, P) float64
        Middle of each band, radians per unit of alpha.
    half : (G,) float64
        Half of the widest.
    """

    def __init__(self, survey: Survey, grids: Grids, starts: np.ndarray):
        self._survey, self._grids, self._shape = survey, grids, starts.shape
        self._first = (starts + np.arange(len(starts))[:, None] * survey.slopes.shape[1]).ravel()
        self._low, self._high = self._of_parts(survey.slopes)
        low, high = self._frequencies(self._low, self._high)
        self.middle, self.half = 0.5 * (low + high), (0.5 * (high - low)).max(axis=1)

    def _of_parts(self, slopes: np.ndarray) -> list[np.ndarray]:
        """(G, P) least and largest of slopes (G, M, N) of the echoes of parts."""
        return [bound.reduceat(bound.reduce(slopes, axis=2).ravel(), self._first
                               ).reshape(self._shape) for bound in (np.minimum, np.maximum)]

    def _frequencies(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest frequency over the band of slopes between two."""
        k = self._survey.echoes.wavenumbers
        return np.minimum(k[0] * low, k[-1] * low), np.maximum(k[0] * high, k[-1] * high)

    def beyond(self, oversampling: float, wider: float | np.ndarray = 0.0) -> np.ndarray:
        """(G,) half bands that hold what lines beside the map read, too.

        These lie the further off the coarser they are. Groups for which that does not end suit no
        more. Parts may be `wider`, (G,), than the echoes that are looked at tell, radians per unit
        of alpha.
        """
        survey, grids = self._survey, self._grids
        reach = 0.5 * survey.echoes.lengths.part_taps * np.pi / oversampling
        beside = _NEARER * survey.echoes.lengths.taps * grids.alpha_spacing
        half = np.maximum(np.maximum(_SLACK * (self.half + wider), reach / grids.room), 1e-9)
        for _ in range(6):
            # the outer lines of groups are read, too, and these read further ones
            away = beside + reach / half
            low, high = self._of_parts(grids.beside(np.multiply.outer(away, (0.5, 1.0))))
            low, high = self._frequencies(np.minimum(low, self._low),
                                          np.maximum(high, self._high))
            reached = _SLACK * ((0.5 * (high - low)).max(axis=1) + wider)
            more = reached > 1.02 * half
            if not more[survey.fine].any():
                break
            half = np.where(more, np.sqrt(half * np.minimum(reached, 16 * half)), half)
        survey.fine &= reached <= 1.1 * half
        return half


def _seek(echoes: Echoes, grid: MapGrid) -> Iterator[tuple[int, int]]:
    """Numbers of groups, and of the parts of each, that suit, the quickest first."""
    counts = [1]
    while counts[-1] < _MOST_GROUPS and 16 * counts[-1] <= len(echoes):
        counts.append(2 * counts[-1])
    found: list[tuple[float, int, int]] = []
    for some in (counts[:5], counts[5:]):  # more groups only where the most of few are best
        if some and (not found or min(found)[1] == counts[4]):
            with contextlib.suppress(_Unsuited), np.errstate(divide='ignore', invalid='ignore'):
                found += _costs_of(echoes, grid, np.array(some))
    for _, n_groups, n_parts in sorted(found):
        yield n_groups, n_parts


def _costs_of(echoes: Echoes, grid: MapGrid, counts: np.ndarray) -> list[tuple[float, int, int]]:
    """Predicted nanoseconds, number of groups and of parts, of those counts that suit."""
    edges = [echoes.edges(count) for count in counts]
    first, end = (np.concatenate([e[cut] for e in edges])
                  for cut in (slice(None, -1), slice(1, None)))
    count_of = np.cumsum([0, *counts[:-1]])  # first group of each count
    survey = Survey(echoes, grid, first, end, seek=True)
    spacing, k = np.minimum.reduceat(survey.pitch_m, count_of), echoes.wavenumbers
    grids = Grids(survey, np.repeat(spacing, counts))
    least = least_oversampling(echoes.parts_db, echoes.lengths.part_taps, DEGREE) * _COARSER
    bands = Bands(survey, grids, np.tile(np.arange(survey.slopes.shape[1]), (len(first), 1)))
    varied = 0.5 * k[-1] * np.ptp(survey.slopes, axis=1).max(axis=1)
    n_parts = _PARTS[_PARTS <= max(int(survey.n_echoes.max()) // _LEAST_ECHOES, 1)]
    half = _SLACK * (bands.half[:, None] + varied[:, None] / n_parts)
    n_lines = _lines(grids.extent[:, None], half * least, echoes.lengths.part_taps)
    cost = _group_cost(survey, grids, n_lines, n_parts)
    cost[(n_parts > 1) & (n_parts * _LEAST_ECHOES > survey.n_echoes[:, None])] = np.inf
    chosen = np.add.reduceat(cost, count_of).argmin(axis=1)
    parts = np.repeat(n_parts[chosen], counts)
    n_lines = _lines(grids.extent, bands.beyond(least, varied / parts) * least,
                     echoes.lengths.part_taps)
    cost = _group_cost(survey, grids, n_lines[:, None], parts[:, None])[:, 0]
    total = np.add.reduceat(cost, count_of) + _profile_cost(echoes, spacing)
    fine = np.logical_and.reduceat(survey.fine, count_of)
    return [(float(t), int(n), int(p)) for t, n, p, ok in zip(
        total, counts, n_parts[chosen], fine, strict=True) if ok]


def _lines(extent: np.ndarray, samples: np.ndarray, taps: int) -> np.ndarray:
    """Lines of a part over an extent; `samples` are radians per unit of direction, resolved."""
    return np.ceil(extent * samples / np.pi) + taps + 3


def _group_cost(survey: Survey, grids: Grids, n_lines: np.ndarray, n_parts: np.ndarray
                ) -> np.ndarray:
    """(G, M) nanoseconds of groups by lines and numbers of parts, but for the profiles."""
    crossed = _crossed(survey.places, grids.spacing, grids.alpha_spacing)[:, None]
    lengths = survey.echoes.lengths
    sizes = {'n_range': grids.n_range[:, None], 'n_alpha': grids.n_alpha[:, None],
             'axis': survey.frames.axis[:, None]}
    return costs().nanoseconds(_counts(
        survey.grid, sizes, survey.n_echoes[:, None], n_lines, n_parts, _SEGMENT,
        2 * (lengths.degree + 1), (lengths.part_taps, lengths.taps), crossed))


def _profile_cost(echoes: Echoes, spacing: np.ndarray) -> np.ndarray:
    """Nanoseconds of the profiles, by the spacing of ranges."""
    n = echoes.window.n_samples
    cells = n * echoes.radar.sample_spacing_m / spacing * _USUAL_PHASES
    return costs().nanoseconds({'profile_bin': len(echoes) * n,
                                'profile_cell': len(echoes) * cells})


def plan_groups(grid: MapGrid, radar: RadarParameters, n_samples: int, tx_m: np.ndarray,
                rx_m: np.ndarray, range_m: tuple[float, float], target_db: float,
                numbers: tuple[int, int] | None = None, before: GroupPlan | None = None,
                band: PhaseHistory | None = None) -> GroupPlan | None:
    """Plan the image of a map from groups of echoes.

    Parameters
    ----------
    grid, radar, n_samples, tx_m, rx_m, target_db, band :
        As for `plan_backprojection`.
    range_m : (float, float)
        Bounds of the half paths to all pixels, metres.
    numbers : (int, int), optional
        Groups, and parts of each, for the map as a whole; the quickest if left out.
    before : GroupPlan, optional
        For as many echoes of a window before. Its numbers are taken where they make an image as
        quick as when they were sought.

    Returns
    -------
    GroupPlan or None
        None where points are as quick or no part of the map lies ahead of a group.
    """
    taps = lengths_for(target_db).taps
    slack = 2 * margin(taps) * radar.range_resolution_m
    window = band or RangeGate.around(radar, n_samples, (range_m[0] - slack, range_m[1] + slack))
    echoes = Echoes(tx_m, rx_m, radar, window, target_db)
    again = before if (before is not None and not before.rest and len(before.maps) == 1
                       and len(before.maps[0].tx) == len(echoes)) else None
    if again is not None:
        numbers = len(again.maps[0].groups), again.maps[0].n_parts
    maps: list[GroupedMap] = []
    rest: list[tuple[tuple[int, int], MapGrid]] = []
    if numbers is not None:
        maps = [one for one in [_grouped(echoes, grid, (0, 0), [numbers])] if one]
    sought_ns = sum(one.cost for one in maps) if again is None else again.sought_ns
    if numbers is None or again is not None and not (
            maps and abs(maps[0].cost - sought_ns) < _ALIKE * sought_ns):
        maps, rest = _divided(echoes, grid, (0, 0))
        sought_ns = sum(one.cost for one in maps)
    if not maps:
        return None
    n_pixels = math.prod(grid.shape)
    shares = [(one.errors_db, math.prod(one.grid.shape) / n_pixels) for one in maps]
    points = None
    if rest:
        points = plan_even_points(grid, band or RangeGate.around(radar, n_samples, range_m),
                                  tx_m, rx_m, range_m, target_db)
        shares += [(points.errors_db, math.prod(part.shape) / n_pixels) for _, part in rest]
    return GroupPlan(tuple(maps), tuple(rest), points, window, _mean_errors(shares), sought_ns)


def _mean_errors(shares: Sequence[tuple[Mapping[str, float], float]]) -> dict[str, float]:
    """Errors of a map by cause from those of its parts and their shares, dB."""
    causes = {cause: None for errors, _ in shares for cause in errors}
    mean = {cause: sum(share * 10 ** (errors.get(cause, -math.inf) / 10)
                       for errors, share in shares) for cause in causes}
    return {cause: -math.inf if error == 0 else 10 * math.log10(error)  # NaN stays
            for cause, error in mean.items()}


def _point_cost(echoes: Echoes, grid: MapGrid) -> float:
    """Nanoseconds of an image point by point."""
    return costs().nanoseconds(echoes.points.operations(len(echoes), math.prod(grid.shape)))


def _divided(echoes: Echoes, grid: MapGrid, corner: tuple[int, int]
             ) -> tuple[list[GroupedMap], list[tuple[tuple[int, int], MapGrid]]]:
    """Parts of a map from groups, and the rest, each with its corner."""
    points = _point_cost(echoes, grid)
    whole = _grouped(echoes, grid, corner)
    cost = points
    best: tuple[list[GroupedMap], list[tuple[tuple[int, int], MapGrid]]] = [], [(corner, grid)]
    if whole is not None and whole.cost < points:
        cost, best = whole.cost, ([whole], [])
    if cost < _CHEAP * points or points < _WORTH_DIVIDING_NS or max(grid.shape) < 2 * _LEAST_SIDE:
        return best
    halves = [_divided(echoes, *half) for half in _halves(grid, corner)]
    maps = [one for found, _ in halves for one in found]
    rest = [part for _, found in halves for part in found]
    divided = sum(one.cost for one in maps) + sum(_point_cost(echoes, part) for _, part in rest)
    return (maps, rest) if divided < cost else best


def _halves(grid: MapGrid, corner: tuple[int, int]) -> Iterator[tuple[MapGrid, tuple[int, int]]]:
    """Halves of a map along its longer side, and their corners."""
    (row, column), (x, y) = corner, (grid.x_m, grid.y_m)
    if grid.n_x >= grid.n_y:
        n = grid.n_x // 2
        cuts = ((0, grid.n_y), (0, n)), ((0, grid.n_y), (n, grid.n_x))
    else:
        n = grid.n_y // 2
        cuts = ((0, n), (0, grid.n_x)), ((n, grid.n_y), (0, grid.n_x))
    for (r0, r1), (c0, c1) in cuts:
        centre = 0.5 * (x[c0] + x[c1 - 1]), 0.5 * (y[r0] + y[r1 - 1]), grid.z_m
        yield MapGrid(centre, c1 - c0, r1 - r0, grid.spacing_m), (row + r0, column + c0)


def _grouped(echoes: Echoes, grid: MapGrid, corner: tuple[int, int],
             numbers: Sequence[tuple[int, int]] | None = None) -> GroupedMap | None:
    """The quickest grouping that suits, or the first of given ones; None where there is none."""
    if min(grid.shape) < echoes.lengths.taps:
        return None
    for n_groups, n_parts in itertools.islice(numbers or _seek(echoes, grid), _TRIES):
        try:
            with np.errstate(divide='ignore', invalid='ignore'):
                return _planned(echoes, grid, corner, n_groups, n_parts)
        except _Unsuited:
            continue
    return None


def _planned(echoes: Echoes, grid: MapGrid, corner: tuple[int, int], n_groups: int, n_parts: int
             ) -> GroupedMap:
    """So many groups of so many parts; _Unsuited where they do not suit or miss the target."""
    edges = echoes.edges(n_groups)
    survey = Survey(echoes, grid, edges[:-1], edges[1:])
    slope = survey.by_range[1]
    resampling = echoes.resampling(survey.pitch_m.min(), (float(slope.min()), float(slope.max())))
    grids = Grids(survey, np.full(n_groups, resampling.spacing))
    if not survey.fine.all():
        raise _Unsuited
    counts = survey.counts[:, None]
    starts = np.arange(n_parts) * counts // n_parts
    bands = Bands(survey, grids, starts)
    part = (starts[:, None] <= survey.some[..., None]).sum(axis=-1) - 1
    parts, half, parts_db = _between_parts(survey, bands, part)
    length = survey.by_range[0].reshape(-1, survey.slopes.shape[2])
    ends_db = echoes.window.mean_end_error_db(
        length, oversampling=resampling.oversampling(echoes.radar))
    # profiles that end too near spoil all routes alike
    known = [ends_db] if 10 ** (ends_db / 10) < _MOST_ENDS * echoes.target else []
    passes_db = survey.passes_db(grids.alpha_spacing, resampling.spacing)
    left = echoes.target - 10 ** (total_db(resampling.predicted_error_db, *passes_db, parts_db,
                                           *known) / 10)
    resampling, expanded = _expanded(survey, grids, resampling, starts, part, left)
    profile = survey.mean(resampling.interpolator.error_with_drift(
        np.abs(slope * resampling.spacing - resampling.cell_m)
        * (0.5 * resampling.segment / resampling.step_m)))
    errors = {
        'range profiles': 10 * math.log10(profile + expanded),
        'polar to map': 10 * math.log10(sum(10 ** (db / 10) for db in passes_db)),
        'azimuth upsampling': parts_db,
        'ends of profiles': ends_db}
    groups = _records(survey, grids, edges, half, parts)
    crossed = _crossed(survey.places, resampling.spacing, grids.alpha_spacing)
    operations = {name: float(n.sum()) for name, n in _counts(
        grid, groups, survey.n_echoes, groups['n_coarse'], n_parts, resampling.segment,
        resampling.interpolator.n_planes, (parts.n_taps, survey.along.n_taps), crossed).items()}
    operations |= {'profile_bin': len(echoes) * resampling.n_padded,
                   'profile_cell': len(echoes) * resampling.n_cells * resampling.n_phases}
    nearest, furthest = float(length.min()), float(length.max())
    slack = 2 * margin(echoes.lengths.taps) * resampling.spacing + 0.1 * (furthest - nearest)
    return GroupedMap(grid, corner, groups, bands.middle, survey.in_frames[0],
                      survey.in_frames[-1], resampling, (nearest - slack, furthest + slack),
                      survey.between, survey.along, parts, errors, operations)


def _between_parts(survey: Survey, bands: Bands, part: np.ndarray
                   ) -> tuple[Interpolator, np.ndarray, float]:
    """Interpolator between the lines of parts, half bands that it is for, (G,), and its error.

    `part`, (G, Q), are those of the looked-at echoes.
    """
    echoes = survey.echoes
    middle = bands.middle[survey.row, part][..., None]
    for found in sufficient_interpolators(echoes.parts_db, taps=echoes.lengths.part_taps,
                                          degree=DEGREE):
        half = bands.beyond(found.oversampling)
        if not survey.fine.all():
            break
        error_db = survey.error_db(found, np.pi / (found.oversampling * half), survey.few, middle,
                                   survey.bends)
        if error_db <= echoes.parts_db:
            return found, half, error_db
    raise _Unsuited


def _expanded(survey: Survey, grids: Grids, resampling: RangeResampling, starts: np.ndarray,
              part: np.ndarray, wanted: float) -> tuple[RangeResampling, float]:
    """Resampling with segments so short that expansions err by less than wanted, and by how much.

    Mean squares of what the cubics along segments leave out, see `profiles`, at the ends of parts
    and at the echoes that are looked at: those of a perturbed track lie off the line between ends.
    """
    after = np.concatenate([starts[:, 1:], survey.counts[:, None]], axis=1)
    n_parts = starts.shape[1]
    found = range_derivatives(survey.places, survey.of_echoes(np.concatenate(
        [starts, after - 1, (starts + after) // 2], axis=1)), 3)
    k, radar = survey.echoes.radar.wavenumber_rad_per_m, survey.echoes.radar
    at_ends, at_some = [], []
    for n in (1, 2, 3):
        shared, scale = found[n][:, 2 * n_parts:], k / math.factorial(n)
        at_ends.append(scale * (found[n][:, :2 * n_parts] - np.concatenate([shared] * 2, axis=1)))
        at_some.append(scale * (survey.by_range[n] - shared[survey.row, part]))
    quartic, quintic = np.maximum(_left_out(*at_ends) / 3,  # nothing in the middle: Simpson
                                  _left_out(*at_some))
    envelope = radar.half_band_rad_per_m ** 2 / 756 * survey.mean(survey.by_range[3] ** 2), 6
    others = (k / 72) ** 2 * survey.mean(survey.by_range[4] ** 2) + quartic, 8
    terms = envelope, others, (quintic, 10)
    for segment in _SEGMENTS:
        half = 0.5 * segment * resampling.spacing
        if (segment > resampling.segment or segment >= 2 * int(grids.n_range.max())
                or half > grids.longest_m):
            continue
        error = sum(term * half ** power for term, power in terms)
        if error <= wanted:
            return dataclasses.replace(resampling, segment=segment), error
    raise _Unsuited


def _left_out(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Mean squares of what a phase's expansion leaves out in fourth and fifth order, (2,).

    The phase's first to third coefficients are (G, Q, S), of echoes at the places of a map; of
    the group where it is largest.
    """
    a2, b2, ac = a * a, 0.5 * b * b, a * c
    a4, a2b2 = a2 * a2, a2 * a2 * b2
    quartic = (np.square(a4 / 24 - b2 - ac) + 0.5 * a2b2) / 128
    quintic = a2 * (a2b2 / 18 + np.square(a4 / 120 - b2 - 0.5 * ac)) / 16
    side = LOBATTO[math.isqrt(a.shape[-1])][1]
    places = np.multiply.outer(side, side).ravel()
    return np.array([(error @ places).mean(axis=1).max() for error in (quartic, quintic)])


def _records(survey: Survey, grids: Grids, edges: np.ndarray, half: np.ndarray, parts: Interpolator
             ) -> np.ndarray:
    """(G,) GROUP as kernels take them."""
    frames, found = survey.frames, np.zeros(len(survey.counts), GROUP)
    found['first'], found['end'] = edges[:-1], edges[1:]
    found['axis'], found['height_m'] = frames.axis, frames.height_m
    found['x_m'], found['y_m'] = frames.origin_m[:, 0], frames.origin_m[:, 1]
    found['track_x'], found['track_y'] = frames.track.T
    found['least'], found['n_alpha'], found['n_range'] = grids.least, grids.n_alpha, grids.n_range
    found['range_m'], found['alpha'] = grids.range_m, grids.alpha
    found['alpha_spacing'] = grids.alpha_spacing
    spacing = np.pi / (half * parts.oversampling)
    found['coarse_spacing'] = spacing
    found['coarse'] = grids.alpha - parts.n_taps // 2 * spacing
    found['n_coarse'] = _lines(grids.extent, half * parts.oversampling, parts.n_taps)
    return found


@functools.cache
def _profile_errors(degree: int) -> np.ndarray:
    """(27, 12) errors of interpolators of profiles, dB.

    For oversampling from 1.3 in steps of 0.1, and margins from 0.03 in steps of 0.05.
    """
    return np.array(known_errors()['profiles'][str(degree)])
