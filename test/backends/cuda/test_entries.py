# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The entries of the backend, and when it is said to be quicker."""

import dataclasses
import inspect

import numpy as np
import pytest

from sar_imaging.backends import backend, protocol
from sar_imaging.backends.cuda.costs import DEFAULT, VARIABLE, DeviceCosts, operations
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.planning.costs import CostModel
from sar_imaging.planning.exact.backprojection import plan_backprojection


def arguments(function):
    given = list(inspect.signature(function).parameters.values())
    return [(p.name, p.kind, p.default) for p in given if p.name != 'self']


def test_entries_are_those_of_the_protocol():
    made = backend('cuda')
    for described in (protocol.Backprojection, protocol.SubapertureImager,
                      protocol.SpectrumFusion):
        entry = getattr(made, described.__name__)
        assert arguments(entry) == arguments(getattr(protocol.Backend, described.__name__))
        for method in (m for m in vars(described) if not m.startswith('_')):
            wanted, given = (vars(kind)[method] for kind in (described, entry))
            assert isinstance(given, property) == isinstance(wanted, property)
            if not isinstance(wanted, property):
                assert arguments(given) == arguments(wanted)
    assert arguments(made.form_map) == arguments(protocol.Backend.form_map)


def test_predicted_time_counts_transfers(make_scene, monkeypatch, tmp_path):
    scene = make_scene(1000.0, n=12, pulses=4)
    block = scene.block
    plan = plan_backprojection(scene.grid, block.radar, block.n_samples, *scene.echoes[1:], -80.0)
    seconds = backend('cuda').seconds(plan)
    assert seconds > 1e-9 * DEFAULT.image
    costs = dataclasses.replace(DEFAULT, transferred_byte=2 * DEFAULT.transferred_byte)
    costs.write(tmp_path / 'costs.json')
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'costs.json'))
    n_bytes = 8 * plan.route.resampling.n_padded * 4 + 8 * 12 * 12  # samples there, the image back
    assert backend('cuda').seconds(plan) - seconds == pytest.approx(
        1e-9 * DEFAULT.transferred_byte * n_bytes)
    assert DeviceCosts.read(tmp_path / 'costs.json') == costs


def test_predicted_time_counts_lit_pixels(make_scene):
    scene = make_scene(1000.0, n=12, pulses=4, aperture_m=4.0)
    block, pulses = scene.block, np.arange(4)
    pointing = Pointing(np.stack([np.cos(pulses), np.sin(pulses), 0 * pulses], axis=-1))
    light = Illumination.of_pulses(AntennaPattern(PatternCut.gaussian(0.3)), pointing, block.tx_m,
                                   block.rx_m)
    grid = MapGrid(scene.grid.centre_m, 512, 512, 0.25)
    seconds = [operations(plan_backprojection(grid, block.radar, block.n_samples,
                                              *scene.echoes[1:], -60.0, given))['line_pixel']
               for given in (None, light)]
    assert seconds[1] == pytest.approx(seconds[0] / 4, rel=0.1)  # the first pulse alone


def test_every_cost_is_the_devices_own():
    """Those of a processor would be far too high; paths of beams alone are the processor's."""
    theirs, ours = dataclasses.asdict(CostModel()), dataclasses.asdict(DeviceCosts())
    ours.pop('transferred_byte')
    methods = {n for n in theirs if n.startswith((  # not offered here
        'merged', 'gathered', 'part', 'summed', 'group'))}
    higher = {n for n in theirs if ours[n] >= theirs[n]}
    assert higher == methods | {'beam_path', 'image', 'weighed_image',
                                'upsampled_part'}  # launches
