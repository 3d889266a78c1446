# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Report of autofocus: the errors found, contrast before and after, and whether to believe it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..signal.pulses import PulseBlock
from .offset_curve import OffsetCurve

ORIGINAL, PARAMETERS, PHASES = 'original', 'parameters', 'residual phases'
FOCUSED, FOCUSED_ALREADY = 'focused by autofocus', 'focused already'
SHARPENED = 'sharpened by autofocus, focus not confirmed'
NOT_CHANGED = 'not changed by autofocus, focus not confirmed'


@dataclasses.dataclass(frozen=True)
class AutofocusReport:
    """What autofocus did to one image.

    Attributes
    ----------
    accepted : bool
        True when a corrected image replaced the original. That alone does not mean that it is in
        focus.
    success : bool
        True when the image returned, corrected or not, is claimed to be focused.
    reason : str
        Why, in a sentence.
    contrast_before, contrast_after : float
        Contrast of the original and of the image returned; where clock offsets were searched for,
        on the pixels that the profiles reach from both tracks.
    entropy_before, entropy_after : float
        Their entropies, nats.
    contrast_found : float
        Contrast of the best corrected image, returned or not; NaN when none was formed.
    answer : str
        Where the best corrected image comes from: ``'parameters'`` of the geometry model alone,
        or these and ``'residual phases'``. ``'original'`` when none was formed.
    estimated_error_db : float
        Estimated error of that image against one with the true geometry, but for what no image
        shows (a displacement), dB; NaN when nothing could be estimated.
    coherence : float
        Coherence of the contributions to the best points, see `residual.Residual`.
    disagreement_rad : float
        Disagreement of two halves of the scene on the parameters, see `evidence.disagreement_rad`.
    parameters : dict of str to float
        Estimated parameters of the geometry model.
    uncertainty : dict of str to float
        Part of each that the image does not determine, in its unit.
    correction_m : float
        Rms change of the half path to the scene's middle, without constant and line, metres.
    largest_move_m : float
        Largest displacement of a phase centre, metres.
    n_points : int
        Bright points used.
    curve : OffsetCurve or None
        Contrast against the offset of the clocks, where that was searched for.

    Examples
    --------
    >>> from sar_imaging.autofocus import AutofocusReport
    >>> report = AutofocusReport(accepted=False, success=False, reason='no bright points',
    ...                          contrast_before=1.0, contrast_after=1.0, entropy_before=9.2,
    ...                          entropy_after=9.2)
    >>> report.verdict
    'not changed by autofocus, focus not confirmed'
    """

    accepted: bool
    success: bool
    reason: str
    contrast_before: float
    contrast_after: float
    entropy_before: float
    entropy_after: float
    contrast_found: float = math.nan
    answer: str = ORIGINAL
    estimated_error_db: float = math.nan
    coherence: float = math.nan
    disagreement_rad: float = math.nan
    parameters: dict[str, float] = dataclasses.field(default_factory=dict)
    uncertainty: dict[str, float] = dataclasses.field(default_factory=dict)
    correction_m: float = 0.0
    largest_move_m: float = 0.0
    n_points: int = 0
    curve: OffsetCurve | None = None

    @property
    def verdict(self) -> str:
        """What the image is now, in few words."""
        if self.accepted:
            return FOCUSED if self.success else SHARPENED
        return FOCUSED_ALREADY if self.success else NOT_CHANGED

    @property
    def details(self) -> str:
        """Why, and the figures."""
        error = (f', estimated error {self.estimated_error_db:.0f} dB'
                 if self.success and self.estimated_error_db < 0 else '')
        return (f'{self.reason}; contrast {self.contrast_before:.3g} -> '
                f'{self.contrast_after:.3g}, entropy {self.entropy_before:.3f} -> '
                f'{self.entropy_after:.3f}{error}')

    def __str__(self) -> str:
        return f'{self.verdict}: {self.details}'


@dataclasses.dataclass(frozen=True)
class AutofocusResult:
    """Image, pulses and report of one aperture.

    Attributes
    ----------
    image : complex64 array
        Corrected where accepted, else the original.
    block : PulseBlock
        The pulses with the phase centres of that image.
    report : AutofocusReport
        What was done.

    Examples
    --------
    >>> from sar_imaging.autofocus import Autofocus
    >>> from sar_imaging.simulation import flawed_aperture
    >>> case = flawed_aperture('smooth', 0.5, seed=1, n_pulses=64, half_scene_m=6.0)
    >>> result = Autofocus(case.grid, n_phases=0, n_points=8).process(case.stated)
    >>> result.image.shape, result.block.n_pulses, result.report.answer
    ((64, 64), 64, 'parameters')
    """

    image: np.ndarray
    block: PulseBlock
    report: AutofocusReport


def found_in_words(report: AutofocusReport) -> str:
    """The best correction that was found, and the contrast that it gives."""
    offset = report.parameters.get('time_offset_s')
    what = (f'positions that move by up to {report.largest_move_m:.2g} m' if offset is None else
            f'a clock offset of {offset:+.4g} s')
    phases = ' and residual phases' if report.answer == PHASES else ''
    return (f'{what}{phases} would change the contrast from {report.contrast_before:.3g} to '
            f'{report.contrast_found:.3g}')
