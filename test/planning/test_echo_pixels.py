# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs that tell errors of images with beams: none is left out, and their mean is bounded."""

import functools

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.grids import even_positions
from sar_imaging.geometry.half_paths import pair_lengths, pair_paths, sample_paths
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.planning.echo_pixels import EchoPixels, _cells_to_draw

GRID = MapGrid((0.0, 400.0, 0.0), 44, 36, 1.0)
POSITIONS = functools.partial(even_positions, GRID)


def _illumination(seed, width, n=24):
    """Beams towards places all over the map and beside it."""
    rng = np.random.default_rng(seed)
    centre = np.zeros((n, 1, 3))
    centre[..., 0], centre[..., 2] = np.linspace(-40, 40, n)[:, None], 70.0
    target = np.array([0.0, 400.0, 0.0]) + rng.uniform(-35, 35, (n, 3)) * [1, 1, 0]
    pattern = AntennaPattern(PatternCut.cosine(width), PatternCut.uniform(2 * width))
    return Illumination.of_pulses(pattern, Pointing(target - centre[:, 0]), centre, centre)


@settings(max_examples=20)
@given(seed=st.integers(0, 999), width=st.floats(0.003, 0.3))
def test_no_lit_pair_is_left_out(seed, width):
    lit = _illumination(seed, width)
    amplitude = lit.amplitude(GRID.points())
    echo, row, column = np.nonzero(amplitude)
    assume(len(echo))
    cells = _cells_to_draw(lit, POSITIONS, GRID.shape, (0, 0), True)
    drawn = np.zeros((24, 4, 4), bool)
    drawn[cells] = True
    assert drawn[echo, row * 4 // GRID.n_y, column * 4 // GRID.n_x].all()
    mesh = [np.linspace(0, size - 1, 5) for size in GRID.shape]
    corners = POSITIONS(*np.meshgrid(*mesh, indexing='ij')).reshape(-1, 3)
    may = lit.may_light(corners, (5, 5)).reshape(-1, 5, 5)
    around = [np.minimum((i / (size - 1) * 4).astype(int), 3)
              for i, size in zip((row, column), GRID.shape, strict=True)]
    assert all(may[echo, around[0] + i, around[1] + j].all() for i in (0, 1) for j in (0, 1))


@settings(max_examples=10)
@given(seed=st.integers(0, 99), width=st.floats(0.004, 0.2))
def test_pairs_stand_for_the_image(seed, width):
    """Share and power of lit pairs, and of dark ones beside them, against all of them."""
    lit = _illumination(seed, width)
    amplitude = lit.amplitude(GRID.points())
    assume((amplitude > 0).mean() > 1e-3)
    pairs = EchoPixels.draw(lit, POSITIONS, GRID.shape, (6, 6))
    # 1024 pairs and more know a share to 3 to 10 %; bright ones are fewer
    assert pairs.share == pytest.approx((amplitude > 0).mean(), rel=0.15)
    assert pairs.power == pytest.approx((amplitude ** 2).mean(), rel=0.3)
    np.testing.assert_allclose(pairs.amplitude, amplitude[(pairs.echoes, *pairs.index)])
    assert (pairs.amplitude == 0).any() or (amplitude > 0).mean() > 0.9


def test_an_error_of_few_pairs_is_bounded():
    """A thousandth of the pairs errs by 1; the bound lies above the truth in 19 of 20 draws."""
    rng, above = np.random.default_rng(0), 0
    for _ in range(200):
        wrong = (rng.random(4096) < 0.005).astype(float)
        pairs = EchoPixels(None, np.zeros(4096, int), (), None, rng.uniform(0, 1, 4096), None, 1.0)
        above += pairs.error(wrong) > 0.005 / (1 / 3)
    assert above > 180
    assert pairs.error(np.zeros(4096)) == 0.0


def test_paths_of_pairs_are_those_of_all():
    rng = np.random.default_rng(1)
    tx, rx, *line = rng.normal(size=(7, 6, 3)) * 10
    length, *derivatives = pair_paths(tx, rx, line)
    expected = sample_paths(tx, rx, line)
    for found, paths in zip((length, *derivatives), (expected.length, *expected.derivatives),
                            strict=True):
        np.testing.assert_allclose(found, np.diag(paths), rtol=1e-12)
    np.testing.assert_allclose(pair_lengths(tx, rx, line[0]), length, rtol=1e-14)
