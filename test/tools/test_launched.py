# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Launch files in the forms of a robot's bringup: what is started, where `launch` can be imported.

Executables stand for those of the package: each writes down its command line and ends. The last
test starts the real nodes.
"""

from __future__ import annotations

import json
import os
import pathlib
import signal
import subprocess
import sys
import textwrap

import pytest

from sar_imaging.tools import launching, node_processes
from sar_imaging.tools.node_processes import free_domain

pytest.importorskip('launch_ros', reason='launch files need a ROS installation')
from launch import LaunchDescription, LaunchService
from launch.actions import (
    GroupAction,
    IncludeLaunchDescription,
    SetEnvironmentVariable,
)
from launch_ros.actions import PushRosNamespace, SetParameter, SetRemap

LAUNCH = pathlib.Path(launching.__file__).parents[1] / 'launch'
NODES = launching.node_names('image', pipeline=False)
WRITES_DOWN = """\
    #!{python}
    import json, os, sys, time
    with open({folder!r} + '/' + str(time.time_ns()) + str(os.getpid()), 'w') as file:
        json.dump([{name!r}, sys.argv[1:], os.environ.get({profile!r}, '')], file)
    sys.exit({name!r} == 'check_config' and 'mode:=volume' in sys.argv)
"""
RUNS = '#!/bin/sh\nexec {python} -m sar_imaging.{module} "$@"\n'


def _executables(prefix: pathlib.Path, texts: dict[str, str]) -> None:
    """Install executables of the package under a prefix of ament."""
    marker = prefix / 'share/ament_index/resource_index/packages/sar_imaging'
    marker.parent.mkdir(parents=True)
    marker.touch()
    folder = prefix / 'lib' / 'sar_imaging'
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(textwrap.dedent(text))
        (folder / name).chmod(0o755)


@pytest.fixture(name='started')
def started_fixture(tmp_path, monkeypatch):
    """Runs actions; returns the exit status and (name, words, profile) of what was started."""
    written = tmp_path / 'written'
    written.mkdir()
    names = {*launching.node_names('subapertures', pipeline=False), 'sar_pipeline', 'localization',
             'check_config', 'wait_until_active', 'ros2'}
    _executables(tmp_path / 'prefix', {name: textwrap.dedent(WRITES_DOWN).format(
        python=sys.executable, folder=str(written), name=name, profile=node_processes.PROFILE)
        for name in names})
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    monkeypatch.setenv('PATH', f'{tmp_path}/prefix/lib/sar_imaging', prepend=os.pathsep)
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
    monkeypatch.delenv(node_processes.PROFILE, raising=False)
    (tmp_path / 'ros2bag').mkdir()
    (tmp_path / 'ros2bag' / '__init__.py').touch()
    monkeypatch.syspath_prepend(tmp_path)

    def run(*actions):
        service = LaunchService()
        service.include_launch_description(LaunchDescription([*actions]))
        status = service.run()
        return status, [json.loads(file.read_text()) for file in sorted(written.iterdir())]
    return run


def include(file='sar_imaging', **arguments):
    """A launch file of the package with arguments."""
    return IncludeLaunchDescription(str(LAUNCH / f'{file}.launch.py'),
                                    launch_arguments=arguments.items())


def nodes_of(started) -> set:
    """Full names of the nodes among what was started."""
    names = set()
    for _, words, _ in started:
        given = dict(w.split(':=', 1) for w in words if ':=' in w)
        if '__node' in given:
            names.add(f'{given.get("__ns", "").rstrip("/")}/{given["__node"]}')
    return names


def named(namespace, names=NODES) -> set:
    """Full names of nodes in a namespace."""
    return {f'{namespace}/{name}' for name in names}


WAYS = {
    'plain': (lambda: [include()], named('')),
    'a namespace': (lambda: [include(namespace='radar1')], named('/radar1')),
    'one process': (lambda: [include('sar_pipeline')], {'/sar_pipeline'}),
    'another mode': (lambda: [include(mode='subapertures')],
                     named('', (*NODES, 'afbp_fusion'))),
    'a map': (lambda: [include(map='place')], named('', (*NODES, 'localization'))),
    'a group': (lambda: [GroupAction([PushRosNamespace('robot'), include()])], named('/robot')),
    'groups in groups': (lambda: [GroupAction([PushRosNamespace('robot'), GroupAction(
        [PushRosNamespace('front'), include()])])], named('/robot/front')),
    'a group and a namespace': (lambda: [GroupAction(
        [PushRosNamespace('robot'), include(namespace='radar1')])], named('/robot/radar1')),
    'twice by namespace': (lambda: [include(namespace=name) for name in ('left', 'right')],
                           named('/left') | named('/right')),
    'twice by group': (lambda: [GroupAction([PushRosNamespace(name), include('sar_pipeline')])
                                for name in ('left', 'right')],
                       {'/left/sar_pipeline', '/right/sar_pipeline'}),
    'two configurations': (lambda: [
        include('sar_pipeline', namespace='car', config='automotive_77ghz'),
        include('sar_pipeline', namespace='drone', config='drone_uwb')],
        {'/car/sar_pipeline', '/drone/sar_pipeline'}),
}


@pytest.mark.parametrize('way', WAYS)
def test_nodes_start_in_the_namespace_of_their_scope(started, way):
    actions, expected = WAYS[way]
    status, processes = started(*actions())
    assert status == 0
    assert nodes_of(processes) == expected


def test_groups_pass_remappings_parameters_and_environment_on(started):
    status, processes = started(
        GroupAction([SetRemap('pulses', 'raw'), SetParameter('use_sim_time', True),
                     SetEnvironmentVariable(node_processes.PROFILE, 'mine.xml'),
                     include('sar_pipeline', namespace='in')]),
        include('sar_pipeline', namespace='out'))
    assert status == 0
    inside, outside = ([(words, profile) for name, words, profile in processes
                        if f'__ns:=/{ns}' in words] for ns in ('in', 'out'))
    [(words, profile)] = inside
    assert {'pulses:=raw', 'use_sim_time:=True'} <= set(words) and profile == 'mine.xml'
    [(words, profile)] = outside
    assert not {'pulses:=raw', 'use_sim_time:=True'} & set(words)
    assert profile.endswith('fastdds_large_segment.xml')


def test_arguments_reach_the_nodes(started):
    status, processes = started(include('sar_pipeline', use_sim_time='true', autostart='false'))
    assert status == 0
    [words] = [words for name, words, _ in processes if name == 'sar_pipeline']
    assert {'use_sim_time:=true', 'autostart:=false'} <= set(words)


@pytest.mark.parametrize('arguments', [{'mode': 'fast'}, {'config': 'absent'},
                                       {'autostart': 'later'}])
def test_arguments_that_make_no_sense_start_nothing(started, arguments):
    assert started(include(**arguments)) == (1, [])


def test_a_replay_without_rosbag2_starts_nothing(started, tmp_path):
    (tmp_path / 'ros2bag' / '__init__.py').unlink()
    (tmp_path / 'ros2bag').rmdir()
    assert started(include('replay', bag=str(tmp_path))) == (1, [])


def test_the_check_gets_the_arguments(started):
    status, processes = started(include(mode='volume'))
    assert status == 1
    [(name, words, _)] = processes  # nothing else was started
    assert name == 'check_config' and words[1:] == ['-p', 'mode:=volume']


def test_a_replay_reaches_the_nodes_of_its_group(started, tmp_path):
    bag = tmp_path / 'bag'
    bag.mkdir()
    (bag / 'metadata.yaml').touch()
    status, processes = started(GroupAction([
        PushRosNamespace('robot'), SetRemap('pulses', 'raw'), SetParameter('use_sim_time', True),
        include('replay', bag=str(bag), pipeline='true', namespace='radar1')]))
    assert status == 0
    started_as = {name: (words, profile) for name, words, profile in processes}
    assert started_as['wait_until_active'][0] == ['/robot/radar1/sar_pipeline']
    player, profile = started_as['ros2']
    assert '--clock' in player and profile.endswith('fastdds_large_segment.xml')
    assert {'/pulses:=/robot/radar1/raw', '/odometry:=/robot/radar1/odometry'} <= set(player)


def test_two_radars_do_not_mix_their_topics(tmp_path, monkeypatch):
    rclpy = pytest.importorskip('rclpy')
    domain = free_domain()
    _executables(tmp_path / 'prefix', {
        name: RUNS.format(python=sys.executable, module=module) for name, module in {
            'sar_pipeline': 'nodes.sar_pipeline', 'check_config': 'tools.check_config'}.items()})
    bringup = tmp_path / 'bringup.launch.py'
    bringup.write_text(textwrap.dedent(f"""\
        from launch import LaunchDescription
        from launch.actions import GroupAction, IncludeLaunchDescription
        from launch_ros.actions import PushRosNamespace

        def generate_launch_description():
            return LaunchDescription([GroupAction([
                PushRosNamespace(name), IncludeLaunchDescription(
                    {str(LAUNCH / 'sar_pipeline.launch.py')!r})]) for name in ('left', 'right')])
        """))
    program = ('import sys; from launch import LaunchDescription, LaunchService; '
               'from launch.actions import IncludeLaunchDescription as Include; '
               's = LaunchService(); s.include_launch_description('
               'LaunchDescription([Include(sys.argv[1])])); sys.exit(s.run())')
    for name, value in {'AMENT_PREFIX_PATH': str(tmp_path / 'prefix'),
                        'ROS_DOMAIN_ID': str(domain), 'ROS_LOG_DIR': str(tmp_path / 'log'),
                        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}.items():
        monkeypatch.setenv(name, value)
    launched = subprocess.Popen([sys.executable, '-c', program, str(bringup)])
    rclpy.init(domain_id=domain)
    try:
        from sar_imaging.tools.wait_until_active import _wait
        watcher = rclpy.create_node('watcher')
        assert _wait(watcher, ['/left/sar_pipeline', '/right/sar_pipeline'], 120.0) == 0
        topics = {name for name, _ in watcher.get_topic_names_and_types()}
    finally:
        rclpy.try_shutdown()
        launched.send_signal(signal.SIGINT)
        status = launched.wait(60)
    assert {'/left/pulses', '/right/pulses'} <= topics
    assert not {'/pulses', '/image'} & topics
    assert status == 0
