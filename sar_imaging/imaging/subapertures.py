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

from ..geometry.polar import PolarGrid
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters
from .beams import BeamLines
from .first_stage import FirstStage
from .fusion_error import EVERYTHING, Coverage
from .fusion_grid import FusionGrid
from .lattice import half_paths, plan_lattice, remaining_db, sample_paths, total_db
from .local_bands import TAPERS_NEEDED, Bands, local_bands, used_share
from .profiles import Profiles
from .projection import PolarLines
from .range_band import RangeBand
from .range_window import RangeWindow
from .subaperture_sampling import choose_sampling, fusion_error
from .work_space import aligned_empty

_STAGE_SHARE_DB = 6.0  # of the target: by so much less the error of sub-aperture images
_MARGIN_DB = 0.5  # predictions are as good as that (docs/benchmarks.md)
_MOST_FILLED = 0.93  # of the band along range: tapers widen it (measured: no harm up to 0.89)
_SAMPLES_PER_SIDE = 5  # grid positions at which the paths are bounded
_SAMPLES_PER_EDGE = 33
_ROWS_FOR_PATHS = 512  # enough to bound how paths differ along a line
_SAMPLING_SLACK = 0.02  # of what is bounded
_PADDING = 32  # samples of windows, for the delays of rows of beams
_DRIFT_SLACK = 0.02  # lattice steps that pixels may drift further than planned; none notices
LENGTHS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)  # pulses to choose from


@dataclasses.dataclass(frozen=True)
class Limits:
    """Extremes of the geometry between phase centres and a polar grid.

    Attributes
    ----------
    range_m : (float, float)
        Smallest and largest half path, metres.
    slope : (float, float)
        Of the half paths by range.
    slope_m : float
        Largest magnitude of their slope by direction over that by range, metres.
    half_range : float
        Largest frequency of the images along range, relative to the carrier's, rad/m.
    """

    range_m: tuple[float, float]
    slope: tuple[float, float]
    slope_m: float
    half_range: float

    @classmethod
    def of(cls, bands: Bands) -> Limits:
        """Extremes of half paths, of their derivatives and of local frequencies."""
        steepest = float(max(bands.slope.max(), -bands.slope.min()))
        return cls(bands.range_m, bands.by_range, steepest, bands.half_range)

    def contain(self, other: Limits, slope_slack: float = 0.0) -> bool:
        """True when what was planned for these limits holds for the other ones, too.

        Parameters
        ----------
        other : Limits
            Those of other phase centres.
        slope_slack : float
            By how much the half paths' slopes by range may exceed those planned for.
        """
        def within(a, b, least=0.0):
            # The extremes of samples miss the true ones by less than this.
            slack = max(_SAMPLING_SLACK * (b[1] - b[0]), least)
            return b[0] - slack <= a[0] and a[1] <= b[1] + slack

        return (within(other.range_m, self.range_m)
                and within(other.slope, self.slope, slope_slack)
                and within((0.0, other.slope_m), (0.0, self.slope_m))
                and within((0.0, other.half_range), (0.0, self.half_range)))


class SubaperturePlan:
    """Cut of an aperture and polar grid of its sub-aperture images.

    Parameters
    ----------
    polar : PolarGrid
        Where the fused image is wanted.
    radar : RadarParameters
        Of the compressed profiles, or of the phase histories.
    n_samples : int
        Samples of a profile, or frequencies of a pulse.
    tx_m, rx_m : (P, C, 3) array_like
        Phase centres of the whole aperture, metres, in the order of the pulses.
    target_db : float
        Wanted error of the fused image against exact backprojection, dB.
    pulses_per_subaperture : int, optional
        Length of the sub-apertures; the quickest if left out.
    oversampling : (float, float)
        Of `polar` along range and direction, for `FusionGrid`.
    ratio : (int, int)
        Ranges of a sub-aperture image to those of the fused one.
    coverage : Coverage
        What of `polar` must be right, see `map_coverage`.
    band : RangeBand, optional
        Takes phase histories as they came, in place of profiles.

    Attributes
    ----------
    polar : PolarGrid
        As given.
    radar : RadarParameters
        Of the profiles.
    coarse : PolarGrid
        Of the sub-aperture images; it reaches beyond `polar` by the guards.
    sampling : Sampling
        Cut and coarse sampling.
    limits : Limits
        Geometry that the plan was made for.
    predicted_error_db : float
        Predicted error of the fused polar image against exact backprojection, dB.
    beams : BeamSampling or None
        Sampling of the beams that sub-aperture images are made from; None where each pulse is
        added to them directly.
    fusion_grid : FusionGrid
        What the second stage needs.
    warnings : tuple of str
        What may make the error larger than predicted.

    Raises
    ------
    ValueError
        No sampling of this geometry meets the target, or it does not suit a polar grid.
    """

    def __init__(self, polar: PolarGrid, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
                 target_db: float = -50.0, pulses_per_subaperture: int | None = None,
                 oversampling: tuple[float, float] = (1.0, 1.0),
                 ratio: tuple[int, int] = (1, 1), coverage: Coverage = EVERYTHING,
                 band: RangeBand | None = None):
        tx_m, rx_m = np.asarray(tx_m, np.float64), np.asarray(rx_m, np.float64)
        self.polar, self.n_samples = polar, int(n_samples)
        self._given, self._band = radar, band
        self.radar = radar = radar if band is None else band.radar
        self._n_channels = tx_m.shape[1]
        paths = sample_paths(*_rows_and_samples(polar, tx_m, rx_m, _SAMPLES_PER_SIDE,
                                                _SAMPLES_PER_SIDE))
        self._lattice_db = min(target_db - _STAGE_SHARE_DB, -50.0)
        bands = local_bands(polar, tx_m, rx_m, radar)
        share = used_share(bands.half_range, polar.range_spacing_m, polar.n_range,
                           tapers=TAPERS_NEEDED)
        if ratio[0] / ratio[1] < share:
            ratio = 1, 1
        usual = dataclasses.replace(polar, n_range=polar.n_range * ratio[0] // ratio[1],
                                    range_spacing_m=polar.range_spacing_m * ratio[1] / ratio[0])
        lattice = self._plan_lattice(paths, usual.range_spacing_m, self.n_samples)
        filled = bands.half_range * usual.range_spacing_m / math.pi
        if filled > _MOST_FILLED:
            raise ValueError(
                f'the sub-aperture images fill {filled:.0%} of what the ranges of the polar grid '
                f'hold, at most {_MOST_FILLED:.0%} can be fused: the elevation changes too much '
                'over this aperture; use Backprojector')
        lengths = (pulses_per_subaperture,) if pulses_per_subaperture else LENGTHS
        self.sampling = choose_sampling(polar, bands, tx_m, rx_m, lengths,
                                        self._first_stage(usual, lattice, tx_m, rx_m,
                                                          bands.range_m),
                                        remaining_db(target_db - _MARGIN_DB, self._lattice_db),
                                        coverage, ratio)
        if self.sampling is None:
            raise ValueError(
                f'no sub-apertures of {", ".join(map(str, lengths))} pulses reach '
                f'target_db={target_db:g} on this polar grid; ask for less, image a smaller '
                'scene, or use Backprojector')
        s = self.sampling
        self.fusion_grid = FusionGrid(polar, s.n_coarse, s.n_fine, s.n_guard, s.beta,
                                      s.n_coarse_range, s.n_fine_range, bands.half_range,
                                      radar.carrier_hz, *oversampling)
        self.coarse = self.fusion_grid.coarse
        guard = self.fusion_grid.fine_range_guard * polar.range_spacing_m
        range_m = _bounds(self.coarse, tx_m, rx_m)
        window = band or RangeWindow.around(radar, self.n_samples, range_m)
        padding = 0 if window.periodic else _PADDING
        # rows of one sub-aperture share phases, never those of two
        per_path = tx_m[..., 0].size / len(paths.length)
        first = {int(p.start * self._n_channels / per_path) for p in s.pulses}
        paths = dataclasses.replace(paths, parts=tuple(sorted(first)))
        self.lattice = self._plan_lattice(paths, self.coarse.range_spacing_m,
                                          window.n_samples + padding,
                                          remaining_db(target_db, s.error_db))
        self.beams = self._first_stage(
            self.coarse, self.lattice, tx_m, rx_m, range_m).choose_beams(
                s.pulses, self.coarse.n_alpha * self.coarse.n_range)
        self._stage_error_db = (self.beams or self.lattice).predicted_error_db
        self.predicted_error_db = total_db(self._stage_error_db, self.sampling.error_db)
        self.warnings = tuple(self._cut_warnings(paths.length, guard))
        self.limits = Limits.of(bands)
        # Slopes as far beyond let pixels drift by this over half a segment, seen from the lattice.
        self._slope_slack = 2 * _DRIFT_SLACK * self.lattice.step_m / (
            max(self.lattice.segment, 1) * self.lattice.spacing)
        self._lines = (PolarLines(self.coarse, Profiles(window, self.lattice, range_m))
                       if self.beams is None else
                       BeamLines(self.coarse, window, self.lattice, self.beams, range_m))

    def _first_stage(self, grid, lattice, tx_m, rx_m, range_m) -> FirstStage:
        span = self.polar.n_alpha * self.polar.alpha_spacing
        padding_m = math.inf if self._band else _PADDING * self.radar.sample_spacing_m
        return FirstStage(grid, span, self.radar, lattice, tx_m, rx_m, self._lattice_db, range_m,
                          padding_m)

    def _plan_lattice(self, paths, spacing, n_samples, *more_db):
        """Lattice with the usual error, or where there is none, with one of `more_db`."""
        for error_db in (self._lattice_db, *more_db):
            lattice = plan_lattice(paths, spacing, self.polar.n_range, self.radar, n_samples,
                                   error_db, periodic=self._band is not None)
            if lattice is not None:
                return lattice
        raise ValueError('the polar grid does not follow the range of this track (too near, or '
                         'around the antenna); use Backprojector')

    def _cut_warnings(self, length, guard_m: float):
        """Profiles that end within the guards, where the taper should find whole responses."""
        if self._band is None:
            start = self.radar.range_start_m
            stop = start + self.n_samples * self.radar.sample_spacing_m
        else:  # they repeat, which does no harm in the guards
            start, guard_m = self._band.range_start_m, 0.0
            stop = start + self._band.period_m
        before, after = (share * self.polar.n_range * self.polar.range_spacing_m
                         for share in self.sampling.coverage.range_margins)
        short = max(start - length.min() - before, length.max() - after - stop) + guard_m
        if short > 0 and self._band is None:
            yield (f'the profiles end {short:.1f} m short of the guards, {guard_m:.1f} m wide, '
                   'around the near and far edge; scatterers cut off there raise the error above '
                   'the prediction: keep more of the profiles, or take longer sub-apertures')
        elif short > 0:
            yield (f'the scene reaches {short:.1f} m beyond the {stop - start:.1f} m that the '
                   f'{self.n_samples} frequencies tell apart around the reference delay; what '
                   'lies there appears in its place as well')

    @property
    def n_subapertures(self) -> int:
        """Number of sub-apertures."""
        return len(self.sampling.pulses)

    def __str__(self) -> str:
        s, lengths = self.sampling, [p.stop - p.start for p in self.sampling.pulses]
        way = 'directly' if self.beams is None else 'from beams'
        return (f'{self.n_subapertures} sub-apertures of {min(lengths)} to {max(lengths)} pulses, '
                f'backprojected {way}, '
                f'{s.n_coarse} coarse lines each ({2 * s.n_guard:g} of them guards) of '
                f'{self.coarse.n_range} ranges, fused to {s.n_fine} lines; predicted error '
                f'{self.predicted_error_db:.1f} dB')

    def check(self, tx_m, rx_m) -> tuple[float, float, bool]:
        """Band of a sub-aperture from its phase centres, and how well it suits the plan.

        Parameters
        ----------
        tx_m, rx_m : (P, C, 3) float64
            Phase centres, metres; they need not be those that were planned for.

        Returns
        -------
        centre_m : float
            Middle of the band, metres, as `SpectrumFusion.add` wants it.
        error_db : float
            Predicted error against exact backprojection, dB.
        within : bool
            The phase centres lie within what was planned for.

        Raises
        ------
        ValueError
            Range does not grow along the lines of the grid.
        """
        bands = local_bands(self.polar, tx_m, rx_m, self.radar)
        within = self.limits.contain(Limits.of(bands), self._slope_slack)
        centre = 0.5 * float(bands.slope.min() + bands.slope.max())
        error = fusion_error(self.sampling, self.polar, bands, slice(None), bands.weight, centre)
        error_db = total_db(self._stage_error_db, 10 * math.log10(error + 1e-16))
        return centre, error_db, within

    def image(self, number: int, block: PulseBlock, weights=None, out=None) -> np.ndarray:
        """Backproject one sub-aperture (Zhang et al., equation 6).

        Parameters
        ----------
        number : int
            Which sub-aperture; its nominal pulses are ``sampling.pulses[number]``.
        block : PulseBlock
            Its range profiles, or its phase histories, with phase centres.
        weights : (P,) float32, optional
            Window over its pulses.
        out : (2, n_alpha, n_range) float32, optional
            Memory for the image; fresh memory costs time.

        Returns
        -------
        (2, n_alpha, n_range) float32
            Real and imaginary part on `coarse`, at range baseband: times
            ``exp(-j 4 pi (r - r_0) / lambda)``, r_0 the first range of `coarse`.

        Raises
        ------
        ValueError
            The block does not match the plan, or there is no such sub-aperture.
        """
        check_profiles(block, self._given, self.n_samples, compressed=self._band is None)
        if not 0 <= number < self.n_subapertures:
            raise ValueError(f'number={number}; the plan has sub-apertures 0 to '
                             f'{self.n_subapertures - 1}')
        shape = (2, self.coarse.n_alpha, self.coarse.n_range)
        parts = aligned_empty(shape, np.float32) if out is None else out
        if weights is not None:
            weights = np.repeat(weights, self._n_channels)
        self._lines.fill(block.samples.reshape(-1, self.n_samples), block.tx_m.reshape(-1, 3),
                         block.rx_m.reshape(-1, 3), parts, weights)
        return parts


def _middles(tx_m, rx_m) -> np.ndarray:
    return 0.5 * (tx_m + rx_m).mean(axis=1)


def _rows_and_samples(polar: PolarGrid, tx_m, rx_m, n_range, n_alpha):
    """Some rows, and ranges and directions of the grid, direction by direction."""
    r, alpha = (v.ravel() for v in np.meshgrid(
        np.linspace(polar.range_m[0], polar.range_m[-1], n_range),
        np.linspace(polar.alpha[0], polar.alpha[-1], n_alpha)))
    tx, rx = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
    # neighbouring rows in groups, since they are added together
    step = max(1, len(tx) // _ROWS_FOR_PATHS)
    return tx[::step], rx[::step], polar.lines(r, alpha)


def _bounds(polar: PolarGrid, tx_m, rx_m) -> tuple[float, float]:
    """Smallest and largest half path to a grid along whose lines they grow, metres."""
    tx_m, rx_m, lines = _rows_and_samples(polar, tx_m, rx_m, 2, _SAMPLES_PER_EDGE)
    length = half_paths(tx_m, rx_m, lines[0])[0]
    near, far = length[:, ::2], length[:, 1::2]
    # what rows and directions between the samples may add
    slack = [sum(np.abs(np.diff(edge, axis=axis)).max(initial=0.0) for axis in (0, 1))
             for edge in (near, far)]
    return float(near.min() - slack[0]), float(far.max() + slack[1])
