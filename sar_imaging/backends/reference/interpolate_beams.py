# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 6: lines of a polar image, from the beams of a sub-aperture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...planning.interpolators import Interpolator
from .farrow import neighbours


class BeamImage(NamedTuple):
    """Beams of a sub-aperture by direction and range from its middle.

    Parameters
    ----------
    profiles : (M, n) complex128
        Beams at cells of half path, at baseband.
    centre_m : (3,) float64
        Middle of the sub-aperture, metres.
    track : (2,) floats
        Horizontal unit vector from which directions are measured.
    direction : (float, float)
        Direction cosine of the first beam, and spacing of beams.
    cells_m : (float, float)
        Half path of the first cell, and spacing of cells, metres.
    range_m : float
        Distance whose curvature the beams have, metres.
    """

    profiles: np.ndarray
    centre_m: np.ndarray
    track: tuple[float, float]
    direction: tuple[float, float]
    cells_m: tuple[float, float]
    range_m: float


def interpolate_beams(beams: BeamImage, points_m: np.ndarray, wavelength_m: float,
                      between: Interpolator, along: Interpolator,
                      parabolas: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
                      ) -> np.ndarray:
    """Value of the sub-aperture's image at points, with the phase of the middle's path.

    At distance d and direction cosine s from the middle, ``f = exp(j k d) (b + j e b'')``: b is
    the beams interpolated to (s, d) between beams and along range, b'' its second derivative by
    the number of the beam. Paths bend by ``X^2 (1 - s^2) / 2 (1/d - 1/d_0)`` more than those of
    beams, which are for distance d_0. An echo at X turns by ``-k X ds`` from beam to beam, ds
    apart: b'' is ``-k^2 X^2 ds^2 b``, and ``e = -(1 - s^2) (1/d - 1/d_0) / (2 k ds^2)`` makes
    the bend good to first order.

    With illumination, an echo of the phase p from beam to beam has the amplitude
    ``A + B p + C p^2``, and ``A b - j B b' - C b''`` takes the place of b.

    Parameters
    ----------
    beams : BeamImage
        From `form_beams`.
    points_m : (..., 3) float64
        Positions, metres.
    wavelength_m : float
        At the carrier, metres.
    between, along : Interpolator
        Between beams and along range.
    parabolas : (A, B, C), each (...) float64, optional
        Parabolas of the amplitude.

    Returns
    -------
    (...) complex128
    """
    offset = points_m - beams.centre_m
    distance = np.linalg.norm(offset, axis=-1)
    direction = offset[..., :2] @ np.array(beams.track) / distance
    place = (direction - beams.direction[0]) / beams.direction[1]
    beam, weights = neighbours(between, place, len(beams.profiles))
    bend = second_derivatives(between, place - (beam[..., 0] - between.first))
    cell, along_range = neighbours(along, (distance - beams.cells_m[0]) / beams.cells_m[1],
                                   beams.profiles.shape[1])
    read = beams.profiles[beam[..., :, None], cell[..., None, :]]
    wavenumber = 4 * np.pi / wavelength_m
    curvature = -(1 - direction ** 2) * (1 / distance - 1 / beams.range_m) / (
        2 * wavenumber * beams.direction[1] ** 2)
    taps = weights + 1j * curvature[..., None] * bend
    if parabolas is not None:
        a, b, c = (v[..., None] for v in parabolas)
        slope = first_derivatives(between, place - (beam[..., 0] - between.first))
        taps = a * taps - 1j * b * slope - c * bend
    value = np.einsum('...k,...l,...kl->...', taps, along_range, read)
    return value * np.exp(2j * np.pi * np.fmod(2 * distance / wavelength_m, 1.0))


def first_derivatives(interpolator: Interpolator, t: np.ndarray) -> np.ndarray:
    """First derivatives of the weights; otherwise as `second_derivatives`."""
    power = np.arange(1, len(interpolator.weights))
    once = power[:, None] * interpolator.weights[1:].astype(np.float64)
    return t[..., None] ** (power - 1) @ once


def second_derivatives(interpolator: Interpolator, t: np.ndarray) -> np.ndarray:
    """Second derivatives of the weights by the place between two samples.

    Parameters
    ----------
    interpolator : Interpolator
        Whose weights are polynomials of t.
    t : (...) float64
        Places, 0 to 1.

    Returns
    -------
    (..., taps) float64
    """
    power = np.arange(2, len(interpolator.weights))
    twice = (power * (power - 1))[:, None] * interpolator.weights[2:].astype(np.float64)
    return t[..., None] ** (power - 2) @ twice
