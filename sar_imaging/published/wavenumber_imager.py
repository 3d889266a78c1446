"""Images in the wavenumber domain by a plan: slow-time transform, Stolt interpolation, pixels."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy.fft

from ..signal.pulses import PulseBlock
from ..signal.spectra import band_spectrum
from .stolt import SlantImage, spread
from .wavenumber_plan import WavenumberPlan

_ROWS_PER_PASS = 256


def image_wavenumber(plan: WavenumberPlan, block: PulseBlock) -> np.ndarray:
    """Image by a plan, complex64."""
    track, band = plan.track, plan.band
    slant = _transform(plan, *_slow_time_spectrum(plan, block))
    scale = np.exp(0.25j * np.pi) * math.sqrt(2 * np.pi) / (band.n_fft * track.spacing_m)
    return slant.read(plan.grid, track, scale)


def _transform(plan: WavenumberPlan, k_y, spectrum) -> SlantImage:
    """Reference of the scene centre, Stolt interpolation and inverse transform."""
    k, band, step = plan.wavenumbers, plan.band, plan.step
    nearest = band.range_wavenumbers(k)[0]
    stolt = np.zeros((len(k_y), plan.n_x), np.complex64)
    for lo in range(0, len(k_y), _ROWS_PER_PASS):
        rows = slice(lo, lo + _ROWS_PER_PASS)
        k_u = k_y[rows, None]
        weight = band.weight(k_u / k)
        k_x = np.sqrt(np.where(weight > 0, k * k - k_u * k_u, nearest ** 2))
        # Equation 12. The amplitude of the stationary phase, which the paper leaves out,
        # makes the image equal to time-domain correlation in scale and phase.
        matched = spectrum[rows] * (weight * k / k_x ** 1.5) * np.exp(
            1j * (k_x * plan.centre_m[1] + k_u * plan.centre_m[0]))
        spread(matched, (k_x - plan.first) / step, plan.taps, stolt[rows])
    return SlantImage.from_spectrum(stolt, (k_y[0], plan.first), (band.step, step),
                                    plan.centre_m)


def _slow_time_spectrum(plan: WavenumberPlan, block: PulseBlock):
    """Slow-time transform, summed over the channels with their offsets along the track.

    Returns the k_u (I,) and the spectrum (I, K) complex128. The transform repeats itself in k_u:
    rows are unrolled to the band of the grid, which moves with frequency.
    """
    band, track, k = plan.band, plan.track, plan.wavenumbers
    number = band.wavenumbers(k)
    k_u = number * band.step
    out = np.zeros((len(k_u), len(k)), np.complex128)
    for channel, offset in enumerate(track.offsets_m):
        one = slice(channel, channel + 1)
        part = dataclasses.replace(block, samples=block.samples[:, one], tx_m=block.tx_m[:, one],
                                   rx_m=block.rx_m[:, one])
        spectrum = scipy.fft.fft(band_spectrum(part)[1][:, 0], band.n_fft, axis=0)
        shift = np.exp(-1j * k_u * (track.first_m + offset))
        out += spectrum[number % band.n_fft] * shift[:, None]
    return k_u, out
