# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measured costs: they explain times of images, fill the file, and plans are made with them."""

from __future__ import annotations

import dataclasses
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging import backends
from sar_imaging.backends.cpu.beams import SubapertureImager
from sar_imaging.backends.cpu.costs import VARIABLE
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.beams import BeamSampling
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.planning.costs import DEFAULT, CostModel, using
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.polar_image import plan_polar
from sar_imaging.tools import command, costs

ROOT = pathlib.Path(__file__).parents[2]
# What no way of imaging is chosen by: too little to be anything beside the other costs.
ALONE = {name: 1e-12 for name in ('profile_bin', 'profile_cell', 'beam_path', 'beam_run', 'image')}


@pytest.fixture(scope='module')
def timings():
    """A single round of each: rough, but times of this machine."""
    return costs.measure(rounds=1, least_s=0.0)


def _as_if(timings, model):
    """The experiments on a machine with these costs."""
    values = dataclasses.asdict(model)
    halves = dict.fromkeys((costs.IMAGE_OVERHEAD, costs.FUSION_OVERHEAD),
                           values.pop('subaperture') / 2)
    values |= halves
    return [dataclasses.replace(t, seconds=1e-9 * sum(values[name] * n for name, n in
                                                      t.operations.items())) for t in timings]


def test_every_cost_has_its_experiment(timings):
    names = {name for timing in timings for name in timing.operations}
    overheads = {costs.IMAGE_OVERHEAD, costs.FUSION_OVERHEAD}
    assert names - overheads == set(dataclasses.asdict(DEFAULT)) - {'subaperture'}
    assert overheads <= names


def test_times_of_known_costs_give_these_costs(timings):
    slower = CostModel(**{name: 3 * v for name, v in dataclasses.asdict(DEFAULT).items()})
    found, predicted = costs.solve(_as_if(timings, slower))
    for name, value in dataclasses.asdict(slower).items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-6), name
    np.testing.assert_allclose(predicted, 1.0, rtol=1e-6)


@pytest.mark.parametrize('name', dataclasses.asdict(DEFAULT))
def test_a_cost_of_its_own_is_found(timings, name):
    # Costs of one image are drawn together where times tell little of each: of the change a
    # quarter comes through for the worst, and all times are explained to 15 %.
    other = dataclasses.replace(DEFAULT, **{name: 4 * getattr(DEFAULT, name)})
    found, predicted = costs.solve(_as_if(timings, other))
    ratios = {n: getattr(found, n) / v for n, v in dataclasses.asdict(DEFAULT).items()}
    assert ratios[name] > 1.4
    np.testing.assert_allclose(predicted, 1.0, atol=0.15)


def test_the_command_writes_costs_that_plans_take(timings, tmp_path, monkeypatch, capsys,
                                                  make_case):
    monkeypatch.setattr(costs, 'measure', lambda name, progress: timings)
    path = tmp_path / 'costs.json'
    assert command.main(['measure-costs', '--output', str(path)]) == 0
    told = capsys.readouterr().out
    assert f'export {VARIABLE}={path}' in told and 'differ' in told
    model = CostModel.read(path)
    for name, usual in dataclasses.asdict(DEFAULT).items():
        assert 0.01 < getattr(model, name) / usual < 100.0
        assert name in told
    case = make_case(1e3, pulses=64)
    with using(model):
        imager = plan_image(case.grid, case.block.radar, case.block.n_samples, method='exact',
                            target_db=-80.0)
        plan = imager.plan(case.block.tx_m, case.block.rx_m).plan
        assert plan.seconds == pytest.approx(model.seconds(plan.operations))
    usual = exact_image(case.grid, case.block)
    # Whichever way is chosen meets the target of -80 dB: they differ by no more than both errors.
    difference = np.linalg.norm(imager(case.block).samples - usual) / np.linalg.norm(usual)
    assert difference < 10 ** (-74.0 / 20)


def test_a_file_that_cannot_be_written_is_told_before_measuring(tmp_path, capsys):
    assert command.main(['measure-costs', '--output', str(tmp_path / 'absent' / 'c.json')]) == 1
    assert 'is no folder' in capsys.readouterr().err


def test_a_device_that_is_not_there_is_one_line(tmp_path, capsys, monkeypatch):
    def fail():
        raise backends.DeviceError('the CUDA driver finds no device')

    monkeypatch.setattr(backends, 'require_device', fail)
    path = tmp_path / 'c.json'
    assert command.main(['measure-costs', '--device', '--output', str(path)]) == 1
    assert capsys.readouterr().err == 'error: the CUDA driver finds no device\n'
    assert not path.exists()


def test_a_file_of_before_has_former_names(tmp_path):
    path = tmp_path / 'costs.json'
    known = dataclasses.asdict(DEFAULT) | {'lit_image': 3.0, 'lit_knot': 4.0}
    path.write_text(json.dumps({name: value for name, value in known.items()
                                if name not in ('weighed_image', 'amplitude_node')}))
    with pytest.warns(DeprecationWarning, match='is now weighed_image, amplitude_node'):
        assert CostModel.read(path) == dataclasses.replace(DEFAULT, weighed_image=3.0,
                                                           amplitude_node=4.0)
    path.write_text('[1.0]')
    with pytest.raises(ValueError, match='holds no costs'):
        CostModel.read(path)


def test_a_process_plans_with_the_file_of_its_environment(tmp_path):
    path = tmp_path / 'costs.json'
    dataclasses.replace(DEFAULT, image=12345.0).write(path)
    code = ('from sar_imaging import plan_image; '
            'from sar_imaging.planning.costs import costs; print(costs().image)')
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, text=True, capture_output=True,
                          env={**os.environ, VARIABLE: str(path)}, check=True)
    assert done.stdout.strip() == '12345.0'


@pytest.mark.parametrize(('route', 'changed'), [
    ('lines', {'map_pixel': 1e9}), ('points', {'point_pixel': 1e-6}),
    ('polar', {'upsampled_pixel': 1e9}), ('polar', {'upsampled_part': 1.0})])
def test_predicted_time_is_what_plans_are_chosen_by_and_what_is_the_same_for_all(
        make_case, route, changed):
    case = make_case(1e3, pulses=64)
    block, model = case.block, dataclasses.replace(DEFAULT, **ALONE, **changed)
    rows = block.tx_m[:, 0], block.rx_m[:, 0]
    with using(model):
        plan = plan_backprojection(case.grid, block.radar, block.n_samples, *rows, -80.0)
        if route == 'polar':  # chosen or not
            plan = dataclasses.replace(plan, route=plan_polar(
                case.grid, *rows, block.radar, block.n_samples, -80.0))
            assert (plan.route.parts is None) == ('upsampled_pixel' in changed)
        assert plan.method == route
        n_pixels = case.grid.n_x * case.grid.n_y
        assert plan.seconds == pytest.approx(1e-9 * plan.route.cost * n_pixels, rel=1e-6)
    dearer = dataclasses.replace(model, image=1e9)
    with using(dearer):
        assert plan.seconds == pytest.approx(1e-9 * plan.route.cost * n_pixels + 1.0, rel=1e-6)


def test_operations_of_afbp_are_those_that_the_backend_does(make_case, monkeypatch):
    case = make_case(1e3, pulses=128, channels=2)
    block, formed = case.block, []
    with using(dataclasses.replace(DEFAULT, line_pixel=1e9)):
        plan = plan_afbp(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                         target_db=-40.0, pulses_per_subaperture=16)
    stage, directions = plan.subapertures, BeamSampling.directions
    monkeypatch.setattr(BeamSampling, 'directions', lambda self, *rest: formed.append(
        directions(self, *rest)) or formed[-1])
    some = block.select(stage.sampling.pulses[0])
    image = SubapertureImager(stage).image(0, some)
    counts = stage.image_operations(some.n_pulses * some.n_channels)
    assert counts['beam_pixel'] == image[0].size
    # From where the sub-aperture is the grid spans a little more or less.
    [(_, _, n_beams)] = formed
    assert counts['beam_cell'] / stage.resampling.n_cells == pytest.approx(n_beams, abs=3)
    whole = stage.image_operations(2 * block.n_pulses, stage.n_subapertures)
    assert plan.seconds == pytest.approx(DEFAULT.seconds(whole | stage.fusion_operations | {
        'image': 1 + stage.n_subapertures, 'map_pixel': case.grid.n_x * case.grid.n_y}))
