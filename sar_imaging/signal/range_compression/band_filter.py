"""Compress LFM pulses, profiles and passband samples by a filter between two FFTs.

The bins of the waveform's band are taken from the transform of the samples, multiplied by a gain
and transformed back at the output's length: compression, window and resampling in one step.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import fft

from ...device_arrays import beside, contiguous, zeros_beside
from ..radar import RadarParameters
from ..waveforms import check_lfm, lfm_spectrum, n_pulse_samples
from ..windows import window as window_weights
from .phase_history import fast_length
from .transforms import forward, inverse


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
        Of the profiles.
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
