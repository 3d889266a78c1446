# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the evidence for an answer of autofocus goes: whether to use it, and to claim it."""

from __future__ import annotations

import math

import numpy as np

from ..signal.pulses import PulseBlock
from .models import GeometryModel
from .report import PARAMETERS, AutofocusReport
from .residual import deal
from .search import detrend, search
from .tiles import Tiles

FEWEST_TO_CLAIM = 4  # bright points without which success is not claimed
LEAST_TO_CLAIM = 0.8  # coherence of bright points
# Of points in phase: simulated ones that are focused have 0.89 to 0.97, those of the Gotcha data
# 0.82; ghosts had up to 0.57, and once 0.76.
LEAST_COHERENCE = 0.7
LARGEST_DISAGREEMENT_RAD = 0.5  # of two halves of a scene
_SUBAPERTURES = 128  # of these halves
_FEWEST_POINTS = 2  # of a half
FEW_UNKNOWNS = 3  # they cannot make ghosts
CLEARLY = 1.05  # gain of contrast that outweighs weak evidence


def doubts(report: AutofocusReport, n_unknowns: int, least_coherence: float) -> list[str]:
    """Reasons not to use an answer, in words.

    Parameters
    ----------
    report : AutofocusReport
        What is known of the answer.
    n_unknowns : int
        Parameters or phases that it was chosen by.
    least_coherence : float
        Least coherence of the bright points that is asked for, 0 to 1.
    """
    out = [] if report.curve is None else report.curve.doubts(_told(report))
    if n_unknowns > FEW_UNKNOWNS and report.coherence < least_coherence:
        out.append(f'the bright points are not in phase (coherence {report.coherence:.2f}, '
                   f'{least_coherence:g} is asked for): perhaps ghosts')
    if report.curve is None and report.answer == PARAMETERS:
        if report.disagreement_rad > LARGEST_DISAGREEMENT_RAD:
            out.append('the two halves of the scene ask for corrections that differ by '
                       f'{report.disagreement_rad:.1f} rad: perhaps ghosts')
        elif (math.isnan(report.disagreement_rad)
              and report.contrast_found < CLEARLY * report.contrast_before):
            out.append(f'{report.n_points} bright points are too few to trust so small a gain')
    return out


def open_points(report: AutofocusReport, claim_db: float) -> list[str]:
    """Reasons not to claim that an answer is right, in words.

    Parameters
    ----------
    report : AutofocusReport
        What is known of the answer.
    claim_db : float
        Estimated error up to which it is claimed, dB.
    """
    out = [] if report.curve is None else report.curve.open_points(_told(report))
    if report.n_points < FEWEST_TO_CLAIM:
        out.append(f'only {report.n_points} bright points stand for the scene')
    if report.curve is not None and report.answer == PARAMETERS:
        if not report.disagreement_rad <= 2 * LARGEST_DISAGREEMENT_RAD:  # each of their middle
            out.append('two halves of the scene ask for corrections that differ by '
                       f'{report.disagreement_rad:.1f} rad')
        return out
    if report.coherence < LEAST_TO_CLAIM:
        out.append(f'the bright points are not in phase (coherence {report.coherence:.2f}, '
                   f'{LEAST_TO_CLAIM} is asked for)')
    if report.estimated_error_db > claim_db:
        out.append(f'the estimated error of {report.estimated_error_db:.0f} dB is above '
                   f'{claim_db:g} dB')
    return out


def _told(report: AutofocusReport) -> float:
    """Coherence of the bright points, where there are enough to tell by it; else 0."""
    return float(np.nan_to_num(report.coherence)) * (report.n_points >= FEWEST_TO_CLAIM)


def disagreement_rad(block: PulseBlock, model: GeometryModel, parameters: np.ndarray,
                     points: np.ndarray) -> float:
    """Rms difference of the phases that two halves of the bright points ask for, radians.

    Each half is searched for the sharpest parameters by itself, from the common ones on. What only
    displaces a tile does not count. An error that is right agrees to a fraction of a radian;
    parameters that merely make noise or ghosts sharper suit one half and not the other.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    model : GeometryModel
        Unknowns.
    parameters : (Q,) float64
        Found with all points.
    points : (K, 3) float64
        Bright points of the image with these parameters, metres.

    Returns
    -------
    float
        NaN where a half has fewer than two points.
    """
    geometry = model(parameters)
    half = deal(points, geometry)
    if not len(parameters) or min(np.bincount(half, minlength=2)) < _FEWEST_POINTS:
        return math.nan
    tiles = Tiles(block, geometry, points, min(_SUBAPERTURES, block.n_pulses))
    changes = []
    for k in (0, 1):
        found = search(block, model, points[half == k], parameters, first_segments=1)
        changes.append(tiles.half_path_change(model(found.parameters)))
    return float(tiles.wavenumber * np.sqrt(np.mean(np.square(detrend(changes[0] - changes[1])))))
