# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 7: sub-aperture images joined by their spectra."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...planning.afbp.polar_grids import UnifiedPolarGrids
from ...planning.aliasing_error import guard_taper


def fuse_bands(grid: UnifiedPolarGrids, contributions: Iterable[tuple[np.ndarray, float]]
               ) -> np.ndarray:
    """Spectrum of the fused image: the sum of the bands of all sub-aperture images.

    Zhang et al., equations 16 and 17: at range wavenumber K_r the spectrum of sub-aperture u is a
    band around the angular wavenumber ``K_alpha = K_r x_u``, as wide as the spectrum of the coarse
    image, which holds it folded. Both grids have the same extent in direction and so the same step
    of K_alpha: the band's bin n is bin ``n mod n_coarse`` of the coarse image and adds to bin
    ``n mod n_fine`` of the fused one. Tapers over the guards make the images periodic.

    Parameters
    ----------
    grid : UnifiedPolarGrids
        Grid of all images.
    contributions : iterable of ((n_coarse, n_coarse_range) complex128, float)
        Image of each sub-aperture on ``grid.coarse`` at range baseband, and its x_u, metres.

    Returns
    -------
    (n_fine, K) complex128
        By angular bin, and by range wavenumber: ``grid.range_wavenumbers``.
    """
    taper = np.multiply.outer(guard_taper(grid.n_coarse, grid.n_guard, grid.beta),
                              guard_taper(grid.n_coarse_range, grid.range_guard, grid.beta))
    wavenumbers = grid.range_wavenumbers
    spectrum = np.zeros((grid.n_fine, len(wavenumbers)), np.complex128)
    for image, centre_m in contributions:
        coarse = np.fft.fft2(image * taper)
        for column, wavenumber in enumerate(wavenumbers):
            middle = int(np.rint(wavenumber * centre_m * grid.extent / (2 * np.pi)))
            bins = middle - grid.n_coarse // 2 + np.arange(grid.n_coarse)
            np.add.at(spectrum[:, column], bins % grid.n_fine,
                      coarse[bins % grid.n_coarse, column - len(wavenumbers) // 2])
    return spectrum


def fused_image(grid: UnifiedPolarGrids, spectrum: np.ndarray, centre_m: float = 0.0
                ) -> np.ndarray:
    """Polar image of a fused spectrum, without the guards.

    The inverse transform of Zhang et al., section II.B, step 4. Where the image is to be
    interpolated to a map, each angular frequency is multiplied by what that takes from it
    (deapodisation).

    Parameters
    ----------
    grid, spectrum :
        From `fuse_bands`.
    centre_m : float
        The image is given at baseband along direction for a sub-aperture there, metres.

    Returns
    -------
    (n_alpha, n_range) complex128
        On ``grid.polar`` at range baseband, times
        ``exp(-j 4 pi centre_m (alpha - alpha_0) / lambda)``.
    """
    polar, n_bins = grid.polar, spectrum.shape[1]
    if grid.between is not None:
        cycles = np.fft.fftfreq(grid.n_fine) - 2 * centre_m * (
            polar.alpha_spacing / grid.wavelength_m)
        spectrum = spectrum * grid.between.gain(cycles - np.rint(cycles))[:, None]
    whole = np.zeros((grid.n_fine, grid.n_fine_range), np.complex128)
    whole[:, np.arange(n_bins) - n_bins // 2] = spectrum
    image = np.fft.ifft2(whole) * (whole.size / (grid.n_coarse * grid.n_coarse_range))
    image = image[grid.fine_guard:, grid.fine_range_guard:][:polar.n_alpha, :polar.n_range]
    # sub-aperture images have their phase from where the guards begin
    guard = 2 * grid.fine_range_guard * polar.range_spacing_m / grid.wavelength_m
    cycles = guard - 2 * centre_m * (polar.alpha - polar.alpha_start) / grid.wavelength_m
    return image * np.exp(2j * np.pi * np.fmod(cycles, 1.0))[:, None]
