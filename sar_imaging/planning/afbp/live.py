# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plan of an aperture by AFBP while its pulses arrive, from a track that is foreseen.

The fused image is sampled for the local frequencies of the foreseen track. Those of the track that
was flown may lie where the interpolation errs more: beyond its band, or all at one end of it. And
profiles may end elsewhere on the map than foreseen.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ...geometry.grids import MapGrid
from ...geometry.half_paths import Paths, half_paths, sample_paths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..echo_power import echo_powers
from ..interpolators import Interpolator, margin
from ..plan import LIVE_SHARES, remaining_db, total_db
from ..polar_cover import DEAPODISED_TAPS, PolarCover
from .plan import AfbpPlan, check_arguments
from .polar_grids import cover_for_fusion
from .subapertures import LocalSpectrum, SubaperturePlan, local_spectrum, plan_subapertures

_SAMPLES_PER_SIDE = 5  # map positions at which errors are looked up
_WAVENUMBERS = 5  # of the band
_PULSES = 64  # of a sub-aperture or a window


def reading_db(cover: PolarCover, polar: PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray,
               illumination: Illumination | None = None, *, centred: bool = False) -> float:
    """Mean error of both passes of the interpolation to a map, relative to the echoes' power, dB.

    Parameters
    ----------
    cover : PolarCover
        Cover of the map, with the interpolators.
    polar : PolarGrid
        Polar grid of the fused image: that of `cover`, or one with fewer lines.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres that were flown, metres.
    illumination : Illumination, optional
        Illumination of the P C echoes; pixels that they do not light stay out.
    centred : bool
        The image is read at baseband along direction, as those of sliding apertures are.
    """
    (tx_m, rx_m), (r, alpha), lines, paths = _of_some_echoes(cover, polar, tx_m, rx_m,
                                                            illumination)
    slope_alpha = half_paths(tx_m, rx_m, lines[0], polar.by_direction(r, alpha))[1]
    # along a line of the map the direction changes with range, too
    ahead = (lines[0][:, cover.axis] - polar.origin_m[cover.axis]) / r
    alpha_by_range = (polar.track[cover.axis] / ahead - alpha) / r
    radar = cover.window.radar
    k = np.linspace(*radar.wavenumbers_rad_per_m, _WAVENUMBERS)[:, None, None]
    along_range = (k * (paths.derivatives[0] + slope_alpha * alpha_by_range)
                   - radar.wavenumber_rad_per_m)
    along_alpha = k * slope_alpha
    if centred:
        along_alpha -= (0.5 * (slope_alpha.min() + slope_alpha.max())
                        * radar.wavenumber_rad_per_m)
    weight = echo_powers(tx_m, rx_m, cover.grid.centre_m, cover.grid.spacing_m * np.array(
        [[cover.grid.n_x, 0, 0], [0, cover.grid.n_y, 0]]), radar)
    return total_db(*(
        interpolator.mean_error_db(
            paths.with_illuminated(frequency) * (spacing / (2 * np.pi)), weight)
        for interpolator, frequency, spacing in (
            (cover.between, along_alpha, polar.alpha_spacing),
            (cover.along, along_range, polar.range_spacing_m))))


def ends_db(cover: PolarCover, polar: PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray,
            illumination: Illumination | None = None) -> float:
    """Error on the map because profiles end, dB; arguments as of `reading_db`."""
    paths = _of_some_echoes(cover, polar, tx_m, rx_m, illumination)[-1]
    return cover.window.mean_end_error_db(
        paths.length, oversampling=cover.resampling.oversampling(cover.window.radar),
        illuminated=paths.illuminated)


def _of_some_echoes(cover: PolarCover, polar: PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray,
                    illumination: Illumination | None
                    ) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray],
                               tuple[np.ndarray, ...], Paths]:
    """Of samples of the map, seen by echoes of some pulses.

    Phase centres, two (R, 3); range and direction, (S,) each; positions and derivatives of the
    lines; `Paths` of them all.
    """
    step = max(1, len(tx_m) // _PULSES)
    if illumination is not None:
        number = np.arange(len(illumination.centre_m)).reshape(len(tx_m), -1)
        illumination = illumination.select(number[::step].ravel())
    centres = tx_m[::step].reshape(-1, 3), rx_m[::step].reshape(-1, 3)
    place = polar.from_map(*(v.ravel() for v in np.meshgrid(*(
        np.linspace(v[0], v[-1], _SAMPLES_PER_SIDE) for v in (cover.grid.x_m, cover.grid.y_m)))))
    lines = polar.lines(*place)
    paths = sample_paths(*centres, lines)
    if illumination is not None:
        paths = illumination.of_paths(paths, lines[0])
    return centres, place, lines, paths


_ROWS_FOR_COVER = 256
_WINDOWS = 9
_FUSION_MARGIN_DB = 3.0  # for tracks that are less smooth than foreseen
_UNLIKE_DB = 10.0  # by which amplitudes of a sub-aperture may err more than those of all
_LEAST = 1e-16
_PARTS = 8  # sub-apertures of which the error of reading the map is looked up
_EXTENSION = 0.05  # of the aperture at both ends, for what is foreseen too short


@dataclasses.dataclass(frozen=True, eq=False)
class LivePlan(AfbpPlan):
    """How the sub-apertures of an aperture are imaged while their pulses arrive.

    Attributes
    ----------
    length : int
        Pulses of a sub-aperture.
    limit_db : float
        Largest error of a sub-aperture on the polar grid that keeps the target, dB; infinite
        where the track was known.
    map_cover : PolarCover
        How the map is read.
    reading_limit_db : float
        Largest error of reading the map that keeps the target, or that of the worst foreseen
        sub-aperture, likewise.
    """

    grid: MapGrid
    length: int
    limit_db: float
    map_cover: PolarCover
    reading_limit_db: float

    def __str__(self) -> str:
        fusion = self.subapertures.fusion_grid
        return (f'sub-apertures of {self.length} pulses on {fusion.n_coarse} x '
                f'{fusion.coarse.n_range} pixels, fused to {fusion.polar.n_alpha} x '
                f'{fusion.polar.n_range}')

    def check(self, tx_m: np.ndarray, rx_m: np.ndarray, illumination: Illumination | None = None,
              window: tuple[np.ndarray, np.ndarray] | None = None
              ) -> tuple[float, float, float] | None:
        """Middle of the band of a sub-aperture, metres, its error on the map and its power, dB.

        As `SubaperturePlan.check`, from its real phase centres, (P, C, 3) float64, metres. None
        where the track or the pointing differs so much that the error may exceed the target;
        never where they had been known. Both are relative to the mean power of the
        sub-apertures, which illumination makes unlike. `window` holds the phase centres, two
        arrays likewise, of the sliding aperture that ends with the sub-aperture.
        """
        plan = self.subapertures
        if window is None:
            reading = reading_db(self.map_cover, plan.polar, tx_m, rx_m, illumination)
        else:
            reading = reading_db(self.map_cover, plan.polar, *window, centred=True)
        try:
            centre_m, error_db, within = plan.check(tx_m, rx_m, illumination)
        except ValueError:
            return None
        worst_db, power_db = error_db, 0.0
        if illumination is not None:
            amplitudes = plan.amplitudes
            assert amplitudes is not None  # planned with illumination
            power, weighing = amplitudes.of_subaperture(plan.polar, plan.radar, tx_m, rx_m,
                                                             illumination)
            amplitudes_db, power_db = (10 * math.log10(v + _LEAST) for v in (weighing, power))
            if amplitudes.lines is not None:  # between nodes they err at least as planned
                amplitudes_db = max(amplitudes_db, power_db + amplitudes.predicted_error_db)
            # The brightest may err more. Of sub-apertures of a length that was asked for,
            # amplitudes may err as planned.
            worst_db = max(error_db + min(power_db, 0.0), min(
                amplitudes_db, amplitudes_db - amplitudes.predicted_error_db
                + self.limit_db - _UNLIKE_DB))
            error_db = total_db(error_db + power_db, amplitudes_db)
            reading += power_db
        if (worst_db > self.limit_db or reading > self.reading_limit_db
                or not (within or math.isinf(self.limit_db))):
            return None
        ends = ends_db(self.map_cover, plan.polar, tx_m, rx_m, illumination)
        return centre_m, total_db(error_db, reading, ends + power_db), power_db


def extension(n_pulses: int, length: int, slack: float) -> tuple[int, int]:
    """Pulses by which to extend an aperture at its start and end, to whole sub-apertures.

    The aperture has `n_pulses`, a sub-aperture `length`; `slack` is times the usual extension.
    """
    least = math.ceil(slack * _EXTENSION * n_pulses)
    extra = math.ceil((n_pulses + 2 * least) / length) * length - n_pulses
    return extra // 2, extra - extra // 2


def plan_live(grid: MapGrid, radar: RadarParameters, n_samples: int, tx_m: np.ndarray,
              rx_m: np.ndarray, *, target_db: float, pulses_per_subaperture: int | None = None,
              slack: float = 1.0, n_window: int = 0, illumination: Illumination | None = None
              ) -> LivePlan:
    """Plan the sub-apertures of an aperture before its pulses came; arguments as of `plan_afbp`.

    `tx_m` and `rx_m` are phase centres as foreseen, extended at both ends (`extension`).

    Parameters
    ----------
    grid, radar, n_samples, tx_m, rx_m, target_db, pulses_per_subaperture :
        As for `plan_afbp`.
    slack : float
        Times the usual margin for deviations from the track; 0 for a track that is known.
    n_window : int
        Pulses of an image, where that is of any part of the track; 0 for the whole of it.
    illumination : Illumination, optional
        Illumination of the echoes, foreseen as these are.

    Raises
    ------
    ValueError
        The geometry does not allow the target.
    """
    check_arguments(grid, target_db, tx_m, rx_m)
    cover, polar_db = cover_for_fusion(grid, tx_m, rx_m, radar, n_samples, target_db,
                                       shares=LIVE_SHARES, illumination=illumination)
    margin_db = min(slack, 2.0) * _FUSION_MARGIN_DB

    def planned(n_pulses: int) -> SubaperturePlan:
        polar = cover.polar if not n_pulses else _for_windows(
            cover.polar, radar, tx_m, rx_m, n_pulses, cover.between.oversampling)
        return plan_subapertures(polar, radar, n_samples, tx_m, rx_m,
                                 target_db=polar_db - margin_db, cover=cover,
                                 pulses_per_subaperture=pulses_per_subaperture,
                                 illumination=illumination)

    plan = planned(n_window)
    # Where another length was asked for, gaps of the foreseen track made these shorter.
    length = pulses_per_subaperture or max(p.stop - p.start for p in plan.sampling.pulses)
    if n_window % length:  # windows are whole sub-apertures
        plan = planned(-(-n_window // length) * length)
    if n_window:
        cover = dataclasses.replace(cover, between_db=_windows_db(
            plan.polar, radar, tx_m, rx_m, n_window, cover.between))
    # Where bands end, sub-apertures that are flown as foreseen err more than their mean, too.
    parts: Sequence[slice] = plan.sampling.pulses[::math.ceil(len(plan.sampling.pulses) / _PARTS)]
    parts = (*parts, plan.sampling.pulses[-1]) if not n_window else [
        slice(first, first + n_window) for first in _first_of_windows(len(tx_m) - n_window)]
    worst_db = max(cover.polar_to_map_db, *(
        reading_db(cover, plan.polar, tx_m[part], rx_m[part], centred=bool(n_window))
        for part in parts))
    reading_limit_db = max(remaining_db(target_db, total_db(*plan.errors_db.values())),
                           worst_db)
    return LivePlan.of(grid, tx_m, rx_m, plan, cover, length=length,
                       limit_db=polar_db if slack else math.inf, map_cover=cover,
                       reading_limit_db=reading_limit_db if slack else math.inf)


def _for_windows(polar: PolarGrid, radar: RadarParameters, tx_m: np.ndarray, rx_m: np.ndarray,
                 n_window: int, oversampling: float) -> PolarGrid:
    """A polar grid with as many directions as images of windows of the track need.

    At baseband along direction their band is that of the window, wherever that lies.
    """
    bands, width = _bands_of_some(polar, radar, tx_m, rx_m, n_window)
    slope = (bands.slope * bands.growth).reshape(-1, rx_m.shape[1] * bands.slope.shape[1])
    # Every window: where a track turns back, their bands differ much.
    low = minimum_filter1d(slope.min(axis=1), width, mode='nearest')
    high = maximum_filter1d(slope.max(axis=1), width, mode='nearest')
    # the carrier's phase is taken away, what the rest of the band has of it remains
    rest = 0.5 * np.ptp(bands.wavenumber) * np.abs(low + high) / 2
    half = float((bands.wavenumber[1] * 0.5 * (high - low) + rest).max())
    spacing = max(math.pi / (half * oversampling), polar.alpha_spacing)
    beyond = margin(DEAPODISED_TAPS)
    first = polar.alpha_start + beyond * polar.alpha_spacing
    extent = (polar.n_alpha - 2 * beyond) * polar.alpha_spacing
    return dataclasses.replace(
        polar, alpha_start=first - beyond * spacing, alpha_spacing=spacing,
        n_alpha=math.ceil(extent / spacing) + 2 * beyond)


def _windows_db(polar: PolarGrid, radar: RadarParameters, tx_m: np.ndarray, rx_m: np.ndarray,
                n_window: int, between: Interpolator) -> float:
    """Error of the interpolation between lines in the worst of some windows, dB."""
    bands, width = _bands_of_some(polar, radar, tx_m, rx_m, n_window)
    n_channels, worst_db = rx_m.shape[1], -math.inf
    k = np.linspace(*bands.wavenumber, _WAVENUMBERS)[:, None, None]
    for first in _first_of_windows(len(bands.slope) // n_channels - width):
        echoes = slice(first * n_channels, (first + width) * n_channels)
        slope, weight = bands.slope[echoes], bands.weight[:, echoes]
        along_range = k * bands.growth[echoes]
        middle = 0.5 * (slope.min() + slope.max()) * radar.wavenumber_rad_per_m
        worst_db = max(worst_db, between.mean_error_db(
            (along_range * slope - middle) * (polar.alpha_spacing / (2 * math.pi)), weight))
    return worst_db


def _first_of_windows(last: int) -> np.ndarray:
    """First pulses of some windows, from that of the first one, 0, to that of the last, int64."""
    return np.unique(np.linspace(0, max(last, 0), _WINDOWS).astype(int))


def _bands_of_some(polar: PolarGrid, radar: RadarParameters, tx_m: np.ndarray, rx_m: np.ndarray,
                   n_window: int) -> tuple[LocalSpectrum, int]:
    """Local frequencies of some pulses of a track, and how many of these a window has."""
    step = max(1, len(tx_m) // _ROWS_FOR_COVER)
    tx_m, rx_m = tx_m[::step], rx_m[::step]
    return local_spectrum(polar, tx_m, rx_m, radar), min(n_window // step + 2, len(tx_m))
