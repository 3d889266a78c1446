# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar images on maps: a wave in range and direction has a closed form on both."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, reject, settings, strategies as st

from sar_imaging.backends.cpu.polar_to_map import overwriting_rounds, polar_to_map
from sar_imaging.compilation import numba
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.plan import SINCOS_ERROR_DB, total_db
from sar_imaging.planning.polar_cover import DEAPODISED_TAPS, DEGREE, TAPS

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
@pytest.mark.parametrize('deapodised', [False, True], ids=['', 'deapodised'])
def test_a_wave_arrives_with_its_carrier(distance_m, height_m, axis, sign, turn, deapodised):
    grid, polar, lines, expected = _case(distance_m, height_m, axis, sign, turn, n_gap=5)
    along = design_interpolator(OVERSAMPLING, taps=TAPS, degree=DEGREE)
    between = design_interpolator(OVERSAMPLING, taps=DEAPODISED_TAPS if deapodised else TAPS,
                                  degree=DEGREE, deapodised=deapodised)
    lines *= np.float32(between.gain([WAVE])[0]) if deapodised else 1
    threads, images = numba.get_num_threads(), []
    try:
        for n in (1, threads):
            numba.set_num_threads(n)
            images.append(np.ones(grid.shape, np.complex64))
            polar_to_map(lines, polar, grid, axis=axis, wavelength_m=WAVELENGTH_M,
                         between=between, along=along, onto=images[-1])
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(*images)  # whatever the number of threads
    error = images[0] - 1 - expected
    # two passes and the phasors; -107.4 dB measured, and 1.8 times as much in the worst pixel
    bound_db = total_db(between.error_db, along.error_db, SINCOS_ERROR_DB) + 1
    assert 10 * math.log10(np.mean(np.abs(error) ** 2)) < bound_db
    assert np.abs(error).max() < 4 * 10 ** (bound_db / 20)


@pytest.fixture(name='interpolators', scope='module')
def interpolators_fixture():
    return {'along': design_interpolator(OVERSAMPLING, taps=TAPS, degree=DEGREE),
            'between': design_interpolator(OVERSAMPLING, taps=DEAPODISED_TAPS, degree=DEGREE,
                                           deapodised=True)}


def _lines_beyond(grid, turn, axis, height_m, flip, step, before):
    """Polar grid around a map, some lines before its first, and noise on it as AFBP has it."""
    centre = np.array(grid.centre_m)
    ahead = np.sign(centre[axis])
    track = np.array([-ahead * math.sin(turn), -math.cos(turn)] if axis == 0
                     else [math.cos(turn), -ahead * math.sin(turn)]) * (-1 if flip else 1)
    side = 1 if -centre[0] * track[1] + centre[1] * track[0] >= 0 else -1
    place = (0.0, 0.0, height_m), tuple(track), side, 0.0
    r, alpha = PolarGrid(*place, height_m + 1.0, 1.0, 1, 0.0, 1.0, 1).from_map(
        *(v.ravel() for v in np.meshgrid(grid.x_m, grid.y_m)))
    step = step * grid.spacing_m / np.array([1.0, r.max()])
    beside = TAPS + 0.3
    polar = PolarGrid(*place, r.min() - beside * step[0], step[0],
                      math.ceil(np.ptp(r) / step[0] + 2 * beside),
                      alpha.min() - before * step[1], step[1],
                      math.ceil(np.ptp(alpha) / step[1] + before + beside))
    noise = np.random.default_rng(0).standard_normal((polar.n_alpha, 2, polar.n_range), np.float32)
    return polar, noise.swapaxes(0, 1)


def _overwrites(lines, polar, grid, axis, interpolators):
    """Whether the map was written over the polar image; it must be as it is elsewhere."""
    options = dict(interpolators, axis=axis, wavelength_m=WAVELENGTH_M)
    before = lines.copy(order='K')
    expected = polar_to_map(lines, polar, grid, **options)
    assert np.array_equal(lines, before) and not np.shares_memory(expected, lines)
    added = np.zeros(grid.shape, np.complex64)
    polar_to_map(lines, polar, grid, **options, onto=added)
    np.testing.assert_array_equal(added, expected)
    image = polar_to_map(lines, polar, grid, **options, overwrite=True)
    np.testing.assert_array_equal(image, expected)
    shared = np.shares_memory(image, lines)
    assert shared or np.array_equal(lines, before)
    return shared


@pytest.mark.parametrize('turn', [0.0, 0.4, -0.4])
@pytest.mark.parametrize('ahead', [1, -1])
def test_a_map_is_written_over_lines_in_its_order(ahead, turn, interpolators):
    grid = MapGrid((ahead * 1000.0, 30.0, 0.0), 61, 300, 1.0)
    place = turn, 0, 300.0
    for flip, step, before, room in (
            (False, 0.7, 60, True), (True, 0.7, 60, False),  # the last line is needed first
            (False, 0.7, 9, False), (False, 2.0, 60, False)):  # no room to begin, or to go on
        polar, lines = _lines_beyond(grid, *place, flip, step, before)
        assert (overwriting_rounds(polar, grid, **interpolators, axis=0) is not None) is room
        # which takes more rounds than little memory is worth
        assert not _overwrites(lines, polar, grid, 0, interpolators)
    polar, lines = _lines_beyond(grid, *place, False, 0.7, 200)
    assert _overwrites(lines, polar, grid, 0, interpolators)
    apart, locked = np.ascontiguousarray(lines), lines.copy(order='K')
    locked.flags.writeable = False
    for other in (apart, locked, np.concatenate([lines, lines], axis=2)[:, :, :polar.n_range]):
        assert not _overwrites(other, polar, grid, 0, interpolators)


def test_a_large_map_is_written_over_lines_in_rounds(interpolators):
    grid = MapGrid((3000.0, 0.0, 0.0), 1400, 1500, 1.0)
    polar, lines = _lines_beyond(grid, 0.1, 0, 1000.0, False, 0.7, 500)
    assert len(overwriting_rounds(polar, grid, **interpolators, axis=0)) == 3
    assert _overwrites(lines, polar, grid, 0, interpolators)


@pytest.mark.parametrize('flip', [False, True])
def test_a_map_seen_along_its_columns_has_its_own_memory(flip, interpolators):
    grid = MapGrid((30.0, 1000.0, 0.0), 300, 61, 1.0)
    polar, lines = _lines_beyond(grid, 0.2, 1, 300.0, flip, 0.7, 200)
    assert not _overwrites(lines, polar, grid, 1, interpolators)


@settings(max_examples=60, deadline=None)
@given(n_x=st.integers(20, 70), n_y=st.integers(64, 400), nearest=st.floats(40.0, 2000.0),
       aside=st.floats(-0.4, 0.4), turn=st.floats(-0.8, 0.8),
       height=st.sampled_from([0.0, 0.4, 1.0]), step=st.floats(0.2, 0.8),
       before=st.integers(15, 80))
@example(n_x=266, n_y=110, nearest=154.0, aside=0.16, turn=0.47, height=1.03, step=0.336,
         before=35)  # the extreme decides where a round ends
def test_overwriting_changes_no_bit(interpolators, n_x, n_y, nearest, aside, turn, height, step,
                                    before):
    """What a round writes is not read by it or later, whichever task is ahead of the others.

    Near and wide maps too, where directions have an extreme within a row.
    """
    grid = MapGrid((nearest + 0.5 * n_x, aside * n_y, 0.0), n_x, n_y, 1.0)
    try:
        polar, lines = _lines_beyond(grid, turn, 0, height * nearest, False, step, before)
    except ValueError:  # lines beyond the map would be on the other side of the track
        reject()
    options = dict(interpolators, axis=0)
    rounds = overwriting_rounds(polar, grid, **options) or [0]
    options['wavelength_m'] = WAVELENGTH_M
    expected = polar_to_map(lines, polar, grid, **options)
    for begin, end in itertools.pairwise(rounds):
        lost = lines.copy(order='K')
        lost.swapaxes(0, 1).reshape(-1)[:2 * end * n_x] = np.nan
        rest = polar_to_map(lost, polar, grid, **options)[begin:]
        np.testing.assert_array_equal(rest, expected[begin:])
    _overwrites(lines, polar, grid, 0, interpolators)
