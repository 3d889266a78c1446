# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar grid that covers a map: where it lies, how finely it is sampled, and how the map is read.

Sampling follows from the local frequencies of the image, which are the derivatives of the half
paths times the wavenumber.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.half_paths import Paths, half_paths, sample_paths
from ..geometry.illumination import NO_SPREAD, AmplitudeSpread, Illumination
from ..geometry.polar import EDGE_SAMPLES, PolarGrid, edge_positions
from ..geometry.track import side_of, track_beside
from ..signal.radar import RadarParameters
from .aliasing_error import TAPERS_NEEDED, used_share
from .echo_power import echo_powers, spread_frequencies, tail_error
from .interpolators import Interpolator, fitting_interpolator, margin
from .plan import total_db
from .profiles import PASSES, RangeGate, RangeResampling, echoes_for_means, plan_resampling

if TYPE_CHECKING:
    from .profiles import PhaseHistory

# Taps of the interpolation, and of that along direction where the spectrum is deapodised. Along
# range it cannot be: along a line of the map direction changes, too, and so does range's gain.
TAPS, DEAPODISED_TAPS = 14, 6
DEGREE = 5  # of the polynomials
LEAST_RANGES = 16  # of the polar image: a vector of the kernels


def range_axis(polar: PolarGrid, grid: MapGrid) -> int:
    """Map axis that follows range: 0 for x, 1 for y."""
    look = [c - o for c, o in zip(grid.centre_m[:2], polar.origin_m[:2], strict=True)]
    return int(abs(look[1]) > abs(look[0]))


_SAMPLES_PER_SIDE = 5  # map positions at which the geometry is bounded
_WAVENUMBERS = 7  # of the band
_SLACK = 1.01  # frequencies between samples of the map, and beside it
_RANGE_RATIOS = (2, 3), (5, 7), (3, 4), (4, 5), (5, 6), (7, 8), (9, 10)


@dataclasses.dataclass(frozen=True)
class PolarCover:
    """Polar grid that covers a map, fine enough to be interpolated to it.

    Attributes
    ----------
    grid, polar : MapGrid, PolarGrid
        The map, and the grid that reaches `margin` pixels beyond it.
    ratio : (int, int)
        Ranges of images that are added to those of their sum, on `polar`.
    resampling : RangeResampling
        How lines of such images read the profiles.
    window : RangeGate or PhaseHistory
        What it needs of the profiles.
    axis : int
        Map axis along which the second pass of the resampling goes.
    between, along : Interpolator
        Of the resampling: between lines and along them.
    slope_alpha : (R, S) float64
        Derivative by direction of the half paths from the echoes to samples of the map, metres.
    weight : (W, R) float64
        Shares of the echoes in the power of the image, see `echo_powers`.
    between_db, along_db : float
        Errors of the interpolation to the map, dB.
    profile_db : float
        Error on the map because profiles, or the part of them that is used, end, dB.
    spread : AmplitudeSpread
        Frequencies along direction of the echoes' amplitude, radians per unit of it.
    """

    grid: MapGrid
    polar: PolarGrid
    ratio: tuple[int, int]
    resampling: RangeResampling
    window: RangeGate | PhaseHistory
    range_m: tuple[float, float]
    axis: int
    between: Interpolator
    along: Interpolator
    slope_alpha: np.ndarray
    weight: np.ndarray
    between_db: float
    along_db: float
    profile_db: float
    spread: AmplitudeSpread = NO_SPREAD

    @property
    def polar_to_map_db(self) -> float:
        """Error of the interpolation to the map, dB."""
        return total_db(self.between_db, self.along_db)

    @property
    def oversampling(self) -> tuple[float, float]:
        """Along range and direction."""
        return self.along.oversampling, self.between.oversampling


def cover_map(grid: MapGrid, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
              n_samples: int, polar_to_map_db: float, profiles_db: float,
              band: PhaseHistory | None = None, *, fused: bool = False,
              illumination: Illumination | None = None) -> PolarCover | None:
    """Cover a map by a polar grid around the aperture.

    None where the map is tiny, too near, all around, or not ahead of the aperture.

    Parameters
    ----------
    grid, tx_m, rx_m, radar, n_samples :
        See `sar_imaging.planning`.
    polar_to_map_db, profiles_db : float
        Wanted errors of each pass of the interpolation to the map and of the backprojection, dB.
    band : PhaseHistory, optional
        Phase histories instead of profiles; `radar` is its own.
    fused : bool
        The polar image will be formed by its spectrum, as that of `SpectrumFusion` is, and
        deapodised for the interpolation between lines, which may be fewer. The images that are
        added to it have no more ranges than the band of a line needs.
    illumination : Illumination, optional
        Illumination of the echoes; what they do not light is left aside.
    """
    found = None if min(grid.shape) < TAPS else _frame(grid, 0.5 * (tx_m + rx_m))
    if found is None:
        return None
    frame, axis = found
    seen = _HalfPaths.of(grid, frame, axis, tx_m, rx_m, illumination)
    if seen is None:
        return None
    paths, spread = seen.paths, seen.spread
    extent = float(np.ptp(paths.of_illuminated(paths.length)))
    low, high = radar.wavenumbers_rad_per_m
    slopes = seen.along_line.min(), seen.along_line.max()
    half_range = float(np.abs(np.multiply.outer((low, high), slopes)
                              - radar.wavenumber_rad_per_m).max())
    half_alpha = float(np.abs(seen.by_alpha).max() * high) + math.sqrt(3) * spread.rms
    # of wavenumbers, some echoes and samples of the map
    some = echoes_for_means(len(tx_m))
    k = np.linspace(low, high, _WAVENUMBERS)[:, None, None]
    even = k * seen.by_alpha[some]
    along_range = k * seen.along_line[some] - radar.wavenumber_rad_per_m
    weight = echo_powers(tx_m, rx_m, grid.centre_m, grid.spacing_m * np.array(
        [[grid.n_x, 0, 0], [0, grid.n_y, 0]]), radar)
    between, between_db = fitting_interpolator(
        spread_frequencies(even, spread.rms), weight[:, some], half_alpha, polar_to_map_db,
        taps=DEAPODISED_TAPS if fused else TAPS, degree=DEGREE, deapodised=fused)
    along, along_db = fitting_interpolator(along_range, weight[:, some], half_range,
                                           polar_to_map_db, taps=TAPS, degree=DEGREE)
    if between is None or along is None:
        return None
    spacing, ratio = math.pi / (half_range * along.oversampling) * 0.999, (1, 1)
    if fused:
        spacing, ratio = _ranges_for_fusion(spacing, extent, radar, seen.by_range)
    n_line = math.ceil(extent / spacing)
    spacing *= ratio[1] / ratio[0]
    range_m = seen.ranges_m(illumination, 2 * margin(TAPS) * spacing)
    window = band or RangeGate.around(radar, n_samples, range_m)
    resampling = plan_resampling(dataclasses.replace(paths, weight=weight), spacing, n_line, radar,
                                 window.n_samples, profiles_db,
                                 fit_spacing=True, periodic=window.periodic,
                                 passes=PASSES if fused else PASSES[:1])
    if resampling is None:
        return None
    polar = _cover(grid, frame, axis, resampling.spacing * ratio[0] / ratio[1], half_alpha,
                   between)
    if polar is None:
        return None
    if spread.rms:
        tail = tail_error(spread, even, lambda f: between.error_at(
            f * (polar.alpha_spacing / (2 * math.pi))), some)
        between_db = 10 * math.log10(10 ** (between_db / 10) + tail)
    profile_db = window.mean_end_error_db(
        paths.length, oversampling=resampling.oversampling(radar), illuminated=paths.illuminated)
    return PolarCover(grid, polar, ratio, resampling, window, range_m, axis, between, along,
                      paths.of_illuminated_rows(seen.slope_alpha), weight, between_db, along_db,
                      profile_db, spread)


class _HalfPaths(NamedTuple):
    """Half paths from echoes to samples of a map, metres, and how they grow.

    Derivatives (R, S) along range, along direction, and by range along a line of the map are those
    of illuminated pairs, which stand for all others; `slope_alpha` is that along direction as is.
    """

    points_m: np.ndarray
    paths: Paths
    by_range: np.ndarray
    by_alpha: np.ndarray
    along_line: np.ndarray
    slope_alpha: np.ndarray
    spread: AmplitudeSpread

    @classmethod
    def of(cls, grid: MapGrid, frame: PolarGrid, axis: int, tx_m: np.ndarray, rx_m: np.ndarray,
           illumination: Illumination | None) -> _HalfPaths | None:
        """As echoes see a map in polar coordinates; None where ranges do not grow everywhere."""
        r, alpha = frame.from_map(*(v.ravel() for v in np.meshgrid(
            *(np.linspace(v[0], v[-1], _SAMPLES_PER_SIDE) for v in (grid.x_m, grid.y_m)))))
        lines = frame.lines(r, alpha)
        paths = sample_paths(tx_m, rx_m, lines)
        by_direction, spread = frame.by_direction(r, alpha), NO_SPREAD
        if illumination is not None:
            paths = illumination.of_paths(paths, lines[0])
            spread = illumination.spread(lines[0], by_direction)
        slope = paths.derivatives[0]
        if paths.of_illuminated(slope).min() <= 0:
            return None
        slope_alpha = half_paths(tx_m, rx_m, lines[0], by_direction)[1]
        # along a line of the map the direction changes with range, too
        step = (lines[0][:, axis] - frame.origin_m[axis]) / r
        alpha_by_range = (frame.track[axis] / step - alpha) / r
        by_range, by_alpha, along_line = (paths.with_illuminated(v) for v in (
            slope, slope_alpha, slope + slope_alpha * alpha_by_range))
        return cls(lines[0], paths, by_range, by_alpha, along_line, slope_alpha, spread)

    def ranges_m(self, illumination: Illumination | None, beyond_m: float
                 ) -> tuple[float, float]:
        """Least and largest half path to what is illuminated, and so far beyond, metres.

        The samples miss the extremes by what range and direction add between two of them.
        """
        may = illumination and illumination.may_light(self.points_m, (_SAMPLES_PER_SIDE,) * 2)
        length = (self.paths.of_illuminated(self.paths.length) if may is None
                  else self.paths.length[may])
        lo, hi = float(length.min()), float(length.max())
        slack = beyond_m + 0.5 * (hi - lo) / (_SAMPLES_PER_SIDE - 1)
        return lo - slack, hi + slack


def _frame(grid: MapGrid, centres: np.ndarray) -> tuple[PolarGrid, int] | None:
    """Polar coordinates as those of one pixel, and the axis of the second pass.

    None when the map is not ahead.
    """
    middle = centres.mean(axis=0)
    look = np.array(grid.centre_m[:2]) - middle[:2]
    distance = math.hypot(*look)
    if distance == 0:
        return None
    track, side = track_beside(centres, grid.centre_m)
    along = (centres[:, :2] - middle[:2]) @ track
    origin = middle.copy()
    origin[:2] += track * 0.5 * (along.min() + along.max())
    frame = PolarGrid(tuple(origin), tuple(track), side, grid.z_m, abs(origin[2] - grid.z_m) + 1.0,
                      1.0, 1, 0.0, 1.0, 1)
    axis = range_axis(frame, grid)
    if axis == 0 and track[1] > 0:  # in the order of the lines of the map, north first
        frame = dataclasses.replace(frame, track=tuple(-track), side=side_of(-track, look))
    corners = np.array([[x, y] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
    offset = corners - origin[:2]
    ahead = offset[:, axis] * np.sign(look[axis])
    if (offset @ frame.across).min() < 0.1 * distance or ahead.min() < 0.1 * distance:
        return None
    return frame, axis


def _ranges_for_fusion(spacing: float, extent: float, radar: RadarParameters, slope: np.ndarray
                       ) -> tuple[float, tuple[int, int]]:
    """Spacing of the ranges of the fused image, and the fewest ranges of a sub-aperture image.

    The band of a polar line, which may be wider than that of a line of the map, must fit; it
    follows from the slopes of the half paths by range.
    """
    band, highest = radar.half_band_rad_per_m, radar.wavenumbers_rad_per_m[1]
    half_range = _SLACK * float(band * slope.max() + highest * np.abs(slope - 1).max())
    spacing /= max(1.0, used_share(half_range, spacing, math.ceil(extent / spacing),
                                   tapers=TAPERS_NEEDED))
    needed = used_share(half_range, spacing, math.ceil(extent / spacing))
    return spacing, next((ratio for ratio in _RANGE_RATIOS if ratio[0] / ratio[1] >= needed),
                         (1, 1))


def _cover(grid: MapGrid, frame: PolarGrid, axis: int, spacing: float, half_alpha: float,
           between: Interpolator) -> PolarGrid | None:
    """Polar grid that reaches `margin` pixels beyond the map, and beyond what its lines read."""
    before, beside = margin(TAPS), margin(between.n_taps)
    r, alpha = edge_positions(grid, frame.origin_m, frame.track, axis, before * spacing)
    # between two edge samples
    slack = 0.5 * grid.spacing_m * (max(grid.shape) - 1) / (EDGE_SAMPLES - 1)
    extent = np.ptp(alpha) + 2 * slack / r.min()
    alpha_spacing = extent
    if half_alpha:
        alpha_spacing = min(math.pi / (half_alpha * between.oversampling), extent)
    # whole vectors, so that lines begin alike
    n_range = math.ceil((np.ptp(r) + 2 * slack) / spacing + 2 * before)
    n_range = -(-n_range // LEAST_RANGES) * LEAST_RANGES
    try:
        return dataclasses.replace(
            frame, range_start_m=r.min() - slack - before * spacing, range_spacing_m=spacing,
            n_range=n_range, alpha_start=alpha.min() - slack / r.min() - beside * alpha_spacing,
            alpha_spacing=alpha_spacing, n_alpha=math.ceil(extent / alpha_spacing) + 2 * beside)
    except ValueError:
        return None
