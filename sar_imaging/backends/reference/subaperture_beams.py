# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image of a sub-aperture by way of its beams: operations 5 and 6, chained as a plan says."""

from __future__ import annotations

import math

import numpy as np

from ...planning.afbp.beams import CELL_TAPS, BeamGeometry, grid_edges
from ...planning.afbp.illumination import AmplitudeNodes, parabola
from ...planning.afbp.subapertures import SubaperturePlan
from .form_beams import beam_profiles, form_beams
from .interpolate_beams import BeamImage, interpolate_beams
from .resample_profiles import profile_spectra


def image_from_beams(plan: SubaperturePlan, samples: np.ndarray, tx_m: np.ndarray,
                     rx_m: np.ndarray, nodes: AmplitudeNodes | None = None) -> np.ndarray:
    """Backproject echoes to the coarse grid of a plan by their beams.

    Parameters
    ----------
    plan : SubaperturePlan
        With beams.
    samples : (R, N) complex64
        Profiles, or phase histories.
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    nodes : AmplitudeNodes, optional
        Through whose amplitudes parabolas go.

    Returns
    -------
    (n_alpha, n_range) complex128
        On ``plan.coarse`` at range baseband.

    Raises
    ------
    ValueError
        The plane is too steep below the echoes for their directions to be told apart.
    """
    polar, source, resampling, sampling = plan.coarse, plan.source, plan.resampling, plan.beams
    assert sampling is not None  # of a plan with beams
    geometry = BeamGeometry.of(polar, grid_edges(polar), tx_m, rx_m)
    if geometry is None:
        raise ValueError(f'the imaging plane, {polar.z_m:g} m high, is too steep below the phase '
                         f'centres around {tx_m.mean(axis=0).round(2)}; use exact backprojection')
    start, spacing, n_beams = sampling.directions(geometry, tx_m, rx_m)
    path_m = geometry.beam_path(tx_m, rx_m, start + spacing * np.arange(n_beams))
    spectra = profile_spectra(source, samples, resampling.n_padded)
    n_cells, number = resampling.n_cells, np.arange(resampling.n_padded) - resampling.n_padded // 2
    beams = form_beams(spectra, path_m, 2 / source.radar.wavelength_m
                       + number / (n_cells * resampling.cell_m), sampling.between)
    first = math.floor((plan.range_m[0] - source.range_start_m) / resampling.cell_m) - CELL_TAPS
    profiles = beam_profiles(beams, n_cells, first,
                             sampling.range_gain(np.ones(len(number)), number, n_cells))
    if not source.periodic:  # a profile is zero beyond its ends
        cell = first + np.arange(n_cells)
        profiles[:, (cell < 0) | (cell >= n_cells)] = 0.0
    image = BeamImage(profiles, geometry.centre_m, polar.track, (start, spacing),
                      (source.range_start_m + first * resampling.cell_m, resampling.cell_m),
                      geometry.range_m)
    points_m = polar.lines(polar.range_m, polar.alpha[:, None])[0]
    parabolas = None if nodes is None else amplitude_parabolas(
        nodes, geometry, points_m, 2 * np.pi * spacing * 2 / source.radar.wavelength_m)
    value = interpolate_beams(image, points_m, source.radar.wavelength_m,
                              sampling.between.interpolator, sampling.along, parabolas)
    cycles = 2 * (polar.range_m - polar.range_start_m
                  + source.phase_range_m) / source.radar.wavelength_m
    return value * np.exp(-2j * np.pi * np.fmod(cycles, 1.0))


def amplitude_parabolas(nodes: AmplitudeNodes, geometry: BeamGeometry, points_m: np.ndarray,
                        phase_per_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and C of the amplitude ``A + B p + C p^2`` of echoes, towards each point.

    p is the phase of an echo from beam to beam: the derivative of its path by direction, metres,
    times `phase_per_m`. The parabola goes through three nodes.
    """
    flat = points_m.reshape(-1, 3)
    offset = flat - geometry.centre_m
    direction = offset[:, :2] @ np.array(geometry.polar.track) / np.linalg.norm(offset, axis=1)
    phase = phase_per_m * geometry.slope(nodes.tx_m, nodes.rx_m, direction)
    a, b, c = (v.reshape(points_m.shape[:-1])
               for v in parabola(phase, nodes.illumination.amplitude(flat).T))
    return a, b, c
