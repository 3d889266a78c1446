# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Builds the package as a ROS workspace does and starts what `ros2 run` would start.

Runs where colcon is installed beside the package's requirements: `make colcon`.
"""

from __future__ import annotations

import configparser
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip('colcon_core', reason='colcon is not in this environment; run `make colcon`')
rclpy = pytest.importorskip('rclpy')

ROOT = pathlib.Path(__file__).parent.parent
SOURCES = ('msg_conversions', 'sar_imaging', 'package.xml', 'setup.py', 'pyproject.toml',
           'README.md', 'LICENSE')
NEEDY = {'radar_driver': 'parameter description_file is empty; name the description',
         'localization': 'parameter map.folder is empty; name a folder'}
START_TIMEOUT_S = 240  # the first start compiles kernels, and Ctrl-C waits for that


@pytest.fixture(scope='module', params=['copy', 'symlink'])
def install(request, tmp_path_factory):
    """Install folder of a workspace with the package's sources."""
    workspace = tmp_path_factory.mktemp(request.param)
    package = workspace / 'src' / 'sar_imaging'
    package.mkdir(parents=True)
    for name in SOURCES:
        source = ROOT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(source, package / name)
    options = ['--symlink-install'] if request.param == 'symlink' else []
    built = subprocess.run([sys.executable, '-m', 'colcon', 'build', *options], cwd=workspace,
                           text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert built.returncode == 0, built.stdout
    return workspace / 'install'


@pytest.fixture
def environment(install, monkeypatch):
    """Environment of a shell that sourced the workspace, in a ROS domain of its own."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.delenv('PYTHONPATH', raising=False)
    sourced = subprocess.run(['bash', '-c', f'source "{install}/local_setup.bash" && env -0'],
                             check=True, stdout=subprocess.PIPE, text=True)
    return dict(line.split('=', 1) for line in sourced.stdout.split('\0') if line)


def _executables(install) -> dict[str, str]:
    """Module of each executable that the build announced."""
    [entry_points] = (install.parent / 'build').glob('**/entry_points.txt')
    parser = configparser.ConfigParser()
    parser.read(entry_points)
    return {name: target.split(':')[0] for name, target in parser['console_scripts'].items()}


def test_tools_print_their_help(install, environment, tmp_path):
    tools = [name for name, module in _executables(install).items() if '.tools.' in module]
    assert tools
    for name in tools:
        result = subprocess.run([install / 'sar_imaging/lib/sar_imaging' / name, '--help'],
                                cwd=tmp_path, env=environment, text=True, capture_output=True)
        assert result.returncode == 0, result.stderr
        assert 'usage:' in result.stdout


def test_nodes_start_and_stop(install, environment, tmp_path):
    nodes = [name for name, module in _executables(install).items() if '.nodes.' in module]
    for name in NEEDY:
        nodes.remove(name)
    assert nodes
    processes = {name: subprocess.Popen(
        [install / 'sar_imaging/lib/sar_imaging' / name], cwd=tmp_path, env=environment,
        text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) for name in nodes}
    try:
        _wait_for_nodes(processes)
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        for name, process in processes.items():
            output, _ = process.communicate(timeout=START_TIMEOUT_S)
            assert process.returncode == 0, f'{name}: {output}'
            assert 'Traceback' not in output, f'{name}: {output}'
    finally:
        for process in processes.values():
            process.kill()
            process.wait()


@pytest.mark.parametrize('name', NEEDY)
def test_a_node_without_defaults_says_what_it_needs(install, environment, tmp_path, name):
    run = subprocess.run([install / 'sar_imaging/lib/sar_imaging' / name], cwd=tmp_path,
                         env=environment, text=True, stdout=subprocess.PIPE,
                         stderr=subprocess.STDOUT, timeout=START_TIMEOUT_S)
    assert run.returncode == 1
    assert NEEDY[name] in run.stdout
    assert 'Traceback' not in run.stdout


def _wait_for_nodes(processes):
    """Return when every node is in the ROS graph; fail when one ends or the time is over."""
    context = rclpy.Context()
    rclpy.init(context=context)
    observer = rclpy.create_node('observer', context=context)
    try:
        deadline = time.monotonic() + START_TIMEOUT_S
        while not set(processes) <= set(observer.get_node_names()):
            for name, process in processes.items():
                assert process.poll() is None, f'{name} ended: {process.stdout.read()}'
            assert time.monotonic() < deadline, f'saw only {observer.get_node_names()}'
            time.sleep(0.05)
    finally:
        observer.destroy_node()
        rclpy.try_shutdown(context=context)


def test_installed_tools_and_nodes_form_an_image(install, environment, tmp_path):
    # Nothing of the source tree is on the path: configuration and nodes are the installed ones.
    subprocess.run([install / 'sar_imaging/lib/sar_imaging/evaluate', ROOT / 'bags' / 'psf',
                    '--output', tmp_path / 'psf', '--launch-nodes'],
                   cwd=tmp_path, env=environment, check=True)
    assert (tmp_path / 'psf' / 'image.png').stat().st_size > 0


def test_share_folder_has_what_launch_needs(install):
    share = install / 'sar_imaging' / 'share'
    marker = share / 'ament_index' / 'resource_index' / 'packages' / 'sar_imaging'
    assert marker.exists() and (share / 'sar_imaging' / 'package.xml').exists()
    for folder in ('launch', 'config', 'resource'):
        # The marker file of the ament index, which has no suffix, stands above.
        expected = {path.name for path in (ROOT / 'sar_imaging' / folder).glob('[!_]*.*')}
        installed = (share / 'sar_imaging' / folder).glob('[!_]*.*')
        assert expected == {path.name for path in installed}
        assert expected
