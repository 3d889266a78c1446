# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 5: beams of a sub-aperture, from the spectra of its echoes."""

from __future__ import annotations

import numpy as np

from ...planning.afbp.beams import BeamGain


def form_beams(spectra: np.ndarray, path_m: np.ndarray, cycles_per_m: np.ndarray, between: BeamGain
               ) -> np.ndarray:
    """Sum of the echoes' spectra with the delays of each direction.

    ``B_m[n] = sum_r g(f_rm[n]) S_r[n] exp(j 2 pi c_n L_rm)``: L_rm is by how much the half path
    of echo r in the direction of beam m is longer than that of the sub-aperture's middle, c_n the
    cycles per metre of half path of frequency n. Seen from beam to beam an echo is an exponential
    of frequency ``f = c_n dL/dm``; its gain g makes up for what the interpolation between beams
    takes from it (deapodisation of gridding: O'Sullivan 1985, Jackson et al. 1991).

    Parameters
    ----------
    spectra : (R, N) complex128
        Spectra of the echoes.
    path_m : (M, R) float64
        L, metres.
    cycles_per_m : (N,) float64
        c, carrier included, 1/m.
    between : BeamGain
        Gain and interpolator.

    Returns
    -------
    (M, N) complex128
    """
    by_beam = np.gradient(path_m, axis=0)
    beams = np.zeros((len(path_m), len(cycles_per_m)), np.complex128)
    for echo, spectrum in enumerate(spectra):
        cycles = np.multiply.outer(path_m[:, echo], cycles_per_m)
        frequency = np.multiply.outer(by_beam[:, echo], cycles_per_m)
        gain = np.exp(np.interp(np.abs(frequency), between.step * np.arange(len(between.log_gain)),
                                between.log_gain))
        beams += gain * spectrum * np.exp(
            2j * np.pi * np.fmod(cycles, 1.0))
    return beams


def beam_profiles(beams: np.ndarray, n_cells: int, first: int, gain: np.ndarray) -> np.ndarray:
    """Range profiles of beams at cells.

    ``b[i] = sum_n g_n B[n] exp(j 2 pi n (first + i) / n_cells)``.

    Parameters
    ----------
    beams : (M, N) complex128
        Spectra, from frequency number ``-(N // 2)`` on; those that cells cannot hold are left out.
    n_cells : int
        Cells of the period.
    first : int
        Number of the first one.
    gain : (N,) float64
        What interpolation along range takes from each frequency.

    Returns
    -------
    (M, n_cells) complex128
    """
    number = np.arange(beams.shape[1]) - beams.shape[1] // 2
    kept = (number >= -(n_cells // 2)) & (number < (n_cells + 1) // 2)
    shift = np.exp(2j * np.pi * np.fmod(number[kept] * (first / n_cells), 1.0))
    bins = np.zeros((len(beams), n_cells), np.complex128)
    bins[:, number[kept] % n_cells] = (beams * gain)[:, kept] * shift
    return n_cells * np.fft.ifft(bins)
