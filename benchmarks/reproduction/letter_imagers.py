# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The imagers that `reproduce_spotlight_letter` compares, with seconds by stage and memory."""

from __future__ import annotations

import contextlib
import dataclasses
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from sar_imaging.backends import backend
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import Method
from sar_imaging.planning.plan import Plan
from sar_imaging.published.ffbp import Ffbp
from sar_imaging.signal.pulses import PulseBlock

from .letter_recording import Recording

EXACT = 'exact BP'

_STATUS, _CLEAR = Path('/proc/self/status'), Path('/proc/self/clear_refs')


@dataclasses.dataclass(frozen=True)
class Formed:
    """An image and what it took.

    Parameters
    ----------
    image : (n_y, n_x) complex64
        On the map grid asked for.
    seconds : dict of str to float
        Wall clock by stage.
    predicted_error_db : float
        What the imager predicts, dB.
    pulses_per_subaperture : int or None
        Where the imager chose it.
    """

    image: np.ndarray
    seconds: dict[str, float]
    predicted_error_db: float
    pulses_per_subaperture: int | None = None


Imager = Callable[[MapGrid, PulseBlock], Formed]
SceneImager = Callable[[MapGrid, Recording], Formed]


def _exact(grid: MapGrid, block: PulseBlock) -> Formed:
    start = time.perf_counter()
    image = plan_image(grid, block.radar, block.n_samples, method='exact', target_db=-80.0)(block)
    return Formed(image.samples, {'backprojection': time.perf_counter() - start},
                  image.report.predicted_error_db)


def _ffbp(kernel: str, oversampling: float, pulses: int) -> Imager:
    def form(grid: MapGrid, block: PulseBlock) -> Formed:
        seconds = {}
        formed, _ = _form(grid, block, _timed_ffbp(seconds), seconds,
                          pulses_per_subaperture=pulses, merge_factor=2, kernel=kernel,
                          range_oversampling=oversampling, angle_oversampling=oversampling)
        return formed

    return form


def _afbp(pulses: int | None) -> Imager:
    return lambda grid, block: _form_by_afbp(grid, block, pulses_per_subaperture=pulses)


def _form_by_afbp(grid: MapGrid, block: PulseBlock, **options) -> Formed:
    timed = _TimedBackend()
    formed, plan = _form(grid, block, 'afbp', timed.seconds, target_db=-50.0, backend=timed,
                         **options)
    return dataclasses.replace(formed, pulses_per_subaperture=max(
        p.stop - p.start for p in plan.subapertures.sampling.pulses))


def _form(grid: MapGrid, block: PulseBlock, method: str | type[Method], stages: dict[str, float],
          **options) -> tuple[Formed, Plan]:
    start = time.perf_counter()
    imager = plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m, method=method,
                        **options)
    seconds, plan = {'planning': time.perf_counter() - start}, imager.report.plan
    image = imager(block)
    return Formed(image.samples, seconds | stages, image.report.predicted_error_db), plan


class _TimedBackend:
    """The quickest backend, with the seconds of each stage of AFBP."""

    def __init__(self):
        self.seconds, self._backend = {}, backend()
        self.Backprojection = self._backend.Backprojection
        self.form_map = _stopwatch(self._backend.form_map, 'resampling', self.seconds)

    def SubapertureImager(self, plan):
        return _timed(self._backend.SubapertureImager(plan), {'image': 'stage 1'}, self.seconds)

    def SpectrumFusion(self, grid, *, keep=False):
        return _timed(self._backend.SpectrumFusion(grid, keep=keep),
                      {'add': 'fusion', 'take_polar_image': 'fusion'}, self.seconds)


def _timed_ffbp(seconds: dict[str, float]) -> type[Method]:
    """FFBP that adds up the seconds of its stages."""
    stages = {'_backproject': 'stage 1', '_merge': 'fusion', '_add': 'resampling'}
    return type('TimedFfbp', (Ffbp,), {step: _stopwatch(getattr(Ffbp, step), stage, seconds)
                                       for step, stage in stages.items()})


def _whole_afbp(pulses: int | None) -> SceneImager:
    """AFBP of the phase history as recorded."""
    def form(grid: MapGrid, recording: Recording) -> Formed:
        return _form_by_afbp(grid, recording.raw(slice(None)), pulses_per_subaperture=pulses,
                             compressed=False, weighting=recording.window,
                             pulse_weights=recording.pulse_weights)

    return form


def _whole_ffbp(kernel: str, oversampling: float, pulses: int) -> SceneImager:
    def form(grid: MapGrid, recording: Recording) -> Formed:
        start = time.perf_counter()
        profiles = recording.profiles()
        compression_s = time.perf_counter() - start
        formed = _ffbp(kernel, oversampling, pulses)(grid, profiles)
        return dataclasses.replace(
            formed, seconds={'range compression': compression_s} | formed.seconds)

    return form


def _timed(plan, stages: dict[str, str], seconds: dict[str, float]):
    """Have an imager's own steps add up their wall clock by stage."""
    for step, stage in stages.items():
        setattr(plan, step, _stopwatch(getattr(plan, step), stage, seconds))
    return plan


def _stopwatch(step: Callable, stage: str, seconds: dict[str, float]) -> Callable:
    def call(*arguments, **options):
        start = time.perf_counter()
        try:
            return step(*arguments, **options)
        finally:
            seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start

    return call


#: Kernel and oversampling of FFBP: the letter states neither.
FFBP_VARIANTS = (('linear', 1.3), ('linear', 2.0), ('cubic', 2.5), ('knab8', 1.8))
PULSES = (16, 64)  # per sub-aperture
#: One that comes as near to exact backprojection as AFBP does, for the whole scene.
_EXACT_FFBP = ('knab8', 2.4, 16)


def ffbp_name(kernel: str, oversampling: float, pulses: int) -> str:
    """Name of a variant of FFBP in `IMAGERS`."""
    return f'FFBP {kernel} x{oversampling:g}, {pulses} pulses'


def afbp_name(pulses: int | None) -> str:
    """Name of AFBP in `IMAGERS`; None where it chooses the length of its sub-apertures."""
    return f'AFBP, {pulses} pulses' if pulses else 'AFBP, its own choice'


#: Imagers by name: ``imager(grid, profiles)`` gives `Formed`.
IMAGERS: dict[str, Imager] = {
    EXACT: _exact,
    **{ffbp_name(*v, n): _ffbp(*v, n) for v in FFBP_VARIANTS for n in PULSES},
    **{afbp_name(n): _afbp(n) for n in PULSES}}
#: Names of those that the letter compares in its figures: its sub-apertures have 16 pulses, and
#: the first variant has sidelobes like those that it shows.
COMPARED = (ffbp_name(*FFBP_VARIANTS[0], PULSES[0]), afbp_name(PULSES[0]))
#: Names of those whose azimuth cuts are drawn.
CUTS = (EXACT, *(ffbp_name(*FFBP_VARIANTS[0], n) for n in PULSES),
        *(ffbp_name(*v, PULSES[0]) for v in FFBP_VARIANTS[2:]), *map(afbp_name, PULSES))
#: Imagers of the whole scene by name: ``imager(grid, recording)`` gives `Formed`.
WHOLE_SCENE: dict[str, SceneImager] = {
    ffbp_name(*v, n): _whole_ffbp(*v, n)
    for *v, n in ((*FFBP_VARIANTS[0], PULSES[0]), *((*FFBP_VARIANTS[-1], n) for n in PULSES),
                  _EXACT_FFBP)
} | {afbp_name(n): _whole_afbp(n) for n in (*PULSES, None)}


@dataclasses.dataclass
class PeakMemory:
    """Largest resident memory of the process while it was watched, bytes."""

    n_bytes: int = 0


@contextlib.contextmanager
def watch_memory() -> Iterator[PeakMemory]:
    """Measure the peak of resident memory, everything the process holds included.

    Linux forgets earlier peaks on request; elsewhere the peak since the start is what is told.
    """
    peak = PeakMemory()
    with contextlib.suppress(OSError):
        _CLEAR.write_text('5')
    yield peak
    try:
        lines = _STATUS.read_text().splitlines()
        peak.n_bytes = 1024 * int(next(s for s in lines if s.startswith('VmHWM')).split()[1])
    except (OSError, StopIteration):
        peak.n_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
