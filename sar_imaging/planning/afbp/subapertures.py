"""First stage of AFBP: sub-aperture images on one polar grid, coarse in direction.

Zhang et al., section II.A: all sub-apertures share unified polar coordinates, so that their
spectra can be joined. How long a sub-aperture may be, how many lines its image needs and how far
the grid must reach beyond the scene follow from the exact geometry: the derivatives of the half
paths are the local frequencies of the image.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...geometry.half_paths import half_paths, sample_paths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...signal.pulses import PulseBlock, check_profiles
from ...signal.radar import RadarParameters
from ..aliasing_error import EVERYTHING, PixelDensity
from ..error_budget import AFBP_SHARES, error_budget, remaining_db, total_db
from ..guard_taper import TAPERS_NEEDED, used_share
from ..local_spectrum import Limits, local_spectrum
from ..plan import Plan
from ..polar_cover import PolarCover
from ..profiles.phase_history import PhaseHistory
from ..profiles.range_gate import RangeGate
from ..profiles.range_resampling import (
    DRIFT_SLACK,
    RangeResampling,
    plan_resampling,
    resampling_error_db,
)
from .beam_gain import bins_per_run
from .beams import BeamSampling
from .lit_subapertures import AmplitudeNodes, LitError, LitSubapertures, amplitude_nodes
from .map_cover import map_density
from .polar_grids import UnifiedPolarGrids
from .sampling import Sampling, choose_sampling, fusion_error
from .subaperture_cost import SubapertureCost

_MARGIN_DB = 0.5  # predictions are as good as that (docs/benchmarks.md)
_MOST_FILLED = 0.93  # of the band along range: tapers widen it (measured: no harm up to 0.89)
_SAMPLES_PER_SIDE = 5  # grid positions at which the paths are bounded
_SAMPLES_PER_EDGE = 33
_ROWS_FOR_PATHS = 512  # enough to bound how paths differ along a line
_PADDING = 32  # samples of windows, for the delays of echoes in beams
LENGTHS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)  # pulses to choose from


@dataclasses.dataclass(frozen=True, eq=False)
class SubaperturePlan(Plan):
    """Cut of an aperture and polar grid of its sub-aperture images.

    Attributes
    ----------
    given : RadarParameters
        Of the blocks to come.
    n_channels : int
        Channels of a pulse.
    sampling : Sampling
        Cut and coarse sampling.
    fusion_grid : UnifiedPolarGrids
        What the second stage needs.
    beams : BeamSampling or None
        Sampling of the beams that sub-aperture images are made from; None where each pulse is
        added to them directly.
    limits : Limits
        Geometry that the plan was made for.
    lit : LitSubapertures or None
        How images are weighed; None where all pixels are lit alike.
    """

    polar: PolarGrid
    given: RadarParameters
    source: RangeGate | PhaseHistory
    n_samples: int
    n_channels: int
    sampling: Sampling
    fusion_grid: UnifiedPolarGrids
    lattice: RangeResampling
    beams: BeamSampling | None
    range_m: tuple[float, float]
    limits: Limits
    warnings: tuple[str, ...]
    lit: LitSubapertures | None = None

    @property
    def radar(self) -> RadarParameters:
        """Of the profiles."""
        return self.source.radar

    @property
    def coarse(self) -> PolarGrid:
        """Grid of the sub-aperture images; it reaches beyond `polar` by the guards."""
        return self.fusion_grid.coarse

    @property
    def n_subapertures(self) -> int:
        """Number of sub-apertures."""
        return len(self.sampling.pulses)

    @property
    def errors_db(self) -> dict[str, float]:
        """Predicted error of the fused polar image by cause, dB."""
        errors = {'sub-aperture images': (self.beams or self.lattice).predicted_error_db,
                  'fusion': self.sampling.error_db}
        return errors if self.lit is None else {
            **errors, 'illumination': self.lit.predicted_error_db}

    def __str__(self) -> str:
        s, lengths = self.fusion_grid, [p.stop - p.start for p in self.sampling.pulses]
        way = 'directly' if self.beams is None else 'from beams'
        return (f'{self.n_subapertures} sub-apertures of {min(lengths)} to {max(lengths)} pulses, '
                f'backprojected {way}, '
                f'{s.n_coarse} coarse lines each ({2 * s.n_guard:g} of them guards) of '
                f'{self.coarse.n_range} ranges, fused to {s.n_fine} lines; predicted error '
                f'{self.predicted_error_db:.1f} dB')

    def illumination_of(self, block: PulseBlock) -> Illumination | None:
        """Of the echoes of a sub-aperture's pulses; None where all pixels are lit alike."""
        if self.lit is None:
            return None
        lit = self.lit.illumination
        return Illumination.of_pulses(lit.pattern, block.pointing, block.tx_m, block.rx_m,
                                      foreseen=lit.foreseen)

    def weighed_by(self, block: PulseBlock) -> Illumination | tuple[AmplitudeNodes, ...] | None:
        """Amplitudes of echoes that are added directly, or nodes of each image from beams.

        None where all pixels are lit alike.
        """
        if self.lit is None or self.beams is None:
            return self.illumination_of(block)
        return amplitude_nodes(self.lit.illumination.pattern, block, self.beams.n_weighed)

    def image_operations(self, n_echoes: int, n_images: int = 1) -> dict[str, float]:
        """How often forming sub-aperture images does the operations of `CostModel`.

        `n_echoes` are the echoes of all images together.
        """
        coarse, lattice, beams = self.coarse, self.lattice, self.beams
        n_pixels, n_bins = coarse.n_alpha * coarse.n_range, lattice.n_padded
        if beams is None:
            return lattice.operations(n_echoes, n_pixels)
        span = coarse.n_alpha * coarse.alpha_spacing
        counts = beams.operations(n_echoes, lattice, n_pixels, span, n_images)
        if beams.n_weighed:
            counts['lit_knot'] = counts['lit_image'] * self.lit.n_knots(coarse, beams.segment)
        relative_bandwidth = (n_bins * self.radar.wavelength_m
                              / (2 * lattice.n_cells * lattice.cell_m))
        half = min(n_bins, lattice.n_cells) / 2
        n_runs = 2 * math.ceil(half / bins_per_run(n_bins, relative_bandwidth))
        return {'profile_bin': n_echoes * n_bins * (not self.source.periodic),
                'beam_path': n_echoes * beams.n_beams(span) * (1.0 if beams.paired else 1.5),
                'beam_run': counts['beam_group'] / n_bins * n_runs,
                **{name: float(n) for name, n in counts.items()}}

    @property
    def fusion_operations(self) -> dict[str, float]:
        """How often fusing all sub-aperture images does the operations of `CostModel`."""
        return self.fusion_grid.operations(self.n_subapertures)

    def check_block(self, number: int, block: PulseBlock) -> None:
        """Raise ValueError where the block does not match, or there is no such sub-aperture."""
        check_profiles(block, self.given, self.n_samples, compressed=not self.source.periodic)
        if not 0 <= number < self.n_subapertures:
            raise ValueError(f'number={number}; the plan has sub-apertures 0 to '
                             f'{self.n_subapertures - 1}')

    def check(self, tx_m, rx_m, illumination: Illumination | None = None
              ) -> tuple[float, float, bool]:
        """Band of a sub-aperture from its phase centres, and how well it suits the plan.

        They need not be those that were planned for; `illumination` is that of their echoes.

        Returns
        -------
        centre_m, error_db : float
            Middle of the band, metres, as `SpectrumFusion.add` wants it, and predicted error.
        within : bool
            The phase centres lie within what was planned for.

        Raises
        ------
        ValueError
            Range does not grow along the lines of the grid.
        """
        bands = local_spectrum(self.polar, tx_m, rx_m, self.radar, illumination,
                               self.sampling.coverage.wanted_ranges)
        # Slopes as far beyond let pixels drift by this over half a segment, seen from the lattice.
        slack = 2 * DRIFT_SLACK * self.lattice.step_m / (
            max(self.lattice.segment, 1) * self.lattice.spacing)
        within = self.limits.contain(Limits.of(bands), slack)
        centre = 0.5 * float(bands.slope.min() + bands.slope.max())
        error = fusion_error(self.sampling, bands, slice(None), bands.weight, centre)
        error_db = total_db(self._image_db(tx_m, rx_m, illumination),
                            10 * math.log10(error + 1e-16))
        return centre, error_db, within

    def _image_db(self, tx_m, rx_m, illumination) -> float:
        """Error of a sub-aperture's image by its phase centres, dB; as planned from beams."""
        planned_db = self.errors_db['sub-aperture images']
        if self.beams is not None:
            return planned_db
        lines = self.polar.lines(*self.polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE))
        paths = sample_paths(tx_m.reshape(-1, 3), rx_m.reshape(-1, 3), lines)
        if illumination is not None:
            paths = illumination.of_paths(paths, lines[0])
        if paths.lit is not None and not paths.lit.any():
            return planned_db
        found_db = resampling_error_db(self.lattice, paths, self.radar)
        return found_db if math.isfinite(found_db) else planned_db  # the limits tell


def plan_subapertures(polar: PolarGrid, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
                      target_db: float = -50.0, pulses_per_subaperture: int | None = None,
                      cover: PolarCover | None = None, band: PhaseHistory | None = None,
                      illumination: Illumination | None = None) -> SubaperturePlan:
    """Plan the sub-apertures of an aperture.

    Parameters
    ----------
    polar : PolarGrid
        Where the fused image is wanted.
    radar, n_samples, tx_m, rx_m, target_db, pulses_per_subaperture :
        As for `plan_afbp`; the error is that of the fused image.
    cover : PolarCover, optional
        Of the map that the fused image is read for; `polar` is its own, or has fewer lines.
    band : PhaseHistory, optional
        Takes phase histories as they came, in place of profiles.
    illumination : Illumination, optional
        Of the P C echoes.

    Raises
    ------
    ValueError
        No sampling of this geometry meets the target, or it does not suit a polar grid.
    """
    tx_m, rx_m = np.asarray(tx_m, np.float64), np.asarray(rx_m, np.float64)
    planner = _Planner(polar, radar if band is None else band.radar, int(n_samples), tx_m, rx_m,
                       target_db, EVERYTHING if cover is None else map_density(polar, cover),
                       band, illumination)
    return planner.plan(radar, pulses_per_subaperture, cover)


@dataclasses.dataclass(frozen=True)
class _Planner:
    polar: PolarGrid
    radar: RadarParameters  # of the profiles
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray
    target_db: float
    coverage: PixelDensity
    band: PhaseHistory | None
    illumination: Illumination | None

    def plan(self, given, length, cover) -> SubaperturePlan:
        polar, radar, tx_m, rx_m = self.polar, self.radar, self.tx_m, self.rx_m
        ratio, oversampling = ((1, 1), ()) if cover is None else (cover.ratio, cover.oversampling)
        # neighbouring echoes in groups, since they are added together
        step = max(1, tx_m[..., 0].size // _ROWS_FOR_PATHS)
        paths = sample_paths(*(c.reshape(-1, 3)[::step] for c in (tx_m, rx_m)),
                             polar.lines(*polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE)))
        if self.illumination is not None:
            paths = self.illumination.select(slice(None, None, step)).of_paths(
                paths, polar.lines(*polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE))[0])
        bands = local_spectrum(polar, tx_m, rx_m, radar, self.illumination,
                               self.coverage.wanted_ranges)
        lit = self.illumination and LitError(polar, radar, tx_m, rx_m, self.illumination,
                                             self.target_db)
        sampling = self._sampling(bands, paths, length, ratio, lit)
        grid = UnifiedPolarGrids(
            *vars(sampling.sizes).values(), bands.half_range, radar.carrier_hz,
            *(oversampling or (1.0, 1.0)), radar.propagation_speed_m_per_s)
        range_m = _bounds(grid.coarse, tx_m, rx_m)
        source = self.band or RangeGate.around(radar, self.n_samples, range_m, _PADDING)
        # echoes of one sub-aperture share phases, never those of two
        first = {p.start * tx_m.shape[1] // step for p in sampling.pulses}
        lattice = self._lattice(
            dataclasses.replace(paths, parts=tuple(sorted(first))), grid.coarse.range_spacing_m,
            source.n_samples + (0 if source.periodic else _PADDING),
            remaining_db(self.target_db, sampling.error_db))
        beams = self._cost(grid.coarse, lattice, range_m, lit).choose_beams(sampling.pulses)
        warnings = [*self._cut_warnings(paths.of_lit(paths.length),
                                        grid.fine_range_guard * polar.range_spacing_m)]
        if lit is not None:
            lattice, lit = lit.plan(grid.coarse, lattice, beams, sampling.pulses)
        return SubaperturePlan(polar, given, source, self.n_samples, tx_m.shape[1], sampling, grid,
                               lattice, beams, range_m, Limits.of(bands), tuple(warnings), lit)

    @property
    def _lattice_db(self) -> float:
        return min(error_budget(self.target_db, AFBP_SHARES)['sub-aperture images'], -50.0)

    def _sampling(self, bands, paths, length, ratio, lit) -> Sampling:
        polar = self.polar
        share = used_share(bands.half_range, polar.range_spacing_m, polar.n_range,
                           tapers=TAPERS_NEEDED)
        if ratio[0] / ratio[1] < share:
            ratio = 1, 1
        usual = dataclasses.replace(polar, n_range=polar.n_range * ratio[0] // ratio[1],
                                    range_spacing_m=polar.range_spacing_m * ratio[1] / ratio[0])
        lattice = self._lattice(paths, usual.range_spacing_m, self.n_samples)
        filled = bands.half_range * usual.range_spacing_m / math.pi
        if filled > _MOST_FILLED:
            raise ValueError(
                f'the sub-aperture images fill {filled:.0%} of what the ranges of the polar grid '
                f'hold, at most {_MOST_FILLED:.0%} can be fused: the elevation changes too much '
                'over this aperture; use exact backprojection')
        lengths, left_db = (length,) if length else LENGTHS, self.target_db - _MARGIN_DB
        if lit is not None:
            left_db = remaining_db(left_db, lit.budget_db)
        sampling = choose_sampling(polar, bands, self.tx_m, self.rx_m, lengths,
                                   self._cost(usual, lattice, bands.range_m, lit),
                                   remaining_db(left_db, self._lattice_db),
                                   self.coverage, ratio)
        if sampling is None:
            raise ValueError(
                f'no sub-apertures of {", ".join(map(str, lengths))} pulses reach '
                f'target_db={self.target_db:g} on this polar grid; ask for less, image a smaller '
                'scene, or use exact backprojection')
        return sampling

    def _cost(self, grid, lattice, range_m, lit) -> SubapertureCost:
        padding_m = math.inf if self.band else _PADDING * self.radar.sample_spacing_m
        return SubapertureCost(grid, self.polar.n_alpha * self.polar.alpha_spacing, self.radar,
                               lattice, self.tx_m, self.rx_m, self._lattice_db,
                               range_m[1] - range_m[0], padding_m,
                               *([] if lit is None else [lit.n_weighed]))

    def _lattice(self, paths, spacing, n_samples, *more_db) -> RangeResampling:
        """Lattice with the usual error, or where there is none, with one of `more_db`."""
        for error_db in (self._lattice_db, *more_db):
            lattice = plan_resampling(paths, spacing, self.polar.n_range, self.radar, n_samples,
                                      error_db, periodic=self.band is not None)
            if lattice is not None:
                return lattice
        raise ValueError('the polar grid does not follow the range of this track (too near, or '
                         'around the antenna); use exact backprojection')

    def _cut_warnings(self, length, guard_m: float):
        """Profiles that end within the guards, where the taper should find whole responses."""
        if self.band is None:
            start = self.radar.range_start_m
            stop = start + self.n_samples * self.radar.sample_spacing_m
        else:  # they repeat, which does no harm in the guards
            start, guard_m = self.band.range_start_m, 0.0
            stop = start + self.band.period_m
        before, after = (share * self.polar.n_range * self.polar.range_spacing_m
                         for share in self.coverage.range_margins)
        short = max(start - length.min() - before, length.max() - after - stop) + guard_m
        if short > 0 and self.band is None:
            yield (f'the profiles end {short:.1f} m short of the guards, {guard_m:.1f} m wide, '
                   'around the near and far edge; scatterers cut off there raise the error above '
                   'the prediction: keep more of the profiles, or take longer sub-apertures')
        elif short > 0:
            yield (f'the scene reaches {short:.1f} m beyond the {stop - start:.1f} m that the '
                   f'{self.n_samples} frequencies tell apart around the reference delay; what '
                   'lies there appears in its place as well')


def _bounds(polar: PolarGrid, tx_m, rx_m) -> tuple[float, float]:
    """Smallest and largest half path to a grid along whose lines they grow, metres."""
    step = max(1, tx_m[..., 0].size // _ROWS_FOR_PATHS)
    length = half_paths(*(c.reshape(-1, 3)[::step] for c in (tx_m, rx_m)),
                        polar.lines(*polar.sampled(2, _SAMPLES_PER_EDGE))[0])[0]
    near, far = length[:, ::2], length[:, 1::2]
    # what echoes and directions between the samples may add
    slack = [sum(np.abs(np.diff(edge, axis=axis)).max(initial=0.0) for axis in (0, 1))
             for edge in (near, far)]
    return float(near.min() - slack[0]), float(far.max() + slack[1])
