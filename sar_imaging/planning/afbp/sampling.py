"""Cut of an aperture into sub-apertures, and how coarsely their images may be sampled.

The local frequencies bound the bands of the sub-aperture images, from which follow the lines that
each needs and the error of the fusion.
"""

from __future__ import annotations

import dataclasses
import functools
import heapq
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
from ..costs import costs
from ..local_spectrum import SAMPLES_PER_SIDE, LocalSpectrum, ranges_before, usual_guard
from ..profiles.transform_length import quick_length
from .aperture_cut import cut_pulses, pieces_between_gaps
from .row_length import row_length
from .subaperture_cost import SubapertureCost

_OVERSAMPLING = (1.1, 1.15, 1.2, 1.25, 1.3, 1.4, 1.6, 1.8, 2.0, 2.3, 2.7, 3.2)
_GUARDS = (1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
_AHEAD = (4, 2, 1, 0)  # choices to look ahead in both
_LEAST_RANGE_GUARD = 16
_WIDE_GUARD = 3.0  # times those along direction: there the error is far less
_NEARER = (0.7, 0.9)  # shares of the furthest distance from the centre, which are told apart
# Most of the error is that of the rows at the two ends of a sub-aperture's band: where these are
# few, it is theirs by chance. Relative deviation of one of them, in images of few scatterers.
_CHANCE = 1.2
# At which errors are looked up: sub-apertures, rows of each, wavenumbers of each row
_CUTS_FOR_ERROR, _ROWS_FOR_ERROR, _WAVENUMBERS = 16, 24, 6


@dataclasses.dataclass(frozen=True)
class Sampling:
    """Cut into sub-apertures and coarse sampling in direction.

    Attributes
    ----------
    pulses : tuple of slice
        Pulses of each sub-aperture.
    centre : (U,) float64
        Middle of the slopes of each, metres (minus the position along the track, to first order).
    n_coarse, n_fine : int
        Lines of a sub-aperture image and of the fused one over the same extent.
    extent : float
        Of both in direction cosine, guards included.
    n_guard : float
        Coarse lines of each guard.
    beta : float
        Shape of the taper.
    n_coarse_range, n_fine_range : int
        Ranges of a sub-aperture image and of the fused one over the same extent, guards included.
    coverage : PixelDensity
        What of the wanted grid must be right.
    error_db : float
        Predicted error of the fusion, dB.
    cost : float
        Nanoseconds of both stages.
    """

    pulses: tuple[slice, ...]
    centre: np.ndarray
    n_coarse: int
    n_fine: int
    extent: float
    n_guard: float
    beta: float
    n_coarse_range: int
    n_fine_range: int
    coverage: PixelDensity
    error_db: float
    cost: float


def choose_sampling(polar: PolarGrid, bands: LocalSpectrum, tx_m, rx_m, lengths,
                    first_stage: SubapertureCost, target_db: float,
                    coverage: PixelDensity = EVERYTHING,
                    ratio: tuple[int, int] = (1, 1)) -> Sampling | None:
    """Quickest cut and coarse sampling that meet a target.

    Zhang et al., equation 16: a sub-aperture whose rows have the slopes x_lo to x_hi (derivative
    of the half path by direction, metres; positions along the track) fills the angular wavenumbers
    ``K x_lo`` to ``K x_hi``, so its image needs coarse lines no further apart than
    ``2 pi / (K_max (x_hi - x_lo))``. They lie some times closer, and some of them on either side
    are guards, over which a taper makes the image periodic. The error is that of the taper's
    spectrum beyond the band (`aliasing_error`), at the frequencies of the rows. Cuts,
    oversamplings and guards are tried from the quickest on.

    Parameters
    ----------
    polar : PolarGrid
        Of the fused image.
    bands : LocalSpectrum
        Its local frequencies.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    lengths : sequence of int
        Pulses of a sub-aperture to try.
    first_stage : SubapertureCost
        Tells the time of all sub-aperture images.
    target_db : float
        Wanted error of the fusion, dB.
    coverage : PixelDensity
        What of `polar` must be right.
    ratio : (int, int)
        Ranges of a sub-aperture image to those of the fused one.

    Returns
    -------
    Sampling or None
        None where the target cannot be met.
    """
    choices, model = [], costs()
    n_pulses, n_channels = tx_m.shape[:2]
    pieces = pieces_between_gaps(mean_centres(tx_m, rx_m))
    least, most = bands.slope.min(axis=1), bands.slope.max(axis=1)
    for length in lengths:
        if length > n_pulses and length != lengths[0]:
            break
        pulses = tuple(cut_pulses(pieces, length))
        first = np.array([p.start for p in pulses]) * n_channels
        lo, hi = np.minimum.reduceat(least, first), np.maximum.reduceat(most, first)
        centre, half = 0.5 * (lo + hi), bands.wavenumber[1] * 0.5 * float((hi - lo).max())
        furthest = float(np.abs(centre).max())
        choices += [((length, i, j), _sampling(polar, ratio, model, pulses, centre, furthest, half,
                                               oversampling, n_guard, coverage))
                    for i, oversampling in enumerate(_OVERSAMPLING)
                    for j, n_guard in enumerate(_GUARDS)]

    @functools.cache
    def some_rows(length):
        return _rows_for_error(samplings[length, 0, 0], bands, n_channels)

    @functools.cache
    def complete(key):
        error = fusion_error(samplings[key], polar, bands, *some_rows(key[0]))
        return dataclasses.replace(samplings[key], error_db=10 * math.log10(error + 1e-16))

    samplings, fine, failed = dict(choices), set(), set()
    n_i, n_j = len(_OVERSAMPLING), len(_GUARDS)
    for key, found in _by_cost(choices, first_stage):
        if not _on_plane(polar, found):
            continue
        # What fails with wider guards and finer sampling fails with less: most choices fall with
        # a few others far ahead.
        for ahead in _AHEAD:
            length, i, j = key[0], min(key[1] + ahead, n_i - 1), min(key[2] + ahead, n_j - 1)
            if key in failed:
                break
            if ahead and (length, i, j) in fine:
                continue
            if complete((length, i, j)).error_db <= target_db:
                fine |= {(length, a, b) for a in range(i, n_i) for b in range(j, n_j)}
            else:
                failed |= {(length, a, b) for a in range(i + 1) for b in range(j + 1)}
        if key not in failed:
            return dataclasses.replace(complete(key), cost=found.cost)
    return None


def _by_cost(choices, first_stage: SubapertureCost
             ) -> Iterator[tuple[tuple[int, int, int], Sampling]]:
    """Choices from the quickest; whole costs are found for those alone that may be next."""
    images = [(found.pulses, found.n_coarse * found.n_coarse_range) for _, found in choices]
    queue = [(found.cost + first_stage.least_cost(*images[i]), i, False)
             for i, (_, found) in enumerate(choices)]
    heapq.heapify(queue)
    while queue:
        cost, i, whole = heapq.heappop(queue)
        key, found = choices[i]
        if whole:
            yield key, dataclasses.replace(found, cost=cost)
        else:
            heapq.heappush(queue, (found.cost + first_stage.cost(*images[i]), i, True))


def _sampling(polar, ratio, model, pulses, centre, furthest, half, oversampling, n_guard,
              coverage):
    """Grid sizes of one choice, and its cost without the first stage's."""
    wanted = polar.n_alpha * polar.alpha_spacing
    spacing = min(math.pi / (max(half, 1e-9) * oversampling), wanted)
    least = wanted + (2 * n_guard + 1) * spacing
    n_coarse = scipy.fft.next_fast_len(math.ceil(least / spacing))
    # Fine lines are those of the wanted grid. Bands beyond their spectrum fold, as they should.
    n_fine = quick_length(math.ceil(n_coarse * spacing / polar.alpha_spacing))
    extent = n_fine * polar.alpha_spacing
    spacing = extent / n_coarse
    # what rounding to fast lengths leaves over widens the guards
    guard = math.floor(32 * (n_coarse - wanted / spacing)) / 64
    beta = taper_shape(guard, math.pi / (max(half, 1e-9) * spacing))
    least = max(_LEAST_RANGE_GUARD,
                math.ceil(n_guard * spacing * furthest / polar.range_spacing_m))
    range_guard = max(least, min(usual_guard(polar.n_range),
                                 ranges_before(polar, (extent - wanted) / 2 + spacing)))
    n_coarse_range, n_fine_range = (n * row_length(
        math.ceil((polar.n_range + 2 * range_guard) / ratio[1]), ratio) for n in ratio)
    cost = (len(pulses) * (model.coarse_pixel * n_coarse * n_coarse_range + model.subaperture)
            + model.fine_pixel * n_fine * n_fine_range)
    return Sampling(pulses, centre, n_coarse, n_fine, extent, guard, beta, n_coarse_range,
                    n_fine_range, coverage, 0.0, cost)


def _on_plane(polar: PolarGrid, s: Sampling) -> bool:
    """Whether the coarse grid, which rounding may move by a line, lies on the plane."""
    beyond = (s.extent - polar.n_alpha * polar.alpha_spacing) / 2 + s.extent / s.n_coarse
    return (s.n_fine_range - polar.n_range) // 2 < ranges_before(polar, beyond)


def _rows_for_error(s: Sampling, bands: LocalSpectrum, n_channels: int) -> tuple[np.ndarray, ...]:
    """Some rows of some sub-apertures, the power of each, and the middle of its band, metres."""
    cuts = np.linspace(0, len(s.pulses) - 1, _CUTS_FOR_ERROR).round().astype(int)
    rows, weight, centre = [], [], []
    for cut in np.unique(cuts):
        first, last = (n * n_channels for n in (s.pulses[cut].start, s.pulses[cut].stop))
        some, power = _rows_by_slope(bands.slope[first:last], bands.weight[first:last])
        rows.append(first + some)
        weight.append(power)
        centre.append(np.full(len(some), s.centre[cut]))
    return tuple(map(np.concatenate, (rows, weight, centre)))


def _rows_by_slope(slope, weight) -> tuple[np.ndarray, np.ndarray]:
    """Some rows of a sub-aperture and the power that each stands for.

    They lie densest where the band ends: the error of the others is far less.
    """
    order = np.argsort(slope.mean(axis=1))
    edges = 0.5 * len(order) * (1 - np.cos(np.linspace(0, np.pi, _ROWS_FOR_ERROR + 1)))
    power = np.interp(edges, np.arange(len(order) + 1), np.append(0, np.cumsum(weight[order])))
    return order[(0.5 * (edges[1:] + edges[:-1])).astype(int)], np.diff(power)


def fusion_error(s: Sampling, polar: PolarGrid, bands: LocalSpectrum, rows, weight,
                 centre_m) -> float:
    """Mean squared error of fusing some rows, relative to their power.

    Parameters
    ----------
    s : Sampling
        Coarse sampling and taper.
    polar : PolarGrid
        Where the fused image is wanted.
    bands : LocalSpectrum
        Local frequencies.
    rows : (R,) int array or slice
        Rows of `bands` to look at.
    weight : (R,) or () array_like
        Share of each.
    centre_m : (R,) or () array_like
        Middle of the slopes of the sub-aperture that each belongs to, metres.

    Returns
    -------
    float
        2 or more, as if nothing fitted, where a frequency lies beyond the coarse grid's.
    """
    guard = s.n_guard / (s.n_coarse - 2 * s.n_guard)
    slope = _to_guards(bands.slope[rows], guard)
    low, high = bands.wavenumber
    wavenumber = low + (high - low) * (np.arange(_WAVENUMBERS) + 0.5) / _WAVENUMBERS
    bins = wavenumber[:, None, None] * (s.extent / (2 * math.pi))
    # from the bin that the band's middle is rounded to, as in the fusion
    frequency = bins * slope - np.rint(bins * np.reshape(centre_m, (-1, 1)))
    weight = np.broadcast_to(np.reshape(weight, (-1, 1)), (len(slope), 1))
    error = aliasing_error(s.n_coarse, s.n_guard, s.beta, frequency, weight, bands.position,
                       s.coverage.along_alpha)
    error += correction_error(s.coverage, s.n_fine, s.n_guard * s.n_fine / s.n_coarse, s.beta)
    # Along range the same happens over a length that grows with the distance from the centre.
    away = np.broadcast_to(np.abs(np.ravel(centre_m)), len(slope))
    furthest = max(float(np.abs(s.centre).max()), float(away.max()), 1e-9)
    which = np.searchsorted(_NEARER, away / furthest)
    for number in np.unique(which):
        some = which == number
        shift = (furthest * [*_NEARER, 1.0][number] * s.extent / s.n_coarse
                 / polar.range_spacing_m)
        error += (weight[some].sum() / weight.sum()) * _range_error(
            s, polar, frequency[:, some], weight[some], shift)
    return error * (1 + _CHANCE / math.sqrt(2 * len(s.pulses)))


def _range_error(s: Sampling, polar: PolarGrid, frequency, weight, shift: float) -> float:
    """Mean squared error near the ends of the ranges, of which `shift` move by a coarse line."""
    n_guard = (s.n_fine_range - polar.n_range) // 2 / shift
    if n_guard > _WIDE_GUARD * s.n_guard:
        return 0.0
    n = int(polar.n_range / shift + 2 * n_guard) + 2
    return aliasing_error(n, n_guard, s.beta, frequency * (n / s.n_coarse), weight,
                      density=s.coverage.along_range)


def _to_guards(slope, share: float) -> np.ndarray:
    """Slopes of which the outermost directions lie by a share of the scene in the guards."""
    slope = slope.copy().reshape(len(slope), SAMPLES_PER_SIDE, -1)
    steps = slope[:, [0, -1]] - slope[:, [1, -2]]
    slope[:, [0, -1]] += share * (SAMPLES_PER_SIDE - 1) * steps
    return slope.reshape(len(slope), -1)
