"""Polar grid that covers a map: where it must lie and how finely it must be sampled.

Sampling follows from the local frequencies of the image, which are the derivatives of the half
paths times the wavenumber.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.map_edges import EDGE_SAMPLES, edge_positions
from ..geometry.polar import PolarGrid
from ..geometry.track_frame import side_of, track_beside
from ..signal.radar import RadarParameters
from .echo_power import echo_power
from .error_budget import total_db
from .interpolators import Interpolator, coarsest_interpolator, finer_interpolator
from .polar_to_map import DEAPODISED_TAPS, DEGREE, LEAST_RANGES, TAPS, margin
from .profiles.range_gate import RangeGate
from .profiles.range_resampling import RangeResampling, half_paths, plan_resampling, sample_paths

if TYPE_CHECKING:
    from .profiles.phase_history import PhaseHistory

_SAMPLES_PER_SIDE = 5  # map positions at which the geometry is bounded
_WAVENUMBERS = 7  # of the band
FitRanges = Callable[[float, float, float], tuple[float, tuple[int, int]]]


@dataclasses.dataclass(frozen=True)
class PolarCover:
    """Polar grid that covers a map, fine enough to be interpolated to it.

    Attributes
    ----------
    polar : PolarGrid
        It reaches `margin` pixels beyond the map.
    ratio : (int, int)
        Ranges of images that are added to those of their sum, on `polar`.
    lattice : RangeResampling
        How lines of such images read the profiles.
    window : RangeGate or PhaseHistory
        What it needs of the profiles.
    axis : int
        Map axis along which the second pass of the resampling goes.
    between, along : Interpolator
        Of the resampling: between lines and along them.
    slope_alpha : (R, S) float64
        Derivative by direction of the half paths from the rows to samples of the map, metres.
    wavenumber : (2,) floats
        Lowest and highest of the radar's band, rad/m.
    between_db, along_db : float
        Errors of the interpolation to the map, dB.
    profile_db : float
        Error on the map because profiles, or the part of them that is used, end, dB.
    """

    polar: PolarGrid
    ratio: tuple[int, int]
    lattice: RangeResampling
    window: RangeGate | PhaseHistory
    range_m: tuple[float, float]
    axis: int
    between: Interpolator
    along: Interpolator
    slope_alpha: np.ndarray
    weight: np.ndarray
    wavenumber: tuple[float, float]
    between_db: float
    along_db: float
    profile_db: float

    @property
    def resampling_db(self) -> float:
        """Error of the interpolation to the map, dB."""
        return total_db(self.between_db, self.along_db)

    @property
    def oversampling(self) -> tuple[float, float]:
        """Along range and direction."""
        return self.along.oversampling, self.between.oversampling


def cover_map(grid: MapGrid, tx_m, rx_m, radar: RadarParameters, n_samples: int,
              resampling_db: float, lattice_db: float, band: PhaseHistory | None = None,
              fit_ranges: FitRanges | None = None) -> PolarCover | None:
    """Cover a map by a polar grid around the aperture.

    Parameters
    ----------
    grid, tx_m, rx_m, radar, n_samples :
        As for `plan_polar`.
    resampling_db, lattice_db : float
        Wanted errors of each pass of the interpolation to the map and of the backprojection, dB.
    band : PhaseHistory, optional
        Phase histories instead of profiles; `radar` is its own.
    fit_ranges : callable, optional
        The polar image will be formed by its spectrum, as that of `SpectrumFusion` is, and
        deapodised for the interpolation between lines, which may be fewer.
        ``fit_ranges(spacing, extent, half_band)`` gives the spacing of its ranges and the ratio
        of the ranges of the images that are added to them, from the spacing that the
        interpolation along lines needs, metres, the extent, metres, and half the band of a line,
        rad/m.

    Returns
    -------
    PolarCover or None
        None where the map is tiny, too near, all around, or not ahead of the aperture.
    """
    frame = _frame(grid, 0.5 * (tx_m + rx_m))
    if frame is None or min(grid.shape) < TAPS:
        return None
    origin, track, side, axis = frame
    deapodised = fit_ranges is not None
    bands = _bands(grid, tx_m, rx_m, radar, origin, track, side, axis)
    if bands is None:
        return None
    paths, (along_range, local), along_alpha, slope_alpha, k = bands
    weight = echo_power(tx_m, rx_m, grid.centre_m, grid.spacing_m * np.array(
        [[grid.n_x, 0, 0], [0, grid.n_y, 0]]), radar)
    between, between_db = fitting_interpolator(
        along_alpha, weight, resampling_db, taps=DEAPODISED_TAPS if deapodised else TAPS,
        deapodised=deapodised)
    along, along_db = fitting_interpolator(along_range, weight, resampling_db, taps=TAPS)
    if between is None or along is None:
        return None
    half_alpha, half_range = (float(np.abs(f).max()) for f in (along_alpha, along_range))
    spacing = math.pi / (half_range * along.oversampling) * 0.999
    n_line, ratio = math.ceil(np.ptp(paths.length) / spacing), (1, 1)
    if fit_ranges is not None:
        spacing, ratio = fit_ranges(spacing, float(np.ptp(paths.length)), local)
        n_line = math.ceil(np.ptp(paths.length) / spacing)
        spacing *= ratio[1] / ratio[0]
    # The sampled half paths miss the extremes by what range and direction add between samples.
    lo, hi = float(paths.length.min()), float(paths.length.max())
    slack = 2 * margin(TAPS) * spacing + 0.5 * (hi - lo) / (_SAMPLES_PER_SIDE - 1)
    range_m = lo - slack, hi + slack
    window = band or RangeGate.around(radar, n_samples, range_m)
    lattice = plan_resampling(paths, spacing, n_line, radar, window.n_samples, lattice_db,
                           fit_spacing=True, periodic=window.periodic)
    if lattice is None:
        return None
    polar = _cover(grid, frame, lattice.spacing * ratio[0] / ratio[1], half_alpha, between)
    if polar is None:
        return None
    return PolarCover(polar, ratio, lattice, window, range_m, axis, between, along, slope_alpha,
                    weight, k, between_db, along_db,
                    window.mean_end_error_db(paths.length,
                                             oversampling=lattice.oversampling(radar)))


def _frame(grid: MapGrid, centres):
    """Origin, track direction, side and second-pass axis; None when the map is not ahead."""
    middle = centres.mean(axis=0)
    look = np.array(grid.centre_m[:2]) - middle[:2]
    distance = math.hypot(*look)
    if distance == 0:
        return None
    track, side = track_beside(centres, grid.centre_m)
    axis = int(abs(look[1]) > abs(look[0]))
    if axis == 0 and track[1] > 0:  # lines in the order of the rows of the map, north first
        track, side = -track, side_of(-track, look)
    along = (centres[:, :2] - middle[:2]) @ track
    origin = middle.copy()
    origin[:2] += track * 0.5 * (along.min() + along.max())
    across = side * np.array([-track[1], track[0]])
    corners = np.array([[x, y] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
    offset = corners - origin[:2]
    ahead = offset[:, axis] * np.sign(look[axis])
    if (offset @ across).min() < 0.1 * distance or ahead.min() < 0.1 * distance:
        return None
    return tuple(origin), tuple(track), side, axis


def _bands(grid, tx_m, rx_m, radar, origin, track, side, axis):
    """What the band of the image follows from.

    Half paths along range; frequencies (K, R, S) of K wavenumbers, R rows and S samples of the map
    along range on a row of the map, rad/m, and half the band at one direction; frequencies along
    direction, rad, and the derivative of the half paths that they come from; the lowest and
    highest wavenumber.
    """
    n = _SAMPLES_PER_SIDE
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(grid.x_m[0], grid.x_m[-1], n),
                                           np.linspace(grid.y_m[0], grid.y_m[-1], n)))
    unit = PolarGrid(origin, track, side, grid.z_m, abs(origin[2] - grid.z_m) + 1.0, 1.0, 1,
                     0.0, 1.0, 1)
    r, alpha = unit.from_map(x, y)
    lines = unit.lines(r, alpha)
    position = lines[0]
    paths = sample_paths(tx_m, rx_m, lines)
    slope = paths.derivatives[0]
    if slope.min() <= 0:
        return None
    slope_alpha = half_paths(tx_m, rx_m, position, unit.by_direction(r, alpha))[1]
    # along a row of the map the direction changes with range, too
    step = (position[:, axis] - origin[axis]) / r
    alpha_by_range = (track[axis] / step - alpha) / r
    centre, band = radar.wavenumber_rad_per_m, radar.half_band_rad_per_m
    k = np.linspace(centre - band, centre + band, _WAVENUMBERS)[:, None, None]
    local = band * slope.max() + (centre + band) * np.abs(slope - 1).max()
    return (paths, (k * (slope + slope_alpha * alpha_by_range) - centre, float(local)),
            k * slope_alpha, slope_alpha, (centre - band, centre + band))


def fitting_interpolator(frequency, weight, wanted_db: float, *, taps: int,
                         deapodised: bool = False) -> tuple[Interpolator | None, float]:
    """Interpolator for the coarsest sampling that reads frequencies well, and its mean error, dB.

    None where no oversampling below 4 does.

    Parameters
    ----------
    frequency : (K, R, S) float64
        Of K wavenumbers, R rows and S places; samples lie ``pi / oversampling`` over the highest
        apart.
    weight : (R,) float64
        Share of each row in the power of the image.
    wanted_db : float
        Mean error over all, dB.
    taps, deapodised :
        As for `design_interpolator`.
    """
    found = coarsest_interpolator(wanted_db, taps=taps, degree=DEGREE, deapodised=deapodised)
    half = max(float(np.abs(frequency).max()), 1e-12)
    weight = weight[:, None] / weight.sum()
    while found is not None:
        error = found.error_at(frequency / (2 * half * found.oversampling))
        error_db = 10 * math.log10(float((error.mean(axis=0) * weight).sum(axis=0).mean()) + 1e-16)
        if error_db <= wanted_db:
            return found, error_db
        found = finer_interpolator(found)  # much of the power lies where the band ends
    return None, math.inf


def _cover(grid, frame, spacing, half_alpha, between) -> PolarGrid | None:
    """Polar grid that reaches `margin` pixels beyond the map, and beyond what its rows read."""
    origin, track, side, axis = frame
    before, beside = margin(TAPS), margin(between.n_taps)
    r, alpha = edge_positions(grid, origin, track, axis, before * spacing)
    # between two edge samples
    slack = 0.5 * grid.spacing_m * (max(grid.shape) - 1) / (EDGE_SAMPLES - 1)
    extent = np.ptp(alpha) + 2 * slack / r.min()
    alpha_spacing = extent
    if half_alpha:
        alpha_spacing = min(math.pi / (half_alpha * between.oversampling), extent)
    # whole vectors, so that lines begin alike
    n_range = math.ceil((np.ptp(r) + 2 * slack) / spacing + 2 * before)
    n_range = -(-n_range // LEAST_RANGES) * LEAST_RANGES
    n_alpha = math.ceil(extent / alpha_spacing) + 2 * beside
    try:
        return PolarGrid(origin, track, side, grid.z_m, r.min() - slack - before * spacing,
                         spacing, n_range,
                         alpha.min() - slack / r.min() - beside * alpha_spacing, alpha_spacing,
                         n_alpha)
    except ValueError:
        return None
