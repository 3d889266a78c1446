# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings tell their antenna: to the nodes' parameters, and to those who image files."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.configuration.antenna import antenna_of, mount_of
from sar_imaging.configuration.parameters import default_file, interpret, load_tree
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.antenna import Antenna, Mount
from sar_imaging.geometry.illumination import Pointing
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.recordings import open_pulses
from sar_imaging.recordings.bag_io import BagError, write_bag
from sar_imaging.recordings.recording import read_recording
from sar_imaging.recordings.truth import antenna_truth
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.tools.node_processes import parameters_from_truth
from sar_imaging.tools.simulate import scenario_truth

MEASURED = Antenna('measured', azimuth_deg=(-5, 0, 5), azimuth_gain_db=(-10, 0, -9))


@pytest.fixture(name='block', scope='module')
def block_fixture():
    scenario = dataclasses.replace(SCENARIOS['stripmap'](), n_pulses=64)
    [block] = scenario.blocks(64)
    return block, scenario_truth(scenario)


def node_parameters(truth, **options):
    """What the nodes would read of the recording's parameters."""
    parameters = parameters_from_truth(truth, **options)
    tree = {f'/**/{node}': {'ros__parameters': values} for node, values in parameters.items()}
    configuration = interpret(tree, load_tree(default_file()))
    assert not any('antenna' in finding.text for finding in configuration.findings)
    return configuration.nodes


def test_pulses_with_pointing_come_back(block, tmp_path):
    block, truth = block
    write_bag(tmp_path / 'bag', [block], truth)
    source = open_pulses(tmp_path / 'bag')
    [read] = source.blocks(1e9)
    np.testing.assert_allclose(read.pointing.boresight, block.pointing.boresight, atol=1e-12)
    np.testing.assert_array_equal(source.illumination.azimuth.amplitude,
                                  SCENARIOS['stripmap']().antenna.amplitudes().azimuth.amplitude)
    nodes = node_parameters(read_recording(tmp_path / 'bag').truth)
    assert antenna_of(nodes['backprojection']) == SCENARIOS['stripmap']().antenna
    assert mount_of(nodes['pulse_buffer']) is None  # the pulses tell


@pytest.mark.parametrize('mount', [
    Mount('platform', boresight=(1, 0, -1), up=(0, 0, 1)), Mount('point', target_m=(0, 9, 1)),
    Mount('track', side='right', squint_deg=5, depression_deg=30),
    Mount('rotation', rate_deg_per_s=90, start_deg=10, start_s=1.7e9, depression_deg=3)])
def test_pulses_by_poses_get_the_pointing_of_the_mount(block, tmp_path, mount):
    block, truth = block
    stamp_ns = np.arange(block.stamp_ns[0] - 10**9, block.stamp_ns[-1] + 10**9, 10**7)
    time_s = (stamp_ns - block.stamp_ns[0]) * 1e-9
    place = np.stack([0 * time_s - 400, 40 * time_s, 0 * time_s + 300], axis=1)
    turns = Rotation.from_euler('z', 0.3 * time_s[:, None])
    plain = dataclasses.replace(block, tx_m=None, rx_m=None, pointing=None)
    told = truth | {'alignment': Alignment().as_dict()} | antenna_truth(MEASURED, mount)
    write_bag(tmp_path / 'bag', [plain], told,
              poses=PoseTable(stamp_ns, place, turns.as_quat()))
    [read] = open_pulses(tmp_path / 'bag').blocks(1e9)
    at_s = (block.stamp_ns - block.stamp_ns[0]) * 1e-9
    centre = np.stack([0 * at_s - 400, 40 * at_s, 0 * at_s + 300], axis=1)
    turned = Rotation.from_euler('z', 0.3 * at_s[:, None])
    expected = mount.pointing(block.stamp_ns, centre, turned)
    np.testing.assert_allclose(read.pointing.boresight, expected.boresight, atol=1e-6)
    recording = read_recording(tmp_path / 'bag')
    assert (recording.antenna, recording.mount) == (MEASURED, mount)
    file = tmp_path / 'antenna.yaml'
    file.write_text(str(told['antenna']))
    nodes = node_parameters(told, pattern_file=str(file))
    assert antenna_of(nodes['backprojection']) == MEASURED
    assert mount_of(nodes['pulse_buffer']) == mount


def test_an_antenna_that_is_none_is_told(block, tmp_path):
    block, truth = block
    write_bag(tmp_path / 'bag', [block], truth | {'antenna': {'pattern': 'horn'}})
    with pytest.raises(BagError, match="the antenna of the recording: .*'horn' is unknown"):
        open_pulses(tmp_path / 'bag')
    assert isinstance(block.pointing, Pointing)
