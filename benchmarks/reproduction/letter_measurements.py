# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measurements of `reproduce_spotlight_letter`: the responses of points 1 to 3."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from benchmarks.reproduction.letter_scene import (
    PAIR_SEPARATION_M,
    SUBSCENE_M,
    SpotlightExperiment,
)
from sar_imaging.geometry import MapGrid
from sar_imaging.quality import ScattererQuality, measure_scatterer, sample_image

PATCH_SPACING_M = 0.05
CUT_HALF_WIDTH_M = 3.0  # of the point responses, on both axes
CUT_STEP_M = 0.005
#: Phases of the echo of point 2 to that of point 1 at which separation is looked at, degrees.
PAIR_PHASES_DEG = (0, 90, 120, 150, 180)


def subscene_grid(experiment: SpotlightExperiment) -> MapGrid:
    """Grid of the magnified subscene."""
    return MapGrid.from_size(experiment.subscene_centre_m, SUBSCENE_M, SUBSCENE_M,
                             PATCH_SPACING_M)


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two responses in a cut.

    Parameters
    ----------
    peaks_m : (2,) tuple of float
        Where the two highest maxima stand along the cut, ascending, metres; one value twice when
        there is no second within 10 dB of the first.
    dip_db : float
        Lowest level between them relative to the lower of the two, dB; 0 when they are one.
    imbalance_db : float
        Level of the lower to the higher, dB.
    sidelobe_db : float
        Highest level outside relative to the higher, beyond the first minima, dB.
    """

    peaks_m: tuple[float, float]
    dip_db: float
    imbalance_db: float
    sidelobe_db: float

    @property
    def separation_m(self) -> float:
        """Distance of the two maxima, metres; 0 when they are one."""
        return self.peaks_m[1] - self.peaks_m[0]


def measure_pair(cut, offset_m) -> Pair:
    """Measure a finely sampled cut through two points.

    Parameters
    ----------
    cut : (n,) complex
        Image along the cut.
    offset_m : (n,) float64
        Positions, ascending, metres.

    Returns
    -------
    Pair
    """
    power = np.abs(np.asarray(cut)) ** 2
    maxima = 1 + np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]))
    minima = 1 + np.flatnonzero((power[1:-1] < power[:-2]) & (power[1:-1] <= power[2:]))
    near = maxima[np.abs(offset_m[maxima]) <= 2 * PAIR_SEPARATION_M]
    near = near[power[near] > 0.1 * power[near].max()]
    low, high = np.sort(near[np.argsort(power[near])[-2:]])[[0, -1]]
    top = max(power[low], power[high])
    start = minima[minima < low].max(initial=0)
    stop = minima[minima > high].min(initial=power.size - 1)
    outside = np.concatenate([power[:start + 1], power[stop:]])
    between = power[low:high + 1].min()
    return Pair((float(offset_m[low]), float(offset_m[high])),
                _decibels(between, min(power[low], power[high])),
                _decibels(min(power[low], power[high]), top), _decibels(outside.max(), top))


def _decibels(power, reference) -> float:
    return 10 * math.log10(max(power / reference, 1e-12))


@dataclasses.dataclass(frozen=True)
class SubsceneImage:
    """Subscene of the letter by one imager, and the responses in it.

    Parameters
    ----------
    image : (n_y, n_x) complex64
        On the grid of the subscene.
    single, pair_cut : (n,) complex128
        Azimuth cuts through point 3 and through points 1 and 2, at `offset_m`.
    offset_m : (n,) float64
        From point 3 and from the middle of the pair, metres.
    quality : ScattererQuality
        Of point 3.
    pair : Pair
        Points 1 and 2.
    """

    image: np.ndarray
    single: np.ndarray
    pair_cut: np.ndarray
    offset_m: np.ndarray
    quality: ScattererQuality
    pair: Pair


def measure_subscene(image, grid: MapGrid, experiment: SpotlightExperiment) -> SubsceneImage:
    """Cuts and figures of points 1 to 3.

    Parameters
    ----------
    image : (n_y, n_x) complex
        Image on `grid` with the carrier phase of backprojection.
    grid : MapGrid
        Pixels of the subscene.
    experiment : SpotlightExperiment
        With the true positions.

    Returns
    -------
    SubsceneImage
    """
    one, two, three = (np.array(s.position_m) for s in experiment.scatterers[:3])
    n = round(CUT_HALF_WIDTH_M / CUT_STEP_M)
    offset = np.arange(-n, n + 1) * CUT_STEP_M
    phase = {'aperture_centre_m': (0.0, 0.0, 0.0),
             'wavenumber_rad_per_m': experiment.radar.wavenumber_rad_per_m}

    def cut(centre):
        azimuth = np.array([-centre[1], centre[0]]) / math.hypot(*centre[:2])
        return sample_image(image, grid, centre[:2] + offset[:, None] * azimuth, **phase)

    quality = measure_scatterer(
        image, grid, three, cut_half_width_range_m=CUT_HALF_WIDTH_M,
        cut_half_width_azimuth_m=CUT_HALF_WIDTH_M, name='point 3',
        neighbours_m=[s.position_m for s in experiment.scatterers if s.name != 'point 3'],
        **phase)
    pair_cut = cut((one + two) / 2)
    return SubsceneImage(image, cut(three), pair_cut, offset, quality,
                         measure_pair(pair_cut, offset))


def separability(response, offset_m) -> dict[int, Pair]:
    """What a pair looks like at several phases, from the response of one point.

    Two points add up; at 0.15 m both have the same response.

    Parameters
    ----------
    response : (n,) complex
        Azimuth cut through one point at its middle.
    offset_m : (n,) float64
        Positions, uniform, metres.

    Returns
    -------
    dict of phase in degrees to Pair
    """
    shift = round(PAIR_SEPARATION_M / (offset_m[1] - offset_m[0]))
    middle = 0.5 * (offset_m[shift:] + offset_m[:-shift])
    return {phase: measure_pair(
        response[shift:] + np.exp(1j * np.radians(phase)) * response[:-shift], middle)
        for phase in PAIR_PHASES_DEG}
