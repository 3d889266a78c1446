# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The calibration command measures a device's costs, here a simulated one of tiny images."""

import dataclasses
import json

import pytest

from sar_imaging.backends import backend
from sar_imaging.backends.cuda.costs import DEFAULT, VARIABLE, DeviceCosts, device_costs
from sar_imaging.tools import costs, measure_costs
from sar_imaging.tools.costs import TimedMap, TimedMaps

TINY = TimedMaps(lines=(TimedMap(1e4, 8, 8, 1),), points=(TimedMap(1e3, 4, 4, 1),), polar=(),
              afbp=((TimedMap(1e3, 16, 16, 4), 4),), transfers=(1 << 10,), varied=False)


@pytest.mark.campaign
def test_the_command_writes_what_the_variable_names(tmp_path, monkeypatch, capsys):
    measure = costs.measure
    monkeypatch.setattr(costs, 'DEVICE', TINY)
    monkeypatch.setattr(costs, 'measure', lambda name, progress: measure(
        name, rounds=1, least_s=0.0))
    path = tmp_path / 'device.json'
    assert measure_costs.main(['--device', '--output', str(path)]) == 0
    told = capsys.readouterr().out
    assert f'export {VARIABLE}={path}' in told
    assert set(json.loads(path.read_text())) == set(dataclasses.asdict(DEFAULT))
    assert all(name in told for name in dataclasses.asdict(DEFAULT))
    monkeypatch.setenv(VARIABLE, str(path))
    measured = device_costs()
    assert isinstance(measured, DeviceCosts)
    # the simulator is far slower than any device; costs are bounded: 50 times the estimate
    assert dataclasses.asdict(measured) != dataclasses.asdict(DEFAULT)
    assert measured.line_pixel <= 50.001 * DEFAULT.line_pixel
    counts = {'line_pixel': 1e9}
    assert backend('cuda').device_costs().seconds(counts) == pytest.approx(measured.line_pixel)


def test_times_of_known_costs_give_these_costs():
    """As if every experiment had taken three times what the estimates say."""
    timings = [costs.Timing(name, {name: 1e3}, 3e-6 * value)
               for name, value in dataclasses.asdict(DEFAULT).items() if name != 'subaperture']
    for name in (costs.IMAGE_OVERHEAD, costs.FUSION_OVERHEAD):
        timings.append(costs.Timing(name, {name: 1e3}, 1.5e-6 * DEFAULT.subaperture))
    found, predicted = costs.solve(timings, DEFAULT)
    assert isinstance(found, DeviceCosts)
    assert predicted == pytest.approx(1.0)
    for name, value in dataclasses.asdict(DEFAULT).items():
        assert getattr(found, name) == pytest.approx(3 * value), name
