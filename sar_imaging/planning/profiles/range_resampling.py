"""Range lattice of a block: spacing, oversampling and segment length that meet an error target.

Backprojection reads range profiles on a lattice whose spacing is the half-path distance between
neighbouring pixels of an image line. The more the true distance differs from it, the further a
pixel drifts from its lattice interval along a segment; this module takes the drift from the exact
geometry and chooses the quickest segment that keeps the predicted error.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...geometry.half_paths import Paths
from ...signal.radar import RadarParameters
from ..costs import costs
from ..error_budget import total_db
from ..interpolators import LEAST_MARGIN, LINE_DEGREE, Interpolator, design_interpolator
from .transform_length import cost_per_sample, smooth_lengths

ECHOES_PER_PASS = 32  # echoes that share the reference for the phase along a segment
_SEGMENTS = (256, 128, 64, 32, 16, 8)
_MAX_PHASES = 8
_ECHOES_FOR_ERRORS = 256  # enough for averages, to which few echoes add most
DRIFT_SLACK = 0.02  # lattice steps that pixels may drift further than planned; none notices
MOST_DRIFT = 2.0  # lattice steps
_CLOSER_DB = 10.0  # by which the worst drift may be worse than the mean one
_LONGER, _FINER, _FEW = 1.1, 1.03, 3  # padded length, cells, and cells around the best
_COST_TRANSFORM = 0.012  # of a pass of the transform, in shares of the whole


@dataclasses.dataclass(frozen=True)
class RangeResampling:
    """How profiles are resampled and read.

    Attributes
    ----------
    n_padded : int
        Length to which a profile is zero-padded before its Fourier transform.
    n_cells : int
        Cells of the lattice over the padded profile; a cell is one pixel of an image line.
    n_phases : int
        Positions of the lattice in a cell.
    segment : int
        Pixels that share one geometry expansion; 0 for the routine for arbitrary points.
    step_m : float
        Half-path distance between lattice positions, metres.
    spacing : float
        Pixel spacing along a line, in the unit of the planned paths.
    interpolator : Interpolator
        Weights for this oversampling and drift.
    predicted_error_db : float
        Predicted error of the image against time-domain correlation, dB.
    """

    n_padded: int
    n_cells: int
    n_phases: int
    segment: int
    step_m: float
    spacing: float
    interpolator: Interpolator
    predicted_error_db: float

    @property
    def cost(self) -> float:
        """Nanoseconds per pixel and echo."""
        model = costs()
        return (model.line_pixel + model.line_segment / self.segment if self.segment
                else model.point_pixel)

    def oversampling(self, radar: RadarParameters) -> float:
        """Lattice positions to a range resolution cell, 1 / bandwidth, of a radar."""
        return radar.range_resolution_m / self.step_m

    @property
    def cell_m(self) -> float:
        """Half-path distance between the lattice positions of neighbouring pixels, metres."""
        return self.step_m * self.n_phases

    def operations(self, n_echoes: int, n_pixels: int) -> dict[str, float]:
        """How often adding echoes to an image does the operations of `CostModel`."""
        counts = {'profile_bin': self.n_padded, 'profile_cell': self.n_cells * self.n_phases}
        counts |= ({'line_pixel': n_pixels, 'line_segment': n_pixels / self.segment}
                   if self.segment else {'point_pixel': n_pixels})
        return {name: n_echoes * n for name, n in counts.items()}


def plan_resampling(paths: Paths, spacing: float, n_line: int, radar: RadarParameters,
                    n_samples: int, target_db: float, *, fit_spacing: bool = False,
                    periodic: bool = False) -> RangeResampling | None:
    """Choose lattice, segment and interpolator for an error target of reading a profile, dB.

    None where range does not follow the lines closely enough.

    Parameters
    ----------
    radar, n_samples, target_db :
        Of the profiles, see `sar_imaging.planning`.
    paths : Paths
        Sampled over the image; derivatives by the same unit as `spacing`.
    spacing, n_line : float, int
        Pixel spacing along a line, and pixels of a line.
    fit_spacing : bool
        The image may take the pixel spacing that fits the lattice, near `spacing`.
    periodic : bool
        The samples are a period, which no zeros may extend.
    """
    slope = paths.of_lit(paths.derivatives[0])
    if not slope.size or slope.min() <= 0:
        return None
    middle = 0.5 * float(slope.min() + slope.max())
    pitch, errors = spacing * middle, _expansion_errors(paths, radar)
    slope = _slopes_of_some(paths)
    longest = next((s for s in reversed(_SEGMENTS) if s >= n_line), _SEGMENTS[0])
    for phases in range(1, _MAX_PHASES + 1):
        n_padded, n_cells = _commensurate(n_samples, radar.sample_spacing_m, pitch, phases,
                                          finer=fit_spacing, periodic=periodic)
        cell = n_padded * radar.sample_spacing_m / n_cells
        if fit_spacing:
            spacing = cell / middle
        lattices = (_fitted(RangeResampling(n_padded, n_cells, phases, segment, cell / phases,
                                            spacing, None, math.inf),
                            slope, errors, radar, target_db)
                    for segment in _SEGMENTS if segment <= longest)
        if found := [lattice for lattice in lattices if lattice is not None]:
            return min(found, key=lambda lattice: lattice.cost)  # more phases only cost memory
    return None


def _fitted(lattice, slope, errors, radar, target_db) -> RangeResampling | None:
    """A lattice with the interpolator that it needs; None where the target is missed."""
    drift, oversampling = _drift(lattice, slope), lattice.oversampling(radar)
    furthest = float(drift.max())
    if oversampling <= 1.25 or furthest > MOST_DRIFT:
        return None
    lattice = dataclasses.replace(lattice, interpolator=design_interpolator(
        oversampling, max(furthest, LEAST_MARGIN), degree=LINE_DEGREE))
    # With the worst drift everywhere first: most candidates need no closer look.
    if _predicted_db(lattice, lattice.interpolator.error_db, errors) > target_db + _CLOSER_DB:
        return None
    predicted = _predicted_db(lattice, _drifting_db(lattice, drift), errors)
    return (dataclasses.replace(lattice, predicted_error_db=predicted) if predicted <= target_db
            else None)


def resampling_error_db(lattice: RangeResampling, paths: Paths, radar: RadarParameters) -> float:
    """Predicted error of a lattice on other paths than it was planned for, dB.

    It is inf where pixels drift further than the lattice was made for.
    """
    drift = _drift(lattice, _slopes_of_some(paths))
    if drift.max() > lattice.interpolator.margin + DRIFT_SLACK:
        return math.inf
    return _predicted_db(lattice, _drifting_db(lattice, drift), _expansion_errors(paths, radar))


def _drift(lattice, slope) -> np.ndarray:
    """How far the pixels of some echoes drift over half a segment, lattice steps."""
    return (np.abs(slope * lattice.spacing - lattice.cell_m)
            * (lattice.segment / 2 / lattice.step_m))


def _drifting_db(lattice, drift) -> float:
    return 10 * math.log10(float(lattice.interpolator.error_with_drift(drift).mean()))


def _predicted_db(lattice, interpolation_db, errors) -> float:
    half = lattice.spacing * lattice.segment / 2
    return total_db(interpolation_db, *(20 * math.log10(error * half ** power + 1e-12)
                                        for power, error in errors))


def _slopes_of_some(paths: Paths) -> np.ndarray:
    echoes = _some_echoes(len(paths.length))
    slope = paths.of_lit(paths.derivatives[0][echoes], echoes)
    return slope if slope.size else paths.of_lit(paths.derivatives[0])


def _some_echoes(n: int) -> np.ndarray:
    return np.linspace(0, n - 1, min(n, _ECHOES_FOR_ERRORS)).round().astype(int)


def _from_shared(paths: Paths) -> list[np.ndarray]:
    """Derivatives of some echoes, less those of the middle one of the `ECHOES_PER_PASS` around."""
    n = len(paths.length)
    echoes = _some_echoes(n)
    middle = middle_of_pass(echoes, paths.parts, n)
    found = [paths.of_lit(d[echoes] - d[middle], echoes) for d in paths.derivatives]
    return found if found[0].size else [np.zeros(1)] * len(found)


def middle_of_pass(echoes, parts, n: int) -> np.ndarray:
    """(K,) int64 middle of the pass of each echo, of n; `parts` are the first added by itself."""
    part = np.searchsorted(parts, echoes, 'right')
    first, stop = np.take(parts, part - 1), np.append(parts, n)[part]
    start = first + (echoes - first) // ECHOES_PER_PASS * ECHOES_PER_PASS
    return start + np.minimum(stop - start, ECHOES_PER_PASS) // 2


def _rms(values) -> float:
    return math.sqrt(np.mean(np.square(values)))


def _expansion_errors(paths, radar):
    """Rms errors over a segment of half length 1, and the powers of it that they grow with.

    d_n being the path's derivatives by f, -1 to 1, the envelope's place lacks d_3 f^3 / 6, the
    path of all echoes d_4 f^4 / 24, and what an echo differs by,
    ``exp(j (a f + b f^2 + c f^3))`` with ``a, b, c = k d_n / n!``, its terms in f^4,
    economised, and f^5.
    """
    k = radar.wavenumber_rad_per_m
    band = radar.half_band_rad_per_m / math.sqrt(3)
    a, b, c = (k * d / math.factorial(n + 1)
               for n, d in enumerate(_from_shared(paths)[:3]))
    quartic = np.hypot(a ** 4 / 24 - b ** 2 / 2 - a * c, a ** 2 * b / 2) / 8 / math.sqrt(2)
    quintic = np.hypot(a ** 3 * b / 6, a ** 5 / 120 - a * b ** 2 / 2 - a ** 2 * c / 2) / 4
    third, fourth = (_rms(paths.of_lit(d)) for d in paths.derivatives[2:])
    return ((3, band / math.sqrt(7) / 6 * third), (4, k / 3 / 24 * fourth), (4, _rms(quartic)),
            (5, _rms(quintic)))


def plan_point_resampling(radar: RadarParameters, n_samples: int, target_db: float
                          ) -> RangeResampling:
    """Lattice for the routine that needs no common direction of range and lines."""
    oversampling = next(v for v in np.arange(1.6, 8.0, 0.2)
                        if design_interpolator(v, LEAST_MARGIN).error_db <= target_db - 3.0)
    pitch = radar.range_resolution_m / oversampling
    n_padded, n_cells = _commensurate(n_samples, radar.sample_spacing_m, pitch, 1)
    step = n_padded * radar.sample_spacing_m / n_cells
    interpolator = design_interpolator(radar.range_resolution_m / step, LEAST_MARGIN)
    return RangeResampling(n_padded, n_cells, 1, 0, step, pitch, interpolator,
                           total_db(interpolator.error_db))


def _commensurate(n_samples, spacing_m, pitch, phases, *, finer=False, periodic=False):
    """Padded length and number of cells, quick to transform, nearest to the pitch.

    N padded samples s apart make n cells of ``N s / n``. With `finer` these may be smaller than
    the pitch, not larger, which leaves room for lengths whose transform is quick. Periodic samples
    are not padded.
    """
    best = None
    for length in [n_samples] if periodic else smooth_lengths(n_samples, _LONGER):
        ideal = length * spacing_m / pitch
        near = _FEW if periodic else 0  # one length has to do
        candidates = range(max(math.floor(ideal) - near, 1), math.ceil(ideal) + near + 1)
        if finer:
            candidates = [n // phases for n in smooth_lengths(
                math.ceil(ideal) * phases, _FINER) if n % phases == 0] or candidates
        for cells in candidates:
            cost = (abs(cells / ideal - 1) + 1e-3 * (length / n_samples - 1)
                    + (_COST_TRANSFORM if finer else 1e-4) * cost_per_sample(cells * phases))
            if best is None or cost < best[0]:
                best = (cost, length, cells)
    return best[1:]
