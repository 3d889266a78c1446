# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What `evaluate` starts the nodes with, what it tells of them, and when it gives up."""

import concurrent.futures
import dataclasses
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

from sar_imaging.configuration.parameters import default_file
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.recordings import bag_io
from sar_imaging.signal.pulses import concatenate
from sar_imaging.tools import simulate
from sar_imaging.tools.evaluate import main, parser
from sar_imaging.tools.evaluation.node_launch import LaunchError, plan_launch
from sar_imaging.tools.node_processes import AFBP_NODES, NODES, PIPELINE, free_domain

ROOT = Path(__file__).resolve().parents[3]
PSF = ROOT / 'bags' / 'psf'
TRUTH = bag_io.read_truth(PSF)
CAR = default_file().with_name('automotive_77ghz.yaml')
GRID = ['-p', 'pulses_per_aperture:=200', '-p', 'grid.size_x:=6.0', '-p', 'grid.size_y:=6.0',
        '-p', 'grid.spacing:=0.1', *(word for axis, value in zip('xyz', TRUTH['grid']['centre_m'],
                                                                 strict=True)
                                     for word in ('-p', f'grid.centre_{axis}:={value}'))]

PATIENCE = ['-p', 'max_age_s:=3600.0', '-p', 'pose.wait_s:=60.0']


def planned(*options, truth=TRUTH):
    arguments = parser().parse_args(['bag', '--output', 'out', '--launch-nodes', *options])
    return plan_launch(arguments, truth)


def test_grid_and_aperture_come_from_the_recording_unless_told():
    launch = planned()
    assert launch.parameters['backprojection']['pulses_per_aperture'] == 200
    assert (launch.files, launch.own, launch.nodes) == ((), False, NODES)
    launch = planned('-p', 'grid.spacing:=0.1')
    assert launch.own and launch.arguments == [
        *PATIENCE, '-p', 'grid.spacing:=0.1', '-p', 'mode:=image']


def test_a_configuration_replaces_what_the_recording_proposes(tmp_path):
    path = tmp_path / 'more.yaml'
    path.write_text('/**/backprojection:\n  ros__parameters: {target_db: -50.0}\n')
    launch = planned('--config', 'automotive_77ghz', '--params', str(path), truth=None)
    assert launch.files == (CAR, path) and launch.own
    assert launch.parameters == planned('--config', str(CAR), '--pipeline').parameters == {}


def test_a_busy_machine_has_time_unless_a_file_asks_for_its_own(tmp_path):
    """A copy of the file of all parameters has the usual waits in it, which would count."""
    path = tmp_path / 'late.yaml'
    path.write_text('/**:\n  ros__parameters: {max_age_s: 0.5}\n')
    for options in ([], ['--config', 'sar_imaging'], ['--params', str(default_file())]):
        assert planned(*options).arguments[:4] == PATIENCE
        assert planned(*options, '--params', str(path)).arguments[:2] == PATIENCE[2:]
    assert planned('-p', 'max_age_s:=0.5').arguments[4:6] == ['-p', 'max_age_s:=0.5']  # the last


@pytest.mark.parametrize(('options', 'mode', 'names'), [
    ([], 'subapertures', AFBP_NODES), (['--pipeline'], 'subapertures', PIPELINE),
    (['--mode', 'image'], 'image', NODES), (['-p', 'mode:=image'], 'image', NODES),
    (['-p', 'mode:=image', '--mode', 'subapertures'], 'subapertures', AFBP_NODES)])
def test_the_mode_is_that_asked_for_last(tmp_path, options, mode, names):
    path = tmp_path / 'mode.yaml'
    path.write_text('/**:\n  ros__parameters: {mode: subapertures}\n')
    launch = planned('--params', str(path), *options)
    assert launch.nodes == names
    assert launch.arguments[-1] == f'mode:={mode}'


@pytest.mark.parametrize(('options', 'reason'), [
    (['-p', 'grid.spaceing:=0.1'], '-p grid.spaceing:=0.1: .* did you mean grid.spacing'),
    (['-p', 'grid.spacing:=wide'], 'grid.spacing: expected a number such as'),
    (['-p', 'mode:=[image'], 'is no YAML value'),
    (['--config', 'nowhere'], 'config:=nowhere is no file; shipped are airborne_x_band'),
    (['-p', 'mode:=volume'], 'publishes points of a volume, .* give --mode image'),
    (['--params', 'nowhere.yaml'], 'nowhere.yaml cannot be read')])
def test_what_no_node_would_take_starts_nothing(options, reason):
    with pytest.raises(LaunchError, match=reason):
        planned(*options)


def test_files_are_checked_before_anything_starts(tmp_path):
    path = tmp_path / 'wrong.yaml'
    path.write_text('/**/backprojection:\n  ros__parameters: {target: -50.0}\n')
    with pytest.raises(LaunchError, match='wrong.yaml: .*target, which no node reads'):
        planned('--params', str(path))
    path.write_text('/**:\n  ros__parameters: {pose: {source: odometry, frame_id: odom}}\n')
    with pytest.raises(LaunchError, match='wrong.yaml: pose.frame_id=odom, but grid and images'):
        planned('--config', str(path))


@pytest.mark.parametrize('option', [['--config', 'my_radar.yaml'], ['-p', 'mode:=image'],
                                    ['--params', 'more.yaml']])
def test_nodes_that_run_keep_their_parameters(option, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([str(PSF), '--output', 'unused', *option])
    assert stopped.value.code == 2
    assert 'those that run already keep theirs' in capsys.readouterr().err


def test_a_value_must_be_assigned(capsys):
    with pytest.raises(SystemExit):
        main([str(PSF), '--output', 'unused', '--launch-nodes', '-p', 'mode=image'])
    assert 'mode=image is not NAME:=VALUE such as' in capsys.readouterr().err


# ------------------------------------------------------------------------------ with the nodes

def car_above_its_scene(folder):
    """Radar file with which no polar grid suits the scene."""
    path = folder / 'above.yaml'
    path.write_text(CAR.read_text().replace('centre_x: -7.0', 'centre_x: -2.9'))
    return path


def with_odometry(folder, frame):
    """The point spread function with positions from odometry in some frame."""
    block = concatenate(list(bag_io.read_blocks(PSF)))
    bare = [dataclasses.replace(block.select(slice(n, n + 25)), tx_m=None, rx_m=None)
            for n in range(0, 200, 25)]
    n = block.n_pulses + 20
    stamp = np.linspace(block.stamp_ns[0] - 10**8, block.stamp_ns[-1] + 10**8, n).astype(np.int64)
    track = np.polynomial.polynomial.polyfit((block.stamp_ns - stamp[0]) * 1e-9,
                                             block.phase_centre_m, 1)
    place = track[0] + np.outer((stamp - stamp[0]) * 1e-9, track[1])
    poses = PoseTable(stamp, place, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), frame)
    truth = TRUTH | {'alignment': Alignment(
        tx_m=np.zeros((block.n_channels, 3)), rx_m=np.arange(3.0 * block.n_channels).reshape(
            -1, 3)).as_dict()}
    bag_io.write_bag(folder / 'odometry', bare, truth, poses=poses)


def silent(folder):
    blocks = [dataclasses.replace(b, samples=0 * b.samples) for b in bag_io.read_blocks(PSF)]
    bag_io.write_bag(folder / 'silence', blocks, TRUTH)


def bare(folder):
    """Recording without truth."""
    folder = folder / 'bare'
    folder.mkdir()
    text = (PSF / 'metadata.yaml').read_text().replace(bag_io.TRUTH_KEY, 'someone.else')
    (folder / 'metadata.yaml').write_text(text)
    (folder / 'psf.mcap').write_bytes((PSF / 'psf.mcap').read_bytes())


@pytest.fixture(scope='module')
def runs(fork_server, tmp_path_factory):
    """Output folder and process of several evaluations, a few at a time."""
    folder = tmp_path_factory.mktemp('evaluate_nodes')
    above = car_above_its_scene(folder)
    for name, config in (('car', CAR), ('above', above)):
        assert simulate.main(['--config', str(config), '--output', str(folder / name)]) == 0
    with_odometry(folder, 'odom')
    silent(folder)
    bare(folder)
    few = [next(bag_io.read_blocks(PSF))]
    bag_io.write_bag(folder / 'few', few, TRUTH)
    commands = {
        'car': ['car', '--config', str(CAR), '-p', 'grid.size_x:=3.0', '--pipeline'],
        'refused': ['above', '--config', str(above), '--mode', 'subapertures'],
        'frame': ['car', '--config', str(CAR), '-p', 'frame_id:=map'],
        'poses': ['odometry'],
        'dropped': ['few', '-p', 'aperture_timeout_s:=0.5'],
        'silence': ['silence'],
        'bare': ['bare', '--config', 'sar_imaging', *GRID]}
    domains = [free_domain() for _ in commands]

    def run(name, domain):
        bag, *options = commands[name]
        return folder / f'out_{name}', fork_server.run(
            [sys.executable, '-m', 'sar_imaging.tools.evaluate', str(folder / bag), '--output',
             str(folder / f'out_{name}'), '--launch-nodes', '--timeout', '600', *options],
            folder, cwd=ROOT, env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
            timeout=300)  # half of the patience: it must not be waited out

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        return dict(zip(commands, pool.map(run, commands, domains), strict=True))


def quality_of(folder):
    return json.loads((folder / 'quality.json').read_text())


@pytest.mark.nodes
def test_the_radars_own_file_and_single_values_count(runs):
    output, result = runs['car']
    assert result.returncode == 0, result.stderr
    quality = quality_of(output)
    assert quality['grid']['n_x'] == 151 and quality['grid']['n_y'] == 301
    assert 'warning: the nodes image' in result.stderr  # another grid than the recording's
    middle = next(s for s in quality['scatterers'] if s['name'] == 'middle')
    assert middle['irw_range_m'] == pytest.approx(0.0594, rel=0.02)  # as check_config derives
    assert quality['predicted_error_db'] < -60
    for words in ('impulse response width', 'peak sidelobe ratio', 'integrated sidelobe ratio',
                  'measured minus true position', 'against exact correlation'):
        assert words in result.stdout


@pytest.mark.nodes
@pytest.mark.parametrize(('run', 'reasons'), [
    ('refused', ['backprojection forms no image: aperture 0 cannot be imaged by sub-apertures: ',
                 'use mode image']),
    ('frame', ['pulse_buffer rejected all of ', "the phase centres are in frame 'odom'"]),
    ('poses', ['pulse_buffer rejected all of ', 'poses so far: dropped poses of /odometry in '
               'frame odom: grid and images are in frame_id=map; set frame_id: odom']),
    ('dropped', ['backprojection forms no image: aperture 0 dropped: 25 of 200 pulses'])])
def test_an_image_that_will_not_come_is_not_waited_for(runs, run, reasons):
    output, result = runs[run]
    assert result.returncode == 1
    for reason in reasons:
        assert reason in result.stderr.split('error: ')[1]
    assert ' warns: ' in result.stderr.split('error: ')[0]
    assert not (output / 'quality.json').exists()


@pytest.mark.nodes
def test_warnings_are_told_once(runs):
    _, result = runs['frame']
    assert result.stderr.count('pulse_buffer warns: rejected pulses') == 1  # of many blocks


@pytest.mark.nodes
def test_a_black_image_is_no_success(runs):
    output, result = runs['silence']
    assert result.returncode == 3
    assert quality_of(output)['focus']['at_noise_level']


@pytest.mark.nodes
def test_without_truth_there_are_focus_and_predicted_error(runs):
    output, result = runs['bare']
    assert result.returncode == 0, result.stderr
    quality = quality_of(output)
    assert quality['scatterers'] == []
    assert -80 < quality['predicted_error_db'] < -60  # as nodes are by default
    assert quality['focus']['contrast'] > 1 and quality['focus']['entropy'] > 0
    assert 'IRW' not in result.stdout
