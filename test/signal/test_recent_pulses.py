# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the pulses of images formed while they arrive were sent, against the pulses."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.pulses.recent import RecentPulses


@pytest.fixture
def block(make_case):
    case = make_case(100.0, channels=2, height_m=30.0, pulses=40)
    return dataclasses.replace(case.block, stamp_ns=case.block.stamp_ns * 1000)


def assert_same(found, expected):
    assert found.radar == expected.radar
    for name in ('stamp_ns', 'tx_m', 'rx_m'):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_the_pulses_of_an_image_in_whatever_order_they_came(block):
    recent = RecentPulses(40)
    for first in (10, 0, 30, 20):
        recent.add(block.select(slice(first, first + 10)))
    counters = np.r_[3:25, 33]
    assert_same(recent.pulses(counters), block.select(np.sort(counters)))


def test_of_a_counter_that_began_anew_the_latest_pulses_count(block):
    recent = RecentPulses(80)
    again = dataclasses.replace(block, stamp_ns=block.stamp_ns + 10**9, tx_m=block.tx_m + 1.0)
    recent.add(concatenate([block, again.select(slice(0, 5))]))
    recent.add(again.select(slice(5, 20)))
    assert_same(recent.pulses(np.arange(20)), again.select(slice(0, 20)))


def test_what_is_forgotten_is_told(block):
    recent = RecentPulses(20)
    for first in range(0, 40, 10):
        recent.add(block.select(slice(first, first + 10)))
    assert recent.pulses(np.arange(20, 40)).n_pulses == 20
    with pytest.raises(ValueError, match='10 of 30 pulses are not remembered; expected pulses '
                                         'among the latest 20'):
        recent.pulses(np.arange(10, 40))
    recent.add(dataclasses.replace(block, radar=dataclasses.replace(block.radar, carrier_hz=9e9)))
    assert recent.pulses(np.arange(40)).radar.carrier_hz == 9e9


def test_a_span_of_time_is_remembered_too_and_times_that_go_back_do_not_keep_pulses(block):
    recent = RecentPulses(10, span_s=25e-9 * float(np.diff(block.stamp_ns[:2])[0]))
    for first in range(0, 40, 5):
        recent.add(block.select(slice(first, first + 5)))
    assert recent.pulses(np.arange(15, 40)).n_pulses == 25  # of these five blocks ends are within
    with pytest.raises(ValueError, match='not remembered'):
        recent.pulses(np.arange(5, 10))
    for first in (0, 5):
        recent.add(block.select(slice(first, first + 5)))
    assert [int(b.counter[0]) for b in recent.unbroken()] == [0, 5]
    with pytest.raises(ValueError, match='not remembered'):
        recent.pulses(np.arange(10, 40))


def test_without_pulses_there_are_none():
    with pytest.raises(ValueError, match='all of 0 pulses are not remembered'):
        RecentPulses(5).pulses(np.zeros(0))
