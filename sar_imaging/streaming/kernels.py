"""Compiles what AFBP needs before the first pulse arrives."""

from __future__ import annotations

import numpy as np

from ..backends.cpu.beams.subaperture import BeamformedSubaperture
from ..backends.cpu.fft.columns import LANES, transform_columns
from ..backends.cpu.fft.rows import transform_rows
from ..backends.cpu.lines import PolarLines
from ..backends.cpu.profiles import Profiles
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..planning.afbp.beams import plan_beams
from ..planning.profiles.range_gate import RangeGate
from ..planning.profiles.range_resampling import plan_resampling, sample_paths
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .fusion import LiveFusion
from .plan import LivePlan
from .subaperture_image import SubapertureImage
from .subapertures import LiveSubapertures

_N_PULSES, _N_SAMPLES, _RANGE_M = 64, 128, 1000.0
_LENGTH = 256  # of a transform; shorter ones are SciPy's
_CUT = 8  # short enough for a window to slide
_TARGET_DB = -50.0
_GRID = MapGrid((0.0, 0.0, 0.0), 32, 32, 0.25)


def compile_subaperture_kernels() -> None:
    """Compile the kernels of the first stage, or load them from the cache.

    A small aperture is imaged. Takes some seconds the first time on a machine and well under one
    after that.
    """
    stage = LiveSubapertures(_GRID, pulses_per_aperture=_N_PULSES, pulses_per_subaperture=_CUT,
                             target_db=_TARGET_DB)
    stage.add(_block().select(slice(0, _N_PULSES)))
    transform_rows(np.zeros((1, _LENGTH), np.complex64))
    _compile_both_ways(_block().select(slice(0, _CUT)))


def _compile_both_ways(block: PulseBlock) -> None:
    """From beams and directly: the aperture above is imaged in one of these ways."""
    polar = PolarGrid((-_RANGE_M, 0.0, 0.0), (0.0, 1.0), -1, 0.0, _RANGE_M, 0.25, 32, 0.0, 1e-3, 4)
    rows = block.tx_m.reshape(-1, 3), block.rx_m.reshape(-1, 3)
    paths = sample_paths(*rows, polar.lines(polar.range_m[[0, -1]], 0.0))
    lattice = plan_resampling(paths, 0.25, 32, block.radar, _N_SAMPLES, _TARGET_DB)
    beams = plan_beams(polar, block.radar, lattice, lattice.n_padded, [rows], _TARGET_DB, 8.0)
    window, range_m = RangeGate.whole(block.radar, _N_SAMPLES), (_RANGE_M, _RANGE_M + 8.0)
    for lines in (BeamformedSubaperture(polar, window, lattice, beams, range_m),
                  PolarLines(polar, Profiles(window, lattice, range_m))):
        lines.fill(block.samples.reshape(_CUT, -1), *rows, np.zeros((2, 4, 32), np.float32))


def compile_fusion_kernels() -> None:
    """The same for the second stage: an aperture is fused, then one that slides on."""
    transform_rows(np.zeros((1, _LENGTH), np.complex64))
    transform_columns(np.zeros((_LENGTH, LANES), np.complex64), LANES)
    block, n_parts = _block(), _N_PULSES // _CUT
    for sliding in (False, True):
        plan = LivePlan(_GRID, block.radar, _N_SAMPLES, block.tx_m, block.rx_m,
                        target_db=_TARGET_DB, length=_CUT, slack=0.0,
                        n_window=_N_PULSES if sliding else 0)
        image = np.zeros((plan.fusion.n_coarse, plan.fusion.coarse.n_range), np.complex64)
        image.flags.writeable = sliding  # images of messages are not
        fusion = LiveFusion()
        for number in range(n_parts + 2 if sliding else n_parts):
            first = number * _CUT
            part = slice(first, first + _CUT)
            centre_m, error_db = plan.check(block.tx_m[part], block.rx_m[part])
            fusion.add(SubapertureImage(
                image, plan.fusion, centre_m, _GRID, block.radar.bandwidth_hz, 0, 0, 0,
                number // n_parts, number, 2 * n_parts if sliding else n_parts, n_parts, first,
                _CUT, 0, _N_PULSES, first, error_db))


def _block() -> PulseBlock:
    """Silent profiles of an aperture and two more sub-apertures."""
    radar = RadarParameters(10e9, 300e6, 600e6, 2 * (_RANGE_M - 16.0) / SPEED_OF_LIGHT)
    numbers = np.arange(_N_PULSES + 2 * _CUT)
    centres = np.zeros((len(numbers), 1, 3))
    centres[:, 0, 0] = -_RANGE_M
    centres[:, 0, 1] = numbers - _N_PULSES / 2
    samples = np.zeros((len(numbers), 1, _N_SAMPLES), np.complex64)
    return PulseBlock(radar, True, numbers, numbers, samples, centres, centres)
