# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Arbitrary points against sums written out, with given polynomials."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.points import (
    PointProfiles,
    PointTiles,
    PointWork,
    _project_points,
)
from sar_imaging.backends.reference.project_points import half_paths


def continuous_cubics(rng, n_rows, n_cells):
    """(R, n, 8) coefficients of profiles without jumps: rounding may take a neighbour's interval.

    The first and the last interval are zero.
    """
    values = rng.standard_normal((2, n_rows, n_cells + 1))
    values[..., :2] = values[..., -2:] = 0.0
    bump = rng.standard_normal((2, 2, n_rows, n_cells)) * 0.3
    bump[..., [0, -1]] = 0.0
    rise = np.diff(values)
    # a straight line, and b t (1 - t) (1 + a t), which is zero at both ends
    b, c = bump[0], bump[1]
    parts = [values[..., :-1], rise + b, c - b, -c]
    return np.concatenate([np.stack([p[part] for p in parts], axis=-1) for part in (0, 1)],
                          axis=-1).astype(np.float32)


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_rows=st.integers(1, 6), n_y=st.integers(1, 40),
       n_x=st.integers(1, 70), tile=st.sampled_from([(16, 16), (4, 4), (1, 256), (1, 16)]),
       kind=st.sampled_from(['map', 'terrain', 'array']), near=st.booleans(),
       in_float64=st.booleans())
def test_sums_of_given_polynomials(seed, n_rows, n_y, n_x, tile, kind, near, in_float64):
    rng = np.random.default_rng(seed)
    pitch_m = rng.uniform(0.02, 0.5)
    size_m = pitch_m * max(n_x, n_y)
    range_m = size_m * rng.uniform(0.0, 1.0) if near else size_m * rng.uniform(10.0, 1000.0)
    tx = np.array([-range_m, 0.0, 0.3 * range_m]) + size_m * rng.standard_normal((n_rows, 3))
    rx = tx + 0.1 * size_m * rng.standard_normal((n_rows, 3)) * rng.integers(0, 2, (n_rows, 1))
    x, y = pitch_m * np.arange(n_x), pitch_m * np.arange(n_y)[::-1]
    points = np.stack(np.broadcast_arrays(x, y[:, None], 0.5), axis=-1)
    if kind == 'map':
        args = x, y, np.array([0.5]), np.array([(0, 1), (1, 0), (0, 0)])
    else:
        points[..., 2] = pitch_m * rng.standard_normal((n_y, n_x)).cumsum(axis=1)
        points[rng.random((n_y, n_x)) < 0.1, 2] = np.nan
        flat = points.reshape(-1)
        args = ((x, y, points[..., 2].ravel(), np.array([(0, 1), (1, 0), (n_x, 1)]))
                if kind == 'terrain' else
                (flat, flat[1:], flat[2:], np.full((3, 2), (3 * n_x, 3))))
    known = np.isfinite(points).all(axis=-1)
    path = np.stack([half_paths(t, r, points) for t, r in zip(tx, rx, strict=True)])
    wavelength_m, step_m = rng.uniform(0.03, 0.5), rng.uniform(0.1, 1.0)
    # some of the points before and beyond the profile
    lo, hi = (np.nanquantile(path, q) if known.any() else range_m for q in (0.1, 0.8))
    n_cells = int((hi - lo) / step_m) + 6
    coefficients = continuous_cubics(rng, n_rows, n_cells)
    zero_m, cycles = lo + rng.random() * step_m, rng.uniform(-1, 1)
    image = rng.standard_normal((n_y, n_x, 2)).astype(np.float32)
    before = image.astype(float).view(complex)[..., 0]
    reach_m = 0.0 if in_float64 else np.inf
    per_step = 2 * step_m / wavelength_m
    profiles = PointProfiles(coefficients.reshape(-1), n_rows, n_cells, zero_m, step_m, per_step,
                             cycles)
    _project_points(profiles, tx, rx, PointTiles(*args, n_y, n_x, *tile, reach_m),
                    image.reshape(-1), PointWork.for_threads(), None)

    wanted = before.copy()
    for some, way in zip(coefficients.astype(float), path, strict=True):
        v = (way[known] - zero_m) / step_m
        cell = np.floor(v)
        powers = (v - cell)[:, None] ** np.arange(4)
        part = some[np.clip(cell, 0, n_cells - 1).astype(int)]
        value = (part[:, :4] * powers).sum(axis=1) + 1j * (part[:, 4:] * powers).sum(axis=1)
        wanted[known] += value * np.exp(2j * np.pi * np.fmod(per_step * v + cycles, 1.0))
    # float32 rounds the path over a tile, at most as wide as the points, by 3e-8 of its radius
    # (rms, `planning.exact.points`); sine polynomials err by 4e-6.
    spread = [np.ptp(points[..., k][known]) if known.any() else 0.0 for k in range(3)]
    phase = 4 * np.pi / wavelength_m * 3e-8 * 0.5 * np.linalg.norm(spread)
    error = np.abs(image.astype(float).view(complex)[..., 0] - wanted)
    scale = np.sqrt(n_rows) * 3.0
    assert np.sqrt(np.mean(error ** 2)) <= scale * np.hypot(1e-5, 2 * phase)
    np.testing.assert_array_equal(image[~known], before[~known].view(float).reshape(-1, 2))
