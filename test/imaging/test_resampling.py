"""Polar images on maps: a wave in range and direction has a closed form on both."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from sar_imaging.compilation import numba
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.imaging.interpolation import design_interpolator
from sar_imaging.imaging.kernels import SINCOS_ERROR_DB
from sar_imaging.imaging.lattice import total_db
from sar_imaging.imaging.resampling import CORRECTED_TAPS, DEGREE, TAPS, add_polar_to_map

WAVELENGTH_M, OVERSAMPLING = 0.03, 2.0
# Cycles per sample, half the band's edge; the interpolators are better than the phasors
WAVE = 0.25 / OVERSAMPLING


def _case(distance_m, height_m, axis, sign, turn, n_gap):
    """Map, polar grid that reaches `TAPS` pixels beyond it, and the wave on the latter."""
    centre = np.zeros(3)
    centre[axis] = sign * distance_m
    # rows and pixels that are no multiples of what is computed together
    grid = MapGrid(tuple(centre), *((93, 70) if axis == 0 else (70, 93)), distance_m * 4e-3)
    track = np.array([-math.sin(turn), math.cos(turn)] if axis == 0
                     else [math.cos(turn), math.sin(turn)])
    side = 1 if -centre[0] * track[1] + centre[1] * track[0] >= 0 else -1
    place = (0.0, 0.0, height_m), tuple(track), side, 0.0
    unit = PolarGrid(*place, height_m + 1.0, 1.0, 1, 0.0, 1.0, 1)
    r, alpha = unit.from_map(*(v.ravel() for v in np.meshgrid(grid.x_m, grid.y_m)))
    step = 0.7 * grid.spacing_m / np.array([1.0, r.max()])
    start, n = zip(*((v.min() - (TAPS + 0.3) * d, math.ceil(np.ptp(v) / d) + 2 * TAPS + 1)
                     for v, d in zip((r, alpha), step, strict=True)), strict=True)
    polar = PolarGrid(*place, start[0], step[0], n[0], start[1], step[1], n[1])
    range_cycles, direction_cycles = (WAVE * np.arange(count) for count in n)
    lines = np.full((2, n[1], n[0] + n_gap), np.nan, np.float32)[:, :, :n[0]]
    wave = np.exp(2j * np.pi * (range_cycles - direction_cycles[:, None]))
    lines[:] = wave.real, wave.imag
    cycles = (WAVE * (r - start[0]) / step[0] - WAVE * (alpha - start[1]) / step[1]
              + 2 / WAVELENGTH_M * (r - start[0]))
    return grid, polar, lines, np.exp(2j * np.pi * cycles).reshape(grid.shape)


@pytest.mark.parametrize('distance_m, height_m', [(12.0, 6.0), (1000.0, 300.0)])
@pytest.mark.parametrize('axis, sign, turn',
                         list(itertools.product((0, 1), (1, -1), (0.0, 0.3))))
@pytest.mark.parametrize('corrected', [False, True], ids=['', 'corrected'])
def test_a_wave_arrives_with_its_carrier(distance_m, height_m, axis, sign, turn, corrected):
    grid, polar, lines, expected = _case(distance_m, height_m, axis, sign, turn, n_gap=5)
    along = design_interpolator(OVERSAMPLING, taps=TAPS, degree=DEGREE)
    between = design_interpolator(OVERSAMPLING, taps=CORRECTED_TAPS if corrected else TAPS,
                                  degree=DEGREE, corrected=corrected)
    lines *= np.float32(between.gain([WAVE])[0]) if corrected else 1
    threads, images = numba.get_num_threads(), []
    try:
        for n in (1, threads):
            numba.set_num_threads(n)
            images.append(np.ones(grid.shape, np.complex64))
            add_polar_to_map(*lines, polar, grid, images[-1], axis=axis,
                             wavelength_m=WAVELENGTH_M, between=between, along=along)
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(*images)  # whatever the number of threads
    error = images[0] - 1 - expected
    # two passes and the phasors; -107.4 dB measured, and 1.8 times as much in the worst pixel
    bound_db = total_db(between.error_db, along.error_db, SINCOS_ERROR_DB) + 1
    assert 10 * math.log10(np.mean(np.abs(error) ** 2)) < bound_db
    assert np.abs(error).max() < 4 * 10 ** (bound_db / 20)
