# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulate the echoes of point scatterers over exact two-way paths, as a receiver records them.

All but FMCW come from the same spectrum ``sum_p a_p exp(-j 2 pi (f_c + f) tau_p)`` with
``tau_p = (|tx - x_p| + |rx - x_p|) / c`` for every pulse and channel in float64: what a receiver
with an anti-alias filter samples is band-limited, and is synthesised so. The beat signal of FMCW
is written down in time, residual video phase included. NumPy's elementwise
square roots, products and sums are exactly rounded and hence the same on every processor; see
`quantise` for the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from ..geometry.illumination import Illumination
from ..signal.dechirp import check_fmcw
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from ..signal.waveforms import check_lfm, lfm_spectrum, n_pulse_samples

#: Samples from delays, seconds, and amplitudes.
Synthesis = Callable[[np.ndarray, np.ndarray], np.ndarray]

OVERSAMPLING = 8  # points of the grid of delays for each bin
TERMS = 9  # of Taylor's series: (pi / 16)^9 / 9! = 1e-12 of a scatterer's amplitude


def dense_spectrum(carrier_hz: float, first_bin: float, n_bins: int, step_hz: float,
                   delays_s: np.ndarray, amplitudes: np.ndarray,
                   reference_delay_s: float) -> np.ndarray:
    """The same spectrum as `sar_imaging.simulation.echoes.scene_spectrum`, faster for many.

    Each echo is written as Taylor's series about the nearest point of a fine grid of delays. The
    moments of all echoes are summed on that grid, and an FFT of each takes them to the bins: the
    non-uniform transform of C. Anderson and M. D. Dahleh, Rapid computation of the discrete
    Fourier transform, SIAM J. Sci. Comput. 17, 1996. A scatterer costs `TERMS` sums instead of a
    product for every bin.

    Parameters
    ----------
    carrier_hz, first_bin, n_bins, step_hz, reference_delay_s
        As in `scene_spectrum`.
    delays_s : (P, C, S) float64
        Two-way delays, seconds.
    amplitudes : (S,) complex128
        Amplitudes of the scatterers.

    Returns
    -------
    (P, C, K) complex128
    """
    middle = n_bins // 2
    n_grid = fft.next_fast_len(OVERSAMPLING * n_bins)
    bins = np.arange(n_bins) - middle
    factors = (-2j * np.pi * bins / n_grid) ** np.arange(TERMS)[:, None]
    out = np.empty((*delays_s.shape[:2], n_bins), complex)
    for index in np.ndindex(delays_s.shape[:2]):
        turn = step_hz * (delays_s[index] - reference_delay_s)  # cycles from bin to bin
        cycles = np.remainder(carrier_hz * delays_s[index], 1.0) + (first_bin + middle) * turn
        angle = 2 * np.pi * np.remainder(cycles, 1.0)
        place = np.remainder(turn, 1.0) * n_grid
        nearest = np.rint(place)
        moments = _moments(amplitudes * (np.cos(angle) - 1j * np.sin(angle)), place - nearest,
                           nearest.astype(np.int64) % n_grid, n_grid)
        out[index] = (fft.fft(moments)[:, bins] * factors).sum(axis=0)
    return out


def _moments(echoes: np.ndarray, offsets: np.ndarray, points: np.ndarray,
             n_grid: int) -> np.ndarray:
    """``sum echo offset^q / q!`` on every point of the grid: ``(TERMS, n_grid)`` complex128."""
    moments = np.empty((TERMS, n_grid), complex)
    for q in range(TERMS):
        if q:
            echoes = echoes * (offsets / q)
        moments[q].real = np.bincount(points, echoes.real, n_grid)
        moments[q].imag = np.bincount(points, echoes.imag, n_grid)
    return moments


DENSE = 4096  # scatterers from which the spectrum of all together is the faster one


def two_way_delays(tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
                   propagation_speed_m_per_s: float = SPEED_OF_LIGHT) -> np.ndarray:
    """Exact two-way delay from transmitter over each point to receiver.

    Rosenberg & Gray, equation 3, first line, for any positions.

    Parameters
    ----------
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    points_m : (S, 3) float64
        Scatterers, metres.
    propagation_speed_m_per_s : float
        Speed of the waves, metres per second.

    Returns
    -------
    (P, C, S) float64
        Delays, seconds.
    """
    path_m = _distances(tx_m, points_m) + _distances(rx_m, points_m)
    return path_m / propagation_speed_m_per_s


def _distances(centres_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    dx, dy, dz = (centres_m[..., axis, None] - points_m[:, axis] for axis in range(3))
    return np.sqrt(dx * dx + dy * dy + dz * dz)


def scene_spectrum(carrier_hz: float, first_bin: float, n_bins: int, step_hz: float,
                   delays_s: np.ndarray, amplitudes: np.ndarray,
                   reference_delay_s: float) -> np.ndarray:
    """Spectrum of the scene at baseband frequencies ``f = (first_bin + k) step_hz``.

    ``sum_p a_p exp(-j 2 pi f_c tau_p) exp(-j 2 pi f (tau_p - reference_delay_s))``. Carrier
    phases are reduced to a fraction of a cycle in float64; the bins' phasors are products of a
    coarse and a fine table, so that a bin costs a multiplication and no sine.

    Parameters
    ----------
    carrier_hz : float
        Carrier frequency, hertz.
    first_bin : float
        Number of the first bin; half-integral for an even number of centred bins.
    n_bins : int
        Number of bins K.
    step_hz : float
        Spacing of the bins, hertz.
    delays_s : (P, C, S) float64
        Two-way delays, seconds.
    amplitudes : (S,) or (P, C, S) complex128
        Amplitudes of the scatterers, or of the echoes.
    reference_delay_s : float
        Delay of time zero of the spectrum, seconds.

    Returns
    -------
    (P, C, K) complex128
    """
    fine = max(1, math.isqrt(n_bins))
    coarse = -(-n_bins // fine)
    amplitudes = np.asarray(amplitudes)
    out = np.zeros((*delays_s.shape[:2], coarse, fine), complex)
    echo = np.empty_like(out)
    for p in range(delays_s.shape[-1]):
        carrier = np.remainder(carrier_hz * delays_s[..., p], 1.0)
        turn = step_hz * (delays_s[..., p] - reference_delay_s)  # cycles from bin to bin
        start = (carrier + first_bin * turn)[..., None]
        turn = turn[..., None]
        coarse_phasors = amplitudes[..., p, None] * _phasor(
            start + turn * (fine * np.arange(coarse)))
        fine_phasors = _phasor(turn * np.arange(fine))
        out += np.multiply(coarse_phasors[..., None], fine_phasors[..., None, :], out=echo)
    return out.reshape(*delays_s.shape[:2], -1)[..., :n_bins]


def _phasor(cycles: np.ndarray) -> np.ndarray:
    """``exp(-j 2 pi cycles)``."""
    angle = 2 * np.pi * (cycles - np.floor(cycles))  # twice as fast as a remainder, and as exact
    return np.cos(angle) - 1j * np.sin(angle)


class EchoSimulator:
    """Simulate the noise-free pulses of one radar from any phase centres; planned once.

    - raw LFM: the pulse of `sar_imaging.signal.waveforms`, delayed exactly, through an
      anti-alias filter that is flat for ``|f| <= B/2`` and falls as a raised cosine to zero at
      half the sample rate. Amplitude one inside the pulse for a scatterer of amplitude one.
    - compressed: profiles whose own FFT is flat over the bins ``|f| <= B/2`` and zero elsewhere,
      ``n_samples`` being one period. Peak one.
    - stepped frequency: one sample per frequency. Amplitude one.
    - FMCW: the beat of `sar_imaging.signal.dechirp`, of scatterers whose echo and ramp overlap
      throughout; its real part for a real converter. Amplitude one.
    - passband: real samples at the carrier, flat over the band ``|f - f_c| <= B/2`` and zero
      elsewhere, ``n_samples`` being one period. Peak one.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the samples to make.
    n_samples : int
        Fast-time samples N per pulse and channel.
    compressed : bool
        True for range profiles.
    points_m : (S, 3) float64
        Scatterers in the imaging frame, metres.
    amplitudes : (S,) complex128
        Their amplitudes.

    Raises
    ------
    ValueError
        The radar's parameters contradict each other, or the profile is sampled too coarsely.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import RadarParameters
    >>> from sar_imaging.simulation import EchoSimulator
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> scatterer = np.array([[100.0, 0.0, 0.0]])
    >>> simulate = EchoSimulator(radar, 64, compressed=True, points_m=scatterer,
    ...                          amplitudes=np.array([1.0 + 0j]))
    >>> phase_centre = np.zeros((1, 1, 3))
    >>> profile = simulate(phase_centre, phase_centre)[0, 0]
    >>> print(f'{radar.range_start_m + np.abs(profile).argmax() * radar.sample_spacing_m:.1f} m')
    100.1 m
    """

    def __init__(self, radar: RadarParameters, n_samples: int, *, compressed: bool,
                 points_m: ArrayLike, amplitudes: ArrayLike):
        self.radar = radar
        self.n_samples = n_samples
        self._points_m = np.asarray(points_m, float).reshape(-1, 3)
        self._amplitudes = np.asarray(amplitudes, complex)
        # How much earlier than the first sample an echo may begin; None: it may alias, as the
        # profiles of a stepped-frequency radar do.
        self._early_samples: int | None = 0
        if compressed:
            self._synthesise = self._plan_compressed()
        elif radar.waveform == Waveform.STEPPED_FREQUENCY:
            self._synthesise = self._plan_stepped_frequency()
            self._early_samples = None
        elif radar.waveform.is_ramp:
            self._synthesise = self._plan_fmcw()
            self._early_samples = None
        elif radar.waveform == Waveform.PASSBAND:
            self._synthesise = self._plan_passband()
        else:
            self._synthesise = self._plan_lfm()
            self._early_samples = n_pulse_samples(radar)

    def __call__(self, tx_m: np.ndarray, rx_m: np.ndarray,
                 illumination: Illumination | None = None) -> np.ndarray:
        """Samples of pulses at the phase centres given.

        Parameters
        ----------
        tx_m, rx_m : (P, C, 3) float64
            Transmit and receive phase centres, metres.
        illumination : Illumination, optional
            Illumination of the P C echoes: scatterers return its two-way amplitude times their
            own.

        Returns
        -------
        (P, C, N) complex128

        Raises
        ------
        ValueError
            A scatterer returns nothing inside the recorded interval; it would appear at the
            wrong delay.
        """
        if illumination is not None:
            two_way = illumination.amplitude(self._points_m).reshape(*tx_m.shape[:2], -1)
            return self._samples(tx_m, rx_m, self._amplitudes * two_way)
        if self._amplitudes.size < DENSE:
            return self._samples(tx_m, rx_m)
        # One by one: the delays of a block would be gigabytes.
        return np.concatenate([self._samples(tx_m[p:p + 1], rx_m[p:p + 1])
                               for p in range(len(tx_m))])

    def _samples(self, tx_m: np.ndarray, rx_m: np.ndarray,
                 amplitudes: np.ndarray | None = None) -> np.ndarray:
        delays_s = two_way_delays(tx_m, rx_m, self._points_m,
                                  self.radar.propagation_speed_m_per_s)
        amplitudes = self._amplitudes if amplitudes is None else amplitudes
        self._check_recorded(delays_s[np.broadcast_to(amplitudes != 0, delays_s.shape)])
        return self._synthesise(delays_s, amplitudes)

    def _check_recorded(self, delays_s: np.ndarray) -> None:
        if not delays_s.size or self._early_samples is None:
            return
        sample = (delays_s - self.radar.first_sample_delay_s) * self.radar.sample_rate_hz
        if sample.min() < -self._early_samples or sample.max() > self.n_samples - 1:
            raise ValueError(
                f'scatterers lie between samples {sample.min():.1f} and {sample.max():.1f}; the '
                f'record holds {-self._early_samples} to {self.n_samples - 1}: change '
                'first_sample_delay_s or record more samples')

    def _spectrum(self, first_bin: float, n_bins: int, step_hz: float,
                  delays_s: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
        few = amplitudes.ndim > 1 or amplitudes.size < DENSE
        spectrum = scene_spectrum if few else dense_spectrum
        return spectrum(self.radar.carrier_hz, first_bin, n_bins, step_hz, delays_s,
                        amplitudes, self.radar.first_sample_delay_s)

    def _plan_compressed(self) -> Synthesis:
        n, radar = self.n_samples, self.radar
        step = radar.sample_rate_hz / n
        half = math.floor(radar.bandwidth_hz / 2 / step * (1 + 1e-12))
        n_bins = 2 * half + 1
        if n_bins > n:
            raise ValueError(f'{n} samples at sample_rate_hz={radar.sample_rate_hz:.6g} cannot '
                             f'hold {n_bins} bins of bandwidth_hz={radar.bandwidth_hz:.6g}; '
                             'sample faster')

        def synthesise(delays_s: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
            spectrum = self._spectrum(-half, n_bins, step, delays_s, amplitudes)
            return _to_time(spectrum, half, n) * (n / n_bins)

        return synthesise

    def _plan_lfm(self) -> Synthesis:
        radar = self.radar
        check_lfm(radar)
        # Room for a pulse at both ends keeps what is cut by the record from wrapping round.
        n_fft = fft.next_fast_len(self.n_samples + 2 * n_pulse_samples(radar))
        step = radar.sample_rate_hz / n_fft
        half = (n_fft - 1) // 2
        frequency = step * np.arange(-half, half + 1)
        pulse = (lfm_spectrum(frequency, radar) * anti_alias_gain(frequency, radar)
                 * radar.sample_rate_hz)

        def synthesise(delays_s: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
            spectrum = self._spectrum(-half, frequency.size, step, delays_s, amplitudes)
            return _to_time(spectrum * pulse, half, n_fft)[..., :self.n_samples]

        return synthesise

    def _plan_stepped_frequency(self) -> Synthesis:
        n, radar = self.n_samples, self.radar

        def synthesise(delays_s: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
            # The samples' phase is that of the delay beyond the reference, carrier included.
            cycles = radar.carrier_hz * radar.first_sample_delay_s % 1.0
            spectrum = self._spectrum(-(n - 1) / 2, n, radar.bandwidth_hz / n, delays_s,
                                      amplitudes)
            return spectrum * _phasor(np.array(-cycles))

        return synthesise

    def _plan_fmcw(self) -> Synthesis:
        n, radar = self.n_samples, self.radar
        check_fmcw(radar, n)
        slope = radar.chirp_rate_hz_per_s
        frequency = radar.carrier_hz + slope * (
            (np.arange(n) - (n - 1) / 2) / radar.sample_rate_hz)

        def synthesise(delays_s: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
            late_s = delays_s - radar.first_sample_delay_s
            out = np.zeros((*delays_s.shape[:2], n), complex)
            for p in range(late_s.shape[-1]):
                late = late_s[..., p, None]
                out += amplitudes[..., p, None] * _phasor(frequency * late - 0.5 * slope * late**2)
            return out.real + 0j if radar.waveform == Waveform.FMCW_REAL else out

        return synthesise

    def _plan_passband(self) -> Synthesis:
        n, radar = self.n_samples, self.radar
        step = radar.sample_rate_hz / n
        half = radar.bandwidth_hz / 2
        bins = np.arange(math.ceil((radar.carrier_hz - half) / step * (1 - 1e-12)),
                         math.floor((radar.carrier_hz + half) / step * (1 + 1e-12)) + 1)
        if not (0 < bins[0] and bins[-1] < n / 2):
            raise ValueError(f'sample_rate_hz={radar.sample_rate_hz:.6g} cannot hold the band of '
                             f'{radar.bandwidth_hz:.6g} Hz at {radar.carrier_hz:.6g} Hz; sample '
                             'at more than twice the upper edge')

        def synthesise(delays_s: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
            # counted from zero frequency: the carrier is part of the bins
            spectrum = scene_spectrum(0.0, bins[0], bins.size, step, delays_s, amplitudes,
                                      radar.first_sample_delay_s)
            grid = np.zeros((*delays_s.shape[:2], n), complex)
            grid[..., bins] = spectrum * (n / bins.size)
            return fft.ifft(grid, overwrite_x=True).real + 0j

        return synthesise


def anti_alias_gain(frequency_hz: np.ndarray, radar: RadarParameters) -> np.ndarray:
    """Receiver filter: one for ``|f| <= B/2``, raised cosine to zero at half the sample rate.

    Parameters
    ----------
    frequency_hz : array of float64
        Baseband frequencies below half the sample rate, hertz.
    radar : RadarParameters
        With bandwidth and sample rate.

    Returns
    -------
    array of float64
        Gain between 0 and 1, in the shape of `frequency_hz`.
    """
    edge, stop = radar.bandwidth_hz / 2, radar.sample_rate_hz / 2
    beyond = np.clip(np.abs(frequency_hz) - edge, 0.0, None) / max(stop - edge, 1e-9 * stop)
    return 0.5 + 0.5 * np.cos(np.pi * np.minimum(beyond, 1.0))


def _to_time(spectrum: np.ndarray, half: int, n: int) -> np.ndarray:
    """Inverse FFT of length `n` of the bins ``-half .. half``."""
    grid = np.zeros((*spectrum.shape[:-1], n), complex)
    grid[..., :half + 1] = spectrum[..., half:]
    if half:
        grid[..., -half:] = spectrum[..., :half]
    return fft.ifft(grid, overwrite_x=True)


def quantise(samples: np.ndarray, bits: int, full_scale: float) -> np.ndarray:
    """Round in-phase and quadrature parts as an analogue-to-digital converter does.

    Also what makes recordings reproducible bit for bit: sines and FFTs differ in the last digit
    of float64 between processors and library versions, by some 1e-11 of a converter's step.

    Parameters
    ----------
    samples : array of complex128
        Signal; parts beyond the full scale are clipped.
    bits : int
        Resolution including the sign, 2 to 24 (float32 holds no more).
    full_scale : float
        Largest magnitude of either part, a power of two so that every step is exact in float32.

    Returns
    -------
    array of complex64
        In the shape of `samples`.

    Raises
    ------
    ValueError
        `bits` is out of range or `full_scale` is no power of two.
    """
    if not 2 <= bits <= 24:
        raise ValueError(f'bits={bits}; expected 2 to 24')
    if math.frexp(full_scale)[0] != 0.5:
        raise ValueError(f'full_scale={full_scale} is not a positive power of two')
    step = full_scale / 2 ** (bits - 1)
    parts = np.ascontiguousarray(samples, complex).view(float)
    levels = np.clip(np.rint(parts / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    # Adding zero turns -0.0, whose sign is the rounding error's, into 0.0.
    return (levels * step + 0.0).astype(np.float32).view(np.complex64)
