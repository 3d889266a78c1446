# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar image of a block: its grid, its parts, how its lines read the profiles, and what it costs.

On unified polar coordinates around the aperture centre the half path is nearly the range itself,
so that image lines read the profiles in step.

A short part of the aperture makes an image that varies slowly with direction once the phase of its
middle is taken off, so a few lines suffice. Parts are backprojected onto such coarse lines and
interpolated to the lines of the common polar grid, which they share in range: the interpolation is
one-dimensional, its weights are constant along a line, and its error is known.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.half_paths import Paths, sample_paths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...memory import IMAGE_BYTES
from ...signal.radar import RadarParameters
from ..costs import costs
from ..echo_power import spread_frequencies, tail_error
from ..interpolators import Interpolator, sufficient_interpolators
from ..plan import EXACT_SHARES, PASSES_DB, Plan, error_budget
from ..polar_cover import PolarCover, cover_map
from ..profiles import (
    PhaseHistory,
    RangeGate,
    RangeResampling,
    echoes_for_means,
    plan_resampling,
    resampling_error_db,
)

if TYPE_CHECKING:
    from ...geometry.grids import EvenGrid
    from .illumination import LineAmplitudes
    from .points import ImagePoints

TAPS, DEGREE = 10, 5
_LEAST_ECHOES = 4  # in a part
_WAVENUMBERS = 5  # of the band, at which errors are looked up


@dataclasses.dataclass(frozen=True)
class AzimuthParts:
    """Cut of the echoes of a block into parts, and the coarse lines on which they are imaged.

    Attributes
    ----------
    echoes : tuple of slice
        Echoes of each part.
    frequency : (n_parts,) float64
        Middle of the band of each part's image along direction, radians per unit of alpha.
    coarse, fine : PolarGrid
        Grids of the parts and of their sum; they differ in direction only.
    interpolator : Interpolator
        From coarse to fine lines.
    error_db : float
        Error of the interpolation, dB.
    cost : float
        Nanoseconds per pixel of the sum.
    """

    echoes: tuple[slice, ...]
    frequency: np.ndarray
    coarse: PolarGrid
    fine: PolarGrid
    interpolator: Interpolator
    error_db: float
    cost: float


def plan_parts(cover: PolarCover, wanted_db: float) -> AzimuthParts | None:
    """Cut echoes into as many parts as make a polar image quickest; None where that gains nothing.

    `wanted_db` is the error of the interpolation from the lines of the parts to those of the sum.
    """
    for interpolator in sufficient_interpolators(wanted_db, taps=TAPS, degree=DEGREE):
        best = _quickest_parts(cover, interpolator)
        if best is None:
            return None
        error_db = _interpolation_db(best, cover)
        # Much power may lie where bands end: parts have few echoes, or the platform stopped.
        if error_db <= wanted_db:
            return dataclasses.replace(best, error_db=error_db)
    return None


def _quickest_parts(cover: PolarCover, interpolator: Interpolator) -> AzimuthParts | None:
    fine, slope, echo_cost = cover.polar, cover.slope_alpha, cover.resampling.cost
    lowest, highest = cover.window.radar.wavenumbers_rad_per_m
    best, least = None, echo_cost * len(slope)
    n_parts = 2
    while n_parts * _LEAST_ECHOES <= len(slope):
        # Bands of the parts, radians per unit of alpha
        edges = np.linspace(0, len(slope), n_parts + 1).round().astype(int)
        lo = np.minimum.reduceat(slope.min(axis=1), edges[:-1])
        hi = np.maximum.reduceat(slope.max(axis=1), edges[:-1])
        lo, hi = np.minimum(lowest * lo, highest * lo), np.maximum(lowest * hi, highest * hi)
        lo, hi = lo - cover.spread.rms, hi + cover.spread.rms
        half = 0.5 * float((hi - lo).max())
        coarse = _coarse_grid(fine, math.pi / (half * interpolator.oversampling))
        if coarse is not None:
            merging = n_parts * (costs().upsampled_pixel
                                 + costs().upsampled_part / (fine.n_alpha * fine.n_range))
            cost = merging + echo_cost * len(slope) * (coarse.n_alpha / fine.n_alpha)
            if cost < least:
                least, best = cost, AzimuthParts(
                    tuple(map(slice, edges[:-1], edges[1:])), 0.5 * (lo + hi), coarse, fine,
                    interpolator, interpolator.error_db, cost)
        n_parts = math.ceil(n_parts * 1.4)
    return best


def _interpolation_db(parts: AzimuthParts, cover: PolarCover) -> float:
    """Mean error at the frequencies of the echoes, seen from the middle of their part's band."""
    some = echoes_for_means(len(cover.slope_alpha))
    middle = np.repeat(parts.frequency, [e.stop - e.start for e in parts.echoes])[some]
    k = np.linspace(*cover.window.radar.wavenumbers_rad_per_m, _WAVENUMBERS)[:, None, None]
    per_radian = parts.coarse.alpha_spacing / (2 * math.pi)
    even = k * cover.slope_alpha[some] - middle[:, None]
    error_db = parts.interpolator.mean_error_db(
        spread_frequencies(even, cover.spread.rms) * per_radian, cover.weight[:, some])
    tail = tail_error(cover.spread, even, lambda f: parts.interpolator.error_at(f * per_radian),
                      some)
    return 10 * math.log10(10 ** (error_db / 10) + tail) if tail else error_db


def _coarse_grid(fine: PolarGrid, spacing: float) -> PolarGrid | None:
    """Lines at a spacing that cover the fine ones and the interpolator's reach."""
    beyond = TAPS // 2
    n_alpha = math.ceil((fine.n_alpha - 1) * fine.alpha_spacing / spacing) + 2 * beyond + 1
    if n_alpha >= fine.n_alpha:
        return None
    try:
        return dataclasses.replace(fine, n_alpha=n_alpha, alpha_spacing=spacing,
                                   alpha_start=fine.alpha_start - beyond * spacing)
    except ValueError:
        return None


_SAMPLES_PER_SIDE = 5  # positions at which the geometry is bounded


@dataclasses.dataclass(frozen=True, eq=False)
class PolarPlan(Plan):
    """Polar image of a block that meets an error target on the map.

    Attributes
    ----------
    resampling : RangeResampling
        How its lines read the profiles.
    window : RangeGate or PhaseHistory
        Part of the profiles that it needs.
    axis : int
        Map axis along which the second pass of the resampling goes.
    between, along : Interpolator
        Of the resampling: between lines and along them.
    parts : AzimuthParts or None
        Cut into parts with fewer lines each; None where all echoes go straight to `polar`.
    cost : float
        Nanoseconds per map pixel.
    amplitudes : LineAmplitudes or None
        Nodes of the echoes' amplitudes; None where all pixels are lit alike.
    """

    polar: PolarGrid
    resampling: RangeResampling
    window: RangeGate | PhaseHistory
    range_m: tuple[float, float]
    axis: int
    between: Interpolator
    along: Interpolator
    parts: AzimuthParts | None
    wavelength_m: float
    errors_db: Mapping[str, float]
    cost: float
    amplitudes: LineAmplitudes | None = None

    method = 'polar'

    @property
    def projected(self) -> PolarGrid:
        """Grid onto whose lines echoes are projected: that of the image or of its parts."""
        return self.polar if self.parts is None else self.parts.coarse

    def operations(self, grid: EvenGrid | ImagePoints, n_echoes: int) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        n_parts = 0 if self.parts is None else len(self.parts.echoes)
        share = 1.0 if self.amplitudes is None else self.amplitudes.share
        return {'image': 1, 'map_pixel': math.prod(grid.shape), 'upsampled_part': n_parts,
                'upsampled_pixel': n_parts * math.prod(self.polar.shape),
                **self.resampling.operations(n_echoes, math.prod(self.projected.shape) * share)}

    def n_bytes(self, grid: EvenGrid | ImagePoints) -> int:
        """Memory that adding the echoes takes besides the image, bytes."""
        n_bytes = 0 if self.amplitudes is None else self.amplitudes.n_bytes(
            *self.projected.shape, self.resampling.segment, 1)
        return IMAGE_BYTES * math.prod(self.polar.shape) + n_bytes

    def __str__(self) -> str:
        n = 1 if self.parts is None else len(self.parts.echoes)
        return (f'pulses are added to a polar image of {self.polar.n_alpha} x '
                f'{self.polar.n_range} pixels in {n} part{"s" * (n > 1)}, which is interpolated '
                'to the map')


def plan_polar(grid: MapGrid, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
               n_samples: int, target_db: float, illumination: Illumination | None = None,
               band: PhaseHistory | None = None) -> PolarPlan | None:
    """Plan the polar image of echoes of phase centres; arguments as of `plan_backprojection`.

    Returns
    -------
    PolarPlan or None
        None where the map is tiny, too near, all around, or not ahead of the aperture.
    """
    budget, planner = error_budget(target_db, EXACT_SHARES), None
    profiles_db, map_db = budget['range profiles'], budget['polar to map'] - PASSES_DB
    cover_of = functools.partial(cover_map, grid, tx_m, rx_m, radar, n_samples, band=band,
                                 profiles_db=profiles_db, illumination=illumination)
    if illumination is not None:
        from .illumination import WeighedPolar

        planner = WeighedPolar(illumination, tx_m, rx_m, radar)
    cover = planner.cover(cover_of, map_db) if planner else cover_of(map_db)
    if cover is None:
        return None
    polar, n_pixels = cover.polar, grid.n_x * grid.n_y
    if polar.n_range * polar.n_alpha > 3 * n_pixels + 100_000:
        return None
    parts_of, parts_db = functools.partial(plan_parts, cover), budget['azimuth upsampling']
    parts = planner.parts(parts_of, parts_db) if planner else parts_of(parts_db)
    resampling = None
    if parts is not None:
        resampling = _resampling_of_parts(parts, cover, tx_m, rx_m, profiles_db, illumination)
    if resampling is None:
        resampling, parts = cover.resampling, None
    amplitudes, lines = None, polar if parts is None else parts.coarse
    if planner:
        resampling, amplitudes = planner.lines(lines, resampling, parts, profiles_db,
                                        budget['illumination'])
        if resampling is None:
            return None
    errors = {'range profiles': resampling.predicted_error_db,
              'polar to map': cover.polar_to_map_db, 'ends of profiles': cover.profile_db}
    cost = resampling.cost * len(tx_m)
    if parts is not None:
        errors['azimuth upsampling'], cost = parts.error_db, parts.cost
    if amplitudes is not None:
        errors['illumination'] = amplitudes.predicted_error_db
        echo_cost = resampling.cost * len(tx_m) * lines.n_alpha / polar.n_alpha
        cost -= echo_cost * (1 - amplitudes.share)
    return PolarPlan(polar, resampling, cover.window, cover.range_m, cover.axis, cover.between,
                     cover.along, parts, radar.wavelength_m, errors,
                     cost * (polar.n_range * polar.n_alpha / n_pixels) + costs().map_pixel,
                     amplitudes)


def _sampled_paths(polar: PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray,
                   illumination: Illumination | None) -> Paths:
    """Half paths to samples of a grid, and which echoes light these."""
    lines = polar.lines(*polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE))
    paths = sample_paths(tx_m, rx_m, lines)
    return paths if illumination is None else illumination.of_paths(paths, lines[0])


def _resampling_of_parts(parts: AzimuthParts, cover: PolarCover, tx_m: np.ndarray,
                         rx_m: np.ndarray, target_db: float, illumination: Illumination | None
                         ) -> RangeResampling | None:
    """Range grid that is as good where echoes are added part by part, to lines far beyond the map.

    That of the map where it will do, None where none does.
    """
    coarse, window = parts.coarse, cover.window
    paths = dataclasses.replace(_sampled_paths(coarse, tx_m, rx_m, illumination),
                                parts=tuple(echoes.start for echoes in parts.echoes),
                                weight=cover.weight)
    error_db = resampling_error_db(cover.resampling, paths, window.radar)
    if error_db <= target_db:
        return dataclasses.replace(cover.resampling, predicted_error_db=error_db)
    return plan_resampling(paths, coarse.range_spacing_m, coarse.n_range, window.radar,
                           window.n_samples, target_db, periodic=window.periodic)
