"""Compress phase histories: stepped frequency, and FMCW with its residual video phase removed.

Both hold one sample per frequency f_n, ``exp(-j 2 pi f_n u)`` for an echo at the delay u beyond
the reference; FMCW has the residual video phase ``+ pi K u^2`` besides. An inverse transform makes
the range profile, whose every delay is then multiplied by ``exp(-j pi K u^2)``. That is the
correlation of the beat signal with its own model at each delay, so nothing is approximated:
around its peak the response is the window's times ``exp(-j 2 pi K tau (t - tau))``, because what
was recorded of an echo is the band that lies K tau below that of the reference.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import fft

from ...compilation import njit, numba
from ...device_arrays import beside, on_device
from ..dechirp import check_fmcw
from ..radar import RadarParameters, Waveform
from ..windows import window as window_weights
from .transforms import inverse

_ROWS_PER_CALL = 256  # bounds the work space
GUARD_SAMPLES = 16  # repeated at both ends of a periodic profile
_LONGEST = 2**24  # samples of a profile: more follow only from broken radar parameters


def fast_length(wanted: float) -> int:
    """Next length whose FFT is fast, at least `wanted` but for rounding.

    Raises
    ------
    ValueError
        It is longer than any profile can reasonably be.
    """
    if not wanted <= _LONGEST:
        raise ValueError(f'profiles would have {wanted:.3g} samples; expected at most {_LONGEST}; '
                         'correct bandwidth_hz, sample_rate_hz and chirp_rate_hz_per_s, or lower '
                         'the oversampling')
    return fft.next_fast_len(math.ceil(wanted * (1 - 1e-12)))


class PhaseHistoryPlan:
    """Planned compression of phase histories; see `sar_imaging.signal.range_compression`.

    Parameters
    ----------
    radar : RadarParameters
        Stepped frequency or FMCW.
    n_samples : int
        Frequencies N of a pulse.
    window : str
        Spectral weighting.
    oversampling : float
        Output samples per ``1 / bandwidth``.
    range_window_m : (2,) floats, optional
        Nearest and farthest half-path distance to keep, metres.

    Attributes
    ----------
    baseband_hz : (N,) float64
        Frequencies of `gain` from the carrier, hertz, ascending.
    gain : (N,) complex64
        Factor of each frequency.
    output_radar : RadarParameters
        Of the profiles. The bandwidth of FMCW grows by twice the largest beat frequency, by
        which bands of echoes are displaced.
    n_output : int
        Samples of each profile.
    snr_loss_db : float
        Loss of signal to noise through the window, dB.

    Raises
    ------
    ValueError
        The parameters contradict each other, or the range window lies outside what the samples
        can tell.
    """

    def __init__(self, radar: RadarParameters, n_samples: int, window: str, oversampling: float,
                 range_window_m: tuple[float, float] | None = None):
        fmcw = radar.waveform != Waveform.STEPPED_FREQUENCY
        if fmcw:
            check_fmcw(radar, n_samples)
        slope = radar.chirp_rate_hz_per_s if fmcw else 0.0
        step_hz = abs(slope) / radar.sample_rate_hz if fmcw else radar.bandwidth_hz / n_samples
        self._falling = slope < 0
        low_s, high_s = _kept_delays(radar, step_hz, range_window_m)
        reach_s = max(abs(low_s), abs(high_s)) + GUARD_SAMPLES / (oversampling
                                                                  * radar.bandwidth_hz)
        bandwidth_hz = n_samples * step_hz + 2 * abs(slope) * reach_s
        self._period = fast_length(oversampling * bandwidth_hz / step_hz)
        rate_hz = step_hz * self._period
        self._first, self.n_output = self._extent(low_s, high_s, rate_hz,
                                                  whole=range_window_m is None)
        self._slope, self._rate_hz = slope, rate_hz
        self._ramp = self._phase_ramp(radar, n_samples)
        weights = window_weights(window, n_samples)
        scale = 2.0 if radar.waveform == Waveform.FMCW_REAL else 1.0
        self.gain = (weights * (scale * self._period / weights.sum())).astype(np.float32)
        self.baseband_hz = (np.arange(n_samples) - (n_samples - 1) / 2) * step_hz
        self.snr_loss_db = max(0.0, 10.0 * math.log10(
            n_samples * np.sum(weights**2) / weights.sum() ** 2))
        self.output_radar = dataclasses.replace(
            radar, bandwidth_hz=bandwidth_hz if fmcw else radar.bandwidth_hz,
            sample_rate_hz=rate_hz,
            first_sample_delay_s=radar.first_sample_delay_s + self._first / rate_hz)

    def _extent(self, low_s: float, high_s: float, rate_hz: float, *,
                whole: bool) -> tuple[int, int]:
        """Number of the first sample, counted from the reference delay, and how many."""
        if whole and low_s == -high_s:
            return -(self._period // 2) - GUARD_SAMPLES, self._period + 2 * GUARD_SAMPLES
        first = math.floor(low_s * rate_hz * (1 + 1e-12))
        last = math.ceil(high_s * rate_hz * (1 - 1e-12))
        return first - GUARD_SAMPLES, last - first + 1 + 2 * GUARD_SAMPLES

    def _phase_ramp(self, radar: RadarParameters, n: int):
        """(n_output,) complex64 factor of each sample of the profile."""
        index = self._first + np.arange(self.n_output)
        # Sample 0 is (N - 1) / 2 steps below the carrier, and the samples' phase is referenced
        # to the reference delay, where the signal model has exp(-j 2 pi f_c tau).
        carrier_cycles = radar.carrier_hz * radar.first_sample_delay_s % 1.0
        video_cycles = 0.5 * self._slope * (index / self._rate_hz) ** 2
        cycles = index * ((n - 1) / 2) / self._period + carrier_cycles + video_cycles
        return np.exp(-2j * np.pi * (cycles % 1.0)).astype(np.complex64)

    def late_video_phase(self, delay_s: np.ndarray) -> np.ndarray:
        """Residual video phase that channels with delays have besides that of perfect ones.

        Parameters
        ----------
        delay_s : (C,) float64
            Delays of the channels that `gain` takes back, seconds.

        Returns
        -------
        (C, n_output) complex64
            Factor that removes it from the profiles, 1 for stepped frequency.
        """
        u = (self._first + np.arange(self.n_output)) / self._rate_hz
        delay_s = np.asarray(delay_s, float)[:, None]
        cycles = self._slope * delay_s * (u + 0.5 * delay_s)
        return np.exp(-2j * np.pi * (cycles % 1.0)).astype(np.complex64)

    def __call__(self, samples: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Range profiles.

        Parameters
        ----------
        samples : (P, C, N) complex64
            Phase histories; profiles of those on a device lie there.
        gain : (N,) or (C, N) complex64
            Factor of each frequency, ascending, and channel.

        Returns
        -------
        (P, C, n_output) complex64
        """
        if self._falling:
            samples = samples[..., ::-1]
        pulses, channels, _ = samples.shape
        if on_device(samples):
            profiles = inverse(samples * beside(gain, samples), self._period)
            source = (self._first + np.arange(self.n_output)) % self._period
            return profiles[..., beside(source, samples)] * beside(self._ramp, samples)
        out = np.empty((pulses, channels, self.n_output), np.complex64)
        step = max(1, _ROWS_PER_CALL // max(channels, 1))
        for start in range(0, pulses, step):
            part = slice(start, start + step)
            profiles = inverse(samples[part] * gain, self._period)
            _wrap_and_turn(profiles.reshape(-1, self._period), self._first, self._ramp,
                           out[part].reshape(-1, self.n_output))
        return out


def _kept_delays(radar: RadarParameters, step_hz: float,
                 range_window_m: tuple[float, float] | None) -> tuple[float, float]:
    """Delays beyond the reference that profiles cover, seconds."""
    period_s = 1.0 / step_hz
    reference_s, speed = radar.first_sample_delay_s, radar.propagation_speed_m_per_s
    low_s, high_s = -period_s / 2, period_s / 2
    if radar.waveform == Waveform.FMCW_REAL:
        low_s = 0.0  # echoes at -u look as those at u do
    elif radar.waveform == Waveform.FMCW and reference_s < period_s / 2:
        low_s, high_s = -reference_s, period_s - reference_s  # no echo comes before its pulse
    if range_window_m is None:
        return low_s, high_s
    near_s, far_s = (2 * r / speed - reference_s for r in range_window_m)
    if near_s >= high_s or far_s <= low_s:
        limits = (speed / 2 * (d + reference_s) for d in (low_s, high_s))
        raise ValueError('range_window_m={} lies outside the {:.2f} to {:.2f} m that the samples '
                         'tell apart'.format(range_window_m, *limits))
    return max(low_s, near_s), min(high_s, far_s)


@njit(parallel=True)
def _wrap_and_turn(profiles, first, ramp, out):
    """Samples from `first` on of periodic profiles, times the ramp."""
    period = profiles.shape[1]
    for row in numba.prange(out.shape[0]):
        source = first % period
        for i in range(out.shape[1]):
            out[row, i] = profiles[row, source] * ramp[i]
            source += 1
            if source == period:
                source = 0
