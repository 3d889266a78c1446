# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulse source and imaging on two hosts: network namespaces joined by a virtual cable."""

import contextlib
import json
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.tools.node_processes import (
    NO_LOG_FILES,
    NODES,
    isolated_environment,
    parameters_from_truth,
    write_parameters,
)

from ..conftest import wait

LARGEST_ERROR_DB = -80.0  # what backprojection plans for by default
PATIENCE_S = 90.0
# A host has shared memory of its own: the processes must not meet there.
HOST = 'mount -t tmpfs shm /dev/shm && ip link set lo up && echo ready && exec cat'


class NotPermitted(RuntimeError):
    """No network namespaces on this machine or for this user."""


def start_host(stack):
    """Namespaces that live as long as the process in them; returns its number."""
    host = stack.enter_context(subprocess.Popen(
        ['unshare', '--net', '--mount', 'sh', '-c', HOST], text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
    stack.callback(host.stdin.close)  # ends it
    if host.stdout.readline() != 'ready\n':
        raise NotPermitted(host.stderr.read().strip())
    return host.pid


def ip(*arguments, inside=()):
    result = subprocess.run([*inside, 'ip', *arguments], capture_output=True, text=True)
    if result.returncode:
        raise NotPermitted(result.stderr.strip())
    return result.stdout


def cable_runs(host):
    """Processes use the interfaces alone that run when they start; this may take a second."""
    return json.loads(ip('-j', 'link', 'show', 'cable', inside=host))[0]['operstate'] == 'UP'


@pytest.fixture
def two_hosts():
    """What to put before a command to run it on one host or the other."""
    if missing := [name for name in ('ip', 'unshare', 'nsenter') if not shutil.which(name)]:
        pytest.skip(f'needs {", ".join(missing)} (iproute2, util-linux)')
    with contextlib.ExitStack() as stack:
        try:
            hosts = [start_host(stack) for _ in range(2)]
            ip('link', 'add', 'cable', 'netns', str(hosts[0]), 'type', 'veth',
               'peer', 'name', 'cable', 'netns', str(hosts[1]))
            inside = [['nsenter', '--target', str(host), '--net', '--mount'] for host in hosts]
            for number, host in enumerate(inside, 1):
                ip('address', 'add', f'10.77.0.{number}/24', 'dev', 'cable', inside=host)
                ip('link', 'set', 'cable', 'up', inside=host)
            wait(lambda: all(map(cable_runs, inside)), 'the cable to run')
        except NotPermitted as error:
            pytest.skip(f'no network namespaces here (run as root): {error}')
        yield inside


def test_pulses_from_another_host_give_the_same_images(two_hosts, spotlight, tmp_path,
                                                       pytestconfig, shipped_profile):
    radar_host, imaging_host = two_hosts
    environment = isolated_environment() | {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_LOG_DIR': str(tmp_path)}
    parameters = tmp_path / 'parameters.yaml'
    write_parameters(parameters, parameters_from_truth(spotlight.truth))
    bag = pytestconfig.rootpath / 'bags' / 'spotlight'
    with contextlib.ExitStack() as stack:
        nodes = []
        for name in NODES:
            log = stack.enter_context(open(tmp_path / f'{name}.log', 'wb'))
            nodes.append(stack.enter_context(subprocess.Popen(
                [*imaging_host, sys.executable, '-m', f'sar_imaging.nodes.{name}',
                 *NO_LOG_FILES, '--params-file', str(parameters)],
                env=environment, stdout=log, stderr=log)))
            stack.callback(nodes[-1].send_signal, signal.SIGINT)
        evaluate = subprocess.run(
            [*radar_host, sys.executable, '-m', 'sar_imaging.tools.evaluate', str(bag),
             '--output', str(tmp_path / 'out')],
            env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
        logs = '\n'.join((tmp_path / f'{name}.log').read_text() for name in NODES)
        assert evaluate.returncode == 0, f'{evaluate.stderr}\n{logs}'
    [cable] = json.loads(ip('-s', '-j', 'link', 'show', 'cable', inside=radar_host))
    assert cable['stats64']['tx']['bytes'] > sum(len(cdr) for cdr in spotlight.raw)
    assert [node.returncode for node in nodes] == [0] * len(NODES)

    image = np.load(tmp_path / 'out' / 'image.npy')
    grid = spotlight.truth['grid']
    grid = MapGrid(tuple(grid['centre_m']), grid['n_x'], grid['n_y'], grid['spacing_m'])
    assert spotlight.error_db(image, grid, np.arange(128, 256)) < LARGEST_ERROR_DB
    assert 'image of aperture 0: 128 pulses, missing none' in logs
    assert 'image of aperture 1: 128 pulses, missing none' in logs


PROBE = """
import rclpy, sys, time
rclpy.init()
node = rclpy.create_node('probe')
deadline = time.monotonic() + float(sys.argv[2])
seen = set()
while sys.argv[1] not in seen and time.monotonic() < deadline:
    time.sleep(0.05)
    seen |= set(node.get_node_names())
print(' '.join(sorted(seen)))
"""


def test_localhost_discovery_hides_a_node_but_keeps_nobody_out(two_hosts, tmp_path):
    """As docs/security.md says: a host that names this one as its static peer reaches it."""
    other_host, robot = two_hosts
    environment = isolated_environment() | {'ROS_LOG_DIR': str(tmp_path)}
    visible, hidden = 'range_compression', 'pulse_buffer'

    def seen(until, **variables):
        probe = subprocess.run(
            [*other_host, sys.executable, '-c', PROBE, until, str(PATIENCE_S)], text=True,
            env=environment | variables, stdout=subprocess.PIPE, check=True)
        return probe.stdout.split()

    with contextlib.ExitStack() as stack:
        for name, reach in ((hidden, 'LOCALHOST'), (visible, 'SUBNET')):
            node = stack.enter_context(subprocess.Popen(
                [*robot, sys.executable, '-m', f'sar_imaging.nodes.{name}', *NO_LOG_FILES],
                env=environment | {'ROS_AUTOMATIC_DISCOVERY_RANGE': reach}, text=True,
                stderr=subprocess.PIPE))
            stack.callback(node.send_signal, signal.SIGINT)
            assert any('ready' in line for line in node.stderr)
        # The one that was there first would have been seen by the time the other one is.
        assert hidden not in seen(visible, ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET')
        assert hidden in seen(hidden, ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET',
                              ROS_STATIC_PEERS='10.77.0.2')
