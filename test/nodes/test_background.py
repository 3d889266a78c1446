# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""range_compression subtracts static background over the blocks, and refuses what cannot be."""

from __future__ import annotations

import numpy as np
from std_msgs.msg import Float32MultiArray

from msg_conversions import pulse_block
from sar_imaging.signal.background import BackgroundFilter
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.radar import RadarParameters

RADAR = RadarParameters(4e9, 1e9, 1.5e9, 2e-8)


def pulses(first, n=32):
    """Profiles every 20 ms: coupling of 1000, an echo of 1 at half a hertz."""
    counter = np.arange(first, first + n)
    samples = np.full((n, 2, 64), 1000.0, np.complex64)
    samples[:, :, 40] += np.exp(1j * np.pi * counter / 50)[:, None]
    centres = np.zeros((n, 2, 3))
    return PulseBlock(RADAR, True, 10**9 + counter * 20_000_000, counter, samples, centres,
                      centres)


def test_background_goes_over_block_borders_and_a_short_average_is_refused(start_node,
                                                                           make_observer):
    node = start_node('range_compression', {'background_s': 1.0, 'oversampling': 1.0})
    observer = make_observer('pulse_blocks')
    observer.subscribe(Float32MultiArray, 'range_profiles')
    observer.wait(lambda: observer.joined, 'the subscription')
    node.wait_for_log('range_compression', 'background averaged over 1 s subtracted')
    node.wait_for_log('range_compression', 'subscriber on .*range_profiles joined')
    blocks = [pulses(first) for first in range(0, 160, 32)]
    observer.send(blocks)
    got = concatenate([pulse_block.from_message(m)
                       for m in observer.wait_for('range_profiles', len(blocks))])
    expected = BackgroundFilter(1.0)(concatenate(blocks))
    # The same numbers in the same order; 1e-3 is the last digit of 1000 in single precision.
    np.testing.assert_allclose(got.samples, expected.samples, rtol=0, atol=1e-3)
    assert np.abs(got.samples[:, :, :40]).max() < 1e-2
    assert np.abs(got.samples[-32:, :, 40]).min() > 0.8

    assert observer.set_parameter('range_compression', 'background_s', 0.1) == (True, '')
    observer.send([pulses(160)])
    node.wait_for_log('range_compression', 'a time constant of 0.1 s is too short to tell')
    observer.wait_for_counters('range_compression', blocks_rejected=1, errors=0)
    assert observer.set_parameter('range_compression', 'background_s', 0.0) == (True, '')
    observer.send([pulses(192)])
    profiles = pulse_block.from_message(observer.wait_for('range_profiles', len(blocks) + 1)[-1])
    np.testing.assert_array_equal(profiles.samples, pulses(192).samples)
