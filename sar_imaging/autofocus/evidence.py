"""How far the evidence for an answer of autofocus goes: whether to use it, and to claim it."""

from __future__ import annotations

import math

from .report import PARAMETERS, AutofocusReport

FEWEST_TO_CLAIM = 4  # bright points without which success is not claimed
LEAST_TO_CLAIM = 0.8  # coherence of bright points
# Of points in phase: simulated ones that are focused have 0.89 to 0.97, those of the Gotcha data
# 0.82; ghosts had up to 0.57, and once 0.76.
LEAST_COHERENCE = 0.7
# Of the halves of a scene: to claim, and to use what a whole curve supports.
LARGEST_DISAGREEMENT_RAD, _FARTHEST_DISAGREEMENT_RAD = 0.5, 4.0
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
        Of the bright points that is asked for, 0 to 1.
    """
    out = [] if report.curve is None else report.curve.doubts(_in_phase(report))
    if n_unknowns > FEW_UNKNOWNS and report.coherence < least_coherence:
        out.append(f'the bright points are not in phase (coherence {report.coherence:.2f}, '
                   f'{least_coherence:g} is asked for): perhaps ghosts')
    limit = (LARGEST_DISAGREEMENT_RAD if report.curve is None else
             _FARTHEST_DISAGREEMENT_RAD)
    if report.answer == PARAMETERS and report.disagreement_rad > limit:
        out.append('the two halves of the scene ask for corrections that differ by '
                   f'{report.disagreement_rad:.1f} rad: perhaps ghosts')
    elif (report.curve is None and report.answer == PARAMETERS
          and math.isnan(report.disagreement_rad)
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
    out = [] if report.curve is None else report.curve.open_points(_in_phase(report))
    if report.n_points < FEWEST_TO_CLAIM:
        out.append(f'only {report.n_points} bright points stand for the scene')
    if report.curve is not None and report.answer == PARAMETERS:
        if not report.disagreement_rad <= LARGEST_DISAGREEMENT_RAD:
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


def _in_phase(report: AutofocusReport) -> bool:
    return report.coherence >= LEAST_COHERENCE and report.n_points >= FEWEST_TO_CLAIM
