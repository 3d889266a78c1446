"""How many beams a sub-aperture needs, how they are read, and the error of both."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from ..geometry.polar import PolarGrid
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .beam_gain import BeamGain, beam_gain, bins_per_run, rms_of_rows, shared_errors
from .beam_kernels import LANES
from .beam_mixing import BEAM_TAPS, CELL_TAPS
from .beam_reading import DEGREE
from .interpolation import Interpolator, design_interpolator
from .lattice import Lattice, sample_paths, total_db

_OVERSAMPLING = (1.16, 1.2, 1.24, 1.28, 1.34, 1.4, 1.5, 1.6, 1.8, 2.0,  # of beams
                 2.4, 2.8, 3.2, 4.0)
_MOST_CORRECTED = 2.0  # beyond, interpolation takes little from any frequency
_LEAST_OVERSAMPLING = 1.1  # of cells: the interpolation could do with no less
_GROUPS = (18, 16, 14, 12, 10, 8, 6, 4, 2, 1)  # beams whose phases grow alike from bin to bin
_SEGMENTS = (128, 64, 32, 16)
_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded
_ROWS, _DIRECTIONS = 17, 33  # at which paths are compared
BEYOND = 1  # beams beyond those that interpolation needs, for rounding
OUTSIDE = BEAM_TAPS // 2 - 1 + BEYOND  # beams before the first direction of the grid
_SPREAD_STEP = 1.02  # factors between one spread that is planned for and the next
_SLACK = 1.1  # sub-apertures that were not looked at may be as much worse
_LEAST_UNEVEN = 1e-4  # wavelengths, which matters to no image
_ARITHMETIC_DB = -80.0  # float32 phasors that turn from bin to bin (measured)
_MARGIN = 0.1  # of the directions of a grid, beyond them
_CLEAR = 0.9  # of the largest direction cosine on the plane
_DIRECTION_STEP = 1e-4  # of the direction cosine, for a derivative
# Time of a row, bin and beam, of a cell's transform and of a pixel, in pixels and rows of
# `kernels.project_lines`; what is added to the first by rows of beams, to the last by segments
_COST_TRIPLE, _COST_CELL, _COST_PIXEL = 0.072, 3.2, 2.6  # (measured)
_COST_GROUP, _COST_SEGMENT = 5.8, 205.0


@dataclasses.dataclass(frozen=True)
class BeamSampling:
    """Sampling of a sub-aperture's beams.

    Attributes
    ----------
    spread_m : float
        Largest derivative, by direction, of what a row's path is longer than the reference's.
    spacing : float
        Of the beams, in direction cosine.
    group : int
        Most beams whose phases are taken to grow alike over a vector of bins.
    uneven_m : float
        By how much rows on opposite sides of the centre may fail to be opposite, rms, for them to
        share phasors; 0 where none do.
    segment : int
        Pixels that share one expansion of the geometry.
    between : BeamGain
        Interpolator between beams, and by what rows are multiplied for it.
    along : Interpolator
        Along range.
    predicted_error_db : float
        Predicted error of the sub-aperture images against time-domain correlation, dB.
    """

    spread_m: float
    spacing: float
    group: int
    uneven_m: float
    segment: int
    between: BeamGain
    along: Interpolator
    predicted_error_db: float

    @property
    def paired(self) -> bool:
        """Rows share phasors where they are opposite enough."""
        return self.uneven_m > 0

    def n_beams(self, span: float) -> int:
        """Beams over some extent in direction cosine, with those that interpolation needs."""
        return math.ceil(span / self.spacing) + BEAM_TAPS + 2 * BEYOND

    def group_of(self, n_beams: int) -> int:
        """Beams of each group, in no more groups than needed: even, or one."""
        size = math.ceil(n_beams / math.ceil(n_beams / self.group))
        return size + size % 2 if self.group > 1 else 1

    def cost(self, n_rows: int, n_bins: int, n_cells: int, n_pixels: int, span: float) -> float:
        """Relative time of a sub-aperture image, in pixels and rows of `project_lines`."""
        n_beams = self.n_beams(span)
        group = self.group_of(n_beams)
        triples = math.ceil(n_beams / group) * (group * (0.5 if self.paired else 1.0)
                                                + _COST_GROUP) * n_rows * n_bins
        return (triples * _COST_TRIPLE + n_beams * n_cells * _COST_CELL
                + n_pixels * (_COST_PIXEL + _COST_SEGMENT / self.segment))


def plan_beams(polar: PolarGrid, radar: RadarParameters, lattice: Lattice, n_bins: int,
               subapertures, target_db: float, reach_m: float,
               padding_m: float = math.inf) -> BeamSampling | None:
    """Quickest sampling of beams that meets a target.

    Parameters
    ----------
    polar : PolarGrid
        Of the sub-aperture images.
    radar : RadarParameters
        Of the profiles.
    lattice : Lattice
        Of the profiles; its cells are those of the beams.
    n_bins : int
        Bins of a profile's spectrum.
    subapertures : sequence of ((R, 3), (R, 3)) float64
        Phase centres of some sub-apertures of the length that is looked at, metres.
    target_db : float
        Wanted error of the sub-aperture images, dB.
    reach_m : float
        Difference of the largest and the smallest half path, metres.
    padding_m : float
        Zeros between the ends of a padded profile, metres of half path: what the rows' delays
        move beyond one end must not come in at the other. Periodic profiles have no ends.

    Returns
    -------
    BeamSampling or None
        None where no sampling meets the target.
    """
    oversampling_range = radar.range_resolution_m / lattice.cell_m
    if oversampling_range < _LEAST_OVERSAMPLING:
        return None
    along = design_interpolator(oversampling_range, taps=CELL_TAPS, degree=DEGREE, corrected=True)
    k = radar.wavenumber_rad_per_m
    edges, views, geometry = grid_edges(polar), [], 0.0
    for centres in subapertures:
        view = _view(polar, edges, *centres)
        if view is None:
            return None
        geometry = max(geometry, view.phase_error(k, radar.bandwidth_hz / radar.carrier_hz))
        if 20 * math.log10(geometry + 1e-12) > target_db:
            return None
        views.append(view)
    slope, curvature = (np.stack([getattr(view, name) for view in views])
                        for name in ('slope', 'curvature'))
    uneven = max(_LEAST_UNEVEN * radar.wavelength_m, *(view.uneven_m for view in views))
    highest = k + 2 * math.pi * radar.bandwidth_hz / SPEED_OF_LIGHT
    spread = max(view.beams.spread(*view.centres) for view in views)
    # Beams beside the grid count, too; there are fewer the wider the spread.
    widest = max(spread, 1e-3 * radar.wavelength_m)
    beyond = OUTSIDE * math.pi / (highest * widest * _OVERSAMPLING[0])
    spread = max(view.beams.spread(*view.centres, beyond) for view in views)
    # The last segment reaches beyond the image.
    spare = lattice.n_cells - reach_m / lattice.cell_m - 2 * CELL_TAPS
    segments = [segment for segment in _SEGMENTS if segment <= spare]
    if 2 * spread > padding_m:
        return None
    # In steps: plans for nearly the same sub-apertures give the same images to the last bit.
    steps = math.log(max(spread, 1e-3 * radar.wavelength_m), _SPREAD_STEP)
    widest = _SPREAD_STEP ** math.ceil(steps)
    bin_rad_per_m = 2 * math.pi / (lattice.n_cells * lattice.cell_m)
    relative = [n * bin_rad_per_m / k
                for n in (bins_per_run(n_bins, n_bins * bin_rad_per_m / k), LANES)]
    n_rows, span = len(subapertures[0][0]), polar.n_alpha * polar.alpha_spacing
    # The image has about as many lines as beams that lie as far apart as they may.
    n_pixels = polar.n_range * span * highest * widest * _OVERSAMPLING[0] / math.pi
    best = None
    for oversampling in _OVERSAMPLING:
        spacing = math.pi / (highest * widest * oversampling)
        between = beam_gain(oversampling, oversampling <= _MOST_CORRECTED)
        if between.interpolator.error_db > target_db:
            continue

        def sampling(group, paired, segment, error_db=0.0, spacing=spacing, between=between):
            return BeamSampling(widest, spacing, group, paired * _SLACK * uneven, segment,
                                between, along, error_db)

        costs = {key: sampling(*key).cost(n_rows, n_bins, lattice.n_cells, n_pixels, span)
                 for key in itertools.product(_GROUPS, (True, False), segments)}
        cheaper = [key for key, cost in costs.items() if best is None or cost < best[0]]
        if not cheaper:
            break
        always, grouped, shared = shared_errors(
            between, *(k * spacing * v for v in (slope, spacing * curvature, uneven)), relative,
            _GROUPS)
        expansion = {segment: np.max([view.expansion_errors(
            segment * polar.range_spacing_m / 2, lattice.cell_m, polar.range_spacing_m, spacing,
            oversampling_range, oversampling, k) for view in views], axis=0)
            for segment in segments}
        for key in sorted(cheaper, key=costs.get):
            group, paired, segment = key
            i = _GROUPS.index(group)
            errors = geometry, *always, *grouped[i], paired * shared[i], *expansion[segment]
            error = total_db(between.interpolator.error_db, along.error_db, _ARITHMETIC_DB,
                             *(20 * math.log10(e + 1e-12) for e in errors))
            if error <= target_db:
                best = costs[key], sampling(*key, error)
                break
    return best and best[1]


@dataclasses.dataclass(frozen=True)
class _View:
    """Geometry of one sub-aperture, seen from its middle."""

    beams: BeamGeometry
    centres: tuple[np.ndarray, np.ndarray]  # phase centres of some rows, metres
    uneven_m: float  # by which rows on opposite sides of the centre are not opposite, rms
    slope: np.ndarray  # (R, D) first derivative of the rows' paths by direction, metres
    curvature: np.ndarray  # (R, D) second derivative
    difference: np.ndarray  # (R, S) of half paths from what beams assume, metres
    bend: np.ndarray  # (R, S) what interpolation between beams makes good to first order, metres
    # along lines: extremes of the distance's first derivative, magnitudes of its second and fourth
    # and of the direction cosine's first and second
    by_range: tuple[tuple[float, float], float, float, float, float]

    def phase_error(self, k: float, relative_bandwidth: float) -> float:
        """Rms over the rows of the largest phase error anywhere, rad."""
        error = (k * np.abs(self.difference - self.bend)
                 + np.abs(k * self.bend) * (relative_bandwidth / math.sqrt(12))
                 + (k * self.bend) ** 2 / 2)
        return float(rms_of_rows(error[None]))

    def expansion_errors(self, half_m, cell_m, pixel_m, spacing, over_range, over_beams, k):
        """Rms errors of expanding places between cells, between beams, and phases."""
        slope, d2, d4, s1, s2 = self.by_range
        d1 = max(abs(d - cell_m / pixel_m) for d in slope)
        drifts = ((d1 * half_m + d2 * half_m ** 2 / 2) / cell_m,
                  (s1 * half_m + s2 * half_m ** 2 / 2) / spacing)
        return [*(t ** 3 / 6 * (math.pi / over) ** 3 / 7
                  for t, over in zip(drifts, (over_range, over_beams), strict=True)),
                k * d4 * half_m ** 4 / 24 / 3]


def _view(polar: PolarGrid, edges, tx_m, rx_m) -> _View | None:
    r, alpha = (v.ravel() for v in np.meshgrid(
        *(np.linspace(v[0], v[-1], _SAMPLES_PER_SIDE) for v in (polar.range_m, polar.alpha))))
    lines = polar.lines(r, alpha)
    rows = np.linspace(0, len(tx_m) - 1, _ROWS).round().astype(int)
    rows = np.concatenate([rows, len(tx_m) - 1 - rows])  # opposite ones, too
    beams = BeamGeometry.of(polar, edges, tx_m, rx_m)
    if beams is None:
        return None
    middle = sample_paths(beams.centre_m[None], beams.centre_m[None], lines)
    length, derivatives = middle.length[0], np.array(middle.derivatives)[:, 0]
    along = np.array([*polar.track, 0.0])
    direction = (lines[0] - beams.centre_m) @ along / length
    first = (lines[1] @ along - direction * derivatives[0]) / length
    second = (lines[2] @ along - 2 * first * derivatives[0] - direction * derivatives[1]) / length
    paths = sample_paths(tx_m[rows], rx_m[rows], lines[:2]).length
    centres = tx_m[rows], rx_m[rows]
    slope = beams.slope(*centres, direction)
    bend = slope ** 2 * (1 - direction ** 2) * (1 / length - 1 / beams.range_m) / 2
    some = np.linspace(*beams.direction, 3)
    return _View(beams, centres, beams.uneven(*centres), beams.slope(*centres, some),
                 beams.curvature(*centres, some),
                 paths - length - beams.extra_path(*centres, direction), bend,
                 ((derivatives[0].min(), derivatives[0].max()), *(
                     float(np.abs(d).max()) for d in (*derivatives[[1, 3]], first, second))))


@dataclasses.dataclass(frozen=True)
class BeamGeometry:
    """Polar coordinates around the middle of a sub-aperture, on the plane of a polar grid.

    Attributes
    ----------
    polar : PolarGrid
        Whose plane, track direction and side they share.
    centre_m : (3,) float64
        Mean phase centre, metres.
    range_m : float
        Distance at which the paths of rows are compared, metres: the harmonic mean of the
        extremes, from which their curvature differs least.
    direction : (float, float)
        Extremes of the direction cosine over the grid.
    """

    polar: PolarGrid
    centre_m: np.ndarray
    range_m: float
    direction: tuple[float, float]

    @classmethod
    def of(cls, polar: PolarGrid, edges: np.ndarray, tx_m, rx_m) -> BeamGeometry | None:
        """Coordinates for some rows; None where the plane is too steep below them.

        `edges` are the grid's, from `grid_edges`.
        """
        centre = 0.5 * (tx_m + rx_m).mean(axis=0)
        offset = edges - centre
        length = np.linalg.norm(offset, axis=1)
        direction = offset[:, :2] @ polar.track / length
        range_m = 2 / (1 / length.min() + 1 / length.max())
        beams = cls(polar, centre, range_m, (float(direction.min()), float(direction.max())))
        height = (centre[2] - polar.z_m) / range_m
        steepest = max(map(abs, beams.direction)) + _MARGIN * np.ptp(direction)
        return beams if steepest ** 2 + height ** 2 < 0.98 else None

    @property
    def known(self) -> np.ndarray:
        """(2,) float64 extremes of the directions in which the plane lies well within sight."""
        (low, high), height = self.direction, (self.centre_m[2] - self.polar.z_m) / self.range_m
        margin, clear = _MARGIN * (high - low), _CLEAR * math.sqrt(1 - height ** 2)
        return np.array([min(low - margin, -clear), max(high + margin, clear)])

    def beam_path(self, tx_m, rx_m, direction) -> np.ndarray:
        """`extra_path`, continued straight beyond the known directions, where it ends."""
        low, high = self.known
        if low <= np.min(direction) and np.max(direction) <= high:
            return self.extra_path(tx_m, rx_m, direction)
        before, after = self.slope(tx_m, rx_m, self.known).T[..., None]
        return (self.extra_path(tx_m, rx_m, np.clip(direction, low, high))
                + before * np.minimum(direction - low, 0.0)
                + after * np.maximum(direction - high, 0.0))

    def extra_path(self, tx_m, rx_m, direction) -> np.ndarray:
        """(R, S) by how much half paths are longer than the distance from the centre, metres."""
        height = self.centre_m[2] - self.polar.z_m
        along = self.range_m * np.asarray(direction)
        across = np.sqrt(np.maximum(self.range_m ** 2 - along ** 2 - height ** 2, 0.0))
        u, v = self.polar.track, self.polar.across
        x = np.stack([*(along * u[axis] + across * v[axis] for axis in (0, 1)),
                      np.full_like(along, -height)])
        beyond = np.sum(x ** 2, axis=0) - self.range_m ** 2
        centres = (tx_m,) if np.array_equal(tx_m, rx_m) else (tx_m, rx_m)
        total = 0.0
        for centre in centres:
            a = centre - self.centre_m
            longer = np.sum(a ** 2, axis=1)[:, None] + beyond - 2 * (a @ x)  # squared
            total = total + longer / (np.sqrt(self.range_m ** 2 + longer) + self.range_m)
        return total / len(centres)

    def slope(self, tx_m, rx_m, direction) -> np.ndarray:
        """(R, S) derivative of `extra_path` by direction, metres."""
        direction = np.asarray(direction)
        before, after = np.split(self.extra_path(tx_m, rx_m, np.concatenate(
            [direction - _DIRECTION_STEP, direction + _DIRECTION_STEP])), 2, axis=1)
        return (after - before) / (2 * _DIRECTION_STEP)

    def uneven(self, tx_m, rx_m) -> float:
        """By how much rows on opposite sides fail to be opposite, rms, metres of that slope."""
        slope = np.sort(self.slope(tx_m, rx_m, self.direction), axis=0)
        return math.sqrt(np.mean(np.abs(slope + slope[::-1]).max(axis=1) ** 2)) / 2

    def curvature(self, tx_m, rx_m, direction) -> np.ndarray:
        """(R, S) second derivative of `extra_path` by direction, metres."""
        step = 10 * _DIRECTION_STEP
        before, here, after = (self.extra_path(tx_m, rx_m, np.asarray(direction) + d)
                               for d in (-step, 0.0, step))
        return (before - 2 * here + after) / step ** 2

    def spread(self, tx_m, rx_m, beyond: float = 0.0) -> float:
        """Largest derivative of `beam_path` by direction up to so far beyond the grid, metres."""
        low, high = self.direction
        directions = np.linspace(low - beyond, high + beyond, _DIRECTIONS)
        path = self.beam_path(tx_m, rx_m, directions)
        return float(np.abs(np.diff(path, axis=1)).max() / (directions[1] - directions[0]))


def grid_edges(polar: PolarGrid) -> np.ndarray:
    """(S, 3) float64 positions along the near and the far edge of a grid, metres."""
    alpha = np.linspace(polar.alpha[0], polar.alpha[-1], _SAMPLES_PER_SIDE)
    r = np.repeat([polar.range_m[0], polar.range_m[-1]], len(alpha))
    return polar.lines(r, np.tile(alpha, 2))[0]
