# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 1: range profiles, or phase histories, at any half path."""

from __future__ import annotations

import numpy as np

from ...planning.profiles import PhaseHistory, RangeGate, rise


def profile_spectra(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int
                    ) -> np.ndarray:
    """Fourier coefficients of the part of range profiles that an image needs.

    ``S[n] = g[n] sum_i w[i] s[i] exp(-j 2 pi n i / N)`` with the window w, which rises and falls
    where it cuts the profile, and the gain g of the plan, a taper outside the radar's band. A
    phase history holds the sums already.

    Parameters
    ----------
    source : RangeGate or PhaseHistory
        What is needed of the profiles.
    samples : (R, K) complex64
        Profiles, or phase histories.
    n_padded : int
        N: samples of the profiles with zeros behind them; K for phase histories.

    Returns
    -------
    (R, N) complex128
        By frequency number, from the lowest one, ``-(N // 2)``, on.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends.reference.resample_profiles import profile_spectra
    >>> from sar_imaging.planning.profiles import RangeGate
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(4))
    >>> gate = RangeGate.whole(block.radar, block.n_samples)
    >>> spectra = profile_spectra(gate, block.samples[:, 0], n_padded=128)
    >>> spectra.shape, spectra.dtype.name
    ((4, 128), 'complex128')
    """
    spectra = np.asarray(samples, np.complex128)
    if isinstance(source, RangeGate):
        window = np.ones(source.n_samples)
        if source.n_rise:
            window[:source.n_rise] = rise(source.n_rise)
        if source.n_fall:
            window[-source.n_fall:] = rise(source.n_fall)[::-1]
        lead = max(-source.first, 0)
        first = source.first + lead
        cut = np.pad(spectra, ((0, 0), (lead, 0)))[:, first:]
        spectra = np.fft.fft(cut[:, :source.n_samples] * window, n_padded)
    # bin `source.zero` is that of the carrier
    return np.roll(spectra * source.gain(n_padded), n_padded // 2 - source.zero, axis=-1)


def resample_profiles(source: RangeGate | PhaseHistory, spectra: np.ndarray, range_m: np.ndarray
                      ) -> np.ndarray:
    """Profiles at any half path, by their Fourier series.

    ``s(D) = sum_n S[n] exp(j 2 pi n (D - D_0) / P)``: D_0 the half path of the first sample, P the
    period of the N samples. A profile is zero outside its period, a phase history repeats.

    Parameters
    ----------
    source : RangeGate or PhaseHistory
        As for `profile_spectra`.
    spectra : (R, N) complex128
        From there.
    range_m : (R, ...) float64
        Half paths for each profile, metres.

    Returns
    -------
    (R, ...) complex128
        At baseband: times ``exp(+j 4 pi (D - source.phase_range_m) / lambda)`` with the carrier.
    """
    n = spectra.shape[-1]
    period_m = n * source.radar.sample_spacing_m
    place = (range_m - source.range_start_m) / period_m
    values = power_series(spectra, np.exp(2j * np.pi * place).reshape(len(spectra), -1))
    values = values.reshape(place.shape) * np.exp(-2j * np.pi * np.fmod(n // 2 * place, 1.0))
    return values if source.periodic else np.where((0 <= place) & (place <= 1), values, 0.0)


def power_series(coefficients: np.ndarray, z: np.ndarray) -> np.ndarray:
    """``sum_n c[n] z^n`` by Horner's rule, whose rounding errors stay below -250 dB.

    Parameters
    ----------
    coefficients : (..., N) complex128
        c of each series.
    z : (..., K) complex128
        Where each is summed; of magnitude 1.

    Returns
    -------
    (..., K) complex128

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends.reference.resample_profiles import power_series
    >>> power_series(np.array([1.0, 2.0, 3.0]), np.array([1j, -1.0])).tolist()
    [(-2+2j), (2+0j)]
    """
    values = np.zeros(z.shape, np.complex128)
    for n in range(coefficients.shape[-1] - 1, -1, -1):
        values *= z
        values += coefficients[..., n, None]
    return values
