# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes with a device that is missing, and with one that fails; they live on."""

from __future__ import annotations

import os

import numpy as np
import pytest
from std_msgs.msg import Float32MultiArray

from msg_conversions import pulse_block
from sar_imaging import backends
from sar_imaging.backends import DeviceError
from sar_imaging.nodes.afbp_fusion import FusionStep
from sar_imaging.nodes.range_compression import RangeCompressionStep
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.signal import PulseBlock, RadarParameters
from sar_imaging.signal.range_compression import RangeCompressor

from .conftest import Nodes
from .step_bench import make

RADAR = RadarParameters(10e9, 300e6, 400e6, 6.2e-6, pulse_length_s=2e-7,
                        chirp_rate_hz_per_s=1.5e15)
# A simulated device whose third block finds no memory. The interpreter imports it at its start.
DEVICE = """
from sar_imaging.backends import DeviceError
from sar_imaging.backends.cuda import transfers

room, calls = transfers._room, []

def fail(shape):
    calls.append(shape)
    if len(calls) == 3:
        raise DeviceError('out of device memory: none is free')
    return room(shape)

transfers._room = fail
"""


def pulses(number, n=8):
    counter = np.arange(number * n, (number + 1) * n)
    rng = np.random.default_rng(number)
    samples = rng.standard_normal((n, 1, 400), np.float32).view(np.complex64)
    centres = np.zeros((n, 1, 3))
    return PulseBlock(RADAR, False, 10**9 + counter * 1_000_000, counter, samples, centres,
                      centres)


@pytest.mark.parametrize('step', [RangeCompressionStep, FusionStep])
def test_a_device_that_is_not_there_is_told_at_the_start(step, monkeypatch):
    def fail():
        raise DeviceError('the CUDA driver finds no device')

    monkeypatch.setattr(backends, 'require_device', fail)
    with pytest.raises(ConfigurationError,
                       match=r'^parameter backend: the CUDA driver finds no device$'):
        make(step, backend='cuda')


def test_a_device_that_fails_is_counted_and_the_node_lives_on(ros_environment, tmp_path,
                                                              make_observer):
    """A real node process; profiles of the other blocks are those of the processor."""
    (tmp_path / 'sitecustomize.py').write_text(DEVICE)
    paths = os.pathsep.join(filter(None, (str(tmp_path), ros_environment.get('PYTHONPATH'))))
    node = Nodes(tmp_path / 'node', {**ros_environment, 'PYTHONPATH': paths,
                                     'NUMBA_ENABLE_CUDASIM': '1'},
                 {'range_compression': {'backend': 'cuda', 'max_age_s': 3600.0}})
    node.start('range_compression')
    try:
        observer = make_observer('pulse_blocks')
        observer.subscribe(Float32MultiArray, 'range_profiles')
        observer.wait(lambda: observer.joined, 'the subscription')
        node.wait_for_log('range_compression', 'subscriber on .*range_profiles joined')
        blocks = [pulses(number) for number in range(5)]
        observer.send(blocks)
        node.wait_for_log('range_compression', 'rejected pulses 16..23 of .*: out of device '
                                               'memory: none is free')
        got = [pulse_block.from_message(m) for m in observer.wait_for('range_profiles', 4)]
        observer.wait_for_counters('range_compression', blocks_rejected=1, blocks_compressed=4,
                                   errors=0)
    finally:
        assert node.stop('range_compression') == 0, node.log('range_compression')
    compress = RangeCompressor.for_block(blocks[0])
    for found, raw in zip(got, (*blocks[:2], *blocks[3:]), strict=True):
        wanted = compress(raw).samples
        error = np.linalg.norm(found.samples - wanted) / np.linalg.norm(wanted)
        assert error < 1e-6  # -120 dB; float32 transforms of two libraries
