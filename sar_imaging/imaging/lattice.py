"""Range lattice of a block: spacing, oversampling and segment length that meet an error target.

Backprojection reads range profiles on a lattice whose spacing is the half-path distance between
neighbouring pixels of an image line. The more the true distance differs from it, the further a
pixel drifts from its lattice interval along a segment; this module bounds that drift from the
exact geometry and chooses the longest segment that keeps the predicted error.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy.fft

from ..geometry import MapGrid
from ..signal.radar import RadarParameters
from .interpolation import PolynomialInterpolator, design_interpolator
from .kernels import SINCOS_ERROR_DB

_SEGMENTS = (64, 32, 16, 8)
_MAX_PHASES = 8
_POINT_OVERSAMPLING = 3.2  # lattice of the routine for arbitrary points
_ACCUMULATION_ERROR_DB = -112.0  # float32 sums
_NEAREST_M = 1e-6  # keeps derivatives finite for a grid around the antenna
_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded


@dataclasses.dataclass(frozen=True)
class LineGeometry:
    """Half path along one image axis, bounded over the grid and all rows.

    Attributes
    ----------
    axis : int
        0 when image lines follow x, 1 when they follow y.
    sign : int
        +1 when range grows with the coordinate, -1 when it falls.
    slope : (2,) tuple of float
        Least and largest change of half path per metre along a line, both positive if usable.
    fourth_derivative : float
        Largest magnitude of the fourth derivative of the half path, 1/m^3.
    range_m : (2,) tuple of float
        Bounds of the half path over the grid, metres.
    """

    axis: int
    sign: int
    slope: tuple[float, float]
    fourth_derivative: float
    range_m: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Lattice:
    """How profiles are resampled and read.

    Attributes
    ----------
    n_padded : int
        Length to which a profile is zero-padded before its Fourier transform.
    n_cells : int
        Lattice cells over the padded profile; a cell is one pixel of an image line.
    n_phases : int
        Lattice positions per cell.
    segment : int
        Pixels that share one geometry expansion; 0 for the routine for arbitrary points.
    step_m : float
        Half-path distance between lattice positions, metres.
    interpolator : PolynomialInterpolator
        Weights for this oversampling and drift.
    predicted_error_db : float
        Predicted error of the image against time-domain correlation, dB.
    """

    n_padded: int
    n_cells: int
    n_phases: int
    segment: int
    step_m: float
    interpolator: PolynomialInterpolator
    predicted_error_db: float


def line_geometry(grid: MapGrid, tx_m, rx_m) -> LineGeometry:
    """Bound the half path over a grid for rows of phase centres.

    Parameters
    ----------
    grid : MapGrid
        Pixels to bound over.
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    """
    n = _SAMPLES_PER_SIDE
    x, y = (np.linspace(a[0], a[-1], n) for a in (grid.x_m, grid.y_m))
    points = np.stack([*(v.ravel() for v in np.meshgrid(x, y)), np.full(n * n, grid.z_m)], axis=1)
    path, slope, fourth = 0.0, 0.0, 0.0
    for centre in (tx_m, rx_m):
        offset = points - np.asarray(centre)[:, None, :]
        d = np.maximum(np.sqrt(np.einsum('rpk,rpk->rp', offset, offset)), _NEAREST_M)
        d1 = offset[..., :2] / d[..., None]
        d2 = (1 - d1 ** 2) / d[..., None]
        d3 = -3 * d1 * d2 / d[..., None]
        path, slope = path + 0.5 * d, slope + 0.5 * d1
        fourth = fourth + 0.5 * np.abs(4 * d1 * d3 + 3 * d2 ** 2) / d[..., None]
    low, high = slope.min(axis=(0, 1)), slope.max(axis=(0, 1))
    sign = np.where(low + high >= 0, 1, -1)
    least = np.where(sign > 0, low, -high)
    axis = int(np.argmax(least))
    largest = high[axis] if sign[axis] > 0 else -low[axis]
    # Extremes along a line are at its ends when range is monotonic there; between sampled lines
    # the half path changes by at most its slope times the distance.
    gap = 0.5 / (n - 1) * np.array([np.ptp(x), np.ptp(y)])
    steepest = np.maximum(np.abs(low), np.abs(high))
    slack = steepest[1 - axis] * gap[1 - axis] + grid.spacing_m
    if least[axis] <= 0:
        slack += steepest[axis] * gap[axis]
    return LineGeometry(axis, int(sign[axis]), (float(least[axis]), float(largest)),
                        float(fourth[..., axis].max()),
                        (float(path.min() - slack), float(path.max() + slack)))


def plan_lattice(geometry: LineGeometry, spacing_m: float, n_line: int, radar: RadarParameters,
                 n_samples: int, target_db: float) -> Lattice:
    """Choose lattice, segment and interpolator for an error target.

    Parameters
    ----------
    geometry : LineGeometry
        From `line_geometry`.
    spacing_m : float
        Pixel spacing along a line, metres.
    n_line : int
        Pixels of a line.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of a profile.
    target_db : float
        Wanted error against time-domain correlation, dB.

    Returns
    -------
    Lattice
        With ``segment == 0`` where range does not follow the lines closely enough.
    """
    pitch = spacing_m * 0.5 * sum(geometry.slope)
    shortest = next((s for s in reversed(_SEGMENTS) if s >= n_line), _SEGMENTS[0])
    if geometry.slope[0] > 0:
        for segment in (s for s in _SEGMENTS if s <= shortest):
            for phases in range(1, _MAX_PHASES + 1):
                lattice = _line_lattice(geometry, spacing_m, pitch, segment, phases, radar,
                                        n_samples)
                if lattice is not None and lattice.predicted_error_db <= target_db:
                    return lattice
    return _point_lattice(radar, n_samples)


def _line_lattice(geometry, spacing_m, pitch, segment, phases, radar, n_samples):
    n_padded, n_cells = _commensurate(n_samples, radar.sample_spacing_m, pitch, phases)
    cell = n_padded * radar.sample_spacing_m / n_cells
    step = cell / phases
    oversampling = radar.range_resolution_m / step
    if oversampling <= 1.25:
        return None
    drift = max(abs(slope * spacing_m - cell) for slope in geometry.slope) * segment / 2
    if drift > 2 * step:
        return None
    interpolator = design_interpolator(oversampling, drift / step)
    # rms over the segment of the first term that the cubic expansion of the path leaves out
    expansion = (radar.wavenumber_rad_per_m * geometry.fourth_derivative / 24 / 3
                 * (spacing_m * segment / 2) ** 4)
    return Lattice(n_padded, n_cells, phases, segment, step, interpolator,
                   _total_db(interpolator.error_db, 20 * math.log10(expansion + 1e-12)))


def _point_lattice(radar, n_samples):
    pitch = radar.range_resolution_m / _POINT_OVERSAMPLING
    n_padded, n_cells = _commensurate(n_samples, radar.sample_spacing_m, pitch, 1)
    step = n_padded * radar.sample_spacing_m / n_cells
    interpolator = design_interpolator(radar.range_resolution_m / step)
    return Lattice(n_padded, n_cells, 1, 0, step, interpolator, _total_db(interpolator.error_db))


def _total_db(*parts_db):
    parts = (*parts_db, SINCOS_ERROR_DB, _ACCUMULATION_ERROR_DB)
    return 10 * math.log10(sum(10 ** (p / 10) for p in parts))


def _commensurate(n_samples, spacing_m, pitch, phases):
    """Padded length and number of cells, both quick to transform, nearest to the pitch."""
    best, length = None, n_samples
    for _ in range(24):
        length = scipy.fft.next_fast_len(length)
        ideal = length * spacing_m / pitch
        for cells in {math.floor(ideal), math.ceil(ideal)} - {0}:
            slow = scipy.fft.next_fast_len(cells * phases) != cells * phases
            cost = abs(cells / ideal - 1) + 2e-3 * slow + 1e-3 * (length / n_samples - 1)
            if best is None or cost < best[0]:
                best = (cost, length, cells)
        length += 1
    return best[1:]
