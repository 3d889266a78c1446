# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus of an aperture: estimate errors, image again exactly, accept only a sharper image."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..backends import AUTO
from ..geometry.grids import MapGrid
from ..imaging.imager import plan_image
from ..quality.measures import contrast, entropy
from ..signal.pulses import PulseBlock
from . import evidence
from .evidence import (
    CLEARLY,
    FEW_UNKNOWNS,
    FEWEST_TO_CLAIM,
    LARGEST_DISAGREEMENT_RAD,
    LEAST_COHERENCE,
    LEAST_TO_CLAIM,
    disagreement_rad,
)
from .models import (
    OFFSET,
    Geometry,
    GeometryModel,
    apply_geometry,
    by_offset,
    narrowed,
    nominal,
    with_track_error,
    within,
)
from .offset_curve import OffsetCurve
from .offset_search import COVERED, OffsetSearch, coverage
from .report import PARAMETERS, PHASES, AutofocusReport, AutofocusResult, found_in_words
from .residual import Residual, absorb, along_sight, estimate_residual
from .search import search
from .tiles import bright_points

if TYPE_CHECKING:
    from ..backends.protocol import Backend
    from ..geometry.illumination import AntennaPattern

__all__ = ['Autofocus', 'AutofocusReport', 'AutofocusResult']
_logger = logging.getLogger(__name__)
_FEWEST_TO_ABSORB = 12
_FEWEST_PULSES = 32  # below it there is no telling a phase error from the scene
N_PHASES = 512
_VARYING_RAD = 0.03  # smooth phase over the scene from which the model is asked again
_MOST_PASSES = 2
_PHASES_TO_JUDGE = 128  # where none are to be corrected
# Visible phase over all offsets: below the first an offset only displaces, below the second the
# search from the middle finds it, and there is no surrounding to judge by.
_LEAST_VISIBLE_RAD, _WIDE_RAD = 2.0, 12.0
_COARSE = 64  # places along each axis at which it is asked whether profiles reach
_FEW_SEEN = 0.1  # of the pixels


class _Answer(NamedTuple):
    """A corrected image and where it comes from."""

    kind: str
    n_unknowns: int  # that it was chosen by
    parameters: np.ndarray
    block: PulseBlock
    image: np.ndarray
    contrast: float


class Autofocus:
    """Estimate errors of the phase centres from an image, and image again without them.

    Parameters
    ----------
    grid : MapGrid
        Grid of the image.
    model : callable, optional
        From a PulseBlock to a `GeometryModel`; a smooth three-dimensional track error of
        `scale_m` if left out.
    imager : callable, optional
        From a PulseBlock to its image on the grid; exact backprojection if left out.
    target_db : float
        Largest error of images by exact backprojection against correlation to plan for, dB.
    illumination : AntennaPattern, optional
        Illumination of exact backprojection, as for `plan_image`.
    backend : str or Backend
        What computes images and those of trials, as for `plan_image`.
    progress : callable, optional
        Called with the number of clock offsets that were tried and with their total, as they are.
    scale_m : float
        Expected size of the track error, metres, for the default model.
    offset_reach_s : float
        Largest error of the model's parameter ``time_offset_s`` to search for, seconds, by trial
        images all over this range; 0 where the error is so small that the search around the start
        finds it.
    n_phases : int
        Most phases of the residual correction, each shared by neighbouring pulses; 0 leaves it
        out. The answer without them is judged by itself in any case.
    least_coherence : float
        Least coherence of the bright points, with which residual phases are used, 0 to 1.
    n_points : int
        Bright points used.
    margin : float
        Relative gain of contrast from which the corrected image is accepted.
    claim_db : float
        Estimated error up to which success is claimed, dB.

    Raises
    ------
    ValueError
        A parameter is out of range.

    Examples
    --------
    >>> from sar_imaging.autofocus import Autofocus
    >>> from sar_imaging.simulation import flawed_aperture
    >>> case = flawed_aperture('smooth', 0.5, seed=1, n_pulses=64, half_scene_m=6.0)
    >>> autofocus = Autofocus(case.grid, scale_m=0.05, n_phases=0, n_points=8)
    >>> result = autofocus.process(case.stated)  # positions that are 15 mm wrong
    >>> report = result.report
    >>> report.accepted, report.contrast_after > report.contrast_before
    (True, True)
    """

    def __init__(self, grid: MapGrid, *,
                 model: Callable[[PulseBlock], GeometryModel] | None = None,
                 imager: Callable[[PulseBlock], np.ndarray] | None = None,
                 target_db: float = -80.0, illumination: AntennaPattern | None = None,
                 backend: str | Backend = AUTO, progress: Callable[[int, int], None] | None = None,
                 scale_m: float = 0.05, offset_reach_s: float = 0.0, n_phases: int = N_PHASES,
                 least_coherence: float = LEAST_COHERENCE, n_points: int = 48,
                 margin: float = 0.005, claim_db: float = -22.0) -> None:
        if n_points < FEWEST_TO_CLAIM:
            raise ValueError(f'n_points={n_points}; expected {FEWEST_TO_CLAIM} or more')
        if n_phases < 0:
            raise ValueError(f'n_phases={n_phases}; expected 1 or more, or 0 for no residual '
                             'correction')
        if not margin > 0:
            raise ValueError(f'margin={margin}; a gain of contrast above 0 must be asked for')
        self.grid, self.scale_m, self._offset_reach_s = grid, scale_m, offset_reach_s
        self.model = model or self._default_model
        self._imager = imager or self._backproject
        self._target_db, self._illumination, self._backend = target_db, illumination, backend
        self._progress, self._warned = progress, False
        self._n_phases, self._n_points = n_phases, n_points
        self._least_coherence = least_coherence
        self._margin, self._claim_db = margin, claim_db

    def process(self, block: PulseBlock, image: np.ndarray | None = None) -> AutofocusResult:
        """Estimate, correct, image again, and decide.

        Parameters
        ----------
        block : PulseBlock
            Range profiles of the aperture with nominal phase centres.
        image : (n_y, n_x) complex64, optional
            Their image, where it exists already.

        Returns
        -------
        AutofocusResult
            A corrected image only where its contrast is higher by the margin, its entropy lower,
            and the evidence for it sufficient; see docs/autofocus.md.

        Raises
        ------
        ValueError
            The block is raw or has no phase centres.
        """
        self._warned = image is not None  # by what formed it, of pixels out of reach for instance
        image = self._imager(block) if image is None else image
        if not np.any(image) and not self._offset_reach_s:
            return self._as_it_was(block, image, 'the image is zero everywhere')
        if block.n_pulses < _FEWEST_PULSES:
            return self._as_it_was(block, image, f'{block.n_pulses} pulses are too few, at least '
                                   f'{_FEWEST_PULSES} are needed')
        model, curve = self.model(block), None
        if self._offset_reach_s:
            model, curve = self._try_offsets(block, model)
            if curve is not None and curve.visible_range_rad < _LEAST_VISIBLE_RAD:
                return self._displaced_only(block, image, curve)
        start, segments, n_unknowns = model.start, None, 1
        if curve is None:
            found = search(block, model, self._points(image, block, self._n_points // 3))
            start, segments = found.parameters, min(2, found.first_segments)
            n_unknowns = found.n_visible
        answers = [self._answer(PARAMETERS, n_unknowns, block, start, model(start))]
        points = self._points(answers[0].image, block, self._n_points)
        if not len(points):
            return self._as_it_was(block, image, 'the corrected image is zero everywhere')
        found = search(block, model, points[:max(self._n_points // 2, 1)], start,
                       first_segments=segments)
        parameters, residual = self._finish(block, model, found.parameters, points)
        answers.append(self._answer(PARAMETERS, found.n_visible, block, parameters,
                                    model(parameters)))
        best = max(self._usable(answers, residual, model, curve),
                   key=lambda answer: answer.contrast)
        apart = disagreement_rad(block, model, best.parameters,
                                 points[:max(self._n_points // 2, 2)])
        details = {'curve': curve, 'n_points': len(points), 'coherence': residual.coherence,
                   'disagreement_rad': apart,
                   'uncertainty': dict(zip(model.names, found.uncertainty.tolist(), strict=True))}
        known = {PARAMETERS: self._error_of_parameters(block, residual, apart, curve)}
        if self._n_phases:
            geometry = along_sight(model(parameters), residual.half_path_m, self.grid.centre_m)
            phased = self._answer(PHASES, self._n_phases, block, parameters, geometry)
            known[PHASES] = residual.error_db
            if self._are_better(phased, best, residual, apart):
                best = phased
        return self._decide(block, image, model, best, known[best.kind], details)

    def _usable(self, answers: list[_Answer], residual: Residual, model: GeometryModel,
                curve: OffsetCurve | None) -> list[_Answer]:
        """Answers of parameters that may be believed: of few, where the points hardly agree."""
        few = [answer for answer in answers if answer.n_unknowns <= FEW_UNKNOWNS]
        usable = answers if residual.coherence >= self._least_coherence else few or answers
        if curve is None:
            return usable
        offset = model.names.index(OFFSET)  # bright points may lead to another maximum
        return [a for a in usable if abs(a.parameters[offset] - model.start[offset])
                <= curve.step_s] or answers[:1]

    def _are_better(self, phased: _Answer, best: _Answer, residual: Residual, apart: float
                    ) -> bool:
        """Whether residual phases are better than parameters alone.

        As sharp with well-known phases is better: they hold what no parameter describes. Others
        that sharpen a little are not worth the doubt where the parameters hold.
        """
        known_well = residual.coherence >= LEAST_TO_CLAIM and residual.error_db <= self._claim_db
        holds = apart <= LARGEST_DISAGREEMENT_RAD
        needed = 1 - self._margin if known_well else CLEARLY if holds else 1 + self._margin
        return (phased.contrast > needed * best.contrast
                and residual.coherence >= self._least_coherence)

    def _try_offsets(self, block: PulseBlock, model: GeometryModel
                     ) -> tuple[GeometryModel, OffsetCurve | None]:
        """The model begun where the curve of all offsets says, and the curve if it is of use."""
        if OFFSET not in model.names:
            raise ValueError(f'offset_reach_s={self._offset_reach_s:g} needs a model with the '
                             f'parameter {OFFSET}; this one has '
                             f'{", ".join(model.names) or "none"}')
        curve = OffsetSearch(block, by_offset(model), self.grid, self._offset_reach_s,
                             self._backend, self._progress).run()
        model = within(model, *curve.offset_s[[0, -1]])
        alone = model.names == (OFFSET,)
        if curve.visible_range_rad < _LEAST_VISIBLE_RAD and alone:
            return model, curve
        # where the track is wrong, too, no offset alone may be sharp
        lost = len(model.names) > FEW_UNKNOWNS and curve.doubts()
        if curve.visible_range_rad < _WIDE_RAD or lost:
            return model, None
        return narrowed(model, curve), curve

    def _points(self, image: np.ndarray, block: PulseBlock, n: int) -> np.ndarray:
        return bright_points(image, self.grid, block, max(n, 1))

    def _answer(self, kind: str, n_unknowns: int, block: PulseBlock, parameters: np.ndarray,
                geometry: Geometry) -> _Answer:
        corrected = apply_geometry(block, geometry)
        image = self._imager(corrected)
        return _Answer(kind, n_unknowns, parameters, corrected, image,
                       contrast(image) if np.any(image) else 0.0)

    def _finish(self, block: PulseBlock, model: GeometryModel, parameters: np.ndarray,
                points: np.ndarray) -> tuple[np.ndarray, Residual]:
        """Parameters that also explain what grows over the scene, and what is left."""
        def estimate() -> Residual:
            return estimate_residual(block, model(parameters), points,
                                     n_phases=self._n_phases or _PHASES_TO_JUDGE)

        residual = estimate()
        for _ in range(_MOST_PASSES):
            if (residual.varying_rad < _VARYING_RAD or not len(parameters)
                    or len(points) < _FEWEST_TO_ABSORB):
                break
            before = parameters, residual
            parameters = absorb(residual, model, parameters, points,
                                block.radar.wavenumber_rad_per_m)
            residual = estimate()
            if residual.error_db >= before[1].error_db:
                parameters, residual = before
                break
        return parameters, residual

    def _error_of_parameters(self, block: PulseBlock, residual: Residual, apart: float,
                             curve: OffsetCurve | None) -> float:
        """Estimated error of the answer without residual phases, dB.

        Of an offset that a whole curve tells it is what the halves of the scene leave open; of
        other parameters it is what a residual phase would correct, and its own error.
        """
        if curve is not None:
            return 20 * math.log10(0.5 * apart + 1e-12)
        left = np.std(residual.half_path_m) * block.radar.wavenumber_rad_per_m
        return 20 * math.log10(math.hypot(left, residual.common_rad, residual.varying_rad) + 1e-12)

    def _decide(self, block: PulseBlock, image: np.ndarray, model: GeometryModel, best: _Answer,
                error_db: float, details: dict[str, Any]) -> AutofocusResult:
        curve = details['curve']
        seen = self._seen(block, best.block) if curve else ...
        (before, entropy_before), (after, entropy_after) = (
            _measured(i[seen]) for i in (image, best.image))
        details |= {
            'answer': best.kind, 'contrast_found': after, 'estimated_error_db': error_db,
            'parameters': dict(zip(model.names, best.parameters.tolist(), strict=True)),
            'correction_m': self._correction(block, best.block),
            'largest_move_m': _largest_move(block, best.block)}
        report = AutofocusReport(False, False, '', before, before, entropy_before,
                                 entropy_before, **details)
        doubted = evidence.doubts(report, best.n_unknowns, self._least_coherence)
        left_open = evidence.open_points(report, self._claim_db)
        claimed = not doubted and not left_open
        sharper = after > (1 + self._margin) * before and entropy_after < entropy_before
        if not (sharper or (curve and curve.outweighs(0.0))):
            small = report.correction_m * block.radar.wavenumber_rad_per_m
            limit = LARGEST_DISAGREEMENT_RAD if curve else 10 ** (self._claim_db / 20)
            if claimed and small <= limit:
                return self._unchanged(dataclasses.replace(
                    report, success=True, reason=f'the image was focused already, to {small:.2f} '
                    'rad'), block, image)
            doubted = ['that is no sharper', *doubted]
        if doubted:
            return self._unchanged(dataclasses.replace(
                report, reason=f'{found_in_words(report)}, but {"; ".join(doubted)}'), block,
                image)
        report = dataclasses.replace(
            report, accepted=True, success=claimed, contrast_after=after,
            entropy_after=entropy_after, reason=(
                'sharper, and all evidence agrees' if claimed else
                f'sharper, but {"; ".join(left_open)}'))
        _logger.info('%s', report)
        return AutofocusResult(best.image, best.block, report)

    def _seen(self, block: PulseBlock, corrected: PulseBlock) -> np.ndarray:
        """(n_y, n_x) bool: pixels that the profiles reach from both tracks, to compare on these.

        All where these are few. Pixels beyond the profiles are dark, which is no contrast.
        """
        x, y = (axis[::-(-len(axis) // _COARSE)] for axis in (self.grid.x_m, self.grid.y_m))
        points = np.stack(np.broadcast_arrays(x, y[:, None], self.grid.z_m), axis=-1)
        there = np.min([coverage(b, Geometry(*b.centres_m), points.reshape(-1, 3))
                        for b in (block, corrected)], axis=0).reshape(len(y), len(x)) >= COVERED
        row, column = (np.arange(n) * len(axis) // n for n, axis in zip(
            self.grid.shape, (y, x), strict=True))
        return (there if there.mean() > _FEW_SEEN else np.ones_like(there))[row][:, column]

    def _displaced_only(self, block: PulseBlock, image: np.ndarray, curve: OffsetCurve
                        ) -> AutofocusResult:
        return self._as_it_was(
            block, image, f'clock offsets of {curve.offset_s[0]:+.3g} to '
            f'{curve.offset_s[-1]:+.3g} s only displace this image (they change its phases by '
            f'{curve.visible_range_rad:.1f} rad): it cannot tell the offset', curve=curve,
            uncertainty={OFFSET: self._offset_reach_s})

    def _as_it_was(self, block: PulseBlock, image: np.ndarray, reason: str, **details: Any
                   ) -> AutofocusResult:
        c, e = _measured(image)
        return self._unchanged(AutofocusReport(False, False, reason, c, c, e, e, **details),
                               block, image)

    def _unchanged(self, report: AutofocusReport, block: PulseBlock, image: np.ndarray
                   ) -> AutofocusResult:
        _logger.info('%s', report)
        return AutofocusResult(image, block, report)

    def _correction(self, block: PulseBlock, corrected: PulseBlock) -> float:
        def path(pulses: PulseBlock) -> np.ndarray:
            return 0.5 * sum(np.linalg.norm(c.mean(axis=1) - self.grid.centre_m, axis=-1)
                             for c in pulses.centres_m)

        change = path(corrected) - path(block)
        u = np.linspace(-1.0, 1.0, len(change))
        return float(np.std(change - np.polyval(np.polyfit(u, change, 1), u)))

    def _default_model(self, block: PulseBlock) -> GeometryModel:
        return with_track_error(nominal(block), scale_m=self.scale_m)

    def _backproject(self, block: PulseBlock) -> np.ndarray:
        imager = plan_image(self.grid, block.radar, block.n_samples, method='exact',
                            target_db=self._target_db, illumination=self._illumination,
                            backend=self._backend)
        if not self._warned:
            self._warned = True
            return imager(block).samples
        image = imager.new_image(block.n_channels)
        imager.accumulate(block, image)
        return image.samples


def _measured(image: np.ndarray) -> tuple[float, float]:
    """Contrast and entropy of an image or of some of its pixels; 0 where all is dark."""
    return (contrast(image), entropy(image)) if np.any(image) else (0.0, 0.0)


def _largest_move(block: PulseBlock, corrected: PulseBlock) -> float:
    return float(max(np.linalg.norm(after - before, axis=-1).max() for before, after in zip(
        block.centres_m, corrected.centres_m, strict=True)))
