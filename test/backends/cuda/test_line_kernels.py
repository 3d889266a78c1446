# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines of an image against sums written out, with given polynomials."""

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from sar_imaging.backends.cuda.arrays import launch, pairs, xp
from sar_imaging.backends.cuda.lines import THREADS, add_lines, block_lines, segment_middles
from sar_imaging.backends.cuda.transfers import to_host

DEGREE = 4


def expected(planes, segment, range_m, step_m, cycles_per_step, start_m, pitch_m, centres_m, n):
    """Sum of ``P(t) exp(j 2 pi c)`` on one line through all phase centres, in float64.

    A segment keeps the interval of its middle; its pixels read on from cell to cell.
    """
    u, i = planes.shape[1], np.arange(n)
    middle = i // segment * segment + segment // 2
    total = np.zeros(n, complex)
    for coefficients, centre_m in zip(planes, centres_m, strict=True):
        interval = np.floor((start_m + pitch_m * middle - centre_m - range_m) / step_m)
        cell = np.floor((interval + 0.5) / u)
        v = (start_m + pitch_m * i - centre_m - range_m) / step_m
        index = (segment + cell + i - middle).astype(int)
        inside = (index >= 0) & (index < planes.shape[-1])
        some = coefficients[(interval - cell * u).astype(int), :, np.where(inside, index, 0)]
        powers = (v - interval - u * (i - middle))[:, None] ** np.arange(DEGREE + 1)
        value = ((some[:, :DEGREE + 1] + 1j * some[:, DEGREE + 1:]) * powers).sum(axis=-1)
        cycles = cycles_per_step * (v - u * i)
        total += np.where(inside, value, 0.0) * np.exp(2j * np.pi * np.fmod(cycles, 1.0))
    return total


def in_blocks(planes):
    """Coefficients as the kernel takes them, (R, U, n / 32, 5, 32) complex64."""
    both = planes[:, :, :DEGREE + 1] + 1j * planes[:, :, DEGREE + 1:]
    cut = both.reshape(*both.shape[:3], -1, 32).swapaxes(2, 3)
    return np.ascontiguousarray(cut, np.complex64)


@settings(max_examples=4, deadline=None)
@example(seed=2833770669, n_rows=34, segment=64, n_phases=2, transposed=False)  # 1,892 cycles
@given(seed=st.integers(0, 2 ** 32), n_rows=st.sampled_from([1, 3, 34]),
       segment=st.sampled_from([32, 64, 128]), n_phases=st.integers(1, 3),
       transposed=st.booleans())
def test_sums_of_given_polynomials(seed, n_rows, segment, n_phases, transposed):
    """Lines that run away from the phase centres: paths are straight, nothing is expanded."""
    rng = np.random.default_rng(seed)
    n_lines, n_pixels = (1, segment - 5) if n_rows > 3 else (9, 40)
    n_cells = 2 * segment + 32 * int(rng.integers(1, 4))
    planes = rng.standard_normal((n_rows, n_phases, 2 * DEGREE + 2, n_cells)) * np.tile(
        0.5 ** np.arange(DEGREE + 1), 2)[:, None]
    planes[..., :segment] = planes[..., -segment:] = 0.0
    planes = planes.astype(np.float32)
    step_m, range_m, cycles = (rng.uniform(0.05, 0.2), rng.uniform(90.0, 110.0),
                               10 ** rng.uniform(-1.0, 3.3))
    # at most a step of drift over half a segment; some lines begin before or end after the cells
    pitch_m = step_m * (n_phases + rng.uniform(-1, 1) * 2 / segment)
    start_m = range_m + rng.uniform(-1, 1) * segment * pitch_m
    angle = rng.uniform(0, 2 * np.pi, n_lines)
    away = np.stack([np.cos(angle), np.sin(angle) * 0.8, np.sin(angle) * 0.6], axis=-1)
    # phase centres on the way back of one line, or all in the middle of several
    along = rng.uniform(-3.0, 3.0, (2, n_rows)) * (n_lines == 1)
    tx, rx = along[..., None] * away[0]
    ramp = np.exp(2j * np.pi * rng.random(n_pixels)).astype(np.complex64)

    def locate(pixel, line):
        position = (start_m + pitch_m * pixel)[..., None] * away[line]
        zero = np.zeros_like(position)
        return position, zero + pitch_m * away[line], zero, zero, zero

    before = rng.standard_normal((n_lines, n_pixels, 2)).astype(np.float32)
    image = xp.asarray(before.swapaxes(0, 1).copy() if transposed else before.copy())
    layout = [n_lines, 0, *((2, 2 * n_lines) if transposed else (2 * n_pixels, 2)), 1]
    blocks = -(-n_pixels // segment), -(-n_lines // block_lines(segment))
    launch(add_lines, blocks, THREADS, pairs(xp.asarray(in_blocks(planes))),
           (n_phases, n_cells, range_m, step_m, cycles, 0.0), segment,
           xp.asarray(np.concatenate([tx, rx], axis=1)),
           xp.asarray(segment_middles(locate, slice(0, n_lines), n_pixels, segment)),
           xp.asarray(ramp), image.reshape(-1), xp.asarray(np.array(layout)))
    after = to_host(image)
    added = (after.swapaxes(0, 1) if transposed else after) - before
    wanted = ramp * expected(planes, segment, range_m, step_m, cycles, start_m, pitch_m,
                             along.mean(axis=0), n_pixels)
    # what is left of phases for float32 rounds by some 1e-6 of a cycle
    error = np.abs(added[..., 0] + 1j * added[..., 1] - wanted).max()
    assert error < 2e-4 * max(1.0, np.abs(wanted).max())


@pytest.mark.parametrize('segment', [8, 16, 32, 64, 128, 256])
def test_a_block_has_all_its_threads(segment):
    assert block_lines(segment) * segment == 2048
