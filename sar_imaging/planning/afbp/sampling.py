"""Cut of an aperture into sub-apertures, and how coarsely their images may be sampled.

The local frequencies bound the bands of the sub-aperture images, from which follow the lines that
each needs and the error of the fusion.
"""

from __future__ import annotations

import dataclasses
import functools
import heapq
import itertools
import math
from collections.abc import Iterator

import numpy as np
import scipy.fft

from ...geometry.polar import PolarGrid
from ...geometry.track_frame import mean_centres
from ..aliasing_error import (
    EVERYTHING,
    PixelDensity,
    aliasing_error,
    correction_error,
    taper_shape,
)
from ..amplitude_spread import spread_frequencies, tail_error
from ..costs import costs
from ..guard_taper import usual_guard
from ..local_spectrum import SAMPLES_PER_SIDE, LocalSpectrum, ranges_before
from ..profiles.transform_length import quick_length
from .polar_grids import FusionSizes
from .row_length import row_length
from .subaperture_cost import SubapertureCost

_GAP = 4.0  # times the usual distance between pulses
_STANDS = 0.1  # of the mean distance, at which a platform stands still
_OVERSAMPLING = (1.1, 1.15, 1.2, 1.25, 1.3, 1.4, 1.6, 1.8, 2.0, 2.3, 2.7, 3.2)
_GUARDS = (1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
_AHEAD = (4, 2, 1, 0)  # choices to look ahead in both
_LEAST_RANGE_GUARD = 16
_WIDE_GUARD = 3.0  # times those along direction: there the error is far less
_NEARER = (0.7, 0.9)  # shares of the furthest distance from the centre, which are told apart
# Most of the error is that of the echoes at the two ends of a sub-aperture's band: where these are
# few, or few of them hold the power, it is theirs by chance. Relative deviation of one of them, in
# images of few scatterers.
_CHANCE = 1.2
# At which errors are looked up: echoes of each sub-aperture, of all, and wavenumbers of each echo
_ECHOES_EACH, _ECHOES_FOR_ERROR, _WAVENUMBERS = 24, 384, 6


def pieces_between_gaps(middles) -> list[tuple[int, int]]:
    """First pulse, and the one after the last, of what lies between gaps of a track.

    `middles` are the mean phase centres of the pulses, (P, 3) float64, metres. Gaps are long for a
    platform that moves, be it that it stands most of the time.
    """
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    moves = steps[steps > _STANDS * steps.mean()] if len(steps) else steps
    usual = np.median(moves) if len(moves) else 0.0
    gaps = (np.flatnonzero(steps > _GAP * usual) + 1).tolist() if usual > 0 else []
    return list(zip([0, *gaps], [*gaps, len(middles)], strict=True))


def cut_pulses(pieces, length: int) -> list[slice]:
    """Sub-apertures of about equal length, `length` pulses at most, within the pieces of a track.

    `pieces` are those of `pieces_between_gaps`.
    """
    cuts = []
    for start, stop in pieces:
        edges = np.linspace(start, stop, math.ceil((stop - start) / length) + 1)
        edges = edges.round().astype(int).tolist()
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
        Of the grids of a sub-aperture image and of the fused one.
    coverage : PixelDensity
        What of the wanted grid must be right.
    n_even : float
        Number of sub-apertures of even power whose sum would vary as much by chance.
    error_db : float
        Predicted error of the fusion, dB.
    """

    pulses: tuple[slice, ...]
    centre: np.ndarray
    sizes: FusionSizes
    coverage: PixelDensity
    n_even: float
    error_db: float = math.nan


class _Cut:
    """One cut into sub-apertures, with the sizes of all oversamplings and guards.

    `half` is half the widest band along direction, rad, `power`, (W, U), that of the
    sub-apertures; ratio and coverage as of `choose_sampling`.
    """

    def __init__(self, polar: PolarGrid, ratio, pulses, centre, half: float, power, coverage):
        self.pulses, furthest = pulses, float(np.abs(centre).max())
        n_even = float((power.sum(axis=1) ** 2 / (power ** 2).sum(axis=1)).min())
        self.samplings = [
            Sampling(pulses, centre, _sizes(polar, ratio, furthest, max(half, 1e-9), *choice),
                     coverage, n_even) for choice in itertools.product(_OVERSAMPLING, _GUARDS)]
        sizes, model = [s.sizes for s in self.samplings], costs()
        self.n_pixels = np.array([s.n_coarse * s.n_coarse_range for s in sizes])
        self.fusion_cost = np.array([model.nanoseconds(s.operations(len(pulses))) for s in sizes])


def choose_sampling(polar: PolarGrid, bands: LocalSpectrum, tx_m, rx_m, lengths,
                    first_stage: SubapertureCost, target_db: float,
                    coverage: PixelDensity = EVERYTHING,
                    ratio: tuple[int, int] = (1, 1)) -> Sampling | None:
    """Quickest cut and coarse sampling that meet a target.

    Zhang et al., equation 16: a sub-aperture whose echoes have the slopes x_lo to x_hi (derivative
    of the half path by direction, metres; positions along the track) fills the angular wavenumbers
    ``K x_lo`` to ``K x_hi``, so its image needs coarse lines no further apart than
    ``2 pi / (K_max (x_hi - x_lo))``. They lie some times closer, and some of them on either side
    are guards, over which a taper makes the image periodic. The error is that of the taper's
    spectrum beyond the band (`aliasing_error`), at the frequencies of the echoes. Cuts,
    oversamplings and guards are tried from the quickest on. None where the target cannot be met.

    Parameters
    ----------
    polar, tx_m, rx_m, target_db :
        As for `plan_subapertures`; the error is that of the fusion alone.
    bands, coverage : LocalSpectrum, PixelDensity
        Of `polar`, and what of it must be right.
    lengths : sequence of int
        Pulses of a sub-aperture to try.
    first_stage : SubapertureCost
        Tells the time of all sub-aperture images.
    ratio : (int, int)
        Ranges of a sub-aperture image to those of the fused one.
    """
    n_pulses, n_channels = tx_m.shape[:2]
    pieces = pieces_between_gaps(mean_centres(tx_m, rx_m))
    least, most = bands.slope.min(axis=1), bands.slope.max(axis=1)
    cuts = []
    for length in lengths:
        if length > n_pulses and cuts:
            break
        pulses = tuple(cut_pulses(pieces, length))
        first = np.array([p.start for p in pulses]) * n_channels
        lo, hi = np.minimum.reduceat(least, first), np.maximum.reduceat(most, first)
        half = bands.wavenumber[1] * 0.5 * float((hi - lo).max()) + math.sqrt(3) * bands.spread.rms
        power = np.add.reduceat(bands.weight, first, axis=1)
        cuts.append(_Cut(polar, ratio, pulses, 0.5 * (lo + hi), half, power, coverage))

    @functools.cache
    def some_echoes(cut):
        return _echoes_for_error(cuts[cut].samplings[0], bands, n_channels)

    @functools.cache
    def error_db(cut, i, j):
        sampling = cuts[cut].samplings[i * n_j + j]
        return 10 * math.log10(fusion_error(sampling, bands, *some_echoes(cut)) + 1e-16)

    n_i, n_j = len(_OVERSAMPLING), len(_GUARDS)
    fine, failed = np.zeros((2, len(cuts), n_i, n_j), bool)
    for cut, place in _by_cost(cuts, first_stage):
        (i, j), found = divmod(place, n_j), cuts[cut].samplings[place]
        if not _on_plane(found.sizes):
            continue
        # What fails with wider guards and finer sampling fails with less: most choices fall with
        # a few others far ahead.
        for ahead in _AHEAD:
            if failed[cut, i, j]:
                break
            a, b = min(i + ahead, n_i - 1), min(j + ahead, n_j - 1)
            if ahead and fine[cut, a, b]:
                continue
            if error_db(cut, a, b) <= target_db:
                fine[cut, a:, b:] = True
            else:
                failed[cut, :a + 1, :b + 1] = True
        if not failed[cut, i, j]:
            return dataclasses.replace(found, error_db=error_db(cut, i, j))
    return None


def _by_cost(cuts: list[_Cut], first_stage: SubapertureCost) -> Iterator[tuple[int, int]]:
    """Cuts and their choices from the quickest on; beams are planned for few of the cuts."""
    queue = [((cut.fusion_cost + first_stage.least_cost(cut.pulses, cut.n_pixels)).min(),
              number, -1) for number, cut in enumerate(cuts)]
    heapq.heapify(queue)
    while queue:
        _, number, place = heapq.heappop(queue)
        if place >= 0:
            yield number, place
            continue
        cut = cuts[number]
        whole = cut.fusion_cost + first_stage.cost(cut.pulses, cut.n_pixels)
        for found in zip(whole, [number] * len(whole), range(len(whole)), strict=True):
            heapq.heappush(queue, found)


def _sizes(polar, ratio, furthest, half, oversampling, n_guard) -> FusionSizes:
    wanted = polar.n_alpha * polar.alpha_spacing
    spacing = min(math.pi / (half * oversampling), wanted)
    least = wanted + (2 * n_guard + 1) * spacing
    n_coarse = scipy.fft.next_fast_len(math.ceil(least / spacing))
    # Fine lines are those of the wanted grid. Bands beyond their spectrum fold, as they should.
    n_fine = quick_length(math.ceil(n_coarse * spacing / polar.alpha_spacing))
    extent = n_fine * polar.alpha_spacing
    spacing = extent / n_coarse
    # what rounding to fast lengths leaves over widens the guards
    guard = math.floor(32 * (n_coarse - wanted / spacing)) / 64
    least = max(_LEAST_RANGE_GUARD,
                math.ceil(n_guard * spacing * furthest / polar.range_spacing_m))
    range_guard = max(least, min(usual_guard(polar.n_range),
                                 ranges_before(polar, (extent - wanted) / 2 + spacing)))
    n_range = row_length(math.ceil((polar.n_range + 2 * range_guard) / ratio[1]), ratio)
    return FusionSizes(polar, n_coarse, n_fine, guard,
                       taper_shape(guard, math.pi / (half * spacing)), ratio[0] * n_range,
                       ratio[1] * n_range)


def _on_plane(sizes: FusionSizes) -> bool:
    """Whether the coarse grid, which rounding may move by a line, lies on the plane."""
    polar = sizes.polar
    beyond = ((sizes.extent - polar.n_alpha * polar.alpha_spacing) / 2
              + sizes.extent / sizes.n_coarse)
    return sizes.fine_range_guard < ranges_before(polar, beyond)


def _echoes_for_error(s: Sampling, bands: LocalSpectrum, n_channels: int
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


def fusion_error(sampling: Sampling, bands: LocalSpectrum, echoes, weight, centre_m) -> float:
    """Mean squared error of fusing some echoes, relative to their power.

    It is 2 or more, as if nothing fitted, where a frequency lies beyond the coarse grid's. Of
    `bands` it looks at some `echoes`, (R,) int64 or a slice; `weight` and `centre_m`, (R,) or (),
    are the share of each and the middle of the slopes of its sub-aperture, metres. Of W cases of
    weights, (W, R), it is that of the worst.
    """
    if np.ndim(weight) == 2:
        return max(fusion_error(sampling, bands, echoes, some, centre_m) for some in weight)
    s, coverage = sampling.sizes, sampling.coverage
    guard = s.n_guard / (s.n_coarse - 2 * s.n_guard)
    slope = _to_guards(bands.slope[echoes], guard)
    low, high = bands.wavenumber
    wavenumber = low + (high - low) * (np.arange(_WAVENUMBERS) + 0.5) / _WAVENUMBERS
    bins = wavenumber[:, None, None] * (s.extent / (2 * math.pi))
    # from the bin that the band's middle is rounded to, as in the fusion
    even, per_radian = bins * slope - np.rint(bins * np.reshape(centre_m, (-1, 1))), (
        s.extent / (2 * math.pi))
    frequency = spread_frequencies(even, bands.spread.rms * per_radian)
    weight = np.broadcast_to(np.reshape(weight, (-1, 1)), (len(slope), 1))
    error = aliasing_error(s.n_coarse, s.n_guard, s.beta, frequency, weight, bands.position,
                           coverage.along_alpha)
    # What amplitudes have beyond the coarse grid's frequencies is missing, and appears elsewhere.
    error += tail_error(bands.spread, even / per_radian,
                        lambda f: 2.0 * (np.abs(f) > s.n_coarse / 2 / per_radian), echoes)
    error += correction_error(coverage, s.n_fine, s.n_guard * s.n_fine / s.n_coarse, s.beta)
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
        error += (weight[some].sum() / weight.sum()) * aliasing_error(
            n, n_guard, s.beta, frequency[:, some] * (n / s.n_coarse), weight[some],
            density=coverage.along_range)
    return error * (1 + _CHANCE / math.sqrt(2 * sampling.n_even))


def _to_guards(slope, share: float) -> np.ndarray:
    """Slopes of which the outermost directions lie by a share of the scene in the guards."""
    slope = slope.copy().reshape(len(slope), SAMPLES_PER_SIDE, -1)
    steps = slope[:, [0, -1]] - slope[:, [1, -2]]
    slope[:, [0, -1]] += share * (SAMPLES_PER_SIDE - 1) * steps
    return slope.reshape(len(slope), -1)
