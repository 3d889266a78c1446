"""Plans: compared by value, pickled, with errors by cause, time and memory."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning import memory
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.planning.baselines.ffbp_choice import plan_ffbp
from sar_imaging.planning.baselines.wavenumber import plan_wavenumber
from sar_imaging.planning.baselines.zero_padding import plan_zero_padding
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.points import ImagePoints


def _exact(case, grid=None, shift_m=0.0):
    block = case.block
    return plan_backprojection(grid or case.grid, block.radar, block.n_samples,
                               block.tx_m.reshape(-1, 3) + shift_m, block.rx_m.reshape(-1, 3),
                               -80.0)


def _afbp(case, shift_m=0.0):
    block = case.block
    return plan_afbp(case.grid, block.radar, block.n_samples, block.tx_m + shift_m, block.rx_m,
                     target_db=-50.0)


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


@pytest.mark.parametrize('plan', [_exact, _points, _afbp, _ffbp, _wavenumber,
                                  _zero_padding])
def test_a_plan_travels_and_is_the_same_on_arrival(make_case, plan):
    case = make_case(1e3, pulses=128)
    made = plan(case)
    there = pickle.loads(pickle.dumps(made))
    assert there == made == plan(case)
    assert made != plan(case, shift_m=0.1) and made != 'a plan'


@pytest.mark.parametrize('plan', [_exact, _points, _afbp, _ffbp])
def test_errors_by_cause_make_the_predicted_one(make_case, plan):
    made = plan(make_case(1e3, pulses=128))
    total = 10 * np.log10(sum(10 ** (e / 10) for e in made.errors_db.values()))
    # besides them there is the rounding of float32, below -106 dB
    assert total <= made.predicted_error_db <= max(total, -100.0) + 1.0
    assert len(made.errors_db) >= 3 and 0 < made.seconds < 60.0


@pytest.mark.parametrize(('plan', 'method'), [
    (_afbp, 'afbp'), (_ffbp, 'ffbp'), (_wavenumber, 'wavenumber'),
    (_zero_padding, 'zero-padding')])
def test_a_plan_knows_the_memory_of_its_image(make_case, monkeypatch, plan, method):
    case = make_case(1e3, pulses=128)
    plan = plan(case)
    assert plan.n_bytes >= 8 * case.grid.n_x * case.grid.n_y
    monkeypatch.setattr(memory, 'available_bytes', lambda: plan.n_bytes - 1)
    block = case.block
    with pytest.raises(MemoryError, match='an image'):
        plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                   method=method, target_db=-50.0)
