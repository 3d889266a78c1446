# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node processes that programs start: refused, stopped, killed and started again."""

import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

from sar_imaging.recordings import bag_io
from sar_imaging.tools.node_processes import (
    NodeProcessError,
    NodeProcesses,
    free_domain,
    isolated_environment,
    parameters_from_truth,
)

PSF = Path(__file__).resolve().parents[2] / 'bags' / 'psf'
pytestmark = pytest.mark.nodes


def test_node_that_refuses_its_parameters_is_quoted(tmp_path):
    truth = bag_io.read_truth(PSF)
    truth['grid'] |= {'n_x': 100_000, 'n_y': 100_000}
    with NodeProcesses(parameters_from_truth(truth), tmp_path, isolated_environment(),
                       nodes=['pulse_buffer', 'backprojection']) as nodes:
        deadline = time.monotonic() + 60
        with pytest.raises(NodeProcessError, match='backprojection ended with status 1') as error:
            while time.monotonic() < deadline:
                nodes.check()
                time.sleep(0.05)
    assert 'max_image_pixels' in str(error.value)


def test_processes_can_be_stopped_killed_and_started_again(tmp_path, shipped_profile):
    parameters = parameters_from_truth(bag_io.read_truth(PSF))
    with NodeProcesses(parameters, tmp_path, isolated_environment(),
                       nodes=['pulse_buffer']) as processes:
        with pytest.raises(NodeProcessError, match='runs already'):
            processes.start('pulse_buffer')
        while 'ready' not in processes.log_tail('pulse_buffer'):
            processes.check()
            time.sleep(0.05)
        mapped = Path(f'/proc/{processes.pid("pulse_buffer")}/maps').read_text()
        segments = {Path(name) for name in re.findall(r'/dev/shm/fastrtps_[0-9a-f]{16}', mapped)}
        assert sum(s.stat().st_size for s in segments) > 64 * 2**20
        processes.kill('pulse_buffer')
        assert not [s for s in segments if s.exists()]  # a killed process removes nothing
        processes.check()  # the caller ended it: nothing is wrong
        processes.start('pulse_buffer')
        processes.check()


def test_nobody_else_gets_a_domain_that_was_found():
    mine = {free_domain() for _ in range(3)}
    code = ('from sar_imaging.tools.node_processes import free_domain\n'
            f'print(*(free_domain() for _ in range({40 - len(mine)})))')
    found = subprocess.run([sys.executable, '-c', code], check=True, text=True,
                           capture_output=True).stdout.split()
    assert len(mine) == 3
    assert len(mine | set(map(int, found))) == 40
