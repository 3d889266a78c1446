# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The transmitted linear frequency modulated (LFM) pulse at baseband.

``s(t) = exp(j pi K (t - T/2)^2)`` for ``0 <= t < T``: the frequency sweeps linearly from
``-K T / 2`` to ``+K T / 2`` and is zero in the middle of the pulse. Time runs from the leading
edge, so the echo of a scatterer at the two-way delay tau begins at tau, which is what
`RadarParameters.first_sample_delay_s` counts from.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fresnel

from .radar import RadarParameters


def lfm_spectrum(frequency_hz: ArrayLike, radar: RadarParameters) -> np.ndarray:
    """Fourier transform of the pulse, ``integral s(t) exp(-j 2 pi f t) dt``, in closed form.

    A receiver's anti-alias filter removes what a sampled replica of the pulse would fold into
    the band, so this and not the transform of a sampled replica is what echoes contain, whatever
    the fraction of a sample by which they are delayed.

    Parameters
    ----------
    frequency_hz : array_like, float64
        Baseband frequencies, hertz.
    radar : RadarParameters
        With pulse length T and chirp rate K, |K| T^2 well above 1.

    Returns
    -------
    array of complex128
        Spectrum in seconds, in the shape of `frequency_hz`; about ``1 / sqrt(|K|)`` in the band.

    Notes
    -----
    With ``t - T/2 = v / sqrt(2 K) + f / K`` the exponent becomes ``j pi v^2 / 2`` and the
    integral a difference of Fresnel integrals.
    """
    frequency_hz = np.asarray(frequency_hz, float)
    length, rate = radar.pulse_length_s, radar.chirp_rate_hz_per_s
    steep = abs(rate)
    f = frequency_hz * math.copysign(1.0, rate)
    scale = math.sqrt(2.0 * steep)
    s1, c1 = fresnel(scale * (length / 2 - f / steep))
    s0, c0 = fresnel(scale * (-length / 2 - f / steep))
    quadratic = np.pi * f**2 / steep
    value = (((c1 - c0) + 1j * (s1 - s0)) / scale
             * (np.cos(quadratic) - 1j * np.sin(quadratic)))
    if rate < 0:  # a falling chirp is the conjugate of the rising one
        value = value.conj()
    centre = np.pi * frequency_hz * length
    return value * (np.cos(centre) - 1j * np.sin(centre))


def n_pulse_samples(radar: RadarParameters) -> int:
    """Samples that the pulse covers when the first falls on its leading edge."""
    # A duration that is a whole number of samples must not gain one from rounding.
    return math.ceil(radar.pulse_length_s * radar.sample_rate_hz * (1 - 1e-12))


def _mistaken_unit(ratio: float) -> str:
    """The end of a message, where the sweep is off by what a unit is."""
    names = {1e6: 'pulse_length_s is probably in microseconds, expected are seconds',
             1e9: 'pulse_length_s is probably in nanoseconds, expected are seconds',
             1e-12: 'chirp_rate_hz_per_s is probably in MHz/us, expected are Hz/s',
             1e-6: 'chirp_rate_hz_per_s is probably in MHz/s, expected are Hz/s'}
    return next((f'; {text}' for factor, text in names.items()
                 if abs(ratio / factor - 1) < 0.05), '')


def check_lfm(radar: RadarParameters) -> None:
    """Refuse parameters that do not describe one LFM pulse sampled without aliasing.

    Raises
    ------
    ValueError
        Pulse length and chirp rate do not sweep the stated bandwidth within 1 %, the pulse is
        shorter than two samples, or the sample rate is below the bandwidth.
    """
    swept = abs(radar.chirp_rate_hz_per_s) * radar.pulse_length_s
    if abs(swept - radar.bandwidth_hz) > 0.01 * radar.bandwidth_hz:
        raise ValueError(
            f'chirp_rate_hz_per_s * pulse_length_s = {swept:.6g} Hz does not match '
            f'bandwidth_hz={radar.bandwidth_hz:.6g}; an LFM pulse sweeps its bandwidth once'
            + _mistaken_unit(swept / radar.bandwidth_hz))
    if n_pulse_samples(radar) < 2:
        raise ValueError(f'pulse_length_s={radar.pulse_length_s} is shorter than two samples at '
                         f'sample_rate_hz={radar.sample_rate_hz}; is it in seconds?')
    if radar.sample_rate_hz < radar.bandwidth_hz:
        raise ValueError(f'sample_rate_hz={radar.sample_rate_hz:.6g} is below '
                         f'bandwidth_hz={radar.bandwidth_hz:.6g}; complex samples need at least '
                         'the bandwidth')
