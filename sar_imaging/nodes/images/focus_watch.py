# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Watch the focus of the images that a node forms, and diagnose images out of focus."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from sar_imaging.compilation import MISSING
from sar_imaging.diagnosis import Diagnosis, diagnose
from sar_imaging.diagnosis.coherence import compile_kernels
from sar_imaging.diagnosis.hypotheses import reach_advice
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality.measures import FocusFigure, focus_figure
from sar_imaging.signal.pulses import PulseBlock, concatenate

from ..runtime.health import Health, Part
from ..runtime.worker import aside

COUNTERS = ('focus_peak_db', 'focus_entropy', 'focus_contrast', 'images_at_noise_level')
SECONDS = 'diagnosis_seconds'  # NaN while one goes on
DIAGNOSIS_COUNTERS = ('focus_coherence', SECONDS)
MISTAKE = 'mistake'  # key of the text on /diagnostics
_FEWEST_PULSES = 16
_MOST_BYTES = 256e6  # of profiles kept for the diagnosis


def count_focus(image: np.ndarray, health: Health | Part) -> FocusFigure:
    """Focus figure of an image, as counters, too.

    Parameters
    ----------
    image : complex64 array
        Image.
    health : Health or Part
        Counters, with `COUNTERS`.
    """
    figure = focus_figure(image)
    health.set('focus_peak_db', figure.peak_over_median_db)
    health.set('focus_entropy', figure.entropy)
    health.set('focus_contrast', figure.contrast)
    if figure.at_noise_level:
        health.count('images_at_noise_level')
    return figure


class FocusWatch:
    """Looks at the first aperture of each radar, and again once images sink into noise.

    Parameters
    ----------
    grid : MapGrid
        Grid of the images.
    pulses_per_aperture : int
        Length of an aperture.
    health : Health or Part
        Counters, with `DIAGNOSIS_COUNTERS`, and log.
    watching : bool
        False where the diagnosis would be wrong: it knows no terrain. Nothing is looked at without
        Numba.
    """

    def __init__(self, grid: MapGrid, pulses_per_aperture: int, health: Health | Part, *,
                 watching: bool = True):
        self._grid, self._length, self._health = grid, pulses_per_aperture, health
        self._radar: tuple[Any, ...] | None = None
        self._kept: list[PulseBlock] = []
        self._watching = self._wanted = watching and not MISSING
        self._was_focused = False
        if self._watching:
            compile_kernels()

    def see(self, block: PulseBlock) -> None:
        """Keep the profiles of a block while an aperture is to be looked at."""
        key = (block.radar, block.samples.shape[1:])
        if key != self._radar:
            self._radar, self._wanted, self._was_focused = key, self._watching, False
            self._kept.clear()
            self._health.tell(MISTAKE, '')
        if not self._wanted:
            return
        aperture = self._aperture(block)
        self._kept = [b for b in self._kept if self._aperture(b) == aperture]
        if sum(b.samples.nbytes for b in self._kept) < _MOST_BYTES:
            self._kept.append(block)

    def explain(self, error: ValueError, block: PulseBlock) -> ValueError:
        """The error of a block that does not reach the grid, with what would explain it."""
        advice = reach_advice(block, self._grid) if block.has_positions else ''
        return ValueError(f'{error}; {advice}') if advice else error

    def judge(self, aperture: int, figure: FocusFigure | None = None) -> None:
        """Look for a mistake when that is due; call it when all of an aperture was published.

        Parameters
        ----------
        aperture : int
            Its number.
        figure : FocusFigure, optional
            Figure of its image, where it was formed here.
        """
        if not self._wanted:
            # Where images were focused before, something happened.
            self._wanted = (self._watching and self._was_focused and figure is not None
                            and figure.at_noise_level)
            return
        blocks = [b for b in self._kept if self._aperture(b) == aperture]
        if sum(b.n_pulses for b in blocks) < _FEWEST_PULSES:
            return
        self._wanted = False
        self._kept = []
        radar = self._radar
        self._health.set(SECONDS, math.nan)
        aside(lambda: self._examine(aperture, blocks, radar, figure), 'diagnosis')

    def _examine(self, aperture: int, blocks: list[PulseBlock], radar: tuple[Any, ...],
                 figure: FocusFigure | None) -> None:
        """Diagnose an aperture; images do not wait for it."""
        began = time.perf_counter()
        try:
            diagnosis = diagnose(concatenate(blocks), self._grid)
            if radar == self._radar:  # else another one sends meanwhile
                self._tell(aperture, diagnosis, figure)
        except Exception as error:
            self._health.warning(f'aperture {aperture} could not be examined: {error}')
        finally:
            self._health.set(SECONDS, time.perf_counter() - began)

    def _tell(self, aperture: int, diagnosis: Diagnosis, figure: FocusFigure | None) -> None:
        self._health.set('focus_coherence', diagnosis.coherence)
        self._was_focused = diagnosis.focused
        self._health.tell(MISTAKE, diagnosis.advice)
        if diagnosis.advice:
            self._health.warning(f'aperture {aperture}: {diagnosis}'
                                 + (f'; {figure}' if figure is not None else ''))

    def _aperture(self, block: PulseBlock) -> int:
        return int(block.counter[0]) // self._length
