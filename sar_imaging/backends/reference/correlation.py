# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain correlation, Rosenberg & Gray, equations 7 and 8."""

from __future__ import annotations

import numpy as np

from ...geometry.illumination import Illumination
from ...signal.radar import RadarParameters
from .project_points import half_paths
from .resample_profiles import power_series


def correlate_spectra(cycles_per_m: np.ndarray | tuple[float, float], spectra: np.ndarray,
                      tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
                      illumination: Illumination | None = None) -> np.ndarray:
    """Correlate spectra with the exact reference of every point.

    ``f(x) = sum_r w_r(x) sum_k S_rk exp(+j 2 pi (first + k step) path_r(x))``.

    Parameters
    ----------
    cycles_per_m : (float, float)
        First frequency and step, in cycles per metre of two-way path.
    spectra : (P, C, K) complex128
        Spectra referred to zero delay.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    points_m : (N, 3) float64
        Positions, metres.
    illumination : Illumination, optional
        Illumination of the P C echoes: w; 1 without.

    Returns
    -------
    (N,) complex128

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends.reference import correlate_spectra
    >>> from sar_imaging.signal.radar import SPEED_OF_LIGHT
    >>> from sar_imaging.signal.spectra import band_spectrum
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(4))
    >>> hertz, spectra = band_spectrum(block)
    >>> cycles_per_m = hertz[0] / SPEED_OF_LIGHT, (hertz[1] - hertz[0]) / SPEED_OF_LIGHT
    >>> value = correlate_spectra(cycles_per_m, spectra, block.tx_m, block.rx_m,
    ...                           np.array([[10_000.0, 0.0, 0.0]]))
    >>> print(f'{abs(value[0]):.2f} of 4 pulses and 5 channels')
    20.00 of 4 pulses and 5 channels
    """
    first, step = cycles_per_m
    image = np.zeros(len(points_m), np.complex128)
    for echo, index in enumerate(np.ndindex(spectra.shape[:2])):
        path = 2 * half_paths(tx_m[index], rx_m[index], points_m)
        image += (power_series(spectra[index], np.exp(2j * np.pi * np.fmod(step * path, 1.0)))
                  * np.exp(2j * np.pi * np.fmod(first * path, 1.0))
                  * amplitude(illumination, echo, points_m))
    return image


def correlate_profiles(radar: RadarParameters, samples: np.ndarray, tx_m: np.ndarray,
                       rx_m: np.ndarray, points_m: np.ndarray, half: int, sharpness: float,
                       illumination: Illumination | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Correlate range profiles with the exact reference of every point.

    ``f(x) = sum_r w_r(x) s_r(D_r(x)) exp(+j 4 pi D_r(x) / lambda)``, s_r read by Knab's series.

    At the place u, in samples, ``s(u) = sum_k s[k] sinc(u - k) cosh(a sqrt(1 - ((u - k) / h)^2))
    / cosh(a)`` (Knab 1979).

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the profiles.
    samples : (P, C, N) complex
        Profiles; zero beyond their ends.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    points_m : (K, 3) float64
        Positions, metres.
    half, sharpness : int, float
        h and a.
    illumination : Illumination, optional
        Illumination of the P C echoes: w; 1 without.

    Returns
    -------
    image : (K,) complex128
        A place outside a profile adds nothing.
    covered : (K,) bool
        Whether all illuminated places are h samples or more from the ends of the profiles.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends.reference import correlate_profiles
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(4))
    >>> image, covered = correlate_profiles(block.radar, block.samples, block.tx_m, block.rx_m,
    ...                                     np.array([[10_000.0, 0.0, 0.0]]), half=16,
    ...                                     sharpness=np.pi * 16 * 0.25)
    >>> print(f'{abs(image[0]):.2f}', covered.tolist())
    20.00 [True]
    """
    n, image = samples.shape[-1], np.zeros(len(points_m), np.complex128)
    covered = np.ones(len(points_m), bool)
    for echo, index in enumerate(np.ndindex(samples.shape[:2])):
        weight_of_echo = amplitude(illumination, echo, points_m)
        path = half_paths(tx_m[index], rx_m[index], points_m)
        place = (path - radar.range_start_m) / radar.sample_spacing_m
        covered &= ((abs(place) >= half) & (abs(place - (n - 1)) >= half)
                    | (weight_of_echo == 0))
        number = np.rint(place).astype(int)[:, None] + np.arange(-half, half + 1)
        away = place[:, None] - number
        root = np.sqrt(np.maximum(1 - (away / half) ** 2, 0.0))
        weight = np.sinc(away) * np.cosh(sharpness * root) / np.cosh(sharpness)
        known = (number >= 0) & (number < n) & (abs(away) < half)
        value = (np.where(known, weight, 0.0) * samples[index][np.clip(number, 0, n - 1)]).sum(1)
        inside = (place >= 0) & (place <= n - 1)
        image += (weight_of_echo * inside * value
                  * np.exp(2j * np.pi * np.fmod(2 * path / radar.wavelength_m, 1.0)))
    return image, covered


def amplitude(illumination: Illumination | None, echo: int, points_m: np.ndarray
              ) -> float | np.ndarray:
    """Two-way amplitude of one echo at points (..., 3), metres; 1 without illumination."""
    return 1.0 if illumination is None else illumination.select([echo]).amplitude(points_m)[0]
