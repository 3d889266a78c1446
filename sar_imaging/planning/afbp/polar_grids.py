# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar grids that the fusion of AFBP works on, and the one that covers a map."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid, edge_positions
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters
from ..aliasing_error import TONES, PixelDensity, taper_band
from ..exact.illumination import WeighedPolar
from ..interpolators import NOT_READ, Interpolator, design_interpolator, margin
from ..plan import AFBP_SHARES, PASSES_DB, error_budget, remaining_db
from ..polar_cover import DEAPODISED_TAPS, DEGREE, TAPS, PolarCover, cover_map, range_axis
from ..profiles import PhaseHistory

_MAX_PIXELS = 2 ** 31  # of each grid; far beyond any memory, and safe to multiply


@dataclasses.dataclass(frozen=True)
class FusionSizes:
    """Sizes of the polar grids that sub-apertures share, coarse and fused.

    Attributes
    ----------
    n_coarse, n_fine : int
        Directions of a sub-aperture image and of the fused one over the same extent, guards
        included.
    n_guard, beta : float
        Coarse directions of each guard, and shape of the taper over it.
    n_coarse_range, n_fine_range : int
        Ranges of a sub-aperture image, and of the fused one over the same extent, guards
        included: those of `polar` lie in the middle.
    """

    polar: PolarGrid
    n_coarse: int
    n_fine: int
    n_guard: float
    beta: float
    n_coarse_range: int
    n_fine_range: int

    @property
    def extent(self) -> float:
        """Extent of both grids in direction cosine, guards included."""
        return self.n_fine * self.polar.alpha_spacing

    @property
    def fine_guard(self) -> int:
        """Fine directions of the guard before the first one of `polar`."""
        return math.ceil(self.n_guard * self.n_fine / self.n_coarse)

    @property
    def range_extent_m(self) -> float:
        """Extent of both grids in range, guards included, metres."""
        return self.n_fine_range * self.polar.range_spacing_m

    @property
    def fine_range_guard(self) -> int:
        """Fine ranges of the guard before the first one of `polar`."""
        return (self.n_fine_range - self.polar.n_range) // 2

    @property
    def range_guard(self) -> int:
        """Whole coarse ranges of each guard."""
        return self.fine_range_guard * self.n_coarse_range // self.n_fine_range

    def operations(self, n_subapertures: int) -> dict[str, float]:
        """How often fusing so many sub-aperture images does the operations of `CostModel`."""
        return {'subaperture': n_subapertures,
                'coarse_pixel': n_subapertures * self.n_coarse * self.n_coarse_range,
                'fine_pixel': self.n_fine * self.n_fine_range}


@dataclasses.dataclass(frozen=True)
class UnifiedPolarGrids(FusionSizes):
    """Polar grids that the sub-apertures of an aperture share, coarse and fused.

    Together with the middle of each sub-aperture's band it is all that `SpectrumFusion` needs:
    the plan of the backprojection stays with the first stage.

    Parameters
    ----------
    half_range : float
        Largest frequency of the images along range, relative to the carrier's, rad/m.
    carrier_hz : float
        Centre frequency of the range profiles, hertz.
    range_oversampling, alpha_oversampling : float
        By how much `polar` is sampled more finely than its image needs, to be interpolated to a
        map; both 1 where the image itself is wanted.
    propagation_speed_m_per_s : float
        Speed of the waves, metres per second.

    Raises
    ------
    ValueError
        A number is impossible, or the guards leave the plane.
    """

    half_range: float
    carrier_hz: float
    range_oversampling: float = 1.0
    alpha_oversampling: float = 1.0
    propagation_speed_m_per_s: float = SPEED_OF_LIGHT

    def __post_init__(self) -> None:
        for name in ('n_guard', 'half_range', 'carrier_hz', 'propagation_speed_m_per_s'):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueError(f'{name}={value} must be positive and finite')
        if not 0 <= self.beta <= 700:  # where the Kaiser window overflows
            raise ValueError(f'beta={self.beta}; expected 0 to 700')
        for name in ('range_oversampling', 'alpha_oversampling'):
            if not 1.0 <= getattr(self, name) < math.inf:
                raise ValueError(f'{name}={getattr(self, name)}; expected 1 or more')
        if not 0 < self.n_coarse_range <= self.n_fine_range or self.range_guard < 1:
            raise ValueError(f'n_coarse_range={self.n_coarse_range}, n_fine_range='
                             f'{self.n_fine_range}; expected at least as many fine ranges as '
                             f'coarse ones, the {self.polar.n_range} wanted ones and a guard at '
                             'either end')
        if not 2 * self.n_guard < self.n_coarse:
            raise ValueError(f'n_coarse={self.n_coarse} directions do not hold two guards of '
                             f'n_guard={self.n_guard:g}')
        if self.fine_guard + self.polar.n_alpha > self.n_fine:
            raise ValueError(f'n_fine={self.n_fine} directions do not hold the '
                             f'{self.polar.n_alpha} wanted ones and a guard')
        n_alpha = max(self.n_coarse, self.n_fine)
        if self.n_fine_range * n_alpha > _MAX_PIXELS:
            raise ValueError(f'{n_alpha} directions x {self.n_fine_range} ranges; expected at '
                             f'most {_MAX_PIXELS} pixels')
        if self.half_range > 2 * self.wavenumber_rad_per_m:
            raise ValueError(f'half_range={self.half_range:g} rad/m exceeds the carrier itself')
        self.coarse  # noqa: B018 refuses guards that leave the plane

    @functools.cached_property
    def coarse(self) -> PolarGrid:
        """Grid of the sub-aperture images: it reaches beyond `polar` by the guards.

        Raises ValueError where these leave the plane.
        """
        polar = self.polar
        try:
            return dataclasses.replace(
                polar, n_alpha=self.n_coarse, alpha_spacing=self.extent / self.n_coarse,
                alpha_start=polar.alpha_start - self.fine_guard * polar.alpha_spacing,
                n_range=self.n_coarse_range,
                range_spacing_m=self.range_extent_m / self.n_coarse_range,
                range_start_m=polar.range_start_m - self.fine_range_guard * polar.range_spacing_m)
        except ValueError as error:
            raise ValueError(f'the guards around the polar grid leave the plane: {error}; use '
                             'exact backprojection') from error

    @functools.cached_property
    def between(self) -> Interpolator | None:
        """Between lines, to a map; the spectrum is deapodised for it. None for no map."""
        if self.alpha_oversampling == 1:
            return None
        return design_interpolator(self.alpha_oversampling, taps=DEAPODISED_TAPS, degree=DEGREE,
                                   deapodised=True)

    @functools.cached_property
    def range_wavenumbers(self) -> np.ndarray:
        """(K,) float64 two-way wavenumbers K_r of the images along range, rad/m, ascending.

        Those of the carrier's bin, number K // 2, and as many on either side as the band has that
        tapers over the guards widen.
        """
        step, n = 2 * math.pi / self.range_extent_m, self.n_coarse_range
        band = self.half_range + taper_band(self.range_guard * self.coarse.range_spacing_m)
        most = min(math.ceil(band / step), (n - 1) // 2)
        # the last bin of an even number, where the fused image has the same one
        lowest = n // 2 if n == self.n_fine_range and math.ceil(band / step) > most else most
        return self.wavenumber_rad_per_m + np.arange(-lowest, most + 1) * step

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the carrier, metres."""
        return self.propagation_speed_m_per_s / self.carrier_hz

    @property
    def wavenumber_rad_per_m(self) -> float:
        """Two-way wavenumber at the carrier, radians per metre of half path."""
        return 4.0 * math.pi * self.carrier_hz / self.propagation_speed_m_per_s

    def check_contribution(self, image: np.ndarray, centre_m: float) -> None:
        """Raise ValueError for what is no image on `coarse`, or a centre that is not finite."""
        shape = self.n_coarse, self.n_coarse_range
        expected = shape if np.iscomplexobj(image) else (2, *shape)
        if image.shape != expected:
            raise ValueError(f'image.shape={image.shape}; expected {expected}')
        if not math.isfinite(centre_m):
            raise ValueError(f'centre_m={centre_m}; expected a finite number of metres')

    def check_for_map(self) -> None:
        """Raise ValueError where images are too coarse to be interpolated to a map."""
        if self.between is None:
            raise ValueError('the fused image is not sampled finely enough to be interpolated to '
                             'a map; plan it for a MapGrid')


_COVERAGE_SAMPLES, _COVERAGE_BINS = 96, 64
_MIXED_LINES = 4  # on either side
_WAVENUMBERS = 3  # of the band
_ECHOES = 256


def cover_for_fusion(grid: MapGrid, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
                     n_samples: int, target_db: float, band: PhaseHistory | None = None,
                     shares: Mapping[str, float] = AFBP_SHARES,
                     illumination: Illumination | None = None) -> tuple[PolarCover, float]:
    """Cover a map by the polar grid of an image that AFBP fuses.

    Parameters
    ----------
    grid, radar, n_samples, band :
        As for `cover_map`.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    target_db : float
        Wanted error of the map against time-domain correlation, dB.
    shares : mapping
        Shares of the target, see `error_budget`: the less ``'polar to map'``, the finer the polar
        grid.
    illumination : Illumination, optional
        Illumination of the P C echoes.

    Returns
    -------
    cover : PolarCover
    polar_db : float
        What the interpolation to the map leaves of the target for the polar image, dB.

    Raises
    ------
    ValueError
        The map is tiny, too near, all around, or not ahead of the aperture.
    """
    step = max(1, len(tx_m) // _ECHOES)
    tx, rx = (np.concatenate([a[:-1:step], a[-1:]]).reshape(-1, 3) for a in (tx_m, rx_m))
    radar = radar if band is None else band.radar
    map_db = error_budget(target_db, shares)['polar to map'] - PASSES_DB

    def cover_of(error_db: float, pulses: Illumination | None = None) -> PolarCover | None:
        return cover_map(grid, tx, rx, radar, n_samples, error_db, min(target_db - 10.0, -50.0),
                         band, fused=True, illumination=pulses)

    if illumination is not None:
        number = np.arange(len(illumination.centre_m)).reshape(len(tx_m), -1)
        illumination = illumination.select(np.concatenate(
            [number[:-1:step], number[-1:]]).ravel())
    cover = _weighed_cover(cover_of, map_db, tx, rx, radar, illumination) if illumination else (
        cover_of(map_db))
    if cover is None:
        raise ValueError('the map is too small, too near, around or beside the aperture for a '
                         'polar image; use exact backprojection')
    if cover.polar_to_map_db >= target_db:
        raise ValueError(f'amplitudes change too abruptly between the lines of a polar image for '
                         f'target_db={target_db:g}; use exact backprojection')
    return cover, remaining_db(target_db, cover.polar_to_map_db)


def _weighed_cover(cover_of: Callable[[float, Illumination], PolarCover | None], error_db: float,
                   tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
                   illumination: Illumination) -> PolarCover | None:
    """Cover, and what reading amplitudes errs; ``cover_of(error_db, illumination)`` gives one."""
    planner = WeighedPolar(illumination, tx_m, rx_m, radar)
    found = planner.cover(lambda wanted: cover_of(wanted, illumination), error_db)
    if found is not None:
        return found
    # The narrow band of what is lit needs few ranges, along which paths may bend too much.
    every = dataclasses.replace(illumination, foreseen=True)
    return planner.cover(lambda wanted: cover_of(wanted, every), error_db)


def map_density(polar: PolarGrid, cover: PolarCover) -> PixelDensity:
    """How densely what is read for the pixels of a map fills the lines and ranges of its cover.

    `polar` is that of `cover` or, for images of parts of the track, one with fewer lines.
    """
    x, y = (np.linspace(v[0], v[-1], _COVERAGE_SAMPLES)
            for v in (cover.grid.x_m, cover.grid.y_m))
    r, alpha = polar.from_map(*(v.ravel() for v in np.meshgrid(x, y)))
    along_alpha, along_range = (
        _COVERAGE_BINS / len(r) * _counts((v - start) / (n * spacing), _COVERAGE_BINS)
        for v, start, n, spacing in (
            (alpha, polar.alpha_start, polar.n_alpha, polar.alpha_spacing),
            (r, polar.range_start_m, polar.n_range, polar.range_spacing_m)))
    # What the spectrum's correction for the interpolation between lines mixes is read, too.
    beside = math.ceil(_MIXED_LINES / polar.n_alpha * _COVERAGE_BINS)
    spread = np.convolve(along_alpha, np.full(2 * beside + 1, 1 / (2 * beside + 1)), 'same')
    return PixelDensity(spread / spread.mean(), along_range, cover.between, _tones(polar, cover))


def _counts(place: np.ndarray, n: int, weights: np.ndarray | None = None) -> np.ndarray:
    """(n,) how many of places, or their weights, lie in each of n equal parts from 0 to 1."""
    part = np.floor(place * n).astype(np.intp).ravel() + 1  # of parts beside them, too
    return np.bincount(np.clip(part, 0, n + 1, out=part), weights, n + 2)[1:-1]


def _tones(polar: PolarGrid, cover: PolarCover) -> np.ndarray:
    """Power of the image by cycles per line, as `PixelDensity` has it."""
    k = np.linspace(*cover.window.radar.wavenumbers_rad_per_m, _WAVENUMBERS)[:, None, None]
    cycles = np.abs(k * cover.slope_alpha) * (polar.alpha_spacing / (2 * math.pi))
    if cycles.max() > 0.5:  # images of parts of the track, which may lie anywhere in its band
        even = (np.arange(TONES) < TONES / cover.between.oversampling).astype(float)
        return even / even.sum()
    weight = np.broadcast_to(cover.weight[0][:, None], cycles.shape)
    power = _counts(cycles / 0.5, TONES, weight.ravel())
    return power / power.sum()


def covers(polar: PolarGrid, grid: MapGrid) -> bool:
    """True when a polar grid reaches as far beyond a map as interpolation reads."""
    if grid.z_m != polar.z_m or min(grid.shape) < TAPS:
        return False
    axis, reach = range_axis(polar, grid), margin(TAPS) - NOT_READ
    corners = np.array([[x, y] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
    offset = corners - polar.origin_m[:2]
    ahead = offset[:, axis]
    if (offset @ polar.across).min() <= 0 or ahead.min() * ahead.max() <= 0:
        return False
    r, alpha = edge_positions(grid, polar.origin_m, polar.track, axis,
                              reach * polar.range_spacing_m)
    axes = (((r - polar.range_start_m) / polar.range_spacing_m, polar.n_range, reach),
            ((alpha - polar.alpha_start) / polar.alpha_spacing, polar.n_alpha,
             margin(DEAPODISED_TAPS) - NOT_READ))
    return all(read <= v.min() and v.max() <= n - read - 1 for v, n, read in axes)
