"""Range compression: raw pulses to range profiles that obey the signal model.

Output, whatever the waveform: ``s(tau) = sum_p a_p p(tau - tau_p) exp(-j 2 pi f_c tau_p)``
(Rosenberg & Gray, section 2) with the peak of a scatterer of unit amplitude equal to one, at the
sample spacing that the imager asks for. The work is planned once; a call is two FFTs.

>>> compressor = RangeCompressor(block.radar, block.n_samples, window='hamming')  # doctest: +SKIP
>>> profiles = compressor(block)                                                  # doctest: +SKIP
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import fft

from ..compilation import njit, numba
from .pulses import PulseBlock
from .radar import RadarParameters, Waveform
from .waveforms import check_lfm, lfm_spectrum, n_pulse_samples
from .windows import window as window_weights

_ROWS_PER_CALL = 256  # bounds the work space
STEPPED_GUARD_SAMPLES = 16  # repeated at both ends of a periodic stepped-frequency profile
RANGE_FILTERS = ('equalised', 'matched')


class RangeCompressor:
    """Planned range compression of pulse blocks of one radar.

    What is kept of the delay axis:

    - LFM: the profile starts at the delay of the first raw sample and ends where a pulse's last
      sample is the last raw one. Scatterers outside did not return a whole pulse.
    - stepped frequency: the whole unambiguous interval ``N / B``, half of it on each side of the
      reference delay `first_sample_delay_s`, and 16 samples more at each end (the profile is
      periodic; interpolators need neighbours).
    - already compressed profiles: what came, resampled as one period of a periodic signal.

    Parameters
    ----------
    radar : RadarParameters
        Of the blocks to come.
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

    Raises
    ------
    ValueError
        A parameter is out of range, the waveform's parameters contradict each other, or fewer
        raw samples come than one pulse is long.
    """

    def __init__(self, radar: RadarParameters, n_samples: int, *, window: str = 'none',
                 oversampling: float = 2.0, range_filter: str = 'equalised',
                 compressed: bool = False):
        if not (math.isfinite(oversampling) and oversampling >= 1.0):
            raise ValueError(f'oversampling={oversampling}; at least 1.0 output sample per '
                             '1 / bandwidth is needed')
        if range_filter not in RANGE_FILTERS:
            raise ValueError(f'range_filter={range_filter!r}; use one of '
                             f'{", ".join(RANGE_FILTERS)}')
        if n_samples < 2:
            raise ValueError(f'n_samples={n_samples}; a pulse needs at least two samples')
        self.radar = radar
        self.n_samples = n_samples
        self.compressed = compressed
        self._target_rate_hz = oversampling * radar.bandwidth_hz
        if compressed:
            self._plan_profiles(window)
        elif radar.waveform == Waveform.STEPPED_FREQUENCY:
            self._plan_stepped_frequency(window)
        else:
            self._plan_lfm(window, range_filter)

    @classmethod
    def for_block(cls, block: PulseBlock, *, window: str = 'none', oversampling: float = 2.0,
                  range_filter: str = 'equalised') -> RangeCompressor:
        """Plan for blocks like `block`, raw or compressed."""
        return cls(block.radar, block.n_samples, window=window, oversampling=oversampling,
                   range_filter=range_filter, compressed=block.compressed)

    @property
    def output_radar(self) -> RadarParameters:
        """Parameters of the profiles: output sample rate and delay of the first sample."""
        return self._output_radar

    @property
    def n_output(self) -> int:
        """Samples of each output profile."""
        return self._n_output

    @property
    def snr_loss_db(self) -> float:
        """Loss of peak signal to noise ratio against the matched filter without window, dB."""
        return self._snr_loss_db

    def __call__(self, block: PulseBlock) -> PulseBlock:
        """Compress a block.

        Parameters
        ----------
        block : PulseBlock
            Samples ``(P, C, n_samples)`` of the planned radar.

        Returns
        -------
        PulseBlock
            Compressed, samples ``(P, C, n_output)`` complex64, positions and times unchanged.
            Profiles that need neither window nor another rate come back as they are, uncopied.

        Raises
        ------
        ValueError
            The block is of another radar, length or kind than planned for.
        """
        got = (block.radar, block.n_samples, block.compressed)
        if got != (self.radar, self.n_samples, self.compressed):
            raise ValueError(
                f'block with {block.n_samples} samples, compressed={block.compressed}, '
                f'{block.radar} does not match the plan for {self.n_samples} samples, '
                f'compressed={self.compressed}, {self.radar}; plan anew with '
                'RangeCompressor.for_block')
        if self._pass_through:
            return block
        transform = (self._stepped_frequency if self._waveform_is_stepped else self._filtered)
        return dataclasses.replace(block, radar=self._output_radar, compressed=True,
                                   samples=transform(block.samples))

    def _plan_lfm(self, window: str, range_filter: str) -> None:
        check_lfm(self.radar)
        n_pulse = n_pulse_samples(self.radar)
        if self.n_samples < n_pulse:
            raise ValueError(f'n_samples={self.n_samples} is less than one pulse '
                             f'({n_pulse} samples at pulse_length_s={self.radar.pulse_length_s}); '
                             'record at least the pulse length plus the swath')
        rate = self.radar.sample_rate_hz
        self._plan_grid(fft.next_fast_len(self.n_samples + n_pulse))
        # In units of samples, as the transform of the recorded pulse has it.
        spectrum = lfm_spectrum(self._band_bins() * (rate / self._n_in), self.radar) * rate
        power = np.abs(spectrum) ** 2
        weights = window_weights(window, spectrum.size)
        response = weights if range_filter == 'equalised' else weights * power
        self._set_filter(response, 1.0 / spectrum,
                         signal_energy=self.radar.pulse_length_s * rate)
        kept_s = (self.n_samples - n_pulse) / rate
        out_rate = rate * (self._n_out / self._n_in)
        self._set_output(out_rate, self.radar.first_sample_delay_s,
                         math.floor(kept_s * out_rate * (1 + 1e-12)) + 1)

    def _plan_profiles(self, window: str) -> None:
        rate = self.radar.sample_rate_hz
        self._plan_grid(self.n_samples)
        n_band = self._n_positive + self._n_negative + 1
        self._set_filter(window_weights(window, n_band), np.full(n_band, n_band / self._n_in),
                         signal_energy=self._n_in / n_band)
        self._set_output(rate * (self._n_out / self._n_in), self.radar.first_sample_delay_s,
                         self._n_out)
        self._pass_through = self._n_out == self._n_in and window == 'none'

    def _plan_grid(self, n_in: int) -> None:
        """FFT lengths and the bins of the band, counted from zero frequency to both sides."""
        rate = self.radar.sample_rate_hz
        half_band = math.floor(self.radar.bandwidth_hz / 2 / (rate / n_in) * (1 + 1e-12))
        self._n_in = n_in
        self._n_positive = min(half_band, (n_in - 1) // 2)
        self._n_negative = min(half_band, n_in // 2)
        wanted = n_in * self._target_rate_hz / rate
        keep_rate = self.compressed and wanted <= n_in * (1 + 1e-9)
        self._n_out = n_in if keep_rate else _fast_length(wanted)
        self._waveform_is_stepped = False
        self._pass_through = False

    def _band_bins(self) -> np.ndarray:
        """(K,) int numbers of the FFT bins inside the band, ascending."""
        return np.arange(-self._n_negative, self._n_positive + 1)

    def _set_filter(self, response: np.ndarray, inverse: np.ndarray, *,
                    signal_energy: float) -> None:
        """Filter that turns a unit scatterer's bins ``1 / inverse`` into `response`, peak one."""
        gain = response * inverse
        # scipy's inverse FFT divides by its length; the peak is the sum of the response's bins.
        self._gain = (gain * (self._n_out / response.sum())).astype(np.complex64)
        snr = response.sum() ** 2 / (self._n_in * np.sum(np.abs(gain) ** 2))
        # No loss at all may round to a negative number.
        self._snr_loss_db = max(0.0, 10.0 * math.log10(signal_energy / snr))

    def _set_output(self, rate_hz: float, first_delay_s: float, n_output: int) -> None:
        self._output_radar = dataclasses.replace(self.radar, sample_rate_hz=rate_hz,
                                                 first_sample_delay_s=first_delay_s)
        self._n_output = n_output

    def _filtered(self, samples: np.ndarray) -> np.ndarray:
        spectra = fft.fft(samples, self._n_in, workers=numba.get_num_threads())
        out = np.zeros((*samples.shape[:2], self._n_out), np.complex64)
        positive, negative = self._n_positive + 1, self._n_negative
        np.multiply(spectra[..., :positive], self._gain[negative:], out=out[..., :positive])
        if negative:
            np.multiply(spectra[..., -negative:], self._gain[:negative],
                        out=out[..., -negative:])
        profiles = fft.ifft(out, overwrite_x=True, workers=numba.get_num_threads())
        return np.ascontiguousarray(profiles[..., :self._n_output])

    def _plan_stepped_frequency(self, window: str) -> None:
        radar, n = self.radar, self.n_samples
        weights = window_weights(window, n)
        self._waveform_is_stepped = True
        self._pass_through = False
        self._n_out = _fast_length(n * self._target_rate_hz / radar.bandwidth_hz)
        first = -(self._n_out // 2) - STEPPED_GUARD_SAMPLES
        n_output = self._n_out + 2 * STEPPED_GUARD_SAMPLES
        index = first + np.arange(n_output)
        self._first = first
        # Sample 0 is (N - 1) / 2 steps below the carrier, and the samples' phase is referenced
        # to the reference delay, where the signal model has exp(-j 2 pi f_c tau).
        carrier_cycles = radar.carrier_hz * radar.first_sample_delay_s % 1.0
        cycles = (index * ((n - 1) / 2) / self._n_out + carrier_cycles) % 1.0
        self._ramp = np.exp(-2j * np.pi * cycles).astype(np.complex64)
        self._gain = (weights * (self._n_out / weights.sum())).astype(np.float32)
        self._snr_loss_db = 10.0 * math.log10(n * np.sum(weights**2) / weights.sum() ** 2)
        rate = radar.bandwidth_hz * (self._n_out / n)
        self._set_output(rate, radar.first_sample_delay_s + first / rate, n_output)

    def _stepped_frequency(self, samples: np.ndarray) -> np.ndarray:
        rows = samples.reshape(-1, self.n_samples)
        out = np.empty((len(rows), self._n_output), np.complex64)
        for start in range(0, len(rows), _ROWS_PER_CALL):
            part = slice(start, start + _ROWS_PER_CALL)
            profiles = fft.ifft(rows[part] * self._gain, self._n_out, overwrite_x=True,
                                workers=numba.get_num_threads())
            _wrap_and_turn(profiles, self._first, self._ramp, out[part])
        return out.reshape(*samples.shape[:2], -1)


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


def _fast_length(wanted: float) -> int:
    """Next length whose FFT is fast, at least `wanted` but for rounding."""
    return fft.next_fast_len(math.ceil(wanted * (1 - 1e-12)))
