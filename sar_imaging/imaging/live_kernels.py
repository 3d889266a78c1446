"""Compiles what AFBP needs before the first pulse arrives."""

from __future__ import annotations

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .live_fusion import LiveFusion
from .live_subapertures import LiveSubapertures

_N_PULSES, _N_SAMPLES, _RANGE_M = 64, 128, 1000.0
_CUT = 8  # short enough for a window to slide


def compile_live_kernels() -> None:
    """Compile the kernels of both stages, or load them from the cache.

    A small aperture is imaged, then one that slides on. Takes some seconds the first time on a
    machine and well under one after that.
    """
    radar = RadarParameters(10e9, 300e6, 600e6, 2 * (_RANGE_M - 16.0) / SPEED_OF_LIGHT)
    numbers = np.arange(_N_PULSES + 2 * _CUT)
    centres = np.zeros((len(numbers), 1, 3))
    centres[:, 0, 0] = -_RANGE_M
    centres[:, 0, 1] = numbers - _N_PULSES / 2
    samples = np.zeros((len(numbers), 1, _N_SAMPLES), np.complex64)
    block = PulseBlock(radar, True, numbers, numbers, samples, centres, centres)
    for sliding in (False, True):
        first = LiveSubapertures(MapGrid((0.0, 0.0, 0.0), 32, 32, 0.25),
                                 pulses_per_aperture=_N_PULSES, pulses_per_subaperture=_CUT,
                                 target_db=-50.0, sliding=sliding)
        second = LiveFusion()
        for image in first.add(block):
            image.image.flags.writeable = sliding  # images of messages are not
            second.add(image)
