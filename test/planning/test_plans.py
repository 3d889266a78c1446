# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans: compared by value, pickled, with errors by cause, time and memory."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from sar_imaging import memory
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.live import plan_live
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.points import ImagePoints
from sar_imaging.published.ffbp import plan_ffbp
from sar_imaging.published.wavenumber import plan_wavenumber
from sar_imaging.published.zero_padding import plan_zero_padding


def _exact(case, grid=None, shift_m=0.0):
    block = case.block
    return plan_backprojection(grid or case.grid, block.radar, block.n_samples,
                               block.tx_m.reshape(-1, 3) + shift_m, block.rx_m.reshape(-1, 3),
                               -80.0)


def _afbp(case, shift_m=0.0):
    block = case.block
    return plan_afbp(case.grid, block.radar, block.n_samples, block.tx_m + shift_m, block.rx_m,
                     target_db=-50.0)


def _live(case, shift_m=0.0, **options):
    block = case.block
    return plan_live(case.grid, block.radar, block.n_samples, block.tx_m + shift_m, block.rx_m,
                     **{'target_db': -50.0} | options)


def _ffbp(case, shift_m=0.0):
    block = case.block
    return plan_ffbp(case.grid, block.radar, block.n_samples, block.tx_m + shift_m, block.rx_m,
                     target_db=-50.0)


def _wavenumber(case, shift_m=0.0):
    block = case.block
    return plan_wavenumber(case.grid, block.radar, block.n_samples, block.tx_m + shift_m,
                           block.rx_m + shift_m, target_db=-50.0)


def _zero_padding(case, shift_m=0.0):
    return plan_zero_padding(dataclasses.replace(case.grid, spacing_m=case.grid.spacing_m
                                                 + 0.1 * shift_m), case.block.radar,
                             case.block.n_samples, case.block.tx_m, case.block.rx_m, ratio=4)


def _points(case, shift_m=0.0):
    return _exact(case, ImagePoints.of_grid(case.grid), shift_m)


@pytest.mark.parametrize('plan', [_exact, _points, _afbp, _live, _ffbp, _wavenumber,
                                  _zero_padding])
def test_a_plan_travels_and_is_the_same_on_arrival(make_case, plan):
    case = make_case(1e3, pulses=128)
    made = plan(case)
    there = pickle.loads(pickle.dumps(made))
    assert there == made == plan(case)
    assert made != plan(case, shift_m=0.1) and made != 'a plan'


@pytest.mark.parametrize('plan', [_exact, _points, _afbp, _live, _ffbp])
def test_errors_by_cause_make_the_predicted_one(make_case, plan):
    made = plan(make_case(1e3, pulses=128))
    total = 10 * np.log10(sum(10 ** (e / 10) for e in made.errors_db.values()))
    # besides them there is the rounding of float32, below -106 dB
    assert total <= made.predicted_error_db <= max(total, -100.0) + 1.0
    assert len(made.errors_db) >= 3 and 0 < made.seconds < 60.0


@pytest.mark.parametrize(('plan', 'method'), [
    (_afbp, 'afbp'), (_ffbp, 'ffbp'), (_wavenumber, 'wavenumber'),
    (_zero_padding, 'zero-padding')])
def test_a_plan_knows_the_memory_of_its_image(make_case, plan, method):
    case = make_case(1e3, pulses=128)
    plan = plan(case)
    assert plan.n_bytes >= 8 * case.grid.n_x * case.grid.n_y
    block = case.block
    with memory.granting(plan.n_bytes - 1), pytest.raises(MemoryError, match='an image'):
        plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                   method=method, target_db=-50.0)


def test_plans_of_tracks_that_are_foreseen_warn_and_refuse_as_all_do(make_case):
    case = make_case(1e3, pulses=128)
    few = dataclasses.replace(case, block=case.block.select(slice(None, None, 16)))
    [ambiguous] = (text for text in _afbp(few).warnings if 'ambiguous' in text)
    assert ambiguous.split(',')[0] in ' '.join(_live(few).warnings)  # how far apart pulses are
    block = case.block
    for wrong, expected in (({'target_db': -10.0}, 'target_db=-10'),
                            ({'tx_m': block.tx_m[:, 0]}, r'\(pulses, channels, 3\)')):
        for plan in (plan_afbp, plan_live):
            with pytest.raises(ValueError, match=expected):
                plan(case.grid, block.radar, block.n_samples, **{
                    'tx_m': block.tx_m, 'rx_m': block.rx_m, 'target_db': -50.0} | wrong)


def test_a_track_that_was_known_is_never_planned_anew(make_case):
    """Of one that was foreseen what deviates is refused: its plan would have to be another."""
    case = make_case(1e3, pulses=128)
    block = case.block.select(slice(0, 16))
    foreseen, known = (_live(case, pulses_per_subaperture=16, slack=slack) for slack in (1.0, 0.0))
    assert foreseen.check(block.tx_m, block.rx_m)[1] <= -50.0
    away = block.tx_m + [0.0, 30.0, 0.0], block.rx_m + [0.0, 30.0, 0.0]
    assert foreseen.check(*away) is None
    assert known.check(*away) is not None


def test_windows_of_a_sliding_aperture_may_not_be_read_worse_than_wanted(make_case):
    """They are read at baseband: their limit was above 0 dB where that was forgotten."""
    case = make_case(1e3, pulses=128)
    plan = _live(case, n_window=48)
    # what errs alike in all images leaves some of the target: measured -50.5 dB
    assert plan.map_cover.polar_to_map_db < plan.reading_limit_db < -50.0
    block = case.block.select(slice(0, 16))
    known = _live(case, n_window=48, slack=0.0)
    assert known.check(block.tx_m, block.rx_m, None, (block.tx_m, block.rx_m)) is not None
