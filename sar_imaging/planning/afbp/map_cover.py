"""Polar grid that covers a map for an image that AFBP fuses, and what of it is wanted."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.illumination import Illumination
from ...geometry.map_edges import edge_positions
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..aliasing_error import TONES, PixelDensity
from ..error_budget import AFBP_SHARES, PASSES_DB, error_budget, remaining_db
from ..exact.lit_polar import LitPolar
from ..polar_cover import PolarCover, cover_map
from ..polar_to_map import DEAPODISED_TAPS, NOT_READ, TAPS, margin, range_axis
from ..profiles.phase_history import PhaseHistory

_COVERAGE_SAMPLES, _COVERAGE_BINS = 256, 64
_MIXED_LINES = 4  # on either side
_WAVENUMBERS = 7  # of the band
_ECHOES = 256


def cover_for_fusion(grid: MapGrid, tx_m, rx_m, radar: RadarParameters, n_samples: int,
                     target_db: float, band: PhaseHistory | None = None,
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
        Of the target, see `error_budget`: the less ``'polar to map'``, the finer the polar grid.
    illumination : Illumination, optional
        Of the P C echoes.

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
    echoes = [np.concatenate([a[:-1:step], a[-1:]]).reshape(-1, 3) for a in (tx_m, rx_m)]
    radar = radar if band is None else band.radar
    map_db = error_budget(target_db, shares)['polar to map'] - PASSES_DB

    def cover_of(error_db, lit=None):
        return cover_map(grid, *echoes, radar, n_samples, error_db, min(target_db - 10.0, -50.0),
                         band, fused=True, illumination=lit)

    if illumination is not None:
        number = np.arange(len(illumination.centre_m)).reshape(len(tx_m), -1)
        illumination = illumination.select(np.concatenate(
            [number[:-1:step], number[-1:]]).ravel())
    cover = _lit_cover(cover_of, map_db, *echoes, radar, illumination) if illumination else (
        cover_of(map_db))
    if cover is None:
        raise ValueError('the map is too small, too near, around or beside the aperture for a '
                         'polar image; use exact backprojection')
    if cover.resampling_db >= target_db:
        raise ValueError(f'amplitudes change too abruptly between the lines of a polar image for '
                         f'target_db={target_db:g}; use exact backprojection')
    return cover, remaining_db(target_db, cover.resampling_db)


def _lit_cover(cover_of, error_db: float, tx_m, rx_m, radar, illumination) -> PolarCover | None:
    """Cover, and what reading amplitudes errs; ``cover_of(error_db, illumination)`` gives one."""
    planner = LitPolar(illumination, tx_m, rx_m, radar)
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
        _COVERAGE_BINS / len(r)
        * np.histogram((v - start) / (n * spacing), _COVERAGE_BINS, (0.0, 1.0))[0]
        for v, start, n, spacing in (
            (alpha, polar.alpha_start, polar.n_alpha, polar.alpha_spacing),
            (r, polar.range_start_m, polar.n_range, polar.range_spacing_m)))
    # What the spectrum's correction for the interpolation between lines mixes is read, too.
    beside = math.ceil(_MIXED_LINES / polar.n_alpha * _COVERAGE_BINS)
    spread = np.convolve(along_alpha, np.full(2 * beside + 1, 1 / (2 * beside + 1)), 'same')
    return PixelDensity(spread / spread.mean(), along_range, cover.between, _tones(polar, cover))


def _tones(polar: PolarGrid, cover: PolarCover) -> np.ndarray:
    """Power of the image by cycles per line, as `PixelDensity` has it."""
    k = np.linspace(*cover.window.radar.wavenumbers_rad_per_m, _WAVENUMBERS)[:, None, None]
    cycles = np.abs(k * cover.slope_alpha) * (polar.alpha_spacing / (2 * math.pi))
    if cycles.max() > 0.5:  # images of parts of the track, which may lie anywhere in its band
        even = (np.arange(TONES) < TONES / cover.between.oversampling).astype(float)
        return even / even.sum()
    weight = np.broadcast_to(cover.weight[0][:, None], cycles.shape)
    power = np.histogram(cycles, TONES, (0.0, 0.5), weights=weight)[0]
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
