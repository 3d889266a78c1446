"""The entries of the backend, and when it is said to be quicker."""

import dataclasses
import inspect

import pytest

from sar_imaging.backends import backend, protocol
from sar_imaging.backends.cuda.costs import DEFAULT, VARIABLE, DeviceCosts
from sar_imaging.planning.exact.backprojection import plan_backprojection


def arguments(function):
    given = list(inspect.signature(function).parameters.values())
    return [(p.name, p.kind, p.default) for p in given if p.name != 'self']


def test_entries_are_those_of_the_protocol():
    made, described = backend('cuda'), protocol.Backprojection
    assert arguments(made.Backprojection) == arguments(protocol.Backend.Backprojection)
    assert arguments(made.Backprojection.add) == arguments(described.add)


def test_predicted_time_counts_transfers(make_scene, monkeypatch, tmp_path):
    scene = make_scene(1000.0, n=12, pulses=4)
    block = scene.block
    plan = plan_backprojection(scene.grid, block.radar, block.n_samples, *scene.rows[1:], -80.0)
    seconds = backend('cuda').seconds(plan)
    assert seconds > 1e-9 * DEFAULT.image
    costs = dataclasses.replace(DEFAULT, transferred_byte=2 * DEFAULT.transferred_byte)
    costs.write(tmp_path / 'costs.json')
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'costs.json'))
    n_bytes = 8 * plan.way.lattice.n_padded * 4 + 16 * 12 * 12  # there; the image and back
    assert backend('cuda').seconds(plan) - seconds == pytest.approx(
        1e-9 * DEFAULT.transferred_byte * n_bytes)
    assert DeviceCosts.read(tmp_path / 'costs.json') == costs
