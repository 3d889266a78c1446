# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection onto terrain and arbitrary points, against float64 time-domain correlation."""

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.spectra import band_spectrum


def _error_db(block, points, image, seed=0):
    """Error against TDC over the brightest and as many random points, dB."""
    flat, points = np.ravel(image), points.reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    brightest = known[np.argsort(np.abs(flat[known]))[-150:]]
    chosen = np.r_[brightest, np.random.default_rng(seed).choice(known, 150)]
    reference = correlate(*band_spectrum(block), block.tx_m, block.rx_m, points[chosen])
    return 10 * np.log10(np.sum(np.abs(flat[chosen] - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


def _form(block, grid, target_db=-80.0, **options):
    image = plan_image(grid, block.radar, block.n_samples, method='exact', target_db=target_db,
                       **options)(block)
    assert image.report.plan.method == 'points'
    return image.samples, image.report


def _hills(grid):
    return 3.0 * np.sin(grid.x_m / 5) * np.cos(grid.y_m[:, None] / 7)


def _on(grid, height_m):
    points = grid.points()
    points[..., 2] = height_m
    return points


@pytest.mark.parametrize('options', [
    {'range_m': 100.0, 'spacing_m': 0.05},
    {'range_m': 1e3, 'height_m': 300.0, 'heading_rad': 0.5, 'channels': 3},
    {'range_m': 1e4},
    {'range_m': 5e4, 'bend_m': 5.0},
], ids=str)
def test_terrain(make_case, options):
    case = make_case(**options)
    height = _hills(case.grid)
    image, report = _form(case.block, case.grid, height_m=height)
    error = _error_db(case.block, _on(case.grid, height), image)
    assert error <= min(-80.0, report.predicted_error_db + 1.0)  # never optimistic


@pytest.mark.parametrize('target_db', [-50.0, -90.0])
def test_target_is_met_and_predicted(make_case, target_db):
    case = make_case(1e3, height_m=300.0)
    image, report = _form(case.block, case.grid.points(), target_db=target_db)
    assert report.predicted_error_db <= target_db
    assert _error_db(case.block, case.grid.points(), image) <= report.predicted_error_db + 1.0


def test_tiles_too_large_for_float32_are_computed_in_float64(make_case):
    # Neighbours in the array lie up to 134 m apart: rounded offsets would cost -68 dB.
    case = make_case(5e4, spacing_m=1.0)
    points = case.grid.points().reshape(-1, 3)
    scattered = np.random.default_rng(2).permutation(points)
    image, _ = _form(case.block, scattered)
    assert _error_db(case.block, scattered, image) <= -80.0


@pytest.mark.parametrize('shape', [(), (1,), (300,), (2, 3, 50), (17, 1), (31, 33)])
def test_points_of_any_shape(make_case, shape):
    case = make_case(1e3)
    points = case.grid.points().reshape(-1, 3)[3000:][:int(np.prod(shape))].reshape(*shape, 3)
    image, _ = _form(case.block, points)
    assert image.shape == shape
    reference = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m, points)
    # a few points may hold no scatterer: compare with the brightest possible pixel
    assert np.abs(image - reference).max() < 1e-4 * np.abs(case.block.samples).max() * 48


def test_level_terrain_is_the_map(make_case):
    case = make_case(1e3, channels=2)
    plain = exact_image(case.grid, case.block)
    image, _ = _form(case.block, case.grid, height_m=np.zeros(case.grid.shape))
    # two -80 dB images; the largest single error is some times the rms one
    assert np.abs(image - plain).max() <= 5e-4 * np.abs(plain).max()


def test_unknown_heights_are_no_pixels(make_case):
    case = make_case(1e3)
    height = _hills(case.grid)
    full, _ = _form(case.block, case.grid, height_m=height)
    unknown = np.random.default_rng(3).random(case.grid.shape) < 0.3
    unknown[:20, :20] = True  # whole tiles
    height[unknown] = np.nan
    image, _ = _form(case.block, case.grid, height_m=height)
    assert not image[unknown].any()
    # tiles have other centres, which changes the rounding below -80 dB
    assert np.abs(image - full)[~unknown].max() <= 5e-4 * np.abs(full).max()
    plan = plan_image(case.grid, case.block.radar, case.block.n_samples, method='exact',
                      target_db=-80.0, height_m=height)
    ones = plan.new_image()
    ones.samples[:] = 1
    plan.accumulate(case.block, ones)
    assert (ones.samples[unknown] == 1).all()


def test_nothing_known_is_dark(make_case):
    case = make_case(1e3)
    plan = plan_image(np.full((4, 3), np.nan), case.block.radar, case.block.n_samples,
                      method='exact', target_db=-80.0)
    assert not plan(case.block).samples.any()


def test_point_at_the_antenna(make_case):
    case = make_case(1e3)
    start = dataclasses.replace(case.block.radar, first_sample_delay_s=0.0)
    block = dataclasses.replace(case.block, radar=start)
    image, _ = _form(block, block.tx_m[24])
    assert np.isfinite(image).all()


def test_ranges_outside_the_profile_are_dark(make_case):
    case = make_case(1e3)
    wide = MapGrid(case.grid.centre_m, 1200, 8, 0.25)
    image, _ = _form(case.block, wide.points())
    assert not image[:, :400].any() and not image[:, -400:].any() and image[:, 600].any()
    with pytest.raises(ValueError, match=r'grid lies 3000.*profiles cover 9\d\d'):
        _form(case.block, np.array([[3000.0, 0.0, 0.0]]))


@pytest.mark.parametrize(('grid', 'options', 'message'), [
    (np.zeros((4, 2)), {}, r'points.shape=\(4, 2\); expected \(..., 3\)'),
    (np.zeros((0, 3)), {}, r'points.shape=\(0, 3\).*at least one point'),
    (np.full((2, 3), np.inf), {}, 'x of 2 points is infinite; write NaN'),
    (np.zeros((4, 3)), {'height_m': np.zeros(4)}, 'height_m goes with a MapGrid'),
    (MapGrid((0, 0, 0), 4, 3, 1.0), {'height_m': np.zeros((4, 3))},
     r'height_m.shape=\(4, 3\).*expected \(3, 4\), row 0 at the largest y'),
])
def test_positions_that_are_none_are_refused(make_case, grid, options, message):
    block = make_case(1e3).block
    with pytest.raises(ValueError, match=message):
        plan_image(grid, block.radar, block.n_samples, method='exact', **options)
