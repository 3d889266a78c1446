"""Backprojection of zero-padded profiles as Rosenberg & Gray publish it, for comparison.

Equations 13 to 19: the spectrum of each profile is padded with zeros by a ratio (14), the profile
is modulated back to the carrier (15) and each pixel takes the nearest sample (16). Further
interpolators read the same zero-padded profile at baseband and apply the exact carrier phase. Each
knows its error beforehand. `sar_imaging.imaging.backprojection` is faster and more accurate.
Equation 18, the image at baseband, is `sar_imaging.quality.to_baseband`.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.fft

from ..compilation import njit, numba
from ..geometry import Grid
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters
from ..signal.spectra import resampled_from_spectrum

#: How a zero-padded profile is read between its samples.
INTERPOLATORS = ('nearest', 'linear', 'cubic', 'sinc')
#: Where each channel is read: at its exact two-way delay; at that of the midpoint between its
#: antennas (equation 3); or at the delay of the reference antenna, turned by equation 19.
DELAYS = ('exact', 'midpoint', 'steering')

SINC_TAPS = 8
ROUNDING_DB = -120.0  # of single-precision profiles and transforms

_PHASES = 2048  # of the weight table, interpolated linearly: below -120 dB
_CHUNK_BYTES = 16 << 20  # zero-padded profiles held at a time
_POINTS_PER_GROUP = 512  # neighbours, which read neighbouring samples


class ZeroPaddedBackprojector:
    """Backproject zero-padded range profiles of one radar onto a grid or any points.

    Parameters
    ----------
    grid_or_points : Grid or (..., 3) array_like
        Where to image, metres.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples L of each profile.
    interpolator : {'nearest', 'linear', 'cubic', 'sinc'}
        'nearest' takes the nearest sample with the carrier phase of that sample, as the paper
        does (equations 15 and 16). The others interpolate the baseband profile over 2, 4
        (Lagrange) and 8 (Kaiser-windowed sinc) samples and apply the exact carrier phase.
    ratio : int
        Zero-padding ratio ``Z_rat``: samples per sample of the profile.
    delay : {'exact', 'midpoint', 'steering'}
        Delay of each channel. 'exact': both legs of its own path. 'midpoint': twice the distance
        from the middle between its antennas, ``0.5 d_n`` (equation 3). 'steering': the profile is
        read at the delay of the reference antenna, the mean of all phase centres of the pulse,
        and multiplied by ``exp(+j w_c tau_spat)``, the conjugate of equation 19.

    Attributes
    ----------
    predicted_error_db : float
        See `predicted_error_db`; approximations of the delay are not part of it.

    Raises
    ------
    ValueError
        An option is unknown or out of range, points are malformed, or the profiles are sampled
        below their bandwidth.

    Examples
    --------
    >>> plan = ZeroPaddedBackprojector(grid, radar, n_samples, ratio=100)    # doctest: +SKIP
    >>> image = plan(profiles)                                               # doctest: +SKIP
    """

    def __init__(self, grid_or_points: Grid | np.ndarray, radar: RadarParameters,
                 n_samples: int, *, interpolator: str = 'nearest', ratio: int = 100,
                 delay: str = 'exact'):
        if delay not in DELAYS:
            raise ValueError(f'delay={delay!r} is unknown; use one of {", ".join(DELAYS)}')
        self.predicted_error_db = predicted_error_db(interpolator, ratio, radar)
        points = (grid_or_points.points() if isinstance(grid_or_points, Grid)
                  else np.asarray(grid_or_points, np.float64))
        if points.shape[-1:] != (3,) or not np.isfinite(points).all():
            raise ValueError(f'points.shape={points.shape}; expected (..., 3) finite numbers')
        self.shape = points.shape[:-1]
        self._points = np.ascontiguousarray(points.reshape(-1, 3))
        self.radar, self.n_samples = radar, int(n_samples)
        self.interpolator, self.ratio, self.delay = interpolator, int(ratio), delay
        self._rate_hz = self.ratio * radar.sample_rate_hz
        self._table = _weight_table(interpolator, ratio, radar)
        self._carrier = self._carrier_at_samples()

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of one block.

        Ranges outside a profile contribute nothing.

        Parameters
        ----------
        block : PulseBlock
            Range profiles with phase centres.

        Returns
        -------
        complex64 array
            ``f(x) = sum_m sum_n s_mn(tau) exp(+j w_c tau)`` (equation 17) at the points, in
            their shape; ``(n_y, n_x)`` for a grid, row 0 at the largest y.

        Raises
        ------
        ValueError
            The block is not compressed, has no positions, does not match the plan, or none of
            its profiles reaches a point.
        """
        check_profiles(block, self.radar, self.n_samples)
        legs = self._legs(block)
        profiles = block.samples.reshape(-1, self.n_samples)
        rows = max(1, _CHUNK_BYTES // (8 * self.n_samples * self.ratio))
        out = np.zeros(len(self._points), np.complex128)
        n_groups = -(-len(self._points) // _POINTS_PER_GROUP)
        reads = np.zeros(n_groups, np.int64)
        for lo in range(0, len(profiles), rows):
            part = slice(lo, lo + rows)
            self._add(self.zero_padded(profiles[part]), [leg[part] for leg in legs], out, reads)
        if block.n_pulses and len(out) and not reads.any():
            start = self.radar.range_start_m
            stop = start + self.n_samples * self.radar.sample_spacing_m
            raise ValueError(f'no point lies within the profiles, which cover {start:.1f} to '
                             f'{stop:.1f} m; move the points or the range window')
        return out.astype(np.complex64).reshape(self.shape)

    def zero_padded(self, profiles: np.ndarray) -> np.ndarray:
        """Profiles at `ratio` times their rate, with 'nearest' modulated to the carrier.

        Parameters
        ----------
        profiles : (R, L) complex64
            Baseband range profiles.

        Returns
        -------
        (R, ratio L) complex64
            Equation 14, and equation 15 with the interpolator 'nearest'.
        """
        workers = numba.get_num_threads()
        spectrum = scipy.fft.fft(np.asarray(profiles, np.complex64), axis=-1, workers=workers)
        samples = resampled_from_spectrum(spectrum, self.ratio * self.n_samples, workers=workers)
        if self.interpolator == 'nearest':
            samples *= self._carrier
        return samples

    def _carrier_at_samples(self) -> np.ndarray:
        """(ratio L,) complex64 ``exp(j w_c t)`` at the upsampled times, equation 15."""
        time_s = (self.radar.first_sample_delay_s
                  + np.arange(self.ratio * self.n_samples) / self._rate_hz)
        cycles = np.fmod(self.radar.carrier_hz * time_s, 1.0)
        return np.exp(2j * np.pi * cycles).astype(np.complex64)

    def _legs(self, block: PulseBlock) -> list[np.ndarray]:
        """Ends of the path that is read, then of the path whose phase is applied, (R, 3) each."""
        tx, rx = block.tx_m, block.rx_m
        if self.delay == 'midpoint':
            tx = rx = 0.5 * (tx + rx)
        read = (tx, rx)
        if self.delay == 'steering':
            centre = np.broadcast_to(block.phase_centre_m[:, None], tx.shape)
            read = (centre, centre)
        return [np.ascontiguousarray(a.reshape(-1, 3)) for a in (*read, tx, rx)]

    def _add(self, profiles, legs, out, reads) -> None:
        start = self.radar.first_sample_delay_s * self._rate_hz
        speed = self.radar.propagation_speed_m_per_s
        per_metre = (self._rate_hz / speed, self.radar.carrier_hz / speed)
        if self.interpolator == 'nearest':
            _add_nearest(profiles, *legs, self._points, start, *per_metre,
                         self.delay == 'steering', out, reads)
            return
        half = self._table.shape[1] // 2
        # One period of the profile, continued where the taps reach beyond its ends.
        profiles = np.concatenate([profiles[:, profiles.shape[1] - half + 1:], profiles,
                                   profiles[:, :half]], axis=1)
        _add_interpolated(profiles, self._table, *legs, self._points, start, *per_metre,
                          self.delay == 'steering', out, reads)


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
        See `ZeroPaddedBackprojector`.
    ratio : int
        Zero-padding ratio ``Z_rat``.
    radar : RadarParameters
        Of the profiles.

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
    nodes, weight = np.polynomial.legendre.leggauss(64)
    weight = weight / 2
    baseband = nodes * _band_edge(ratio, radar)  # cycles per sample
    if interpolator == 'nearest':
        absolute = radar.carrier_hz / (ratio * radar.sample_rate_hz) + baseband
        error = float(2 - 2 * weight @ np.sinc(absolute))
    else:
        position = (nodes + 1) / 2
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


def _weight_table(interpolator: str, ratio: int, radar: RadarParameters) -> np.ndarray | None:
    """(_PHASES + 1, T) float64 weights at equally spaced positions; None for 'nearest'."""
    if interpolator == 'nearest':
        return None
    return _weights(interpolator, np.linspace(0, 1, _PHASES + 1), ratio, radar)


@njit(inline='always')
def _path(point, a, b):
    """Metres from `a` over the point to `b`."""
    ax, ay, az = point[0] - a[0], point[1] - a[1], point[2] - a[2]
    bx, by, bz = point[0] - b[0], point[1] - b[1], point[2] - b[2]
    return np.sqrt(ax * ax + ay * ay + az * az) + np.sqrt(bx * bx + by * by + bz * bz)


@njit(inline='always')
def _phasor(cycles):
    """``exp(j 2 pi cycles)``."""
    angle = 2 * np.pi * (cycles - np.floor(cycles))
    return complex(np.cos(angle), np.sin(angle))


@njit(parallel=True)
def _add_nearest(profiles, read_a, read_b, tx, rx, points, start, samples_per_metre,
                 cycles_per_metre, steer, out, reads):
    """Add the sample nearest to each point's delay (equation 16), steered by equation 19."""
    n_rows, n = profiles.shape
    for group in numba.prange(len(reads)):
        first = group * _POINTS_PER_GROUP
        last = min(first + _POINTS_PER_GROUP, len(points))
        for row in range(n_rows):
            for i in range(first, last):
                path = _path(points[i], read_a[row], read_b[row])
                k = int(np.floor(path * samples_per_metre - start + 0.5))
                if not 0 <= k < n:
                    continue
                reads[group] += 1
                value = complex(profiles[row, k])
                if steer:
                    spatial = _path(points[i], tx[row], rx[row]) - path
                    value *= _phasor(cycles_per_metre * spatial)
                out[i] += value


@njit(parallel=True)
def _add_interpolated(profiles, table, read_a, read_b, tx, rx, points, start, samples_per_metre,
                      cycles_per_metre, steer, out, reads):
    """Add the interpolated baseband profile at each point's delay times the carrier phase.

    Profiles start ``T/2 - 1`` samples before the first and end ``T/2`` after the last.
    """
    n_taps = table.shape[1]
    n_rows, n = profiles.shape[0], profiles.shape[1] - n_taps + 1
    for group in numba.prange(len(reads)):
        first = group * _POINTS_PER_GROUP
        last = min(first + _POINTS_PER_GROUP, len(points))
        for row in range(n_rows):
            for i in range(first, last):
                path = _path(points[i], read_a[row], read_b[row])
                position = path * samples_per_metre - start
                k = int(np.floor(position))
                if not 0 <= k < n:
                    continue
                reads[group] += 1
                phase = (position - k) * _PHASES
                p = min(int(phase), _PHASES - 1)
                between = phase - p
                value = 0j
                for tap in range(n_taps):
                    weight = table[p, tap] + between * (table[p + 1, tap] - table[p, tap])
                    value += weight * profiles[row, k + tap]
                if steer:
                    path = _path(points[i], tx[row], rx[row])
                out[i] += value * _phasor(cycles_per_metre * path)
