"""Zero-padded profiles read at pixels, Rosenberg & Gray, equations 13 to 19."""

from __future__ import annotations

import numpy as np
import scipy.fft

from ..backends.cpu.correlation import distance, phasor
from ..compilation import njit, numba
from ..signal.pulses import PulseBlock
from ..signal.spectra import resampled_from_spectrum
from .zero_padding_plan import ZeroPaddingPlan

_PHASES = 2048  # of the weight table, interpolated linearly: below -120 dB
_POINTS_PER_GROUP = 512  # neighbours, which read neighbouring samples


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


def _padded(plan, profiles) -> np.ndarray:
    """(R, ratio L) complex64 profiles at `ratio` times their rate, equation 14."""
    workers = numba.get_num_threads()
    spectrum = scipy.fft.fft(np.asarray(profiles, np.complex64), axis=-1, workers=workers)
    return resampled_from_spectrum(spectrum, plan.ratio * plan.n_samples, workers=workers)


def _carrier_at_samples(plan) -> np.ndarray:
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
