# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus in the nodes: its parameters, and the report of its results."""

from __future__ import annotations

import collections
import dataclasses
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from sar_imaging.autofocus.autofocus import N_PHASES, Autofocus
from sar_imaging.autofocus.corrected_track import CorrectedTrack, corrected_track
from sar_imaging.autofocus.evidence import LEAST_COHERENCE
from sar_imaging.autofocus.live import BEYOND, compile_autofocus, live_autofocus
from sar_imaging.autofocus.offset_search import BEYOND_S
from sar_imaging.autofocus.phase_gradient import PhaseGradient
from sar_imaging.autofocus.report import (
    NOT_CHANGED,
    SHARPENED,
    AutofocusReport,
    AutofocusResult,
)
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.planning.afbp.polar_grids import UnifiedPolarGrids
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.streaming.aperture import ApertureImage

from ..antenna import pattern_from
from ..poses.frame_datum import FrameDatum
from ..poses.known_positions import KnownPositions
from ..poses.pose_input import BLOCK
from ..runtime.health import Health, Part
from ..runtime.parameters import BACKEND, ConfigurationError, Parameter
from .image_grid import TERRAIN_FILE

TRACK_ERROR = Parameter(
    'autofocus.track_error', 0.0, 'Expected size of a smooth error of the positions that '
    'autofocus looks for; 0 for none.', 'm', 0.0, 100.0)
TIME_OFFSET = Parameter(
    'autofocus.time_offset', 0.0, 'Largest expected offset between the clocks of pulses and '
    'positions, which autofocus searches for; 0 for none.', 's', 0.0, 100.0)
RANGE_BIAS = Parameter(
    'autofocus.range_bias', 0.0, 'Expected size of a constant error of the ranges that autofocus '
    'looks for beside the above; 0 for none.', 'm', 0.0, 100.0)
RESIDUAL_PHASES = Parameter(
    'autofocus.residual_phases', True, 'Try a phase of each pulse for what track and clock '
    'leave, too.')
COHERENCE_LIMIT = Parameter(
    'autofocus.coherence_limit', LEAST_COHERENCE, 'Least coherence of the bright points with '
    'which residual phases are used.', '', 0.0, 1.0)
POSITION_STD = Parameter(
    'autofocus.position_std', 0.0, 'Standard deviation of the positions along each axis by what '
    'no image shows, such as an error that all pulses share; corrected_pose is published where it '
    'is told.', 'm', 0.0, 1e4)
PHASE_GRADIENT = Parameter(
    'autofocus.phase_gradient', False, 'Look for errors of the positions that are a phase of each '
    'pulse, the same for the whole scene.')
EXPECTED = (TRACK_ERROR, TIME_OFFSET)  # either of them switches autofocus on
BESIDE = (RANGE_BIAS, POSITION_STD)  # of no use without them
PARAMETERS = (*EXPECTED, *BESIDE, RESIDUAL_PHASES, COHERENCE_LIMIT)
FAILED = 'autofocus failed'  # verdict
FIRST_PROGRESS_S, PROGRESS_S = 2.0, 5.0  # between lines that tell how far a search is
# Of the last aperture, as keys of the diagnostics and fields of the report.
_FIGURES = {
    'autofocus_contrast_before': 'contrast_before', 'autofocus_contrast_after': 'contrast_after',
    'autofocus_entropy_before': 'entropy_before', 'autofocus_entropy_after': 'entropy_after',
    'autofocus_error_db': 'estimated_error_db', 'autofocus_correction_m': 'correction_m',
    'autofocus_largest_move_m': 'largest_move_m'}
FUSION_COUNTERS = ('autofocus_attempted', 'autofocus_accepted', 'autofocus_failed',
                   'autofocus_contrast_before', 'autofocus_contrast_after', 'autofocus_error_db',
                   'autofocus_correction_m', 'autofocus_seconds', 'autofocus_aperture')
COUNTERS = ('autofocus_attempted', 'autofocus_accepted', 'autofocus_claimed', 'autofocus_failed',
            *_FIGURES, 'autofocus_time_offset_s', 'autofocus_seconds', 'autofocus_aperture')


class Note(NamedTuple):
    """Whether an image was corrected, in few words, and what was done to it, in figures.

    `track` computes the track that a focused image tells, where that is wanted.
    """

    verdict: str
    details: str
    track: Callable[[], CorrectedTrack] | None = None


def tell(health: Health | Part, aperture: int, note: Note) -> None:
    """Put into the diagnostics what autofocus did to the image of an aperture."""
    health.set('autofocus_aperture', aperture)
    health.tell('autofocus_verdict', note.verdict)
    health.tell('autofocus_reason', note.details)


class ImageFocus:
    """Tries to focus every image and tells what came of it.

    Where an offset of the clocks is looked for, an image waits until positions are known as far
    behind its aperture as the search reaches and 2 s more, or until nothing more comes.

    Parameters
    ----------
    parameters : mapping
        Values of `PARAMETERS` and `pose_input.TRACK_PARAMETERS`, of the grid and of the imager.
    grid : MapGrid
        Grid of the images.
    health : Health or Part
        Counters, with `COUNTERS`, and log.
    datum : FrameDatum, optional
        Datum of the imaging frame, for positions from fixes.

    Raises
    ------
    ConfigurationError
        Another parameter excludes autofocus.

    Attributes
    ----------
    positions : KnownPositions or None
        Where the phase centres were; None where neither an offset of the clocks is looked for nor
        a pose of the body published.
    reach_s : float
        Largest offset of the clocks to try, seconds.
    """

    def __init__(self, parameters: Mapping[str, Any], grid: MapGrid, health: Health | Part,
                 datum: FrameDatum | None = None):
        self._expected = {p.name: parameters[p.name] for p in EXPECTED if parameters[p.name]}
        if not self._expected:
            given = next(p.name for p in BESIDE if parameters[p.name])
            raise ConfigurationError(
                f'{given}={parameters[given]:g} is of use beside an expected error of the track '
                f'or the clock; set {TRACK_ERROR.name} or {TIME_OFFSET.name}, too')
        if parameters[TERRAIN_FILE.name]:
            raise ConfigurationError(
                f'autofocus ({", ".join(self._expected)}) is not possible here: it works on a '
                f'plane; leave {TERRAIN_FILE.name} empty')
        self._parameters, self._grid, self._health = parameters, grid, health
        self._illumination = pattern_from(parameters)
        self.reach_s = BEYOND * parameters[TIME_OFFSET.name]
        told = parameters[POSITION_STD.name] and parameters['pose.source'] != BLOCK
        self.positions = (KnownPositions(parameters, health, datum, self.reach_s + BEYOND_S)
                          if self.reach_s or told else None)
        self._waiting: collections.deque[ApertureImage] = collections.deque()
        compile_autofocus()  # the first image must not wait for it

    @classmethod
    def wanted(cls, parameters: Mapping[str, Any], grid: MapGrid,
               health: Health | Part, datum: FrameDatum) -> ImageFocus | None:
        """Autofocus where the parameters expect an error, else None."""
        asked = any(parameters[p.name] for p in (*EXPECTED, *BESIDE))
        return cls(parameters, grid, health, datum) if asked else None

    def summary(self) -> str:
        """Settings for the log line at the start."""
        expected = ' and '.join(
            f'{name.split(".")[1].replace("_", " ")}s of {value:g} '
            f'{"m" if name == TRACK_ERROR.name else "s"}'
            for name, value in self._expected.items())
        known = '' if self.positions is None else f', positions from {self.positions.source}'
        return f'autofocus for {expected}{known}'

    def take(self, images: Iterable[ApertureImage], *, final: bool = False
             ) -> list[ApertureImage]:
        """Add images; returns those that are done with, in their order.

        Parameters
        ----------
        images : iterable of ApertureImage
            With their pulses.
        final : bool
            Wait for nothing.
        """
        self._waiting.extend(images)
        done = []
        while self._waiting and (final or not self.reach_s
                                 or self.positions.suffices(self._waiting[0].pulses)):
            done.append(self._focused(self._waiting.popleft()))
        if self.positions is not None:
            self.positions.awaited = bool(self._waiting)
        return done

    def discard(self) -> int:
        """Forget the images that wait; returns the number of their pulses."""
        n = sum(image.n_pulses for image in self._waiting)
        self._waiting.clear()
        return n

    def _focused(self, product: ApertureImage) -> ApertureImage:
        """The image in focus where that was found, else as it is; its pulses are let go."""
        self._health.count('autofocus_attempted')
        began = time.perf_counter()
        try:
            autofocus = self._autofocus(product)
            result = autofocus.process(product.pulses, product.image)
        except (ValueError, MemoryError) as error:
            self._health.count('autofocus_failed')
            note = Note(FAILED, str(error))
            tell(self._health, product.aperture, note)
            self._health.warning(f'autofocus of aperture {product.aperture} failed, the image '
                                 f'is published unchanged: {error}')
            return dataclasses.replace(product, pulses=None, focus=note)
        seconds = time.perf_counter() - began
        report = result.report
        self._count(report, seconds)
        tell(self._health, product.aperture, Note(report.verdict, report.reason))
        curve = report.curve
        tried = '' if curve is None else (
            f', {len(curve.offset_s)} offsets of {curve.offset_s[0]:+.3g} to '
            f'{curve.offset_s[-1]:+.3g} s tried')
        details = (f'{report.details}, largest move {report.largest_move_m:.3g} m{tried}, '
                   f'{seconds:.3g} s')
        return dataclasses.replace(
            product, image=result.image, pulses=None,
            focus=Note(report.verdict, details, self._track(autofocus, product.pulses, result)))

    def _track(self, autofocus: Autofocus, pulses: PulseBlock, result: AutofocusResult
               ) -> Callable[[], CorrectedTrack] | None:
        """What computes the corrected track, where it is wanted and the focus is claimed."""
        if not (self._parameters[POSITION_STD.name] and result.report.success):
            return None
        return lambda: corrected_track(result, autofocus.model(pulses), self._grid,
                                       position_std_m=self._parameters[POSITION_STD.name])

    def _autofocus(self, product: ApertureImage) -> Autofocus:
        p, which = self._parameters, f'autofocus of aperture {product.aperture}'
        track = self.positions.around(product.pulses) if self.reach_s else None
        if self.reach_s:
            self._health.info(f'{which}: trying clock offsets of {-self.reach_s:g} to '
                              f'{self.reach_s:g} s')
        began, told = time.perf_counter(), 0.0

        def progress(n_tried: int, n: int) -> None:
            nonlocal told
            seconds = time.perf_counter() - began
            if seconds - told >= (PROGRESS_S if told else FIRST_PROGRESS_S):
                told = seconds
                self._health.info(f'{which}: {n_tried} of {n} clock offsets tried in '
                                  f'{seconds:.0f} s, {seconds * (n / n_tried - 1):.0f} s to go')
        return live_autofocus(
            self._grid, track_error_m=p[TRACK_ERROR.name], time_offset_s=p[TIME_OFFSET.name],
            range_bias_m=p[RANGE_BIAS.name], track=track, target_db=p['target_db'],
            n_phases=N_PHASES if p[RESIDUAL_PHASES.name] else 0,
            least_coherence=p[COHERENCE_LIMIT.name], illumination=self._illumination,
            backend=p[BACKEND.name], progress=progress)

    def _count(self, report: AutofocusReport, seconds: float) -> None:
        if report.accepted:
            self._health.count('autofocus_accepted')
        if report.success:
            self._health.count('autofocus_claimed')
        for key, field in _FIGURES.items():
            self._health.set(key, float(getattr(report, field)))
        self._health.set('autofocus_time_offset_s', report.parameters.get('time_offset_s', 0.0))
        self._health.set('autofocus_seconds', seconds)


class PolarFocus:
    """Tries to focus fused polar images; see `LiveFusion.focus`.

    Parameters
    ----------
    health : Health or Part
        Counters, with `FUSION_COUNTERS`, and log.
    """

    def __init__(self, health: Health | Part):
        self._health = health

    def __call__(self, polar: np.ndarray, grid: UnifiedPolarGrids, ends_m: tuple[float, float]
                 ) -> tuple[np.ndarray, Note]:
        """The polar image in focus where that was found, else as it is, and what to tell."""
        health = self._health
        health.count('autofocus_attempted')
        began = time.perf_counter()
        try:
            result = PhaseGradient(grid.polar, grid, ends_m).at_baseband(polar, grid.between)
        except (ValueError, MemoryError) as error:
            health.count('autofocus_failed')
            health.warning(f'autofocus failed, the image is published unchanged: {error}')
            return polar, Note(FAILED, str(error))
        seconds = time.perf_counter() - began
        health.count('autofocus_accepted', int(result.accepted))
        after = result.contrast_after if result.accepted else result.contrast_before
        correction_m = float(np.std(result.half_path_m))
        for key, value in (('contrast_before', result.contrast_before), ('contrast_after', after),
                           ('error_db', result.error_db), ('correction_m', correction_m),
                           ('seconds', seconds)):
            health.set(f'autofocus_{key}', float(value))
        found = (f'contrast {result.contrast_before:.3g} -> {after:.3g}' if result.accepted else
                 f'contrast would change from {result.contrast_before:.4g} to '
                 f'{result.contrast_after:.4g}, but the two halves of the ranges disagree or the '
                 'gain is too small')
        error = f', estimated error {result.error_db:.0f} dB' if result.error_db < 0 else ''
        return result.image, Note(
            SHARPENED if result.accepted else NOT_CHANGED,
            f'{found}{error}, correction {correction_m:.3g} m rms, {seconds:.3g} s')
