# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The one entry: choice of the method, the same result from all of them, and their options."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.imaging.afbp import Afbp
from sar_imaging.imaging.checks import METHOD_CHECKS
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import METHODS, method_class
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.signal import PulseBlock


def _imager(case, grid=None, **options):
    block = case.block
    return plan_image(case.grid if grid is None else grid, block.radar, block.n_samples, **options)


def _error_db(image, reference) -> float:
    difference = np.abs(np.asarray(image) - reference) ** 2
    return 10 * np.log10(difference.sum() / np.sum(np.abs(reference) ** 2))


@pytest.fixture(scope='module')
def case(make_case):
    return make_case(1e3, pulses=128)


@pytest.fixture(scope='module')
def reference(case):
    return np.asarray(_imager(case, method='correlation')(case.block))


@pytest.mark.parametrize('title', METHOD_CHECKS)
@pytest.mark.parametrize('method', METHODS)
def test_all_methods_do_what_they_say(method, title):
    told = METHOD_CHECKS[title](method_class(method), {})
    assert ('refused' in told) == (method == 'wavenumber' and title == 'a bent track')


def test_all_methods_are_named_where_users_look():
    for name in METHODS:
        assert f"``'{name}'``" in plan_image.__doc__


def test_auto_takes_the_quicker_one_that_meets_the_target(case, reference):
    slow = dataclasses.replace(DEFAULT, line_pixel=1e4, point_pixel=1e5, part_coefficient=1e3)
    with using(slow):
        image = _imager(case, target_db=-50.0)(case.block)
        assert image.report.method == 'afbp' and 'exact backprojection takes' in str(image.report)
        assert _error_db(image, reference) <= -50.0
        # what AFBP cannot do, or not well enough, is done exactly
        for options, reason in (({'target_db': -95.0}, 'not possible'),
                                ({'height_m': np.zeros(case.grid.shape)}, 'flat maps alone')):
            report = _imager(case, **options)(case.block).report
            assert report.method == 'exact' and reason in report.reason
    report = _imager(case, target_db=-50.0)(case.block).report
    assert report.method == 'exact' and 'quick' in report.reason


def test_bright_surroundings_are_imaged_exactly(make_case):
    """AFBP predicts for even scenes; what is much brighter right beside the map raises it."""
    case = make_case(1e3, pulses=128, n_points=1)
    x, y, _ = case.points[0]
    beside = dataclasses.replace(case.grid, centre_m=(x, y - 16.0, 0.0), n_x=96, n_y=96)
    with using(dataclasses.replace(DEFAULT, line_pixel=1e4, point_pixel=1e6,
                                   part_coefficient=1e3)):
        afbp = _imager(case, beside, method='afbp', target_db=-50.0)(case.block)
        image = _imager(case, beside, target_db=-50.0)(case.block)
    assert afbp.report.predicted_error_db > -40.0  # measured: -28 dB
    assert 'bright surroundings' in str(afbp.report)
    assert image.report.method == 'exact' and 'surroundings are bright' in image.report.reason
    # It is as dark, and told to be: measured -44 dB, predicted -36 dB.
    assert image.planned.predicted_error_db <= -50.0 < image.report.predicted_error_db


def test_pulses_from_the_same_places_are_planned_once(case, monkeypatch):
    planned, whole = [], Afbp.plan
    monkeypatch.setattr(Afbp, 'plan', lambda self, *centres: planned.append(1)
                        or whole(self, *centres))
    block = case.block
    imager = _imager(case, tx_m=block.tx_m, rx_m=block.rx_m, method='afbp')
    assert imager.report.predicted_error_db < -60.0 and len(planned) == 1
    first, second = imager(block), imager(block)
    np.testing.assert_array_equal(first.samples, second.samples)
    assert len(planned) == 1
    imager(dataclasses.replace(block, tx_m=block.tx_m + 0.5, rx_m=block.rx_m + 0.5))
    assert len(planned) == 2


def test_options_of_one_method_are_named(case):
    block = case.block
    imager = _imager(case, tx_m=block.tx_m, rx_m=block.rx_m, method='afbp',
                     pulses_per_subaperture=32)
    assert imager.report.plan.subapertures.n_subapertures == 4
    with pytest.raises(ValueError, match="'exact' has no option pulses_per_subaperture"):
        _imager(case, method='exact', pulses_per_subaperture=32)
    with pytest.raises(ValueError, match='merge_factor: options of one method'):
        _imager(case, merge_factor=2)
    with pytest.raises(ValueError, match='no option taps; it has pulses_per_subaperture, merge'):
        _imager(case, method='ffbp', taps=4)


@pytest.mark.parametrize('method', ['exact', 'afbp'])
def test_images_grow_as_pulses_come(case, reference, method):
    halves = [case.block.select(slice(0, 64)), case.block.select(slice(64, None))]
    imager = _imager(case, method=method)
    image = imager(halves[0])
    imager.accumulate(halves[1], image)
    assert _error_db(image, reference) <= -60.0
    np.testing.assert_array_equal(image.counters, np.sort(case.block.counter))
    assert image.n_pulses == 128 and len(image.missing) == 0
    with pytest.raises(ValueError, match='same imager'):
        image.samples = image.samples[1:]
        imager.accumulate(halves[1], image)


def test_missing_pulses_are_those_between_the_first_and_the_last(case):
    block = case.block.select(np.r_[0:10, 12:20])
    image = _imager(case, method='exact')(block)
    first = int(case.block.counter[0])
    assert image.missing.tolist() == [first + 10, first + 11]
    assert image.stamp_ns == int(block.stamp_ns[9])


@pytest.mark.parametrize('method', ['exact', 'afbp', 'ffbp'])
def test_both_phase_centres_are_their_mean_if_wanted(make_case, method):
    case = make_case(1e3, pulses=96, channels=3)
    middles = 0.5 * (case.block.tx_m + case.block.rx_m)
    moved = dataclasses.replace(case.block, tx_m=middles, rx_m=middles)
    np.testing.assert_array_equal(_imager(case, method=method, midpoint=True)(case.block),
                                  _imager(case, method=method)(moved))


def test_polar_grids_and_points_are_imaged_too(case):
    r = float(np.hypot(*np.subtract(case.grid.centre_m[:2], case.block.tx_m[:, 0, :2].mean(0))))
    polar = _imager(case, tx_m=case.block.tx_m, rx_m=case.block.rx_m, method='afbp',
                    target_db=-50.0).report.plan.subapertures.polar
    assert isinstance(polar, PolarGrid) and r > 0
    exact = _imager(case, polar, method='exact', target_db=-80.0)(case.block)
    assert exact.shape == (polar.n_alpha, polar.n_range)
    assert _error_db(_imager(case, polar, method='afbp')(case.block), exact.samples) <= -55.0
    points = case.grid.points()[::7, ::5]
    whole = np.asarray(_imager(case, method='exact')(case.block))
    assert _error_db(_imager(case, points)(case.block), whole[::7, ::5]) <= -60.0


@pytest.mark.parametrize(('options', 'message'), [
    ({'method': 'fast'}, "'exact', 'afbp'"),
    ({'method': 'afbp', 'height_m': np.zeros((96, 96))}, 'terrain'),
    ({'method': 'wavenumber', 'grid': np.zeros((4, 3))}, 'images a MapGrid'),
    ({'weights': [np.nan]}, 'finite'),
    ({'method': 'exact', 'backend': 'gpu'}, 'reference'),
    ({'method': 'afbp', 'backend': 'gpu'}, 'reference'),
    ({'method': 'exact', 'pulse_weights': [1.0]}, 'one for each pulse'),
])
def test_what_cannot_be_done_is_refused(case, options, message):
    with pytest.raises(ValueError, match=message):
        _imager(case, **options)(case.block)


def test_blocks_without_positions_are_refused(case):
    block = case.block
    bare = PulseBlock(block.radar, True, block.stamp_ns, block.counter, block.samples)
    for method in ('auto', 'exact', 'afbp', 'correlation'):
        with pytest.raises(ValueError, match='phase centres'):
            _imager(case, method=method)(bare)
