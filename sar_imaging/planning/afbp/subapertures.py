# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""First stage of AFBP: the cut of an aperture, and sub-aperture images coarse in direction.

Zhang et al., section II.A: all sub-apertures share unified polar coordinates, so that their
spectra can be joined. How long a sub-aperture may be, how many lines its image needs and how far
the grid must reach beyond the scene follow from the exact geometry: the derivatives of the half
paths times the wavenumber are the local frequencies of the image. These bound the bands of the
sub-aperture images, from which follow the lines that each needs and the error of the fusion.
Images are formed from beams or directly, as is quicker.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.fft

from ...geometry.half_paths import Paths, half_paths, sample_paths
from ...geometry.illumination import NO_SPREAD, AmplitudeSpread, Illumination
from ...geometry.polar import PolarGrid
from ...geometry.track import mean_centres
from ...signal.pulses import PulseBlock, check_profiles
from ...signal.radar import RadarParameters
from ..aliasing_error import (
    EVERYTHING,
    TAPERS_NEEDED,
    PixelDensity,
    aliasing_error,
    correction_error,
    taper_shape,
    used_share,
    usual_guard,
)
from ..costs import costs
from ..echo_power import echo_powers, spread_frequencies, tail_error
from ..plan import AFBP_SHARES, Plan, error_budget, remaining_db, total_db
from ..polar_cover import PolarCover
from ..profiles import (
    DRIFT_SLACK,
    PASSES,
    PhaseHistory,
    RangeGate,
    RangeResampling,
    plan_resampling,
    resampling_error_db,
)
from ..transform_lengths import quick_length, row_length
from .beams import (
    SLACK,
    BeamSampling,
    bins_per_run,
    least_bending_slope,
    least_operations,
    plan_beams,
)
from .illumination import (
    AmplitudeError,
    AmplitudeNodes,
    SubapertureAmplitudes,
    amplitude_nodes,
)
from .polar_grids import FusionSizes, UnifiedPolarGrids, map_density

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded
_SAMPLING_SLACK = 0.02  # of what is bounded


@dataclasses.dataclass(frozen=True)
class LocalSpectrum:
    """Local frequencies of a grid's sub-aperture images.

    Attributes
    ----------
    slope : (R, S) float64
        Derivative of the half path by direction, over that by range, metres, from each echo to
        points direction by direction. Times the frequency along range it is that along direction.
    growth : (R, S) float64
        Derivative of the half path by range. Times the wavenumber it is the frequency along range.
    position : (S,) float64
        Where the points lie along direction, 0 to 1.
    wavenumber : (2,) floats
        Lowest and highest of the band, rad/m.
    half_range : float
        Largest frequency along range, relative to the carrier's, rad/m.
    weight : (W, R) float64
        Shares of the echoes in the power of an image, see `echo_powers`.
    spread : AmplitudeSpread
        Frequencies along direction of the echoes' amplitude, radians per unit of it.
    """

    slope: np.ndarray
    growth: np.ndarray
    position: np.ndarray
    wavenumber: tuple[float, float]
    half_range: float
    range_m: tuple[float, float]
    weight: np.ndarray
    spread: AmplitudeSpread = NO_SPREAD


@dataclasses.dataclass(frozen=True)
class Limits:
    """Extremes of the geometry between phase centres and a polar grid.

    Attributes
    ----------
    slope : (float, float)
        Slope of the half paths by range.
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
    def of(cls, bands: LocalSpectrum) -> Limits:
        """Extremes of half paths, of their derivatives and of local frequencies."""
        steepest = float(max(bands.slope.max(), -bands.slope.min()))
        growth = float(bands.growth.min()), float(bands.growth.max())
        return cls(bands.range_m, growth, steepest, bands.half_range)

    def contain(self, other: Limits, slope_slack: float = 0.0) -> bool:
        """True when what was planned for these limits holds for those of other phase centres.

        Slopes of the half paths by range may exceed those planned for by `slope_slack`.
        """
        def within(a: tuple[float, float], b: tuple[float, float], least: float = 0.0) -> bool:
            # The extremes of samples miss the true ones by less than this.
            slack = max(_SAMPLING_SLACK * (b[1] - b[0]), least)
            return b[0] - slack <= a[0] and a[1] <= b[1] + slack

        return (within(other.range_m, self.range_m)
                and within(other.slope, self.slope, slope_slack)
                and within((0.0, other.slope_m), (0.0, self.slope_m))
                and within((0.0, other.half_range), (0.0, self.half_range)))


def local_spectrum(polar: PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
                   illumination: Illumination | None = None, wanted: float = 1.0) -> LocalSpectrum:
    """Local frequencies of backprojected images at samples of a polar grid and its guards.

    `illumination` tells the amplitudes of the P C echoes, `wanted` the share of the ranges whose
    power counts.

    Raises
    ------
    ValueError
        Range does not grow along the lines of the grid.
    """
    # Frequencies in the guards count, too: the nearer, the more they change with direction.
    guard = usual_guard(polar.n_range)
    before = min(guard, max(0, ranges_before(polar, 0.0)) // 2)
    wider = dataclasses.replace(
        polar, range_start_m=polar.range_start_m - before * polar.range_spacing_m,
        n_range=before + polar.n_range + guard)
    r, alpha = wider.sampled(SAMPLES_PER_SIDE, SAMPLES_PER_SIDE)
    share = np.repeat(np.linspace(0, 1, SAMPLES_PER_SIDE), SAMPLES_PER_SIDE)
    position, along_range = polar.lines(r, alpha)[:2]
    along_alpha = polar.by_direction(r, alpha)
    tx_m, rx_m = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
    length, by_range, slope = half_paths(tx_m, rx_m, position, along_range, along_alpha)
    # Corners of a cell that is lit in part count: the scene may end within it.
    illuminated = illumination and illumination.may_light(position, (SAMPLES_PER_SIDE,) * 2)
    some = by_range if illuminated is None else by_range[illuminated]
    extremes = float(some.min()), float(some.max())
    if extremes[0] <= 0.1:
        raise ValueError('range does not grow along the lines of the polar grid; it lies beside '
                         'or behind the track, use exact backprojection')
    slope /= by_range
    if illuminated is not None:
        slope = _of_illuminated_points(slope, illuminated)
        by_range = _of_illuminated_points(by_range, illuminated).clip(*extremes)
    half_range = (radar.half_band_rad_per_m * extremes[1] + radar.wavenumbers_rad_per_m[1]
                  * max(1 - extremes[0], extremes[1] - 1))
    middle = len(position) // 2
    sides = (wanted * polar.n_range * polar.range_spacing_m * along_range[middle],
             polar.n_alpha * polar.alpha_spacing * along_alpha[middle])
    weight = echo_powers(tx_m, rx_m, position[middle], sides, radar)
    if illumination is not None:  # what lights nothing of the scene adds no power either
        amplitude = illumination.amplitude(position)
        bright = np.einsum('rs,rs->r', amplitude, amplitude)
        if (weight @ bright).min() > 0:
            weight = weight * bright / (weight * bright).mean(axis=1, keepdims=True)
    return LocalSpectrum(slope, by_range, share, radar.wavenumbers_rad_per_m, half_range,
                         (float(length.min()), float(length.max())), weight,
                         NO_SPREAD if illumination is None else
                         illumination.spread(position, along_alpha))


def _of_illuminated_points(slope: np.ndarray, illuminated: np.ndarray) -> np.ndarray:
    """Slopes (R, S) in which the mean of the points that an echo lights stands for the others."""
    count = illuminated.sum(axis=1, keepdims=True)
    mean = (slope * illuminated).sum(axis=1, keepdims=True) / np.maximum(count, 1)
    return np.where(illuminated | (count == 0), slope, mean)


def ranges_before(polar: PolarGrid, beyond: float) -> int:
    """Ranges on the plane before the first one, in all directions up to so far beyond the grid."""
    last = polar.alpha_start + (polar.n_alpha - 1) * polar.alpha_spacing
    steepest = max(abs(polar.alpha_start), abs(last)) + beyond
    if steepest >= 1:
        return -1
    nearest = abs(polar.height_m) / math.sqrt(1 - steepest ** 2)
    return math.floor((polar.range_start_m - nearest) / polar.range_spacing_m)


_GAP = 4.0  # times the usual distance between pulses
_STANDS = 0.1  # of the mean distance, at which a platform stands still
_OVERSAMPLING = (1.1, 1.15, 1.2, 1.25, 1.3, 1.4, 1.6, 1.8, 2.0, 2.3, 2.7, 3.2)
_GUARDS = (1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
# Errors are above the first, and fall by less than the second for each unit of the taper's shape
# (measured; the lobes of the Kaiser window itself fall by 8.7 dB).
_FLAT_DB, _FALL_DB = -30.0, 11.0
_LEAST_RANGE_GUARD = 16
_WIDE_GUARD = 3.0  # times those along direction: there the error is far less
_NEARER = (0.7, 0.9)  # shares of the furthest distance from the centre, which are told apart
# Most of the error is that of the echoes at the two ends of a sub-aperture's band: where these are
# few, or few of them hold the power, it is theirs by chance. Relative deviation of one of them, in
# images of few scatterers.
_CHANCE = 1.2
# At which errors are looked up: echoes of each sub-aperture, of all, and wavenumbers of each echo
_ECHOES_EACH, _ECHOES_FOR_ERROR, _WAVENUMBERS = 48, 192, 6


def pieces_between_gaps(middles: np.ndarray) -> list[tuple[int, int]]:
    """First pulse, and the one after the last, of what lies between gaps of a track.

    `middles` are the mean phase centres of the pulses, (P, 3) float64, metres. Gaps are long for a
    platform that moves, be it that it stands most of the time.
    """
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    moves = steps[steps > _STANDS * steps.mean()] if len(steps) else steps
    usual = np.median(moves) if len(moves) else 0.0
    gaps = (np.flatnonzero(steps > _GAP * usual) + 1).tolist() if usual > 0 else []
    return list(zip([0, *gaps], [*gaps, len(middles)], strict=True))


def cut_pulses(pieces: Sequence[tuple[int, int]], length: int) -> list[slice]:
    """Sub-apertures of about equal length, `length` pulses at most, within the pieces of a track.

    `pieces` are those of `pieces_between_gaps`.
    """
    cuts: list[slice] = []
    for start, stop in pieces:
        n = math.ceil((stop - start) / length)
        edges = [round(start + i * ((stop - start) / n)) for i in range(n)] + [stop]
        cuts += map(slice, edges[:-1], edges[1:])
    return cuts


@dataclasses.dataclass(frozen=True)
class Sampling:
    """Cut into sub-apertures, and sizes of their grids.

    Attributes
    ----------
    pulses : tuple of slice
        Pulses of each sub-aperture.
    centre : (U,) float64
        Middle of the slopes of each, metres (minus the position along the track, to first order).
    sizes : FusionSizes
        Sizes of the grids of a sub-aperture image and of the fused one.
    coverage : PixelDensity
        What of the wanted grid must be right.
    n_even : float
        Number of sub-apertures of even power whose sum would vary as much by chance.
    error_db : float
        Predicted error of the fusion, dB.
    half_m : float
        Half the widest range of slopes of a sub-aperture, metres.
    """

    pulses: tuple[slice, ...]
    centre: np.ndarray
    sizes: FusionSizes
    coverage: PixelDensity
    n_even: float
    error_db: float = math.nan
    half_m: float = math.nan


@dataclasses.dataclass(frozen=True)
class _Cut:
    """One cut into sub-apertures.

    `half` is half the widest band along direction, rad, and `half_m` half the widest range of
    slopes in it, metres; `power`, (W, U), is that of the sub-apertures.
    """

    pulses: tuple[slice, ...]
    centre: np.ndarray
    half_m: float
    half: float
    power: np.ndarray

    @property
    def furthest_m(self) -> float:
        """Largest distance of a band's middle from that of the grid, metres."""
        return float(np.abs(self.centre).max())

    def sampling(self, sizes: FusionSizes, coverage: PixelDensity) -> Sampling:
        """That of some sizes."""
        n_even = float((self.power.sum(axis=1) ** 2 / (self.power ** 2).sum(axis=1)).min())
        return Sampling(self.pulses, self.centre, sizes, coverage, n_even, half_m=self.half_m)


class SamplingSearch:
    """Search for the quickest cut and coarse sampling that meet a target.

    Zhang et al., equation 16: a sub-aperture whose echoes have the slopes x_lo to x_hi (derivative
    of the half path by direction, metres; positions along the track) fills the angular wavenumbers
    ``K x_lo`` to ``K x_hi``, so its image needs coarse lines no further apart than
    ``2 pi / (K_max (x_hi - x_lo))``. They lie some times closer, and some of them on either side
    are guards, over which a taper makes the image periodic. The error is that of the taper's
    spectrum beyond the band (`aliasing_error`), at the frequencies of the echoes. Cuts,
    oversamplings and guards are tried from the quickest on, by sizes that are not rounded yet.

    Parameters
    ----------
    polar, tx_m, rx_m, target_db :
        As for `plan_subapertures`; the error is that of the fusion alone.
    bands, coverage : LocalSpectrum, PixelDensity
        Of `polar`, and what of it must be right.
    lengths : sequence of int
        Pulses of a sub-aperture to try.
    ratio : (int, int)
        Ranges of a sub-aperture image to those of the fused one.
    """

    def __init__(self, polar: PolarGrid, bands: LocalSpectrum, tx_m: np.ndarray, rx_m: np.ndarray,
                 lengths: Sequence[int], target_db: float, coverage: PixelDensity = EVERYTHING,
                 ratio: tuple[int, int] = (1, 1)):
        self._polar, self._bands, self._ratio = polar, bands, ratio
        self._target_db, self._coverage = target_db, coverage
        self._cuts = _cuts(bands, tx_m, rx_m, lengths)
        # shapes of tapers that surely miss the target, cut by cut
        self._flattest = np.full(len(self._cuts), (_FLAT_DB - target_db) / _FALL_DB)
        self._echoes = functools.cache(lambda cut: _echoes_for_error(
            self._cuts[cut], bands, tx_m.shape[1]))
        self._sampling = functools.cache(self._try)  # it lives as long as the search

    def quickest(self, first_stage: SubapertureCost) -> Sampling | None:
        """The quickest one; None where the target cannot be met.

        `first_stage` tells the time of all sub-aperture images.
        """
        cost = _cost(self._cuts, self._polar, self._ratio, first_stage)
        # with what rounding may add to guards
        shape = taper_shape(1.1 * np.array(_GUARDS) + 2, 1.1 * np.array(_OVERSAMPLING)[:, None])
        useful = np.flatnonzero(shape >= self._flattest[:, None, None])
        order = useful[np.argsort(cost.ravel()[useful], kind='stable')]
        places = zip(*np.unravel_index(order, cost.shape), strict=True)
        return next(filter(None, (self._sampling(*place) for place in places)), None)

    def _try(self, cut: int, oversampling: int, guard: int) -> Sampling | None:
        """One of them, None where it misses the target."""
        one = self._cuts[cut]
        sizes = _sizes(self._polar, self._ratio, one.furthest_m, one.half,
                       _OVERSAMPLING[oversampling], _GUARDS[guard], self._flattest[cut])
        if sizes is None or not _on_plane(sizes):
            return None
        found = one.sampling(sizes, self._coverage)
        error_db = 10 * math.log10(fusion_error(found, self._bands, *self._echoes(cut)) + 1e-16)
        if error_db <= self._target_db:
            return dataclasses.replace(found, error_db=error_db)
        self._flattest[cut] = sizes.beta + (error_db - self._target_db) / _FALL_DB
        return None


def _cuts(bands: LocalSpectrum, tx_m: np.ndarray, rx_m: np.ndarray, lengths: Sequence[int]
          ) -> list[_Cut]:
    """Those with sub-apertures of some lengths, as far as the aperture holds them."""
    n_pulses, n_channels = tx_m.shape[:2]
    pieces = pieces_between_gaps(mean_centres(tx_m, rx_m))
    least, most = bands.slope.min(axis=1), bands.slope.max(axis=1)
    highest = bands.wavenumber[1] * bands.growth.max(axis=1)
    cuts: list[_Cut] = []
    for length in lengths:
        if length > n_pulses and cuts:
            break
        pulses = tuple(cut_pulses(pieces, length))
        first = np.array([p.start for p in pulses]) * n_channels
        lo, hi = np.minimum.reduceat(least, first), np.maximum.reduceat(most, first)
        half_m = 0.5 * (hi - lo)
        half = float((half_m * np.maximum.reduceat(highest, first)).max())
        half += math.sqrt(3) * bands.spread.rms
        power = np.add.reduceat(bands.weight, first, axis=1)
        cuts.append(_Cut(pulses, 0.5 * (lo + hi), float(half_m.max()), max(half, 1e-9), power))
    return cuts


def _cost(cuts: list[_Cut], polar: PolarGrid, ratio: tuple[int, int], first_stage: SubapertureCost
          ) -> np.ndarray:
    """About the nanoseconds of cuts with each oversampling and guard, (L, O, G)."""
    n, length, half, half_m, furthest_m = np.array([
        (len(c.pulses), c.pulses[0].stop - c.pulses[0].start, c.half, c.half_m, c.furthest_m)
        for c in cuts]).T[:, :, None, None]
    oversampling, n_guard = np.array(_OVERSAMPLING)[:, None], np.array(_GUARDS)
    wanted = polar.n_alpha * polar.alpha_spacing
    spacing = np.minimum(math.pi / (half * oversampling), wanted)
    n_coarse = wanted / spacing + 2 * n_guard + 1
    n_range = polar.n_range + 2 * np.maximum(
        usual_guard(polar.n_range), n_guard * spacing * furthest_m / polar.range_spacing_m)
    n_pixels = n_coarse * n_range * (ratio[0] / ratio[1])
    return n * np.minimum(*first_stage.about(length, half_m, n_pixels)) + costs().nanoseconds({
        'subaperture': n, 'coarse_pixel': n * n_pixels,
        'fine_pixel': n_coarse * spacing / polar.alpha_spacing * n_range})


def _sizes(polar: PolarGrid, ratio: tuple[int, int], furthest: float, half: float,
           oversampling: float, n_guard: float, flattest: float) -> FusionSizes | None:
    """Sizes of the grids of one choice; None where the taper's shape is below the `flattest`."""
    wanted = polar.n_alpha * polar.alpha_spacing
    spacing = min(math.pi / (half * oversampling), wanted)
    least = wanted + (2 * n_guard + 1) * spacing
    n_coarse = scipy.fft.next_fast_len(math.ceil(least / spacing))
    # Fine lines are those of the wanted grid. Bands beyond their spectrum fold, as they should.
    n_fine = quick_length(math.ceil(n_coarse * spacing / polar.alpha_spacing))
    extent = n_fine * polar.alpha_spacing
    spacing = extent / n_coarse
    # what rounding to fast lengths leaves over widens the guards
    # in steps, as the shape of the taper: tables of errors are kept
    guard = math.floor(4 * (n_coarse - wanted / spacing)) / 8
    beta = math.floor(8 * taper_shape(guard, math.pi / (half * spacing))) / 8
    if beta < flattest:
        return None
    least = max(_LEAST_RANGE_GUARD,
                math.ceil(n_guard * spacing * furthest / polar.range_spacing_m))
    range_guard = max(least, min(usual_guard(polar.n_range),
                                 ranges_before(polar, (extent - wanted) / 2 + spacing)))
    n_range = row_length(math.ceil((polar.n_range + 2 * range_guard) / ratio[1]), ratio)
    return FusionSizes(polar, n_coarse, n_fine, guard, beta, ratio[0] * n_range,
                       ratio[1] * n_range)


def _on_plane(sizes: FusionSizes) -> bool:
    """Whether the coarse grid, which rounding may move by a line, lies on the plane."""
    polar = sizes.polar
    beyond = ((sizes.extent - polar.n_alpha * polar.alpha_spacing) / 2
              + sizes.extent / sizes.n_coarse)
    return sizes.fine_range_guard < ranges_before(polar, beyond)


def _echoes_for_error(s: _Cut, bands: LocalSpectrum, n_channels: int
                      ) -> tuple[np.ndarray, ...]:
    """Some echoes, powers of each, (W, R), and the middle of its sub-aperture's band, metres.

    They lie densest where bands end, those of the widest sub-apertures in front: the error of the
    others is far less. Each stands for all that end about as far from the middle of their bands.
    """
    lengths = [n_channels * (p.stop - p.start) for p in s.pulses]
    middle = np.repeat(s.centre, lengths)
    order = np.argsort(bands.slope.mean(axis=1) - middle, kind='stable')
    n_looked_at = min(_ECHOES_EACH * len(s.pulses), _ECHOES_FOR_ERROR)
    edges = 0.5 * len(order) * (1 - np.cos(np.linspace(0, np.pi, n_looked_at + 1)))
    powers = [np.diff(np.interp(edges, np.arange(len(order) + 1),
                                np.append(0, np.cumsum(weight[order]))))
              for weight in bands.weight]
    some = order[(0.5 * (edges[1:] + edges[:-1])).astype(int)]
    return some, np.stack(powers), middle[some]


def fusion_error(sampling: Sampling, bands: LocalSpectrum, echoes: np.ndarray | slice,
                 weight: np.ndarray, centre_m: float | np.ndarray) -> float:
    """Mean squared error of fusing some echoes, relative to their power.

    It is 2 or more, as if nothing fitted, where a frequency lies beyond the coarse grid's. Of
    `bands` it looks at some `echoes`, (R,) int64 or a slice; `weight`, (W, R), and `centre_m`,
    (R,) or (), are the share of each, of W cases of which the worst counts, and the middle of the
    slopes of its sub-aperture, metres.
    """
    s, coverage = sampling.sizes, sampling.coverage
    guard = s.n_guard / (s.n_coarse - 2 * s.n_guard)
    slope = _to_guards(bands.slope[echoes], centre_m, 0.5 * guard)
    low, high = bands.wavenumber
    wavenumber = low + (high - low) * (np.arange(_WAVENUMBERS) + 0.5) / _WAVENUMBERS
    per_radian, growth = s.extent / (2 * math.pi), bands.growth[echoes]

    def even_at(places: np.ndarray | slice) -> np.ndarray:
        """Frequencies at some places, from the bin that the band's middle is rounded to."""
        bins = wavenumber[:, None, None] * growth[:, places] * per_radian
        return bins * slope[:, places] - np.rint(bins * np.reshape(centre_m, (-1, 1)))

    def frequencies(even: np.ndarray) -> np.ndarray:
        return spread_frequencies(even, bands.spread.rms * per_radian)

    even = functools.cache(lambda: even_at(slice(None)))
    # errors are told by the outermost places, unless others may leave the band
    furthest = (high * growth.max() * per_radian * float(
        np.abs(slope - np.reshape(centre_m, (-1, 1))).max()) + 1)
    outer = np.flatnonzero((bands.position == 0) | (bands.position == 1))
    if bands.spread.rms or furthest > s.n_coarse / 2:
        outer = np.arange(len(bands.position))
    by_echo = aliasing_error(
        s.n_coarse, s.n_guard, s.beta, frequencies(even_at(outer)), bands.position[outer],
        coverage.along_alpha).mean(axis=0)
    # Along range the same happens over a length that grows with the distance from the centre.
    away = np.broadcast_to(np.abs(np.ravel(centre_m)), len(slope))
    furthest = max(float(np.abs(sampling.centre).max()), float(away.max()), 1e-9)
    which = np.searchsorted(_NEARER, away / furthest)
    for number in np.unique(which):
        some = which == number
        # ranges that move by a coarse line
        shift = (furthest * [*_NEARER, 1.0][number] * s.extent / s.n_coarse
                 / s.polar.range_spacing_m)
        n_guard = s.fine_range_guard / shift
        if n_guard > _WIDE_GUARD * s.n_guard:
            continue
        n = int(s.polar.n_range / shift + 2 * n_guard) + 2
        by_echo[some] += aliasing_error(
            n, n_guard, s.beta, frequencies(even())[:, some] * (n / s.n_coarse),
            density=coverage.along_range).mean()
    error = float((weight @ by_echo / weight.sum(axis=1)).max())
    # What amplitudes have beyond the coarse grid's frequencies is missing, and appears elsewhere.
    if bands.spread.rms:
        error += tail_error(bands.spread, even() / per_radian,
                            lambda f: 2.0 * (np.abs(f) > s.n_coarse / 2 / per_radian), echoes)
    error += correction_error(coverage, s.n_fine, s.n_guard * s.n_fine / s.n_coarse, s.beta)
    return error * (1 + _CHANCE / math.sqrt(2 * sampling.n_even))


def _to_guards(slope: np.ndarray, centre_m: float | np.ndarray, beyond: float) -> np.ndarray:
    """Slopes of which the outermost directions lie by a share of the scene beyond it.

    That is where tapers are steepest; only where slopes grow towards the band's end does it count.
    """
    slope = slope.copy().reshape(len(slope), SAMPLES_PER_SIDE, -1)
    ends = slope[:, [0, -1]]
    steps = ends - slope[:, [1, -2]]
    growing = steps * (ends - np.reshape(centre_m, (-1, 1, 1))) > 0
    slope[:, [0, -1]] += beyond * (SAMPLES_PER_SIDE - 1) * steps * growing
    return slope.reshape(len(slope), -1)


_CUTS_FOR_BEAMS = 5  # sub-apertures whose geometry is looked at
_USUAL = 1.2  # times the least cost of beams (measured: 1.05 to 1.4)


@dataclasses.dataclass(frozen=True)
class SubapertureCost:
    """What both ways of forming sub-aperture images depend on, but for the images' size.

    Attributes
    ----------
    grid : PolarGrid
        Grid of the images, or nearly.
    span : float
        Extent of the wanted pixels in direction cosine.
    tx_m, rx_m : (P, C, 3) float64
    target_db : float
        Wanted error of the images, dB.
    reach_m, padding_m : float
        As for `plan_beams`.
    bent_m : float
        Half the widest range of slopes from which on there are no beams, metres.
    n_weighed : callable, optional
        As of `BeamSampling`, of sub-apertures with some pulses; None where images from beams
        cannot be weighed well enough.
    """

    grid: PolarGrid
    span: float
    radar: RadarParameters
    resampling: RangeResampling
    tx_m: np.ndarray
    rx_m: np.ndarray
    target_db: float
    reach_m: float
    padding_m: float
    bent_m: float
    n_weighed: Callable[[Sequence[slice]], int | None] = lambda pulses: 0

    def expects_beams(self, pulses: Sequence[slice], half_m: float) -> bool:
        """Whether images from beams seem to be the quicker ones."""
        direct, from_beams = self.about(pulses[0].stop - pulses[0].start, half_m,
                                        self.grid.n_alpha * self.grid.n_range)
        return bool(from_beams < direct)

    def about(self, length: int | np.ndarray, half_m: float | np.ndarray,
              n_pixels: float | np.ndarray) -> tuple[float | np.ndarray, np.ndarray]:
        """Nanoseconds of an image: directly, and about that from beams.

        `length` are its pulses, `half_m` half the range of slopes by direction, metres, and
        `n_pixels` its pixels: arrays that are broadcast together.
        """
        n_echoes = length * self.tx_m.shape[1]
        from_beams = _USUAL * costs().nanoseconds(least_operations(
            n_echoes, self.resampling, n_pixels,
            self.span * half_m * self.radar.wavenumbers_rad_per_m[1] / math.pi))
        return (n_echoes * self.resampling.cost * n_pixels,
                np.where(half_m >= self.bent_m, math.inf, from_beams))

    def choose_beams(self, pulses: Sequence[slice]) -> BeamSampling | None:
        """Beams for images on `grid`; None where adding each pulse directly is quicker."""
        beams = self._beams(pulses)
        if beams is None:
            return None
        n_echoes = max(p.stop - p.start for p in pulses) * self.tx_m.shape[1]
        n_pixels = self.grid.n_alpha * self.grid.n_range
        from_beams = costs().nanoseconds(beams.operations(n_echoes, self.resampling, n_pixels,
                                                          self.span))
        return beams if from_beams < n_echoes * self.resampling.cost * n_pixels else None

    def _beams(self, pulses: Sequence[slice]) -> BeamSampling | None:
        n_weighed = self.n_weighed(pulses)
        if n_weighed is None:
            return None
        # of echoes that share an image
        n = max(1, n_weighed)
        cuts = [(self.tx_m[pulses[i], number % n::n].reshape(-1, 3),
                 self.rx_m[pulses[i], number % n::n].reshape(-1, 3))
                for number, i in enumerate(self._for_beams(pulses))]
        beams = plan_beams(self.grid, self.radar, self.resampling, cuts, self.target_db,
                           self.reach_m, self.padding_m)
        return beams and dataclasses.replace(beams, n_weighed=n_weighed)

    def _for_beams(self, pulses: Sequence[slice]) -> list[int]:
        """Numbers of some sub-apertures, evenly, and of the widest where none is about as wide."""
        some = np.unique(np.linspace(0, len(pulses) - 1, _CUTS_FOR_BEAMS).round().astype(int))
        middles, first = mean_centres(self.tx_m, self.rx_m), [p.start for p in pulses]
        width = np.linalg.norm(np.maximum.reduceat(middles, first)
                               - np.minimum.reduceat(middles, first), axis=1)
        widest = int(width.argmax())
        return [*some, *[widest] * bool(width[widest] > SLACK * width[some].max())]


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
        Radar parameters of the blocks to come.
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
    amplitudes : SubapertureAmplitudes or None
        How images are weighed; None where all pixels are lit alike.
    """

    polar: PolarGrid
    given: RadarParameters
    source: RangeGate | PhaseHistory
    n_samples: int
    n_channels: int
    sampling: Sampling
    fusion_grid: UnifiedPolarGrids
    resampling: RangeResampling
    beams: BeamSampling | None
    range_m: tuple[float, float]
    limits: Limits
    warnings: tuple[str, ...]
    amplitudes: SubapertureAmplitudes | None = None

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
        errors = {'sub-aperture images': (self.beams or self.resampling).predicted_error_db,
                  'fusion': self.sampling.error_db}
        return errors if self.amplitudes is None else {
            **errors, 'illumination': self.amplitudes.predicted_error_db}

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
        if self.amplitudes is None:
            return None
        assert block.tx_m is not None and block.rx_m is not None  # as was checked
        known = self.amplitudes.illumination
        return Illumination.of_pulses(known.pattern, block.pointing, block.tx_m, block.rx_m,
                                      foreseen=known.foreseen)

    def weighed_by(self, block: PulseBlock) -> Illumination | tuple[AmplitudeNodes, ...] | None:
        """Amplitudes of echoes that are added directly, or nodes of each image from beams.

        None where all pixels are lit alike.
        """
        if self.amplitudes is None or self.beams is None:
            return self.illumination_of(block)
        return amplitude_nodes(self.amplitudes.illumination.pattern, block, self.beams.n_weighed)

    def image_operations(self, n_echoes: int, n_images: int = 1) -> dict[str, float]:
        """How often forming sub-aperture images does the operations of `CostModel`.

        `n_echoes` are the echoes of all images together.
        """
        coarse, resampling, beams = self.coarse, self.resampling, self.beams
        n_pixels, n_bins = coarse.n_alpha * coarse.n_range, resampling.n_padded
        if beams is None:
            return resampling.operations(n_echoes, n_pixels)
        span = coarse.n_alpha * coarse.alpha_spacing
        counts = beams.operations(n_echoes, resampling, n_pixels, span, n_images)
        if beams.n_weighed and self.amplitudes is not None:
            counts['amplitude_node'] = counts['weighed_image'] * self.amplitudes.n_nodes(
                coarse, beams.segment)
        relative_bandwidth = (n_bins * self.radar.wavelength_m
                              / (2 * resampling.n_cells * resampling.cell_m))
        half = min(n_bins, resampling.n_cells) / 2
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

    def check(self, tx_m: np.ndarray, rx_m: np.ndarray, illumination: Illumination | None = None
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
        # Slopes as far beyond let pixels drift by this over half a segment, seen from the ranges.
        slack = 2 * DRIFT_SLACK * self.resampling.step_m / (
            max(self.resampling.segment, 1) * self.resampling.spacing)
        within = self.limits.contain(Limits.of(bands), slack)
        centre = 0.5 * float(bands.slope.min() + bands.slope.max())
        error = fusion_error(self.sampling, bands, slice(None), bands.weight, centre)
        error_db = total_db(self._image_db(tx_m, rx_m, illumination),
                            10 * math.log10(error + 1e-16))
        return centre, error_db, within

    def _image_db(self, tx_m: np.ndarray, rx_m: np.ndarray, illumination: Illumination | None
                  ) -> float:
        """Error of a sub-aperture's image by its phase centres, dB; as planned from beams."""
        planned_db = self.errors_db['sub-aperture images']
        if self.beams is not None:
            return planned_db
        lines = self.polar.lines(*self.polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE))
        paths = sample_paths(tx_m.reshape(-1, 3), rx_m.reshape(-1, 3), lines)
        if illumination is not None:
            paths = illumination.of_paths(paths, lines[0])
        if paths.illuminated is not None and not paths.illuminated.any():
            return planned_db
        found_db = resampling_error_db(self.resampling, paths, self.radar)
        return found_db if math.isfinite(found_db) else planned_db  # the limits tell


def plan_subapertures(polar: PolarGrid, radar: RadarParameters, n_samples: int, tx_m: ArrayLike,
                      rx_m: ArrayLike, *, target_db: float = -50.0,
                      pulses_per_subaperture: int | None = None, cover: PolarCover | None = None,
                      band: PhaseHistory | None = None, illumination: Illumination | None = None
                      ) -> SubaperturePlan:
    """Plan the sub-apertures of an aperture.

    Parameters
    ----------
    polar : PolarGrid
        Where the fused image is wanted.
    radar, n_samples, tx_m, rx_m, target_db, pulses_per_subaperture :
        As for `plan_afbp`; the error is that of the fused image.
    cover : PolarCover, optional
        Cover of the map that the fused image is read for; `polar` is its own, or has fewer lines.
    band : PhaseHistory, optional
        Takes phase histories as they came, in place of profiles.
    illumination : Illumination, optional
        Illumination of the P C echoes.

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

    def plan(self, given: RadarParameters, length: int | None, cover: PolarCover | None
             ) -> SubaperturePlan:
        polar, radar, tx_m, rx_m = self.polar, self.radar, self.tx_m, self.rx_m
        ratio, along_range, along_alpha = ((1, 1), 1.0, 1.0) if cover is None else (
            cover.ratio, *cover.oversampling)
        # neighbouring echoes in groups, since they are added together
        step = max(1, tx_m[..., 0].size // _ROWS_FOR_PATHS)
        paths = sample_paths(tx_m.reshape(-1, 3)[::step], rx_m.reshape(-1, 3)[::step],
                             polar.lines(*polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE)))
        if self.illumination is not None:
            paths = self.illumination.select(slice(None, None, step)).of_paths(
                paths, polar.lines(*polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE))[0])
        bands = local_spectrum(polar, tx_m, rx_m, radar, self.illumination,
                               self.coverage.wanted_ranges)
        weighing = self.illumination and AmplitudeError(polar, radar, tx_m, rx_m,
                                                        self.illumination, self.target_db)
        ratio = self._ratio(bands, ratio)
        usual = dataclasses.replace(polar, n_range=polar.n_range * ratio[0] // ratio[1],
                                    range_spacing_m=polar.range_spacing_m * ratio[1] / ratio[0])
        resampling = cover.resampling if cover and cover.ratio == ratio else self._resampling(
            paths, usual.range_spacing_m, self.n_samples)
        first_stage = self._cost(usual, resampling, bands.range_m, weighing)
        lengths, left_db = (length,) if length else LENGTHS, self.target_db - _MARGIN_DB
        if weighing is not None and bands.spread.rms > 0:  # amplitudes differ
            left_db = remaining_db(left_db, weighing.budget_db)
        search = SamplingSearch(polar, bands, tx_m, rx_m, lengths,
                                remaining_db(left_db, self._profiles_db), self.coverage, ratio)
        while True:
            sampling = search.quickest(first_stage)
            if sampling is None:
                raise ValueError(
                    f'no sub-apertures of {", ".join(map(str, lengths))} pulses reach '
                    f'target_db={self.target_db:g} on this polar grid; ask for less, image a '
                    'smaller scene, or use exact backprojection')
            grid = UnifiedPolarGrids(
                **vars(sampling.sizes), half_range=bands.half_range, carrier_hz=radar.carrier_hz,
                range_oversampling=along_range, alpha_oversampling=along_alpha,
                propagation_speed_m_per_s=radar.propagation_speed_m_per_s)
            range_m = _bounds(grid.coarse, tx_m, rx_m)
            source = self.band or RangeGate.around(radar, self.n_samples, range_m, _PADDING)
            # echoes of one sub-aperture share phases, never those of two
            first = {p.start * tx_m.shape[1] // step for p in sampling.pulses}
            resampling = self._resampling(
                dataclasses.replace(paths, parts=tuple(sorted(first))),
                grid.coarse.range_spacing_m, source.n_samples + (
                    0 if source.periodic else _PADDING),
                remaining_db(self.target_db, sampling.error_db))
            cost = self._cost(grid.coarse, resampling, range_m, weighing)
            beams = cost.choose_beams(sampling.pulses)
            if beams or not first_stage.expects_beams(sampling.pulses, sampling.half_m):
                break
            # their paths bend too much for beams: shorter ones, or directly
            first_stage = dataclasses.replace(first_stage, bent_m=sampling.half_m)
        warnings = [*self._cut_warnings(paths.of_illuminated(paths.length),
                                        grid.fine_range_guard * polar.range_spacing_m)]
        amplitudes = None
        if weighing is not None:
            resampling, amplitudes = weighing.plan(grid.coarse, resampling, beams,
                                                   sampling.pulses)
        return SubaperturePlan(polar, given, source, self.n_samples, tx_m.shape[1], sampling, grid,
                               resampling, beams, range_m, Limits.of(bands), tuple(warnings),
                               amplitudes)

    @property
    def _profiles_db(self) -> float:
        return min(error_budget(self.target_db, AFBP_SHARES)['sub-aperture images'], -50.0)

    def _ratio(self, bands: LocalSpectrum, ratio: tuple[int, int]) -> tuple[int, int]:
        """Ranges of a sub-aperture image to those of the fused one."""
        polar = self.polar
        share = used_share(bands.half_range, polar.range_spacing_m, polar.n_range,
                           tapers=TAPERS_NEEDED)
        if ratio[0] / ratio[1] < share:
            ratio = 1, 1
        filled = (bands.half_range * polar.range_spacing_m * ratio[1] / ratio[0]) / math.pi
        if filled > _MOST_FILLED:
            raise ValueError(
                f'the sub-aperture images fill {filled:.0%} of what the ranges of the polar grid '
                f'hold, at most {_MOST_FILLED:.0%} can be fused: the elevation changes too much '
                'over this aperture; use exact backprojection')
        return ratio

    def _cost(self, grid: PolarGrid, resampling: RangeResampling, range_m: tuple[float, float],
              weighing: AmplitudeError | None) -> SubapertureCost:
        padding_m = math.inf if self.band else _PADDING * self.radar.sample_spacing_m
        return SubapertureCost(
            grid, self.polar.n_alpha * self.polar.alpha_spacing, self.radar, resampling, self.tx_m,
            self.rx_m, self._profiles_db, range_m[1] - range_m[0], padding_m,
            least_bending_slope(grid, self.radar, self._profiles_db),
            *([] if weighing is None else [weighing.n_weighed]))

    def _resampling(self, paths: Paths, spacing: float, n_samples: int, *more_db: float
                    ) -> RangeResampling:
        """Range grid with the usual error, or where there is none, with one of `more_db`."""
        for error_db in (self._profiles_db, *more_db):
            resampling = plan_resampling(paths, spacing, self.polar.n_range, self.radar, n_samples,
                                         error_db, periodic=self.band is not None, passes=PASSES)
            if resampling is not None:
                return resampling
        raise ValueError('the polar grid does not follow the range of this track (too near, or '
                         'around the antenna); use exact backprojection')

    def _cut_warnings(self, length: np.ndarray, guard_m: float) -> Iterator[str]:
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


def _bounds(polar: PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray) -> tuple[float, float]:
    """Smallest and largest half path to a grid along whose lines they grow, metres."""
    step = max(1, tx_m[..., 0].size // _ROWS_FOR_PATHS)
    length = half_paths(*(c.reshape(-1, 3)[::step] for c in (tx_m, rx_m)),
                        polar.at(*polar.sampled(2, _SAMPLES_PER_EDGE)))[0]
    near, far = length[:, ::2], length[:, 1::2]
    # what echoes and directions between the samples may add
    slack = [sum(np.abs(np.diff(edge, axis=axis)).max(initial=0.0) for axis in (0, 1))
             for edge in (near, far)]
    return float(near.min() - slack[0]), float(far.max() + slack[1])
