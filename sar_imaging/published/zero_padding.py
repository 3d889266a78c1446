# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Zero-padded backprojection: L. Rosenberg, D. Gray, Multichannel SAR Imaging with Backprojection.

Equations 13 to 19: the spectrum of each profile is padded with zeros by a ratio (14), the profile
is modulated back to the carrier (15) and each pixel takes the nearest sample (16). Further
interpolators read the same zero-padded profile at baseband and apply the exact carrier phase. Each
knows its error beforehand.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import scipy.fft
from numpy.typing import ArrayLike

from ..backends.cpu.correlation import distance, phasor
from ..compilation import njit, numba
from ..geometry.grids import Grid, PointGrid
from ..geometry.half_paths import half_paths
from ..geometry.track import mean_centres
from ..imaging.image import Report
from ..memory import IMAGE_BYTES
from ..planning.exact.points import some_of
from ..planning.exact.pulse_power import PulsePower
from ..planning.plan import with_chance
from ..planning.profiles import check_reach, echoes_for_means, reach_warnings, some_pixels
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from ..signal.spectra import resampled_from_spectrum
from .judged import JudgedMethod, JudgedPlan, may_err_db

#: How a zero-padded profile is read between its samples.
INTERPOLATORS = ('nearest', 'linear', 'cubic', 'sinc')
#: Where each channel is read: at its exact two-way delay; at that of the midpoint between its
#: antennas (equation 3); or at the delay of the reference antenna, with the phase of equation 19.
DELAYS = ('exact', 'midpoint', 'steering')
SINC_TAPS = 8
ROUNDING_DB = -120.0  # of single-precision profiles and transforms
CHUNK_BYTES = 16 << 20  # zero-padded profiles held at a time
_POSITION_BYTES, _SUM_BYTES, _SAMPLE_BYTES = 24, 16, 8  # float64 x 3, complex128, complex64
_COPIES = 3  # of the profiles that are padded at a time
_RATIOS = (2, 4, 8, 16)  # to choose from
_AT_ENDS = 8  # samples of a profile whose power is that at its end
# Of the error because profiles end, which are stronger at some places (measured); and of another
_END_DOUBT, _CHANCE_DB = 2.0, 2.0
_FULL = 0.95  # share of the sampling that a band fills, beyond which all errors are alike
_POINTS = 4096  # whose ranges are looked at closely
_NODES, _BY_NODE = np.polynomial.legendre.leggauss(64)  # over the band, and between two samples
_PHASES = 2048  # of the weight table, interpolated linearly: below -120 dB
_POINTS_PER_GROUP = 512  # neighbours, which read neighbouring samples


class ZeroPadding(JudgedMethod):
    """Backprojection of zero-padded profiles: any grid, any track; `exact` errs less in less time.

    For its options see `plan_zero_padding`. Ranges outside a profile contribute nothing.
    Equation 18, the image at baseband, is `quality.to_baseband`.
    """

    NAME = 'zero-padding'
    OWN = {'interpolator': 'sinc', 'ratio': None, 'delay': 'exact'}

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """See `Method`."""
        return self.planned(plan_zero_padding(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                              target_db=self.options.target_db, **self.own))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return image_zero_padded(self.report.plan, block)

    def errors_of(self, echoes: np.ndarray, at_pixels: PulsePower) -> dict[str, float]:
        """See `JudgedMethod`; profiles are read as if they repeated."""
        ends = sum(float(np.mean(np.abs(some) ** 2))
                   for some in (echoes[:, :_AT_ENDS], echoes[:, -_AT_ENDS:]))
        return {'ends of profiles': len(echoes) * ends * self.report.plan.end_error()}


@dataclasses.dataclass(frozen=True, eq=False)
class ZeroPaddingPlan(JudgedPlan):
    """How zero-padded profiles are read at pixels.

    Attributes
    ----------
    grid : Grid
        Where the pixels are.
    radar : RadarParameters
        Describes the compressed profiles.
    n_samples : int
        Samples L of each profile.
    interpolator, ratio, delay :
        As given to `plan_zero_padding`.
    errors_db : mapping of str to float
        Predicted error against time-domain correlation by cause, dB; approximations of the delay
        are not part of it.
    warnings : tuple of str
        What makes the image worse than predicted.
    """

    grid: Grid
    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray
    interpolator: str
    ratio: int
    delay: str
    errors_db: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def rate_hz(self) -> float:
        """Sample rate of the zero-padded profiles."""
        return self.ratio * self.radar.sample_rate_hz

    @property
    def echoes_per_pass(self) -> int:
        """Profiles that are zero-padded at a time, which bounds memory."""
        return max(1, CHUNK_BYTES // (_SAMPLE_BYTES * self.n_samples * self.ratio))

    @property
    def n_bytes(self) -> int:
        """Memory that forming the image takes, bytes."""
        profiles = _COPIES * _SAMPLE_BYTES * self.echoes_per_pass * self.ratio * self.n_samples
        return profiles + math.prod(self.grid.shape) * (_POSITION_BYTES + _SUM_BYTES + IMAGE_BYTES)

    def end_error(self) -> float:
        """Mean squared error of a read because profiles end, over the power at their two ends.

        What lies beyond an end, and the other end that is read in its place, are tones of the
        band cut off d samples away, w radians a sample: the sinc of the transform leaves
        ``1 / (2 pi d cos(w / 2))`` of each, on average between two samples half of its square.
        """
        tx, rx = (a[echoes_for_means(len(a))] for a in self.echoes_m)
        after = (half_paths(tx, rx, some_of(self.pixels))[0] - self.radar.range_start_m
                 ) / self.radar.sample_spacing_m
        away = np.maximum(np.stack([after, self.n_samples - 1 - after]) + 0.5, 0.5)
        edge = math.pi * min(self.radar.bandwidth_hz / self.radar.sample_rate_hz, _FULL)
        tones = 2 / edge * math.tan(edge / 2)
        return float(_END_DOUBT * tones / (8 * math.pi ** 2) * 2 * np.mean(away ** -2.0))

    def weights(self, position: ArrayLike) -> np.ndarray:
        """Weights of the neighbours of a place between two zero-padded samples.

        Parameters
        ----------
        position : (P,) array_like
            Places, 0 to 1.

        Returns
        -------
        (P, T) float64
            Of the samples ``1 - T/2 .. T/2``. Not for 'nearest'.
        """
        return _weights(self.interpolator, position, self.ratio, self.radar)

    def paths(self, tx_m: np.ndarray, rx_m: np.ndarray) -> list[np.ndarray]:
        """Ends of the paths at which profiles are read, and of those whose phase is applied.

        Parameters
        ----------
        tx_m, rx_m : (P, C, 3) float64
            Phase centres, metres.

        Returns
        -------
        list of four (P * C, 3) float64
            Two ends of each.
        """
        if self.delay == 'midpoint':
            tx_m = rx_m = 0.5 * (tx_m + rx_m)
        read = tx_m, rx_m
        if self.delay == 'steering':
            read = (np.broadcast_to(mean_centres(tx_m, rx_m)[:, None], tx_m.shape),) * 2
        return [np.ascontiguousarray(a.reshape(-1, 3)) for a in (*read, tx_m, rx_m)]

    def __str__(self) -> str:
        return (f'profiles are zero-padded {self.ratio} times and read by {self.interpolator} '
                f'interpolation, delays: {self.delay}')


def plan_zero_padding(grid: Grid, radar: RadarParameters, n_samples: int, tx_m: np.ndarray,
                      rx_m: np.ndarray, *, target_db: float = -60.0, interpolator: str = 'sinc',
                      ratio: int | None = None, delay: str = 'exact') -> ZeroPaddingPlan:
    """Plan an image from zero-padded profiles.

    Parameters
    ----------
    grid : Grid
        Where the pixels are.
    radar : RadarParameters
        Describes the compressed profiles.
    n_samples : int
        Samples L of each profile.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres, to tell which pixels lie beyond the profiles.
    target_db : float
        Wanted error against time-domain correlation, dB.
    interpolator : {'nearest', 'linear', 'cubic', 'sinc'}
        'nearest' takes the nearest sample with the carrier phase of that sample, as the paper
        does (equations 15 and 16). The others interpolate the baseband profile over 2, 4
        (Lagrange) and 8 (Kaiser-windowed sinc) samples and apply the exact carrier phase.
    ratio : int, optional
        Zero-padding ratio ``Z_rat``: samples per sample of the profile. By default the least of
        some that meets the target, or the largest of them.
    delay : {'exact', 'midpoint', 'steering'}
        Delay of each channel. 'exact': both legs of its own path. 'midpoint': twice the distance
        from the middle between its antennas, ``0.5 d_n`` (equation 3). 'steering': the profile is
        read at the delay of the reference antenna, the mean of all phase centres of the pulse,
        and multiplied by ``exp(+j w_c tau_spat)``, the conjugate of equation 19.

    Returns
    -------
    ZeroPaddingPlan

    Raises
    ------
    ValueError
        An option is unknown or out of range, a point is NaN, or the profiles are sampled below
        their bandwidth or reach no pixel.
    """
    if delay not in DELAYS:
        raise ValueError(f'delay={delay!r} is unknown; use one of {", ".join(DELAYS)}')
    pixels = grid.points_m.reshape(-1, 3) if isinstance(grid, PointGrid) else some_pixels(grid)
    if not np.isfinite(pixels).all():
        raise ValueError('points contain NaN or infinity; expected finite numbers')
    chance_db = may_err_db(grid, tx_m, rx_m, radar, _CHANCE_DB)
    if ratio is None:
        ratio = next((r for r in _RATIOS if predicted_error_db(interpolator, r, radar)
                      <= target_db - chance_db), _RATIOS[-1])
    error = predicted_error_db(interpolator, ratio, radar)
    centre = 0.5 * (pixels.min(axis=0) + pixels.max(axis=0))
    radius = np.linalg.norm(pixels - centre, axis=-1).max()
    path = 0.5 * sum(np.linalg.norm(a - centre, axis=-1) for a in (tx_m, rx_m))
    check_reach((path.min() - radius, path.max() + radius), radar, n_samples)
    errors = with_chance({'range profiles': error}, chance_db)
    warnings = reach_warnings(pixels[::-(-len(pixels) // _POINTS)], tx_m, rx_m, radar, n_samples)
    if delay != 'exact':
        warnings = (*warnings, f'delay={delay!r} approximates the paths of the channels, and the '
                    "predicted error is that of reading the profiles alone; use delay='exact'")
    return ZeroPaddingPlan(grid, radar, n_samples, tx_m.copy(), rx_m.copy(), interpolator,
                           int(ratio), delay, errors, warnings)


def predicted_error_db(interpolator: str, ratio: int, radar: RadarParameters) -> float:
    """Predicted error of one read of a zero-padded profile.

    Mean squared error over a flat band and uniformly distributed positions between two samples,
    over the power of the signal. With 'nearest' it is ``2 - 2 mean sinc(f / (Z_rat f_s))`` over
    the absolute frequencies f of the band: the carrier phase of a sample up to half a step away.

    The error of an image against time-domain correlation is about the same or lower: what is not
    a common factor of all reads, ``mean sinc(f / (Z_rat f_s))``, spreads along azimuth, in part
    beyond the image.

    Parameters
    ----------
    interpolator : {'nearest', 'linear', 'cubic', 'sinc'}
        See `plan_zero_padding`.
    ratio : int
        Zero-padding ratio ``Z_rat``.
    radar : RadarParameters
        Describes the profiles.

    Returns
    -------
    float
        dB, rounding in single precision included.

    Raises
    ------
    ValueError
        The interpolator is unknown, the ratio is not a positive integer, or the profiles are
        sampled below their bandwidth.
    """
    if interpolator not in INTERPOLATORS:
        raise ValueError(f'interpolator={interpolator!r} is unknown; use one of '
                         f'{", ".join(INTERPOLATORS)}')
    if not (ratio >= 1 and ratio == int(ratio)):
        raise ValueError(f'ratio={ratio}; expected a positive integer')
    if radar.sample_rate_hz < radar.bandwidth_hz:
        raise ValueError(f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
                         f'{radar.bandwidth_hz:g} Hz; sample them at the bandwidth or faster')
    weight = _BY_NODE / 2
    baseband = _NODES * _band_edge(ratio, radar)  # cycles per sample
    if interpolator == 'nearest':
        absolute = radar.carrier_hz / (ratio * radar.sample_rate_hz) + baseband
        error = float(2 - 2 * weight @ np.sinc(absolute))
    else:
        position = (_NODES + 1) / 2
        taps = _weights(interpolator, position, ratio, radar)
        offset = np.arange(taps.shape[1]) - taps.shape[1] // 2 + 1 - position[:, None]
        # Relative to the wanted value, so that the phase of the position drops out.
        value = np.einsum('pk,pkf->pf', taps, np.exp(2j * np.pi * offset[..., None] * baseband))
        error = float(weight @ np.abs(value - 1) ** 2 @ weight)
    return 10 * math.log10(error + 10 ** (ROUNDING_DB / 10))


def _band_edge(ratio: int, radar: RadarParameters) -> float:
    """Highest baseband frequency, cycles per zero-padded sample."""
    return radar.bandwidth_hz / (2 * ratio * radar.sample_rate_hz)


def _weights(interpolator: str, position: np.ndarray, ratio: int, radar: RadarParameters
             ) -> np.ndarray:
    """(P, T) weights of the samples ``1 - T/2 .. T/2`` at positions (P,) between 0 and 1."""
    t = np.asarray(position, float)[:, None]
    if interpolator == 'linear':
        return np.hstack([1 - t, t])
    if interpolator == 'cubic':
        return np.hstack([-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2,
                          -(t + 1) * t * (t - 2) / 2, (t + 1) * t * (t - 1) / 6])
    offset = t - (np.arange(SINC_TAPS) - SINC_TAPS // 2 + 1)
    # The window's spectrum ends half way between the band and its first repetition.
    reach = SINC_TAPS * (0.5 - _band_edge(ratio, radar))
    beta = math.pi * math.sqrt(max(reach ** 2 - 1, 0))
    inside = np.clip(1 - (2 * offset / SINC_TAPS) ** 2, 0, None)
    return np.sinc(offset) * np.i0(beta * np.sqrt(inside)) / np.i0(beta)


def image_zero_padded(plan: ZeroPaddingPlan, block: PulseBlock) -> np.ndarray:
    """Image by a plan, complex64."""
    radar = plan.radar
    points = np.ascontiguousarray(plan.grid.points().reshape(-1, 3))
    paths = plan.paths(block.tx_m, block.rx_m)
    profiles = block.samples.reshape(-1, plan.n_samples)
    start = radar.first_sample_delay_s * plan.rate_hz
    speed = radar.propagation_speed_m_per_s
    where = (points, start, plan.rate_hz / speed, radar.carrier_hz / speed,
             plan.delay == 'steering')
    image = np.zeros(len(points), np.complex128)
    nearest = plan.interpolator == 'nearest'
    carrier = _carrier_at_samples(plan) if nearest else None
    table = None if nearest else plan.weights(np.linspace(0, 1, _PHASES + 1))
    for lo in range(0, len(profiles), plan.echoes_per_pass):
        echoes = slice(lo, lo + plan.echoes_per_pass)
        padded, ends = _padded(plan, profiles[echoes]), [a[echoes] for a in paths]
        if nearest:
            padded *= carrier
            _add_nearest(padded, *ends, *where, image)
            continue
        half = table.shape[1] // 2
        # One period of the profile, continued where the taps reach beyond its ends.
        padded = np.concatenate([padded[:, padded.shape[1] - half + 1:], padded,
                                 padded[:, :half]], axis=1)
        _add_interpolated(padded, table, *ends, *where, image)
    return image.astype(np.complex64).reshape(plan.grid.shape)


def _padded(plan: ZeroPaddingPlan, profiles: np.ndarray) -> np.ndarray:
    """(R, ratio L) complex64 profiles at `ratio` times their rate, equation 14."""
    workers = numba.get_num_threads()
    spectrum = scipy.fft.fft(np.asarray(profiles, np.complex64), axis=-1, workers=workers)
    return resampled_from_spectrum(spectrum, plan.ratio * plan.n_samples, workers=workers)


def _carrier_at_samples(plan: ZeroPaddingPlan) -> np.ndarray:
    """(ratio L,) complex64 ``exp(j w_c t)`` at the upsampled times, equation 15."""
    time_s = (plan.radar.first_sample_delay_s
              + np.arange(plan.ratio * plan.n_samples) / plan.rate_hz)
    return np.exp(2j * np.pi * np.fmod(plan.radar.carrier_hz * time_s, 1.0)).astype(np.complex64)


@njit(inline='always')
def _path(point, a, b):
    """Metres from `a` over the point to `b`."""
    return distance(point, a) + distance(point, b)


@njit(parallel=True)
def _add_nearest(profiles, read_a, read_b, tx, rx, points, start, samples_per_metre,
                 cycles_per_metre, steer, out):
    """Add the sample nearest to each point's delay (equation 16), steered by equation 19."""
    n_echoes, n = profiles.shape
    for group in numba.prange(-(-len(points) // _POINTS_PER_GROUP)):
        first = group * _POINTS_PER_GROUP
        last = min(first + _POINTS_PER_GROUP, len(points))
        for echo in range(n_echoes):
            for i in range(first, last):
                path = _path(points[i], read_a[echo], read_b[echo])
                k = int(np.floor(path * samples_per_metre - start + 0.5))
                if not 0 <= k < n:
                    continue
                value = complex(profiles[echo, k])
                if steer:
                    spatial = _path(points[i], tx[echo], rx[echo]) - path
                    value *= phasor(cycles_per_metre * spatial)
                out[i] += value


@njit(parallel=True)
def _add_interpolated(profiles, table, read_a, read_b, tx, rx, points, start, samples_per_metre,
                      cycles_per_metre, steer, out):
    """Add the interpolated baseband profile at each point's delay times the carrier phase.

    Profiles start ``T/2 - 1`` samples before the first and end ``T/2`` after the last.
    """
    n_taps = table.shape[1]
    n_echoes, n = profiles.shape[0], profiles.shape[1] - n_taps + 1
    for group in numba.prange(-(-len(points) // _POINTS_PER_GROUP)):
        first = group * _POINTS_PER_GROUP
        last = min(first + _POINTS_PER_GROUP, len(points))
        for echo in range(n_echoes):
            for i in range(first, last):
                path = _path(points[i], read_a[echo], read_b[echo])
                position = path * samples_per_metre - start
                k = int(np.floor(position))
                if not 0 <= k < n:
                    continue
                phase = (position - k) * _PHASES
                p = min(int(phase), _PHASES - 1)
                between = phase - p
                value = 0j
                for tap in range(n_taps):
                    weight = table[p, tap] + between * (table[p + 1, tap] - table[p, tap])
                    value += weight * profiles[echo, k + tap]
                if steer:
                    path = _path(points[i], tx[echo], rx[echo])
                out[i] += value * phasor(cycles_per_metre * path)
