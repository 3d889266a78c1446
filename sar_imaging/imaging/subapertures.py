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
import scipy.fft

from ..geometry.polar import PolarGrid
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .fusion_error import mean_error, taper_shape
from .lattice import plan_lattice, sample_paths, slope_along, total_db
from .profiles import Profiles
from .projection import PolarLines

_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded
_ROWS_FOR_PATHS = 512  # enough to bound how paths differ along a line
_GAP = 4.0  # times the usual distance between pulses
_LENGTHS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)  # pulses
_OVERSAMPLING = (1.25, 1.4, 1.6, 1.8, 2.0, 2.3, 2.7, 3.2)
_GUARDS = (1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
# Time of a coarse and a fine pixel in the fusion; a pixel and row of the kernel is 1 (measured)
_COST_COARSE, _COST_FINE, _COST_SUBAPERTURE = 14.0, 18.0, 1e6
_LEAST_RANGE_GUARD = 16
_ROWS_FOR_ERROR = 96
_ROUNDING = 0.25  # of a band's middle to a bin, on average


@dataclasses.dataclass(frozen=True)
class Bands:
    """Local frequencies of a grid's sub-aperture images.

    Attributes
    ----------
    slope : (R, S) float64
        Derivative of the half path by direction, over that by range, from each row to sampled
        points, metres. Times the wavenumber it is the frequency along direction.
    position : (S,) float64
        Where the points lie along direction, 0 to 1.
    wavenumber : (2,) floats
        Lowest and highest of the band, rad/m.
    half_range : float
        Largest frequency along range, relative to the carrier's, rad/m.
    """

    slope: np.ndarray
    position: np.ndarray
    wavenumber: tuple[float, float]
    half_range: float


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
    range_guard : int
        Ranges of each guard.
    error_db : float
        Predicted error of the fusion, dB.
    cost : float
        Relative time.
    """

    pulses: tuple[slice, ...]
    centre: np.ndarray
    n_coarse: int
    n_fine: int
    extent: float
    n_guard: float
    beta: float
    range_guard: int
    error_db: float
    cost: float


class SubaperturePlan:
    """Cut of an aperture and polar grid of its sub-aperture images.

    Parameters
    ----------
    polar : PolarGrid
        Where the fused image is wanted.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of a profile.
    tx_m, rx_m : (P, C, 3) array_like
        Phase centres of the whole aperture, metres, in the order of the pulses.
    target_db : float
        Wanted error of the fused image against exact backprojection, dB.
    pulses_per_subaperture : int, optional
        Length of the sub-apertures; the quickest if left out.

    Attributes
    ----------
    polar : PolarGrid
        As given.
    coarse : PolarGrid
        Of the sub-aperture images; it reaches beyond `polar` by the guards.
    sampling : Sampling
        Cut and coarse sampling.
    predicted_error_db : float
        Predicted error of the fused polar image against exact backprojection, dB.
    half_range : float
        Largest frequency of the images along range, rad/m.

    Raises
    ------
    ValueError
        No sampling of this geometry meets the target, or it does not suit a polar grid.
    """

    def __init__(self, polar: PolarGrid, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
                 target_db: float = -50.0, pulses_per_subaperture: int | None = None):
        tx_m, rx_m = np.asarray(tx_m, np.float64), np.asarray(rx_m, np.float64)
        self.polar, self.radar, self.n_samples = polar, radar, int(n_samples)
        self._n_channels = tx_m.shape[1]
        paths = _paths(polar, tx_m, rx_m)
        lattice = plan_lattice(paths, polar.range_spacing_m, polar.n_range, radar, n_samples,
                               min(target_db - 10.0, -50.0))
        if lattice is None:
            raise ValueError('the polar grid does not follow the range of this track (too near, '
                             'or around the antenna); use Backprojector')
        self.lattice = lattice
        bands = local_bands(polar, tx_m, rx_m, radar)
        self.half_range = bands.half_range
        lengths = (pulses_per_subaperture,) if pulses_per_subaperture else _LENGTHS
        self.sampling = choose_sampling(polar, bands, tx_m, rx_m, lengths, lattice.cost,
                                        10 * math.log10(10 ** (target_db / 10)
                                                        - 10 ** (lattice.predicted_error_db / 10)))
        if self.sampling is None:
            raise ValueError(
                f'no sub-apertures of {", ".join(map(str, lengths))} pulses reach '
                f'target_db={target_db:g} on this polar grid; ask for less, image a smaller '
                'scene, or use Backprojector')
        self.coarse = self._coarse_grid()
        self.predicted_error_db = total_db(lattice.predicted_error_db, self.sampling.error_db)
        guard = self.sampling.range_guard * polar.range_spacing_m
        slack = 0.5 * np.ptp(paths.length) / (_SAMPLES_PER_SIDE - 1) + 2 * guard
        self._profiles = Profiles(radar, lattice, (float(paths.length.min() - slack),
                                                   float(paths.length.max() + slack)))
        self._lines = PolarLines(self.coarse, self._profiles)

    @property
    def n_subapertures(self) -> int:
        """Number of sub-apertures."""
        return len(self.sampling.pulses)

    def __str__(self) -> str:
        s, lengths = self.sampling, [p.stop - p.start for p in self.sampling.pulses]
        return (f'{self.n_subapertures} sub-apertures of {min(lengths)} to {max(lengths)} pulses, '
                f'{s.n_coarse} coarse lines each ({2 * s.n_guard:g} of them guards) of '
                f'{self.coarse.n_range} ranges, fused to {s.n_fine} lines; predicted error '
                f'{self.predicted_error_db:.1f} dB')

    def image(self, number: int, block: PulseBlock) -> np.ndarray:
        """Backproject one sub-aperture (Zhang et al., equation 6).

        Parameters
        ----------
        number : int
            Which sub-aperture; its nominal pulses are ``sampling.pulses[number]``.
        block : PulseBlock
            Its range profiles with phase centres.

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
        check_profiles(block, self.radar, self.n_samples)
        if not 0 <= number < self.n_subapertures:
            raise ValueError(f'number={number}; the plan has sub-apertures 0 to '
                             f'{self.n_subapertures - 1}')
        parts = np.zeros((2, self.coarse.n_alpha, self.coarse.n_range), np.float32)
        self._lines.add(block.samples.reshape(-1, self.n_samples), block.tx_m.reshape(-1, 3),
                        block.rx_m.reshape(-1, 3), parts)
        return parts

    def _coarse_grid(self) -> PolarGrid:
        polar, s = self.polar, self.sampling
        try:
            return dataclasses.replace(
                polar, n_alpha=s.n_coarse, alpha_spacing=s.extent / s.n_coarse,
                alpha_start=polar.alpha_start - self.fine_guard * polar.alpha_spacing,
                n_range=polar.n_range + 2 * s.range_guard,
                range_start_m=polar.range_start_m - s.range_guard * polar.range_spacing_m)
        except ValueError as error:
            raise ValueError(f'the guards around the polar grid leave the plane: {error}; use '
                             'Backprojector') from error

    @property
    def fine_guard(self) -> int:
        """Fine lines of the guard before the first line of `polar`."""
        s = self.sampling
        return math.ceil(s.n_guard * s.extent / s.n_coarse / self.polar.alpha_spacing)


def _paths(polar: PolarGrid, tx_m, rx_m):
    """Half paths at samples of the grid, for some rows."""
    n = _SAMPLES_PER_SIDE
    r, alpha = (v.ravel() for v in np.meshgrid(
        np.linspace(polar.range_m[0], polar.range_m[-1], n),
        np.linspace(polar.alpha[0], polar.alpha[-1], n)))
    tx, rx = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
    # neighbouring rows in groups, since they are added together
    step = max(1, len(tx) // _ROWS_FOR_PATHS)
    return sample_paths(tx[::step], rx[::step], polar.lines(r, alpha))


def local_bands(polar: PolarGrid, tx_m, rx_m, radar: RadarParameters) -> Bands:
    """Local frequencies of backprojected images at samples of a polar grid.

    Parameters
    ----------
    polar : PolarGrid
        Grid.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    radar : RadarParameters
        Of the profiles.

    Returns
    -------
    Bands

    Raises
    ------
    ValueError
        Range does not grow along the lines of the grid.
    """
    n = _SAMPLES_PER_SIDE
    where = np.linspace(0, 1, n)
    r, share = (v.ravel() for v in np.meshgrid(
        np.linspace(polar.range_m[0], polar.range_m[-1], n), where))
    alpha = polar.alpha[0] + share * (polar.alpha[-1] - polar.alpha[0])
    position, along_range = polar.lines(r, alpha)[:2]
    along_alpha = polar.by_direction(r, alpha)
    rows = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
    by_range = slope_along(*rows, position, along_range)
    if by_range.min() <= 0.1:
        raise ValueError('range does not grow along the lines of the polar grid; it lies beside '
                         'or behind the track, use Backprojector')
    slope = slope_along(*rows, position, along_alpha) / by_range
    half = 2 * math.pi * radar.bandwidth_hz / SPEED_OF_LIGHT
    k = radar.wavenumber_rad_per_m
    half_range = half * by_range.max() + (k + half) * np.abs(by_range - 1).max()
    return Bands(slope, share, (k - half, k + half), float(half_range))


def choose_sampling(polar: PolarGrid, bands: Bands, tx_m, rx_m, lengths, row_cost: float,
                    target_db: float) -> Sampling | None:
    """Quickest cut and coarse sampling that meet a target.

    Parameters
    ----------
    polar : PolarGrid
        Where the fused image is wanted.
    bands : Bands
        Its local frequencies.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    lengths : sequence of int
        Pulses of a sub-aperture to try.
    row_cost : float
        Relative time of backprojecting one row to one pixel.
    target_db : float
        Wanted error of the fusion, dB.

    Returns
    -------
    Sampling or None
        None where the target cannot be met.
    """
    choices = []
    n_pulses, n_channels = tx_m.shape[:2]
    middles = 0.5 * (tx_m + rx_m).mean(axis=1)
    for length in lengths:
        if length > n_pulses and length != lengths[0]:
            break
        pulses = cut_pulses(middles, length)
        lo, hi = _slopes(bands.slope, pulses, n_channels)
        centre, half = 0.5 * (lo + hi), bands.wavenumber[1] * 0.5 * float((hi - lo).max())
        choices += [(length, oversampling, n_guard,
                     _sampling(polar, bands, pulses, centre, half, n_channels, oversampling,
                               n_guard, row_cost))
                    for oversampling in _OVERSAMPLING for n_guard in _GUARDS]
    failed = []
    for *key, sampling in sorted(choices, key=lambda choice: choice[-1].cost):
        # What fails with wider guards and finer sampling fails with less.
        if any(key[0] == f[0] and key[1] <= f[1] and key[2] <= f[2] for f in failed):
            continue
        found = _with_error(sampling, polar, bands, n_channels, key[1])
        if found.error_db <= target_db:
            return found
        failed.append(key)
    return None


def cut_pulses(middles, length: int) -> list[slice]:
    """Sub-apertures of about equal length that do not reach across gaps of the track.

    Parameters
    ----------
    middles : (P, 3) float64
        Mean phase centre of each pulse, metres.
    length : int
        Most pulses of a sub-aperture.

    Returns
    -------
    list of slice
    """
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    usual = np.median(steps) if len(steps) else 0.0
    gaps = np.flatnonzero(steps > _GAP * usual) + 1 if usual > 0 else []
    cuts = []
    for start, stop in zip([0, *gaps], [*gaps, len(middles)], strict=True):
        edges = np.linspace(start, stop, math.ceil((stop - start) / length) + 1).round()
        cuts += [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return cuts


def _slopes(slope, pulses, n_channels):
    """Smallest and largest slope of each sub-aperture."""
    first = np.array([p.start for p in pulses]) * n_channels
    return (np.minimum.reduceat(slope.min(axis=1), first),
            np.maximum.reduceat(slope.max(axis=1), first))


def _sampling(polar, bands, pulses, centre, half, n_channels, oversampling, n_guard, row_cost):
    """Grid sizes and cost of one choice."""
    wanted = polar.n_alpha * polar.alpha_spacing
    spacing = min(math.pi / (max(half, 1e-9) * oversampling), wanted)
    least = wanted + (2 * n_guard + 1) * spacing
    n_coarse = scipy.fft.next_fast_len(math.ceil(least / spacing))
    # Fine lines are those of the wanted grid, and all bands with their margins must fit.
    edge = bands.wavenumber[1] * float(np.abs(centre).max()) / math.pi
    n_fine = scipy.fft.next_fast_len(max(
        math.ceil(n_coarse * spacing / polar.alpha_spacing), 1))
    while n_fine < edge * n_fine * polar.alpha_spacing + n_coarse:
        n_fine = scipy.fft.next_fast_len(n_fine + 1)
        if n_fine > 4 * polar.n_alpha + 8 * n_coarse:
            break
    extent = n_fine * polar.alpha_spacing
    spacing = extent / n_coarse
    range_guard = max(_LEAST_RANGE_GUARD, math.ceil(
        n_guard * spacing * float(np.abs(centre).max()) / polar.range_spacing_m))
    n_range = polar.n_range + 2 * range_guard
    n_rows = sum(p.stop - p.start for p in pulses) * n_channels
    coarse = n_coarse * n_range
    cost = (n_rows * row_cost * coarse + len(pulses) * (_COST_COARSE * coarse + _COST_SUBAPERTURE)
            + _COST_FINE * n_fine * n_range)
    return Sampling(tuple(pulses), centre, n_coarse, n_fine, extent, n_guard, 0.0, range_guard,
                    0.0, cost)


def _with_error(s: Sampling, polar: PolarGrid, bands: Bands, n_channels: int,
                oversampling: float) -> Sampling:
    """The choice with its taper and predicted error."""
    spacing = s.extent / s.n_coarse
    number = np.repeat(np.arange(len(s.pulses)), [(p.stop - p.start) * n_channels
                                                  for p in s.pulses])
    rows = np.unique(np.linspace(0, len(number) - 1, _ROWS_FOR_ERROR).round().astype(int))
    offset = bands.slope[rows] - s.centre[number[rows], None]
    frequency = np.abs(np.multiply.outer(bands.wavenumber, offset)) * spacing
    frequency += _ROUNDING * 2 * np.pi / s.n_coarse
    position = np.broadcast_to(bands.position, frequency.shape)
    # what rounding to fast lengths leaves over widens the guards
    n_guard = (s.n_coarse - polar.n_alpha * polar.alpha_spacing / spacing) / 2
    n_guard = math.floor(4 * max(s.n_guard, n_guard)) / 4
    beta = taper_shape(n_guard, oversampling)
    error = mean_error(s.n_coarse, n_guard, beta, frequency, position)
    # Along range the same happens over a length that grows with the distance from the centre.
    shift = np.abs(s.centre).mean() * spacing / polar.range_spacing_m
    error += mean_error(int(polar.n_range / max(shift, 1e-9) + 2 * n_guard) + 2, n_guard, beta,
                        frequency)
    return dataclasses.replace(s, n_guard=n_guard, beta=beta,
                               error_db=10 * math.log10(error + 1e-16))
