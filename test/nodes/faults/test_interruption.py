# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C ends a node at any moment: while it loads libraries, and while it compiles kernels."""

import signal
import subprocess
import sys

import pytest


def _start(environment, *options, **variables):
    return subprocess.Popen(
        [sys.executable, *options, '-m', 'sar_imaging.nodes.backprojection', '--ros-args',
         '--disable-external-lib-logs'], env=environment | variables, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True, start_new_session=True)


def _interrupt_at(process, sign):
    """Send Ctrl-C when a line with `sign` comes; exit status, and what came afterwards."""
    with process:
        for line in process.stderr:
            if sign in line:
                process.send_signal(signal.SIGINT)
                rest = process.stderr.read()
                return process.wait(), rest
    pytest.fail(f'{sign!r} never came')


# Python tells what it has imported: numpy comes early, the last of these before the node starts.
@pytest.mark.parametrize('module', ['numpy', 'numba', 'sar_imaging.imaging.imager',
                                    'rclpy', 'sar_imaging.nodes.images.volume_cloud'])
def test_while_libraries_are_loaded(ros_environment, module):
    process = _start(ros_environment, '-X', 'importtime')
    status, rest = _interrupt_at(process, f' {module}\n')
    assert status == 0
    assert 'Traceback' not in rest


def test_while_kernels_are_compiled(ros_environment, tmp_path):
    process = _start(ros_environment, NUMBA_CACHE_DIR=str(tmp_path))
    status, rest = _interrupt_at(process, 'compiling kernels')
    assert status == 0
    assert 'Traceback' not in rest and 'ready' not in rest
    # Without the interruption the node goes on to the last one: 11.
    assert len(list(tmp_path.rglob('*.nbc'))) <= 3
