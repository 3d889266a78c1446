# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Paths of echoes as beams take them, against distances, and what beams cost at least."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.afbp.beams import (
    BeamGeometry,
    BeamSampling,
    grid_edges,
    least_operations,
)
from sar_imaging.planning.profiles import RangeResampling

POLAR = PolarGrid((30.0, -20.0, 400.0), (0.6, 0.8), 1, 10.0, 900.0, 0.25, 512, -0.05, 1e-3, 100)


@pytest.fixture(name='echoes')
def rows_fixture():
    """Phase centres; of the second half of the echoes receivers stand apart."""
    rng = np.random.default_rng(4)
    along = np.linspace(-9.0, 7.0, 21)[:, None] * [*POLAR.track, 0.0]
    tx = np.array(POLAR.origin_m) + along + rng.normal(0, 0.3, (21, 3))
    rx = tx.copy()
    rx[10:] += rng.normal(0, 0.5, (11, 3))
    return tx, rx


def test_paths_are_those_to_the_plane(echoes):
    geometry = BeamGeometry.of(POLAR, grid_edges(POLAR), *echoes)
    local = dataclasses.replace(POLAR, origin_m=tuple(geometry.centre_m))
    direction = np.linspace(*geometry.direction, 9)
    points = local.lines(geometry.range_m, direction)[0]
    distance = np.mean([np.linalg.norm(points[:, None] - centre, axis=-1) for centre in echoes],
                       axis=0)
    # Measured: 2e-13 m, the rounding of the distances
    np.testing.assert_allclose(geometry.extra_path(*echoes, direction),
                               distance - geometry.range_m, rtol=0, atol=1e-11)


def test_paths_go_on_straight_where_the_plane_ends(echoes):
    geometry = BeamGeometry.of(POLAR, grid_edges(POLAR), *echoes)
    low, high = geometry.known
    direction = np.linspace(low - 0.3, high + 0.3, 101)
    path = geometry.beam_path(*echoes, direction)
    for beyond, end in ((direction < low, low), (direction > high, high)):
        slope = geometry.slope(*echoes, [end])
        expected = geometry.extra_path(*echoes, [end]) + slope * (direction[beyond, None] - end)
        np.testing.assert_allclose(path[beyond], expected, rtol=0, atol=1e-11)


def test_spread_is_the_steepest_slope(echoes):
    geometry = BeamGeometry.of(POLAR, grid_edges(POLAR), *echoes)
    direction = np.linspace(*geometry.direction, 1001)
    steepest = np.abs(geometry.slope(*echoes, direction)).max()
    # Differences between the directions that are looked at lie a little below; measured: 4e-5
    assert 0.99 * steepest < geometry.spread(*echoes) <= steepest * (1 + 1e-6)


@given(group=st.integers(1, 18), paired=st.booleans(),
       segment=st.sampled_from([16, 32, 64, 128]), span=st.floats(1e-6, 1.0),
       spacing=st.floats(1e-3, 1.0), n_echoes=st.integers(1, 600), n_bins=st.integers(1, 40_000),
       n_cells=st.integers(1, 40_000), n_pixels=st.integers(1, 10_000_000))
def test_no_beams_cost_less_than_the_least(group, paired, segment, span, spacing, n_echoes, n_bins,
                                           n_cells, n_pixels):
    sampling = BeamSampling(1.0, spacing, group, 1.0 * paired, segment, None, None, -60.0)
    resampling = RangeResampling(n_bins, n_cells, 1, 0, 0.1, 0.1, None, -60.0)
    # beams that are oversampled the least lie 1.16 times closer than the band lets them
    least = least_operations(n_echoes, resampling, n_pixels, (1 - 1e-12) * span / spacing / 1.16)
    needed = sampling.operations(n_echoes, resampling, n_pixels, span)
    assert all(least[name] <= needed[name] for name in least)
