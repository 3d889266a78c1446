# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A program that ends when nodes are active: what the replay of a launch file waits for."""

import contextlib
import subprocess
import sys


@contextlib.contextmanager
def _waiting(environment, *arguments):
    with subprocess.Popen(
            [sys.executable, '-m', 'sar_imaging.tools.wait_until_active', *arguments],
            env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()  # it waits for as long as it takes


def test_it_ends_when_the_last_node_is_active(start_node, make_observer, ros_environment):
    start_node('pulse_buffer')
    start_node('range_compression', {'autostart': False})
    observer = make_observer()
    observer.wait(lambda: observer.state('pulse_buffer') == 'active', 'the first node')
    with _waiting(ros_environment, 'pulse_buffer', '/range_compression') as process:
        observer.wait(lambda: observer.node.count_clients('range_compression/get_state'),
                      'the question')
        assert process.poll() is None
        assert observer.change_state('range_compression', 'configure')
        assert process.poll() is None
        assert observer.change_state('range_compression', 'activate')
        assert process.wait() == 0
        assert 'pulse_buffer, /range_compression active' in process.stderr.read()


def test_it_gives_up_when_the_time_is_over(ros_environment):
    with _waiting(ros_environment, 'nobody', '--timeout', '0.5') as process:
        assert process.wait() == 1
        assert 'nobody not active after 0.5 s' in process.stderr.read()
