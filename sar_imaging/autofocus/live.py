# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus of the nodes: geometry models from a few parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .autofocus import Autofocus
from .models import GeometryModel, nominal, with_range_bias, with_track_error
from .track import PhaseCentreTrack, on_track

_N_PULSES, _N_SAMPLES, _RANGE_M = 64, 128, 1000.0
BEYOND = 1.25  # what is searched for a clock offset, over its expected size


def live_autofocus(grid: MapGrid, *, track_error_m: float = 0.0, time_offset_s: float = 0.0,
                   range_bias_m: float = 0.0, track: PhaseCentreTrack | None = None, **options: Any
                   ) -> Autofocus:
    """Autofocus for an expected error of the track, of the clock or of the range.

    An offset of the clocks is searched for from -1.25 to 1.25 times its expected size, as far as
    the track is known.

    Parameters
    ----------
    grid : MapGrid
        Grid of the images.
    track_error_m : float
        Expected size of a smooth error of the track, metres; 0 where there is none.
    time_offset_s : float
        Largest expected offset between the clocks of pulses and positions, seconds; 0 where there
        is none.
    range_bias_m : float
        Expected size of a constant error of the ranges, metres; 0 where there is none.
    track : PhaseCentreTrack, optional
        Where the phase centres were before, during and after the aperture. Left out, it is that
        of the pulses, and offsets of more than a tenth of their duration cannot be tried.
    options
        Of `Autofocus`, such as `n_phases` and `target_db`.

    Returns
    -------
    Autofocus
        Its `process` raises ValueError where the times of the pulses do not ascend.

    Examples
    --------
    >>> from sar_imaging.autofocus.live import live_autofocus
    >>> from sar_imaging.simulation import flawed_aperture
    >>> case = flawed_aperture('smooth', 0.5, seed=1, n_pulses=64, half_scene_m=6.0)
    >>> autofocus = live_autofocus(case.grid, track_error_m=0.02, n_phases=0, n_points=8)
    >>> report = autofocus.process(case.stated).report
    >>> report.contrast_after > report.contrast_before
    True
    """
    def model(block: PulseBlock) -> GeometryModel:
        time_s = (block.stamp_ns - block.stamp_ns[0]) * 1e-9
        if np.any(np.diff(time_s) <= 0):
            raise ValueError('the times of the pulses do not ascend; autofocus takes errors for '
                             'functions of time, give every pulse its own')
        out = nominal(block)
        if time_offset_s:
            out = on_track(block, track or PhaseCentreTrack.of_pulses([block]),
                           scale_s=time_offset_s)
        if track_error_m:
            out = with_track_error(out, scale_m=track_error_m, time_s=time_s)
        if range_bias_m:
            out = with_range_bias(out, scale_m=range_bias_m)
        return out

    return Autofocus(grid, model=model, offset_reach_s=BEYOND * time_offset_s, **options)


def compile_autofocus() -> None:
    """Compile the kernels, or load them from the cache, before the first aperture is complete.

    A small aperture with one point is focused. Takes some seconds the first time on a machine and
    well under one after that.
    """
    radar = RadarParameters(10e9, 300e6, 600e6, 2 * (_RANGE_M - 16.0) / SPEED_OF_LIGHT)
    number = np.arange(_N_PULSES)
    centres = np.zeros((_N_PULSES, 1, 3))
    centres[:, 0, 0], centres[:, 0, 1] = -_RANGE_M, number - _N_PULSES / 2
    half_path = np.linalg.norm(centres[:, 0], axis=-1)
    profile = radar.range_start_m + np.arange(_N_SAMPLES) * radar.sample_spacing_m
    samples = (np.sinc((profile - half_path[:, None]) / radar.range_resolution_m)
               * np.exp(-1j * radar.wavenumber_rad_per_m * half_path)[:, None])
    block = PulseBlock(radar, True, number * 10**7, number, samples[:, None], centres, centres)
    live_autofocus(MapGrid((0.0, 0.0, 0.0), 32, 32, 0.25), track_error_m=0.01,
                   time_offset_s=0.01).process(block)
