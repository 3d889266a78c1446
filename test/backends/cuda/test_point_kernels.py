# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Points against sums of given polynomials, and bounds of tiles."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cuda.arrays import launch, pairs, xp
from sar_imaging.backends.cuda.points import BLOCK, THREADS, add_points, bound_tiles
from sar_imaging.backends.cuda.transfers import to_host

DEGREE = 3


def tiles_of(points, tile, reach=0.0):
    n_y, n_x = points.shape[:2]
    flat = points.reshape(-1)
    made = (*(xp.asarray(flat[k:].copy()) for k in range(3)),
            xp.asarray(np.array([(3 * n_x, 3)] * 3)), (n_y, n_x, *tile, reach),
            xp.zeros((-(-n_y // tile[0]) * -(-n_x // tile[1]), 4), np.float64))
    launch(bound_tiles, -(-len(made[-1]) // THREADS), THREADS, *made)
    return made


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2 ** 32), tile=st.sampled_from([(16, 16), (8, 8), (4, 4)]),
       reach=st.sampled_from([0.0, 100.0]))
def test_sums_of_given_polynomials(seed, tile, reach):
    """In float32 by offsets from tiles, and point by point in float64 where they reach nowhere."""
    rng = np.random.default_rng(seed)
    n_rows, n_cells, step_m, cycles = 3, 200, 0.1, rng.uniform(0.1, 8.0)
    points = np.array([60.0, 0.0, 0.0]) + np.stack(np.meshgrid(
        0.3 * np.arange(9), 0.3 * np.arange(7), [0.0], indexing='ij'), axis=-1)[:, :, 0]
    points += rng.uniform(-0.1, 0.1, points.shape)
    points[2, 3, 1] = np.nan
    tx, rx = rng.uniform(-2.0, 2.0, (2, n_rows, 3))
    planes = rng.standard_normal((n_rows, 2 * DEGREE + 2, n_cells)) * np.tile(
        0.5 ** np.arange(DEGREE + 1), 2)[:, None]
    planes[..., 0] = planes[..., -1] = 0.0
    planes = planes.astype(np.float32)
    cell_by_cell = (planes[:, :DEGREE + 1] + 1j * planes[:, DEGREE + 1:]).swapaxes(1, 2).astype(
        np.complex64, order='C')
    range_m = 55.0 + rng.uniform(0, 6.0)  # some points lie outside
    image = xp.zeros(2 * points[..., 0].size, np.float32)
    made = tiles_of(points, tile, reach)
    own = BLOCK // math.prod(tile)
    launch(add_points, -(-len(made[-1]) // own), THREADS, pairs(xp.asarray(cell_by_cell)),
           (n_cells, range_m, step_m, cycles, 0.25),
           xp.asarray(np.concatenate([tx, rx], axis=1)), *made, image)
    found = to_host(image).view(np.complex64).reshape(points.shape[:2])
    wanted = np.zeros(points.shape[:2], complex)
    for row in range(n_rows):
        path = 0.5 * (np.linalg.norm(points - tx[row], axis=-1)
                      + np.linalg.norm(points - rx[row], axis=-1))
        v = np.nan_to_num((path - range_m) / step_m)
        n = np.clip(np.floor(v), 0, n_cells - 1).astype(int)
        powers = np.clip(v - np.floor(v), 0, 1)[..., None] ** np.arange(DEGREE + 1)
        some = planes[row][:, n]
        value = np.einsum('qij,ijq->ij', some[:DEGREE + 1] + 1j * some[DEGREE + 1:], powers)
        wanted += value * np.exp(2j * np.pi * np.fmod(cycles * v + 0.25, 1.0))
    assert found[2, 3] == 0.0
    wanted[2, 3] = 0.0
    # paths in float32 are good to 1e-6 of a cell; a cell has up to 8 cycles
    assert np.abs(found - wanted).max() < 2e-4 * max(1.0, np.abs(wanted).max())


@pytest.mark.parametrize('tile', [(4, 4), (1, 16)])
def test_tiles_are_bounded(tile):
    rng = np.random.default_rng(1)
    points = rng.standard_normal((5, 9, 3))
    points[rng.random((5, 9)) < 0.3] = np.nan
    points[:4, :4] = np.nan
    tiles = to_host(tiles_of(points, tile)[-1])
    number = 0
    for top in range(0, 5, tile[0]):
        for left in range(0, 9, tile[1]):
            own = points[top:top + tile[0], left:left + tile[1]].reshape(-1, 3)
            own = own[np.isfinite(own).all(axis=1)]
            if len(own):
                low, high = own.min(axis=0), own.max(axis=0)
                np.testing.assert_allclose(tiles[number], [*(low + high) / 2,
                                                           math.dist(low, high) / 2])
            else:
                assert np.isnan(tiles[number, 0])
            number += 1
