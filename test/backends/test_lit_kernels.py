# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled backprojection with illumination against the formula, by the same plans."""

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from sar_imaging.backends import cpu, reference
from sar_imaging.backends.cpu.illumination import Antennas, TileAmplitudes
from sar_imaging.geometry import MapGrid, TerrainGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.illumination import draw_points, node_positions, tile_error_db
from sar_imaging.planning.exact.points import ImagePoints, plan_points
from sar_imaging.planning.plan import Plan, total_db
from sar_imaging.planning.profiles import RangeGate
from sar_imaging.signal import SPEED_OF_LIGHT, RadarParameters

RADAR, N_SAMPLES = RadarParameters(9.6e9, 150e6, 225e6, 2 * 300 / SPEED_OF_LIGHT), 320


def _case(seed, width, squint, n_pulses=24, n_channels=2):
    """Noise from a track, antennas that look anywhere near the grid."""
    rng = np.random.default_rng(seed)
    tx = np.zeros((n_pulses, n_channels, 3))
    tx[..., 0] = np.linspace(-15, 15, n_pulses)[:, None]
    tx[..., 2] = 60.0
    rx = tx + rng.normal(size=(1, n_channels, 3)) * 0.3 * (np.arange(n_channels) > 0)[:, None]
    pointing = Pointing.beside_track(tx.mean(axis=1), 1, rng.uniform(0, 0.3), squint)
    pattern = AntennaPattern(PatternCut.sinc(width), PatternCut.cosine(rng.uniform(0.1, 0.9)))
    lit = Illumination.of_pulses(pattern, pointing, tx, rx)
    samples = rng.normal(size=(2, n_pulses * n_channels, N_SAMPLES))
    samples = (samples[0] + 1j * samples[1]).astype(np.complex64)
    spectrum = np.fft.fft(samples)
    spectrum[:, N_SAMPLES // 3:-(N_SAMPLES // 3)] = 0  # of the band
    return (np.fft.ifft(spectrum).astype(np.complex64), tx.reshape(-1, 3), rx.reshape(-1, 3), lit)


def _images(plan, samples, tx, rx):
    images = []
    for backend in (cpu, reference):
        image = np.zeros(plan.grid.shape, np.complex64)
        backend.Backprojection(plan).add(samples, tx, rx, image)
        images.append(image)
    return images


GRIDS = {'lines': MapGrid((0.0, 400.0, 0.0), 45, 70, 0.9),
         'volume': MapGrid((10.0, 380.0, 2.0), 3, 90, 0.7),
         'points': TerrainGrid(MapGrid((0.0, 400.0, 0.0), 40, 37, 0.9),
                               np.random.default_rng(3).normal(size=(37, 40)))}


@pytest.mark.parametrize('name', GRIDS)
@settings(max_examples=5)
@given(seed=st.integers(0, 1000), width=st.floats(0.03, 0.6), squint=st.floats(-0.1, 0.1),
       target_db=st.floats(-80, -40))
def test_images_are_those_of_the_formula(name, seed, width, squint, target_db):
    samples, tx, rx, lit = _case(seed, width, squint)
    grid = GRIDS[name]
    if name == 'points':
        heights = grid.height_m.copy()
        heights[seed % 37, :seed % 40] = np.nan  # no pixels
        grid = ImagePoints.of_grid(TerrainGrid(grid.map_grid, heights))
    plan = plan_backprojection(grid, RADAR, N_SAMPLES, tx, rx, target_db, lit)
    found, expected = _images(plan, samples, tx, rx)
    power = (np.abs(expected) ** 2).sum()
    if power == 0:  # nothing is lit
        assert not found.any()
        return
    error_db = 10 * np.log10((np.abs(found - expected) ** 2).sum() / power + 1e-20)
    # Of few pulses and lit pixels errors are by chance larger than of a scene at large.
    assert error_db <= plan.predicted_error_db + 6.0
    dark = (lit.amplitude(grid.points()) == 0).all(axis=0)
    assert np.abs(expected[dark]).max(initial=0) == 0
    assert plan.errors_db['illumination'] <= target_db


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), width=st.floats(0.01, 0.8), squint=st.floats(-1.0, 1.0),
       apart=st.sampled_from([32, 8, 1]))
def test_no_lit_tile_is_left_out(seed, width, squint, apart):
    """What the corners of blocks say is dark is dark at all nodes."""
    _, tx, _, lit = _case(seed, width, squint, n_channels=1)
    grid, segment = GRIDS['lines'], 8

    def locate(pixel, line):
        return (grid.origin_m + np.multiply.outer(pixel, [0, -grid.spacing_m, 0.0])
                + np.multiply.outer(line, [grid.spacing_m, 0.0, 0.0]),)

    nodes = node_positions(locate, grid.n_x, grid.n_y, segment, apart)
    found, any_lit, amplitude, node, between = TileAmplitudes(Antennas.of(lit), *nodes).amplitudes(
        slice(0, None))
    expected = lit.amplitude(np.moveaxis(nodes[0], 0, -1))  # (R, G, P, K)
    tiles = np.stack([expected[:, :, 2 * s:2 * s + 3].max(axis=(2, 3))
                      for s in range(found.shape[2])], axis=2) > 0
    np.testing.assert_array_equal(found, tiles)
    np.testing.assert_array_equal(any_lit, tiles.any(axis=0))
    for r, g, s in np.argwhere(tiles)[:200]:
        np.testing.assert_allclose(amplitude[r, g, 2 * s:2 * s + 3],
                                   expected[r, g, 2 * s:2 * s + 3], atol=1e-6)
    # a line lies between its nodes
    x = nodes[0][0, :, 0]
    line = np.arange(found.shape[1] * 32).reshape(-1, 32)
    here = np.take_along_axis(x, node, 1) + between * (
        np.take_along_axis(x, node + 1, 1) - np.take_along_axis(x, node, 1))
    np.testing.assert_allclose(here, grid.x_m[np.minimum(line, grid.n_x - 1)], atol=1e-4)


def test_plans_with_illumination_compare_and_count_lit_pixels_alone():
    samples, tx, rx, lit = _case(1, 0.05, 0.0)
    grid = GRIDS['lines']
    args = grid, RADAR, N_SAMPLES, tx, rx, -60.0
    plan, again, bare = plan_backprojection(*args, lit), plan_backprojection(*args, lit), (
        plan_backprojection(*args))
    assert isinstance(plan, Plan) and plan == again and plan != bare
    share = (lit.amplitude(grid.points()) > 0).mean()
    # of some thousand random pairs, and of tiles that are lit in part
    assert share - 0.03 <= plan.route.amplitudes.share <= min(1.0, 2.2 * share + 0.1)
    assert 'illumination' not in bare.errors_db
    # nodes of the largest pass: three coordinates in float64, 32 amplitudes in float32
    nodes = plan.route.amplitudes.n_bytes((grid.n_y, grid.n_x), plan.route.tile) // (24 + 32 * 4)
    assert nodes >= 1 and plan.n_bytes >= lit.n_bytes + nodes * (24 + 32 * 4)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), tile=st.sampled_from([(16, 16), (8, 8)]))
def test_amplitudes_between_nodes_err_as_planned(seed, tile):
    """Parabolas of the compiled loop against those that the plan judges."""
    samples, tx, rx, lit = _case(seed, 0.25, 0.0)
    grid = GRIDS['lines']
    assume((lit.amplitude(grid.points()) > 0).any())
    plan = plan_backprojection(grid, RADAR, N_SAMPLES, tx, rx, -75.0, lit)
    points = ImagePoints.of_grid(grid)
    route = plan_points(points, RangeGate.around(RADAR, N_SAMPLES, plan.range_m), tx, rx,
                        plan.range_m, -90.0, illumination=lit)
    pairs = draw_points(lit, points.positions, points.size, tile)
    planned_db = tile_error_db(pairs, points.positions, points.size, tile)[0]
    route = dataclasses.replace(route, tile=tile, amplitudes=dataclasses.replace(
        route.amplitudes, each=False))
    found, expected = _images(dataclasses.replace(plan, route=route), samples, tx, rx)
    error_db = 10 * np.log10((np.abs(found - expected) ** 2).sum()
                             / (np.abs(expected) ** 2).sum())
    # Errors of neighbouring pixels and pulses are alike; the rest of the plan errs by -85 dB.
    assert abs(error_db - total_db(planned_db, route.predicted_error_db)) < 5.0
