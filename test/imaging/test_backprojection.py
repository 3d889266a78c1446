# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection against float64 time-domain correlation of the same profiles."""

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.planning.exact import backprojection as plans
from sar_imaging.signal.spectra import band_spectrum


def _error_db(case, image, seed=0):
    """Error against TDC over the brightest and as many random pixels, dB."""
    flat = np.ravel(image)
    chosen = np.r_[np.argsort(np.abs(flat))[-200:],
                   np.random.default_rng(seed).integers(0, flat.size, 200)]
    points = case.grid.points().reshape(-1, 3)[chosen]
    reference = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m, points)
    return 10 * np.log10(np.sum(np.abs(flat[chosen] - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


def _plan(case, target_db=-80.0, **options):
    return plan_image(case.grid, case.block.radar, case.block.n_samples, method='exact',
                      target_db=target_db, **options)


@pytest.mark.parametrize('channels', [1, 5])
@pytest.mark.parametrize('range_m', [100.0, 1e3, 1e4, 5e4])
def test_default_error_at_all_ranges(make_case, range_m, channels):
    case = make_case(range_m, channels=channels)
    plan = _plan(case)
    error = _error_db(case, plan(case.block))
    assert error <= -80.0
    assert error <= plan.report.predicted_error_db + 1.0  # never optimistic


@pytest.mark.parametrize('options', [
    {'range_m': 1e3, 'height_m': 500.0, 'channels': 2},
    {'range_m': 1e3, 'height_m': 500.0, 'heading_rad': 0.5},
    {'range_m': 1e3, 'height_m': 500.0, 'heading_rad': np.pi},  # range falls along x
    {'range_m': 1e3, 'heading_rad': -1.4},                      # lines follow y
    {'range_m': 300.0, 'heading_rad': np.pi / 2},
    {'range_m': 1e3, 'bend_m': 5.0, 'channels': 3},             # curved track
], ids=str)
def test_any_direction_height_and_track(make_case, options):
    case = make_case(**options)
    plan = _plan(case)
    assert _error_db(case, plan(case.block)) <= min(-80.0, plan.report.predicted_error_db + 1.0)


def test_near_grid_uses_the_routine_for_points(make_case):
    case = make_case(25.0, height_m=10.0, heading_rad=0.8, channels=2, aperture_m=5.0)
    plan = _plan(case)
    assert _error_db(case, plan(case.block)) <= -80.0
    assert plan.report.plan.method == 'points'


@pytest.mark.parametrize('target_db', [-40.0, -60.0, -90.0])
def test_target_is_met_and_predicted(make_case, target_db):
    case = make_case(1e3)
    plan = _plan(case, target_db=target_db)
    error = _error_db(case, plan(case.block))
    assert error - 1.0 <= plan.report.predicted_error_db <= target_db


@pytest.mark.parametrize(('options', 'target_db'), [
    ({'range_m': 1e3}, -80.0),
    ({'range_m': 1e3, 'channels': 5, 'height_m': 400.0, 'heading_rad': 2.5}, -80.0),
    ({'range_m': 1e3, 'bend_m': 3.0, 'heading_rad': np.pi / 2}, -80.0),
    ({'range_m': 100.0, 'spacing_m': 0.1}, -80.0),
    ({'range_m': 5e4}, -60.0),
], ids=str)
def test_groups_meet_the_target(make_case, options, target_db):
    case = make_case(**options)
    plan = _plan(case, target_db=target_db)
    with using(dataclasses.replace(DEFAULT, line_pixel=100.0, point_pixel=1e6)):
        error = _error_db(case, plan(case.block))
    assert plan.report.plan.method == 'groups'
    assert error - 1.0 <= plan.report.predicted_error_db <= target_db


def test_many_pulses_are_added_in_groups(make_case):
    case = make_case(1e3, n=300, pulses=400, spacing_m=0.2)
    plan = _plan(case)
    assert _error_db(case, plan(case.block)) <= -80.0
    assert plan.report.plan.method == 'groups'


def test_image_is_the_sum_of_its_pulses(make_case):
    case = make_case(1e3, channels=2)
    plan = _plan(case)
    whole = plan(case.block).samples
    grown = plan.new_image()
    for part in (slice(0, 5), slice(5, 6), slice(6, 6), slice(6, None)):
        plan.accumulate(case.block.select(part), grown)
    # two roundings of -80 dB images
    assert np.abs(grown.samples - whole).max() <= 3e-4 * np.abs(whole).max()


def test_peak_phase_is_the_scatterers(make_case):
    case = make_case(1e3, n_points=1)
    grid = MapGrid(tuple(case.points[0]), 9, 9, 0.25)
    image = exact_image(grid, case.block)
    expected = np.count_nonzero(np.abs(np.fft.fftfreq(case.block.n_samples, 1 / 400e6)) <= 150e6)
    assert image[4, 4] == pytest.approx(48 * expected, rel=1e-4)


@pytest.mark.parametrize('shape', [(1, 1), (1, 70), (70, 1), (5, 131)])
def test_any_image_shape(make_case, shape):
    case = make_case(1e3)
    grid = MapGrid(case.grid.centre_m, shape[1], shape[0], 0.11)
    image = exact_image(grid, case.block)
    points = grid.points()
    reference = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m, points)
    # a small patch may hold no scatterer: compare with the brightest possible pixel
    assert np.abs(image - reference).max() < 1e-4 * np.abs(case.block.samples).max() * 48


def test_ranges_outside_the_profile_are_dark(make_case):
    case = make_case(1e3)
    wide = MapGrid(case.grid.centre_m, 1200, 40, 0.25)
    image = exact_image(wide, case.block)
    assert not image[:, :400].any() and not image[:, -400:].any()
    middle = dataclasses.replace(case, grid=MapGrid(case.grid.centre_m, 96, 40, 0.25))
    assert _error_db(middle, np.ascontiguousarray(image[:, 552:648])) <= -80.0


def test_grid_out_of_reach_is_refused(make_case):
    case = make_case(1e3)
    grid = MapGrid((3000.0, 0.0, 0.0), 16, 16, 0.25)
    with pytest.raises(ValueError, match=r'grid lies 29\d\d.*profiles cover 9\d\d'):
        exact_image(grid, case.block)


def test_grid_around_the_antenna_stays_finite(make_case):
    case = make_case(10.0, height_m=5.0)
    antenna = case.block.tx_m[24, 0]
    grid = MapGrid(tuple(antenna), 65, 65, 0.25)
    image = exact_image(grid, case.block)
    assert np.isfinite(image).all()


def test_bad_blocks_are_named(make_case):
    case = make_case(1e3)
    plan, block = _plan(case), case.block
    image = plan.new_image()
    for bad, message in (
            (dataclasses.replace(block, compressed=False), 'apply range compression first'),
            (dataclasses.replace(block, tx_m=None, rx_m=None), 'no phase centres'),
            (dataclasses.replace(block, samples=block.samples[..., :-1]), 'this plan is for')):
        with pytest.raises(ValueError, match=message):
            plan.accumulate(bad, image)
    image.samples = image.samples.astype(complex)
    with pytest.raises(ValueError, match=r'image is complex128 .*block complex64 \(96, 96\)'):
        plan.accumulate(block, image)


def test_impossible_plans_are_refused(make_case):
    case = make_case(1e3)
    coarse = dataclasses.replace(case.block.radar, sample_rate_hz=300e6)
    with pytest.raises(ValueError, match='1.25 times the bandwidth'):
        plan_image(case.grid, coarse, 100, method='exact', target_db=-80.0)
    with pytest.raises(ValueError, match='target_db=-150'):
        _plan(case, target_db=-150.0)


def test_pulses_from_the_same_places_need_no_new_plan(make_case, monkeypatch):
    case = make_case(1e3, pulses=64)
    moved = dataclasses.replace(case.block, tx_m=case.block.tx_m + [0.0, 3.0, 0.0],
                                rx_m=case.block.rx_m + [0.0, 3.0, 0.0])
    fresh = [exact_image(case.grid, block)
             for block in (case.block, moved)]
    planned = []
    plan_groups = plans.plan_groups

    def counted(grid, radar, n_samples, tx_m, *others, **named):
        planned.append(tx_m[0, 1])
        return plan_groups(grid, radar, n_samples, tx_m, *others, **named)

    monkeypatch.setattr(plans, 'plan_groups', counted)
    imager = plan_image(case.grid, case.block.radar, case.block.n_samples, method='exact',
                        target_db=-80.0)
    for block, image in zip((case.block, case.block, moved, moved, case.block),
                            (fresh[0], fresh[0], fresh[1], fresh[1], fresh[0]), strict=True):
        np.testing.assert_array_equal(imager(block), image)
    first = case.block.tx_m[0, 0, 1]
    assert planned == pytest.approx([first, first + 3.0, first])
    # Phase centres that the caller changes in place are other ones.
    case.block.tx_m[:] += [0.0, 3.0, 0.0]
    case.block.rx_m[:] += [0.0, 3.0, 0.0]
    np.testing.assert_array_equal(imager(case.block), fresh[1])
