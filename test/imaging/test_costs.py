# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Costs: plans follow them, files hold them, and what is no cost is refused."""

from __future__ import annotations

import dataclasses

import pytest

from sar_imaging.backends.cpu.costs import VARIABLE
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.costs import DEFAULT, CostModel, costs, using


def test_the_quickest_way_follows_the_costs(make_case):
    case = make_case(1e3, pulses=64)

    def method(**changed):
        with using(dataclasses.replace(DEFAULT, **changed)):
            report = plan_image(case.grid, case.block.radar, case.block.n_samples,
                                case.block.tx_m, case.block.rx_m, method='exact',
                                target_db=-80.0).report
        return report.plan.method

    assert method() == 'groups'
    assert method(group=1e8) == 'lines'
    assert method(line_pixel=1e3, part_coefficient=1e3) == 'points'


def test_a_file_holds_costs_and_the_environment_names_it(tmp_path, monkeypatch):
    model = dataclasses.replace(DEFAULT, line_pixel=0.4, subaperture=3e5)
    model.write(tmp_path / 'costs.json')
    assert CostModel.read(tmp_path / 'costs.json') == model
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'costs.json'))
    with using(None):  # as at the start of a process
        assert costs() == model
    monkeypatch.delenv(VARIABLE)
    with using(None):
        assert costs() == DEFAULT


@pytest.mark.parametrize('text', ['', '[1]', '{"line_pixel": -1}', '{"pixel": 1}',
                                  '{"line_pixel": "1"}', '{"line_pixel": NaN}'])
def test_files_without_costs_are_refused(tmp_path, text):
    (tmp_path / 'costs.json').write_text(text)
    with pytest.raises(ValueError, match='measure-costs'):
        CostModel.read(tmp_path / 'costs.json')
    with pytest.raises(ValueError, match='costs.json'):
        CostModel.read(tmp_path / 'absent' / 'costs.json')
