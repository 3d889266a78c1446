# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fast-time spectra of range profiles and phase histories, the input of correlation."""

from __future__ import annotations

import numpy as np
import scipy.fft

from .pulses import PulseBlock
from .radar import RadarParameters, Waveform


def phase_history_frequencies(carrier_hz: float, bandwidth_hz: float, n: int) -> np.ndarray:
    """(n,) float64 absolute frequencies of a stepped-frequency pulse, ascending, hertz."""
    return carrier_hz + (np.arange(n) - (n - 1) / 2) * (bandwidth_hz / n)


def resampled_from_spectrum(spectrum: np.ndarray, n_out: int, *, workers: int = 1) -> np.ndarray:
    """Samples of the same period at another rate, by padding or cropping the spectrum.

    Rosenberg & Gray, equation 14.

    Parameters
    ----------
    spectrum : (R, N) complex64
        Fourier transforms of R signals, zero frequency first.
    n_out : int
        Number of samples wanted over the period.
    workers : int
        Threads of the inverse transform.

    Returns
    -------
    (R, n_out) complex64
    """
    n = spectrum.shape[-1]
    keep = min(n, n_out)
    upper, lower = (keep + 1) // 2, keep // 2
    padded = np.zeros((len(spectrum), n_out), np.complex64)
    padded[:, :upper] = spectrum[:, :upper]
    padded[:, n_out - lower:] = spectrum[:, n - lower:]
    padded *= np.float32(n_out / n)
    return scipy.fft.ifft(padded, axis=-1, workers=workers, overwrite_x=True)


def band_spectrum(block: PulseBlock) -> tuple[np.ndarray, np.ndarray]:
    """Spectrum of every pulse inside the waveform's band, referred to zero delay.

    A scatterer of amplitude a at delay tau contributes ``a exp(-j 2 pi f tau)`` at the absolute
    frequency f (Rosenberg & Gray, equation 8), up to the window of the range compression.
    Profiles are taken as one period of a periodic signal; content outside the band is left out.

    Parameters
    ----------
    block : PulseBlock
        Range profiles, or the raw phase history of a stepped-frequency radar.

    Returns
    -------
    frequencies_hz : (K,) float64
        Absolute frequencies, ascending and equally spaced, hertz.
    spectra : (P, C, K) complex128
        Spectrum of each pulse and channel.

    Raises
    ------
    ValueError
        The block holds raw pulses of another waveform; compress them first.

    Examples
    --------
    >>> from sar_imaging.signal.spectra import band_spectrum
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(4))
    >>> frequencies_hz, spectra = band_spectrum(block)
    >>> spectra.shape, spectra.dtype.name
    ((4, 5, 95), 'complex128')
    >>> print(f'{frequencies_hz[0] / 1e9:.2f} to {frequencies_hz[-1] / 1e9:.2f} GHz')
    9.85 to 10.15 GHz
    """
    radar, n = block.radar, block.n_samples
    frequencies = band_frequencies(radar, n, block.compressed)
    if not block.compressed:
        reference = np.exp(-2j * np.pi * np.fmod(frequencies * radar.first_sample_delay_s, 1.0))
        return frequencies, block.samples * reference
    baseband, inside = _baseband(radar, n)
    spectra = scipy.fft.fft(block.samples.astype(np.complex128), axis=-1, norm='forward')
    spectra = scipy.fft.fftshift(spectra, axes=-1)[..., inside]
    baseband = baseband[inside]
    spectra *= np.exp(-2j * np.pi * np.fmod(baseband * radar.first_sample_delay_s, 1.0))
    return frequencies, spectra


def band_frequencies(radar: RadarParameters, n_samples: int, compressed: bool) -> np.ndarray:
    """(K,) float64 frequencies of `band_spectrum`, absolute, ascending, hertz.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the pulses.
    n_samples : int
        Samples of each.
    compressed : bool
        Whether they are range profiles.

    Raises
    ------
    ValueError
        They are raw pulses of another waveform than stepped frequency.
    """
    if compressed:
        baseband, inside = _baseband(radar, n_samples)
        return radar.carrier_hz + baseband[inside]
    if radar.waveform is not Waveform.STEPPED_FREQUENCY:
        raise ValueError(f'raw {radar.waveform.name} pulses have no band spectrum; '
                         'apply range compression first')
    return phase_history_frequencies(radar.carrier_hz, radar.bandwidth_hz, n_samples)


def beyond_band(profiles: np.ndarray, radar: RadarParameters) -> np.ndarray:
    """What range profiles hold beyond the frequencies of `band_spectrum`, (..., N) complex64."""
    inside = _baseband(radar, profiles.shape[-1])[1]
    spectra = scipy.fft.fft(profiles, axis=-1)
    spectra[..., scipy.fft.ifftshift(inside)] = 0.0
    return scipy.fft.ifft(spectra, axis=-1)


def _baseband(radar: RadarParameters, n_samples: int) -> tuple[np.ndarray, np.ndarray]:
    """(N,) frequencies of a transform, ascending, hertz, and which are inside the band."""
    baseband = scipy.fft.fftshift(scipy.fft.fftfreq(n_samples, 1.0 / radar.sample_rate_hz))
    return baseband, np.abs(baseband) <= 0.5 * radar.bandwidth_hz * (1 + 1e-9)
