"""Compiles what AFBP needs before the first pulse arrives."""

from __future__ import annotations

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from .live_fusion import LiveFusion
from .live_subapertures import LiveSubapertures

_N_PULSES, _N_SAMPLES, _RANGE_M = 64, 128, 1000.0


def compile_live_kernels() -> None:
    """Compile the kernels of both stages, or load them from the cache.

    One small aperture is imaged. Takes some seconds the first time on a machine and well under
    one after that.
    """
    radar = RadarParameters(10e9, 300e6, 600e6, 2 * (_RANGE_M - 16.0) / 299_792_458.0)
    centres = np.zeros((_N_PULSES, 1, 3))
    centres[:, 0, 0] = -_RANGE_M
    centres[:, 0, 1] = np.arange(_N_PULSES) - _N_PULSES / 2
    numbers = np.arange(_N_PULSES)
    samples = np.zeros((_N_PULSES, 1, _N_SAMPLES), np.complex64)
    first = LiveSubapertures(MapGrid((0.0, 0.0, 0.0), 32, 32, 0.25),
                             pulses_per_aperture=_N_PULSES, target_db=-50.0)
    second = LiveFusion(images_every=1)
    block = PulseBlock(radar, True, numbers, numbers, samples, centres, centres)
    for image in first.add(block):
        second.add(image)
