# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines read from random beams, against the formula."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.beams import (
    STORED,
    TILE,
    BeamPlaces,
    _expand_weights,
    interpolate_beams,
    summed_cells,
    work_size,
)
from sar_imaging.backends.cpu.instructions import job_counter
from sar_imaging.backends.reference import interpolate_beams as reference
from sar_imaging.compilation import numba
from sar_imaging.planning.afbp.beams import BEAM_TAPS, CELL_TAPS, DEGREE
from sar_imaging.planning.interpolators import design_interpolator

BETWEEN = design_interpolator(1.4, taps=BEAM_TAPS, degree=DEGREE, deapodised=True)
ALONG = design_interpolator(1.3, taps=CELL_TAPS, degree=DEGREE, deapodised=True)


def _table(interpolator):
    weights = np.zeros((DEGREE + 1, STORED), np.float32)
    weights[:, :interpolator.n_taps] = interpolator.weights
    return weights


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_beams=st.integers(BEAM_TAPS + 1, 40),
       n_lines=st.integers(1, 40), n_pixels=st.integers(1, 120),
       segment=st.sampled_from([16, 32, 64, 128]), bent=st.booleans())
def test_lines_away_from_the_middle(seed, n_beams, n_lines, n_pixels, segment, bent):
    """Directions are the same along a line and cells come in step: nothing is expanded."""
    rng = np.random.default_rng(seed)
    range_m, cell_m = 10 ** rng.uniform(2.5, 4.0), 0.3
    n_segments = -(-n_pixels // segment)
    n_cells = n_segments * segment + 2 * CELL_TAPS + summed_cells(segment)
    beams = rng.standard_normal((n_beams, n_cells + TILE, 2)).astype(np.float32)
    beams[:, n_cells:] = 0.0
    profiles = beams.view(np.complex64)[..., 0]
    turn = rng.uniform(0, 2 * np.pi)
    track, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    centre = 10.0 * rng.standard_normal(3)
    spacing, wavelength_m = rng.uniform(1e-3, 5e-3), 0.03
    first = rng.uniform(-0.2, 0.0)
    # between the beams that have all neighbours
    s = first + spacing * rng.uniform(BEAM_TAPS // 2 - 1, n_beams - BEAM_TAPS // 2, n_lines)
    down = 0.3 * range_m
    start_m = range_m + cell_m * (CELL_TAPS + rng.random())

    def place(r):
        beside = np.sqrt(r ** 2 * (1 - s ** 2) - (down * r / start_m) ** 2)
        horizontal = np.multiply.outer(r * s, track) + np.multiply.outer(beside, across)
        return np.concatenate([horizontal, np.full((n_lines, 1), -down * r / start_m)], axis=1)

    middle = np.arange(n_segments) * segment + segment // 2
    away = place(start_m) / start_m
    lines = np.zeros((n_segments, n_lines, 12))
    lines[..., :3] = centre + (start_m + cell_m * middle)[:, None, None] * away
    lines[..., 3:6] = cell_m * away
    curvature = 1 / (start_m * (rng.uniform(0.7, 1.4) if bent else 1.0))
    bend = -wavelength_m / (4 * np.pi * spacing ** 2) if bent else 0.0
    image = np.full((2, n_lines, n_pixels), np.nan, np.float32)
    index = np.arange(summed_cells(segment), dtype=np.float32) - segment // 2
    work = np.empty(numba.get_num_threads() * work_size(segment), np.float32)
    zero_cycles, jobs = rng.random(), job_counter()
    interpolate_beams(
        beams.reshape(-1), (n_beams, n_cells + TILE, n_lines, n_pixels, segment), lines,
        BeamPlaces(centre, track, np.array([range_m, cell_m, cell_m]), np.array([first, spacing]),
                   2 / wavelength_m, zero_cycles, np.array([curvature, bend])),
        _table(BETWEEN), _table(ALONG), index, image.reshape(-1), work, jobs.ctypes.data, None)

    points = centre + (start_m + cell_m * np.arange(n_pixels))[None, :, None] * away[:, None]
    beam_image = reference.BeamImage(
        profiles.astype(complex), centre, tuple(track), (first, spacing), (range_m, cell_m),
        1 / curvature if bent else np.inf)
    wanted = reference.interpolate_beams(beam_image, points, wavelength_m, BETWEEN, ALONG)
    if not bent:
        wanted = _without_bend(profiles, points - centre, track, first, spacing, range_m, cell_m,
                               wavelength_m)
    cycles = 2 * cell_m / wavelength_m * np.arange(n_pixels) - zero_cycles
    wanted = wanted * np.exp(-2j * np.pi * np.fmod(cycles, 1.0))
    read = image[0] + 1j * image[1]
    # Sine polynomials err by 4e-6, weights and positions by 1e-6. Along a segment 1/d of the bend
    # is a straight line: it is off by the square of half the segment over the distance.
    straight = (segment / 2 * cell_m / range_m) ** 2
    scale = np.linalg.norm(wanted) + np.sqrt(wanted.size)
    turns = np.abs(bend) * np.abs(1 / range_m - curvature) if bent else 0.0
    assert np.linalg.norm(read - wanted) <= scale * (3e-5 * (1 + turns)
                                                     + 10 * np.abs(bend) / range_m * straight)


@given(t=st.floats(0.0, 1.0), seed=st.integers(0, 2 ** 32))
def test_weights_are_expanded_to_second_order(t, seed):
    """Value, first derivative and half the second one, of any polynomials."""
    weights = np.random.default_rng(seed).standard_normal((DEGREE + 1, STORED)).astype(np.float32)
    work = np.full(3 * STORED + 2, np.nan, np.float32)
    _expand_weights(weights, np.float32(t), work, np.uint64(1))
    polynomials = [np.polynomial.Polynomial(column.astype(float)) for column in weights.T]
    wanted = [[f(t) for f in polynomials], [f.deriv()(t) for f in polynomials],
              [f.deriv(2)(t) / 2 for f in polynomials]]
    np.testing.assert_allclose(work[1:-1], np.ravel(wanted), atol=3e-5)  # up to 60, in float32
    assert np.isnan(work[[0, -1]]).all()


def _without_bend(profiles, offset, track, first, spacing, range_m, cell_m, wavelength_m):
    """Plain interpolation, tap by tap."""
    distance = np.linalg.norm(offset, axis=-1)
    u = (offset[..., :2] @ track / distance - first) / spacing
    v = (distance - range_m) / cell_m
    beam, cell = np.floor(u).astype(int), np.floor(v).astype(int)
    total = np.zeros(u.shape, complex)
    for k in range(BEAM_TAPS):
        across = sum((u - beam) ** q * BETWEEN.weights[q, k].astype(float)
                     for q in range(DEGREE + 1))
        for l in range(CELL_TAPS):
            along = sum((v - cell) ** q * ALONG.weights[q, l].astype(float)
                        for q in range(DEGREE + 1))
            total += across * along * profiles[beam + BETWEEN.first + k, cell + ALONG.first + l]
    return total * np.exp(4j * np.pi * np.fmod(distance / wavelength_m, 1.0))
