# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Spectra of sub-aperture images and their place in the fused one: figures 3 and 4."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy.fft

from benchmarks.reproduction.letter_scene import SUBSCENE_M
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.radar import SPEED_OF_LIGHT

from .letter_measurements import subscene_grid
from .letter_recording import Recording

#: Sub-apertures of the picture: those of the letter would be too narrow to be seen.
N_SUBAPERTURES = 16
SHOWN = 11  # sub-aperture whose spectrum is drawn by itself
_OVERSAMPLING = 1.5  # of sub-aperture images in range and direction


@dataclasses.dataclass(frozen=True)
class Spectra:
    """Magnitudes over angular and range wavenumber, both ascending.

    Angular wavenumbers are given as the position along the track to which they belong at the
    carrier, ``x = -K_alpha / k_c`` (Zhang et al., equation 13).

    Parameters
    ----------
    coarse : (n_coarse, n_range) float32
        Of one sub-aperture image as its Fourier transform gives it: folded.
    coarse_m : (n_coarse,) float64
        Its track positions, metres, one period around zero.
    placed, fused : (n_fine, n_range) float32
        The same unfolded, and the sum over all sub-apertures.
    track_m : (n_fine,) float64
        Their track positions, metres.
    frequency_hz : (n_range,) float64
        Range wavenumbers as frequencies, relative to the carrier, hertz.
    subaperture_m : (float, float)
        Ends of the sub-aperture shown, metres along the track.
    aperture_m : float
        Length of the aperture, metres.
    carrier_hz, bandwidth_hz : float
        Of the radar.
    """

    coarse: np.ndarray
    coarse_m: np.ndarray
    placed: np.ndarray
    fused: np.ndarray
    track_m: np.ndarray
    frequency_hz: np.ndarray
    subaperture_m: tuple[float, float]
    aperture_m: float
    carrier_hz: float
    bandwidth_hz: float


def _coarse_grid(recording: Recording) -> PolarGrid:
    """Polar grid of the subscene, coarse in direction, for one sub-aperture."""
    experiment = recording.experiment
    radar, (x, y, _) = experiment.radar, experiment.subscene_centre_m
    r, alpha = math.hypot(x, y), y / math.hypot(x, y)
    range_spacing = radar.range_resolution_m / _OVERSAMPLING
    # the highest frequency of the band has the finest structure
    wavelength = radar.shortest_wavelength_m
    alpha_spacing = wavelength / (2 * experiment.aperture_m / N_SUBAPERTURES) / _OVERSAMPLING
    n_range, n_alpha = (round(SUBSCENE_M / s) for s in (range_spacing, alpha_spacing * r))
    return PolarGrid((0.0, 0.0, 0.0), (0.0, 1.0), -1, 0.0, r - n_range // 2 * range_spacing,
                     range_spacing, n_range, alpha - n_alpha // 2 * alpha_spacing,
                     alpha_spacing, n_alpha)


def measure_spectra(recording: Recording) -> Spectra:
    """Form sub-aperture images of the subscene and transform them.

    Parameters
    ----------
    recording : Recording
        Of the letter; image without window to see the whole band.

    Returns
    -------
    Spectra
    """
    experiment = recording.experiment
    block = recording.patch_profiles(subscene_grid(experiment))
    radar, grid = block.radar, _coarse_grid(recording)
    imager = plan_image(grid.lines(grid.range_m, grid.alpha[:, None])[0], radar, block.n_samples,
                        method='exact', target_db=-60.0)
    # towards the edges to zero, as the image is not periodic; and to range baseband
    factor = (np.outer(np.hanning(grid.n_alpha), np.hanning(grid.n_range))
              * np.exp(-1j * radar.wavenumber_rad_per_m * grid.range_m))
    n_coarse, n_fine, column = grid.n_alpha, grid.n_alpha * N_SUBAPERTURES, np.arange(grid.n_range)
    wavenumber = 2 * np.pi * scipy.fft.fftfreq(grid.n_range, grid.range_spacing_m)
    stretch = 1 + wavenumber / radar.wavenumber_rad_per_m
    # of a bin, as a position on the track
    width_m = 2 * np.pi / (n_coarse * grid.alpha_spacing) / radar.wavenumber_rad_per_m
    fused = np.zeros((n_fine, grid.n_range), np.complex64)
    edges = np.arange(N_SUBAPERTURES + 1) * (experiment.n_pulses // N_SUBAPERTURES)
    for number, pulses in enumerate(map(slice, edges[:-1], edges[1:])):
        part = block.select(pulses)
        coarse = scipy.fft.fft2(imager(part).samples * factor)
        track = part.tx_m[:, 0, 1]
        middle = np.rint(-track.mean() * stretch / width_m).astype(int)
        bins = middle + np.arange(n_coarse)[:, None] - n_coarse // 2
        placed = np.zeros_like(fused)
        placed[bins % n_fine, column] = coarse[bins % n_coarse, column]
        fused += placed
        if number == SHOWN:
            shown = np.abs(coarse), np.abs(placed), (float(track[0]), float(track[-1]))

    def ascending(magnitude):
        # a position on the track has the opposite sign of its wavenumber
        return scipy.fft.fftshift(magnitude)[::-1]

    def positions(n):
        return -width_m * scipy.fft.fftshift(scipy.fft.fftfreq(n, 1 / n))[::-1]

    return Spectra(ascending(shown[0]), positions(n_coarse), ascending(shown[1]),
                   ascending(np.abs(fused)), positions(n_fine),
                   scipy.fft.fftshift(wavenumber) * SPEED_OF_LIGHT / (4 * np.pi),
                   shown[2], experiment.aperture_m, radar.carrier_hz, radar.bandwidth_hz)
