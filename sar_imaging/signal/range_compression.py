# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range compression: turn raw pulses into range profiles that follow the signal model.

Output, whatever the waveform: ``s(tau) = sum_p a_p p(tau - tau_p) exp(-j 2 pi f_c tau_p)``
(Rosenberg & Gray, section 2) with the peak of a scatterer of unit amplitude equal to one, at the
sample spacing that the imager asks for. The work is planned once; a call is two FFTs, of a phase
history one.

LFM pulses, profiles and passband samples are compressed by a filter between two FFTs. The bins of
the waveform's band are taken from the transform of the samples, multiplied by a gain and
transformed back at the output's length: compression, window and resampling in one step.

Phase histories of stepped frequency and FMCW hold one sample per frequency f_n,
``exp(-j 2 pi f_n u)`` for an echo at the delay u beyond the reference; FMCW has the residual video
phase ``+ pi K u^2`` besides. An inverse transform makes the range profile, whose every delay is
then multiplied by ``exp(-j pi K u^2)``. That is the correlation of the beat signal with its own
model at each delay, so nothing is approximated: around its peak the response is the window's times
``exp(-j 2 pi K tau (t - tau))``, because what was recorded of an echo is the band that lies K tau
below that of the reference.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from scipy import fft

from ..compilation import MISSING, njit, numba
from ..device_arrays import beside, contiguous, on_device, zeros_beside
from .calibration import ChannelCalibration
from .dechirp import check_fmcw
from .pulses import PulseBlock
from .pulses.block import check_samples
from .radar import RadarParameters, Waveform
from .waveforms import check_lfm, lfm_spectrum, n_pulse_samples
from .windows import window as window_weights


def forward(samples: np.ndarray, n: int) -> np.ndarray:
    """(..., n) complex64 transform of samples (..., N), with zeros behind them."""
    if on_device(samples):
        return np.fft.fft(samples, n).astype(np.complex64, copy=False)
    return fft.fft(samples, n, workers=numba.get_num_threads())


def inverse(spectra: np.ndarray, n: int) -> np.ndarray:
    """(..., n) complex64 inverse transform, divided by n, of spectra, which may be overwritten."""
    if on_device(spectra):
        return np.fft.ifft(spectra, n).astype(np.complex64, copy=False)
    return fft.ifft(spectra, n, overwrite_x=True, workers=numba.get_num_threads())


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
        Radar parameters of the profiles. The bandwidth of FMCW grows by twice the largest beat
        frequency, by which bands of echoes are displaced.
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

    def _phase_ramp(self, radar: RadarParameters, n: int) -> np.ndarray:
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
        if MISSING or on_device(samples):
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


@njit(parallel=True)  # type: ignore[untyped-decorator]
def _wrap_and_turn(profiles: np.ndarray, first: int, ramp: np.ndarray, out: np.ndarray) -> None:
    """Samples from `first` on of periodic profiles, times the ramp."""
    period = profiles.shape[1]
    for row in numba.prange(out.shape[0]):
        source = first % period
        for i in range(out.shape[1]):
            out[row, i] = profiles[row, source] * ramp[i]
            source += 1
            if source == period:
                source = 0


class BandFilter:
    """Planned filter over the band of one radar; see `sar_imaging.signal.range_compression`.

    Made by `for_lfm`, `for_profiles` and `for_passband`.

    Attributes
    ----------
    baseband_hz : (K,) float64
        Frequencies of `gain` from the carrier, hertz, ascending.
    gain : (K,) complex64
        Factor of each frequency.
    output_radar : RadarParameters
        Radar parameters of the profiles.
    n_output : int
        Samples of each profile.
    snr_loss_db : float
        Loss of signal to noise against the matched filter without window, dB.
    changes_nothing : bool
        Samples that come are the profiles wanted already.
    """

    def __init__(self, radar: RadarParameters, n_in: int, n_out: int, centre_hz: float = 0.0):
        step_hz = radar.sample_rate_hz / n_in
        half_band = radar.bandwidth_hz / 2 / step_hz * (1 + 1e-12)
        self._radar, self._n_in, self._n_out = radar, n_in, n_out
        self._centre_bin = round(centre_hz / step_hz)
        beside = self._centre_bin - centre_hz / step_hz  # bins
        self._n_positive = min(math.floor(half_band - beside), (n_in - 1) // 2)
        self._n_negative = min(math.floor(half_band + beside), n_in // 2)
        bins = np.arange(-self._n_negative, self._n_positive + 1)
        self.baseband_hz = (bins + self._centre_bin) * step_hz - centre_hz
        self._ramp: np.ndarray | None = None
        self.changes_nothing = False
        self._set_output(n_out)

    @classmethod
    def for_lfm(cls, radar: RadarParameters, n_samples: int, window: str, oversampling: float,
                range_filter: str) -> BandFilter:
        """Filter for raw LFM pulses; raises ValueError as `RangeCompressor` says."""
        check_lfm(radar)
        n_pulse = n_pulse_samples(radar)
        if n_samples < n_pulse:
            raise ValueError(f'n_samples={n_samples} is less than one pulse '
                             f'({n_pulse} samples at pulse_length_s={radar.pulse_length_s}); '
                             'record at least the pulse length plus the swath')
        rate = radar.sample_rate_hz
        n_in = fft.next_fast_len(n_samples + n_pulse)
        plan = cls(radar, n_in, fast_length(n_in * (oversampling * radar.bandwidth_hz) / rate))
        # In units of samples, as the transform of the recorded pulse has it.
        spectrum = lfm_spectrum(plan.baseband_hz, radar) * rate
        weights = window_weights(window, spectrum.size)
        response = weights if range_filter == 'equalised' else weights * np.abs(spectrum) ** 2
        plan._set_filter(response, 1.0 / spectrum, signal_energy=radar.pulse_length_s * rate)
        kept_s = (n_samples - n_pulse) / rate
        plan._set_output(
            math.floor(kept_s * plan.output_radar.sample_rate_hz * (1 + 1e-12)) + 1)
        return plan

    @classmethod
    def for_profiles(cls, radar: RadarParameters, n_samples: int, window: str,
                     oversampling: float) -> BandFilter:
        """Filter for range profiles: weights and resamples; a period each."""
        wanted = n_samples * (oversampling * radar.bandwidth_hz) / radar.sample_rate_hz
        keep_rate = wanted <= n_samples * (1 + 1e-9)
        plan = cls(radar, n_samples, n_samples if keep_rate else fast_length(wanted))
        plan._set_flat(window)
        plan.changes_nothing = plan._n_out == n_samples and window == 'none'
        return plan

    @classmethod
    def for_passband(cls, radar: RadarParameters, n_samples: int, window: str,
                     oversampling: float) -> BandFilter:
        """Filter for real samples at the carrier: analytic signal at baseband; a period each.

        Raises
        ------
        ValueError
            The sample rate is below twice the band's upper edge, or the band reaches below zero.
        """
        upper_hz = radar.carrier_hz + radar.bandwidth_hz / 2
        if 2 * upper_hz > radar.sample_rate_hz or 2 * radar.carrier_hz < radar.bandwidth_hz:
            raise ValueError(
                f'passband samples at sample_rate_hz={radar.sample_rate_hz:.6g} hold frequencies '
                f'up to half of it; the band is bandwidth_hz={radar.bandwidth_hz:.6g} around '
                f'carrier_hz={radar.carrier_hz:.6g}')
        wanted = n_samples * (oversampling * radar.bandwidth_hz) / radar.sample_rate_hz
        plan = cls(radar, n_samples, fast_length(wanted), radar.carrier_hz)
        plan._set_flat(window, scale=2.0)
        # Bins fall beside the carrier by less than half a bin; and the signal model's phase is
        # counted from zero delay, that of the transform from the first sample.
        output = plan.output_radar
        offset_hz = plan._centre_bin * radar.sample_rate_hz / n_samples - radar.carrier_hz
        cycles = (offset_hz * np.arange(plan.n_output) / output.sample_rate_hz
                  - radar.carrier_hz * radar.first_sample_delay_s % 1.0)
        plan._ramp = np.exp(2j * np.pi * (cycles % 1.0)).astype(np.complex64)
        return plan

    def _set_flat(self, window: str, scale: float = 1.0) -> None:
        """Filter for profiles, whose spectra fill the band evenly."""
        n_band = self.baseband_hz.size
        self._set_filter(window_weights(window, n_band),
                         np.full(n_band, scale * n_band / self._n_in),
                         signal_energy=self._n_in / n_band / scale**2)

    def _set_filter(self, response: np.ndarray, inverse: np.ndarray, *,
                    signal_energy: float) -> None:
        """Filter that turns a unit scatterer's bins ``1 / inverse`` into `response`, peak one."""
        gain = response * inverse
        # scipy's inverse FFT divides by its length; the peak is the sum of the response's bins.
        self.gain = (gain * (self._n_out / response.sum())).astype(np.complex64)
        snr = response.sum() ** 2 / (self._n_in * np.sum(np.abs(gain) ** 2))
        # No loss at all may round to a negative number.
        self.snr_loss_db = max(0.0, 10.0 * math.log10(signal_energy / snr))

    def _set_output(self, n_output: int) -> None:
        rate_hz = self._radar.sample_rate_hz * (self._n_out / self._n_in)
        self.output_radar = dataclasses.replace(self._radar, sample_rate_hz=rate_hz)
        self.n_output = n_output

    def __call__(self, samples: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Range profiles.

        Parameters
        ----------
        samples : (P, C, N) complex64
            As planned for; profiles of those on a device lie there.
        gain : (K,) or (C, K) complex64
            Factor of each frequency and channel.

        Returns
        -------
        (P, C, n_output) complex64
        """
        spectra, gain = forward(samples, self._n_in), beside(gain, samples)
        out = zeros_beside((*samples.shape[:2], self._n_out), samples)
        centre, negative = self._centre_bin, self._n_negative
        above = slice(centre, centre + self._n_positive + 1)
        np.multiply(spectra[..., above], gain[..., negative:],
                    out=out[..., :self._n_positive + 1])
        if negative:
            # bins below zero are the last ones of the transform
            below = slice((centre - negative) or None, centre or None)
            np.multiply(spectra[..., below], gain[..., :negative], out=out[..., -negative:])
        profiles = contiguous(inverse(out, self._n_out)[..., :self.n_output])
        if self._ramp is not None:
            profiles *= beside(self._ramp, profiles)
        return profiles


RANGE_FILTERS = ('equalised', 'matched')


class RangeCompressor:
    """Turn raw pulses of one radar into range profiles; planned once.

    What is kept of the delay axis:

    - LFM: the profile starts at the delay of the first raw sample and ends where a pulse's last
      sample is the last raw one. Scatterers outside did not return a whole pulse.
    - stepped frequency: the whole unambiguous interval ``N / B``, half of it on each side of the
      reference delay `first_sample_delay_s`, and 16 samples more at each end (the profile is
      periodic; interpolators need neighbours).
    - FMCW: the same, but not before zero delay, where the interval then starts. A real converter
      tells half of the interval, beyond the reference delay.
    - passband samples and already compressed profiles: what came, resampled as one period of a
      periodic signal.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the blocks to come.
    n_samples : int
        Fast-time samples N of the blocks to come.
    window : str
        Spectral weighting over the band, see `sar_imaging.signal.windows`.
    oversampling : float
        Output samples per ``1 / bandwidth``, at least 1. The output rate is the next one above
        ``oversampling * bandwidth_hz`` whose FFT is fast; `output_radar` tells it exactly.
        Profiles that come faster keep their rate.
    range_filter : {'equalised', 'matched'}
        For LFM. 'equalised' divides by the pulse's spectrum inside the band ``|f| <= B/2``, so
        that the response is the window's alone; 'matched' multiplies by its conjugate, which
        loses the least signal to noise but adds the Fresnel ripple of the pulse's spectrum to
        the window. `snr_loss_db` states the price.
    compressed : bool
        True when the blocks to come are range profiles already.
    range_window_m : (2,) floats, optional
        Nearest and farthest half-path distance to keep, metres, the latter possibly infinite;
        16 samples more at each end where there are any. By default everything above.
    calibration : ChannelCalibration, optional
        Errors of the channels' amplitude, phase and delay to remove.

    Raises
    ------
    ValueError
        A parameter is out of range, the waveform's parameters contradict each other, fewer
        raw samples come than one pulse is long, or the range window holds no sample.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import RangeCompressor
    >>> from sar_imaging.simulation import SCENARIOS
    >>> raw = next(SCENARIOS['psf_raw']().blocks())  # chirps of 1 microsecond
    >>> compress = RangeCompressor.for_block(raw, window='hamming')
    >>> profiles = compress(raw)
    >>> raw.samples.shape, profiles.samples.shape
    ((25, 5, 526), (25, 5, 193))
    >>> peak = np.abs(profiles.samples[0, 0]).argmax()
    >>> radar = profiles.radar
    >>> print(f'echo at {radar.range_start_m + peak * radar.sample_spacing_m:.1f} m, '
    ...       f'{compress.snr_loss_db:.1f} dB of signal to noise lost')
    echo at 10000.0 m, 1.4 dB of signal to noise lost
    """

    def __init__(self, radar: RadarParameters, n_samples: int, *, window: str = 'none',
                 oversampling: float = 2.0, range_filter: str = 'equalised',
                 compressed: bool = False, range_window_m: tuple[float, float] | None = None,
                 calibration: ChannelCalibration | None = None):
        if not (math.isfinite(oversampling) and oversampling >= 1.0):
            raise ValueError(f'oversampling={oversampling}; at least 1.0 output sample per '
                             '1 / bandwidth is needed')
        if range_filter not in RANGE_FILTERS:
            raise ValueError(f'range_filter={range_filter!r}; use one of '
                             f'{", ".join(RANGE_FILTERS)}')
        if n_samples < 2:
            raise ValueError(f'n_samples={n_samples}; a pulse needs at least two samples')
        if range_window_m is not None and not range_window_m[0] < range_window_m[1]:
            raise ValueError(f'range_window_m={range_window_m}; expected the nearest and a '
                             'larger farthest distance')
        self.radar = radar
        self.n_samples = n_samples
        self.compressed = compressed
        plan: BandFilter | PhaseHistoryPlan
        if compressed:
            plan = BandFilter.for_profiles(radar, n_samples, window, oversampling)
        elif radar.waveform.is_phase_history:
            plan = PhaseHistoryPlan(radar, n_samples, window, oversampling, range_window_m)
        elif radar.waveform == Waveform.PASSBAND:
            plan = BandFilter.for_passband(radar, n_samples, window, oversampling)
        else:
            plan = BandFilter.for_lfm(radar, n_samples, window, oversampling, range_filter)
        self._plan = plan
        self._output_radar = plan.output_radar
        self._kept = slice(0, plan.n_output)
        if range_window_m is not None and isinstance(plan, BandFilter):
            self._cut(range_window_m)
        self._pass_through = (isinstance(plan, BandFilter) and plan.changes_nothing
                              and calibration is None)
        self._set_calibration(calibration)

    def _set_calibration(self, calibration: ChannelCalibration | None) -> None:
        plan = self._plan
        self._calibration, self._gain, self._turn = calibration, plan.gain, None
        if calibration is None:
            return
        self._gain = (plan.gain * calibration.correction(plan.baseband_hz)).astype(np.complex64)
        if isinstance(plan, PhaseHistoryPlan) and calibration.delay_s.any():
            self._turn = plan.late_video_phase(calibration.delay_s)

    def _cut(self, range_window_m: tuple[float, float]) -> None:
        """Keep the range window of the filter's profiles."""
        radar, n = self._plan.output_radar, self._plan.n_output
        first, last = ((r - radar.range_start_m) / radar.sample_spacing_m
                       for r in range_window_m)
        start = max(0, math.floor(first) - GUARD_SAMPLES)
        stop = min(n, math.ceil(min(last, n)) + 1 + GUARD_SAMPLES)
        if first > n - 1 or last < 0:
            raise ValueError(f'range_window_m={range_window_m} lies outside the profiles, '
                             f'{radar.range_start_m:.2f} to '
                             f'{radar.range_start_m + (n - 1) * radar.sample_spacing_m:.2f} m')
        self._kept = slice(start, stop)
        self._output_radar = dataclasses.replace(
            radar, first_sample_delay_s=2 / radar.propagation_speed_m_per_s
            * (radar.range_start_m + start * radar.sample_spacing_m))

    @classmethod
    def for_block(cls, block: PulseBlock, **options: Any) -> RangeCompressor:
        """Plan for blocks like `block`, raw or compressed; options as of the constructor."""
        return cls(block.radar, block.n_samples, compressed=block.compressed, **options)

    @property
    def output_radar(self) -> RadarParameters:
        """Parameters of the profiles: output sample rate and delay of the first sample."""
        return self._output_radar

    @property
    def n_output(self) -> int:
        """Samples of each output profile."""
        return self._kept.stop - self._kept.start

    @property
    def snr_loss_db(self) -> float:
        """Loss of peak signal to noise ratio against the matched filter without window, dB."""
        return self._plan.snr_loss_db

    def __call__(self, block: PulseBlock) -> PulseBlock:
        """Compress a block.

        Parameters
        ----------
        block : PulseBlock
            Samples ``(P, C, n_samples)`` of the planned radar.

        Returns
        -------
        PulseBlock
            Compressed, samples ``(P, C, n_output)`` complex64, positions and times unchanged; on
            the device where those of the block lie there. Profiles that need neither window nor
            another rate come back as they are, uncopied.

        Raises
        ------
        ValueError
            The block is of another radar, length or kind than planned for, has another number
            of channels than the calibration, or holds samples that are not finite.
        """
        self.check(block)
        check_samples(block.samples, block.counter)
        if self._pass_through and self.n_output == block.n_samples:
            return block
        return self.compressed_block(block, self.profiles(block.samples))

    def check(self, block: PulseBlock) -> None:
        """Check that a block is what was planned for, but for its samples.

        Raises
        ------
        ValueError
            As a call.
        """
        got = (block.radar, block.n_samples, block.compressed)
        if got != (self.radar, self.n_samples, self.compressed):
            raise ValueError(
                f'block with {block.n_samples} samples, compressed={block.compressed}, '
                f'{block.radar} does not match the plan for {self.n_samples} samples, '
                f'compressed={self.compressed}, {self.radar}; plan anew with '
                'RangeCompressor.for_block')
        if self._calibration is not None:
            self._calibration.check_channels(block.n_channels)

    def profiles(self, samples: np.ndarray) -> np.ndarray:
        """Range profiles of samples, unchecked.

        Parameters
        ----------
        samples : (P, C, n_samples) complex64
            Samples of the planned radar.

        Returns
        -------
        (P, C, n_output) complex64
            On the device where the samples lie there.
        """
        if not self._pass_through:
            samples = self._plan(samples, self._gain)
            if self._turn is not None:
                samples *= beside(self._turn, samples)
        return contiguous(samples[..., self._kept])

    def compressed_block(self, block: PulseBlock, profiles: np.ndarray) -> PulseBlock:
        """A block with its range profiles in place of its samples."""
        return dataclasses.replace(block, radar=self._output_radar, compressed=True,
                                   samples=profiles)
