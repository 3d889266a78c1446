# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Echoes by the sum over scatterers in plain NumPy, which shares nothing with the package's own.

Range profiles are the inverse transform of ``sum a exp(-2 pi j (f_c + f) D / c)`` over a flat
band, with two-way paths D and float64 phases. Only the containers are the package's.
"""

from __future__ import annotations

import numpy as np

from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

C = 299_792_458.0
_GUARD_CELLS = 20  # of range, around the echoes
_OVERSAMPLING = 1.25


def radar_of(carrier_hz: float, bandwidth_hz: float, paths_m: np.ndarray):
    """Radar whose profiles hold all two-way paths, and its number of samples."""
    guard = _GUARD_CELLS * C / bandwidth_hz
    first, last = paths_m.min() - guard, paths_m.max() + guard
    rate = _OVERSAMPLING * bandwidth_hz
    return RadarParameters(carrier_hz=carrier_hz, bandwidth_hz=bandwidth_hz, sample_rate_hz=rate,
                           first_sample_delay_s=first / C), int(np.ceil((last - first) / C * rate))


def profiles(radar: RadarParameters, n_samples: int, paths_m, amplitudes) -> np.ndarray:
    """(P, K, n_samples) complex64 of scatterers with paths (P, N) and K amplitudes each (N, K)."""
    frequency = np.fft.fftfreq(n_samples, 1 / radar.sample_rate_hz)
    band = np.flatnonzero(np.abs(frequency) <= radar.bandwidth_hz / 2)
    band = band[np.argsort(frequency[band])]
    amplitudes = np.asarray(amplitudes, np.complex64)
    out = np.zeros((len(paths_m), amplitudes.shape[1], n_samples), complex)
    rows = np.empty((len(band), len(amplitudes)), np.complex64)
    for pulse, path in zip(out, paths_m, strict=True):
        delay = path / C
        late = delay - radar.first_sample_delay_s
        phasor = np.exp(-2j * np.pi * (radar.carrier_hz * delay + frequency[band[0]] * late))
        step = np.exp(-2j * np.pi * radar.sample_rate_hz / n_samples * late)
        for row in rows:
            row[:] = phasor
            phasor *= step
        pulse[:, band] = (rows @ amplitudes).T
    return (np.fft.ifft(out) * (n_samples / len(band))).astype(np.complex64)


def block_of(radar: RadarParameters, samples, tx_m, rx_m=None, *, pulse_rate_hz=100.0
             ) -> PulseBlock:
    """Pulses of samples (P, C, n) and phase centres (P, C, 3)."""
    number = np.arange(len(samples))
    stamp_ns = np.rint(number * 1e9 / pulse_rate_hz).astype(np.int64)
    return PulseBlock(radar, True, stamp_ns, number, samples, tx_m, tx_m if rx_m is None else rx_m)
