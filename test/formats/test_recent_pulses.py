"""Acquisitions of images formed while pulses arrive, against those of the pulses themselves."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.formats import Acquisition
from sar_imaging.formats.acquisition import RecentPulses
from sar_imaging.signal.pulses import concatenate


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
    assert_same(recent.acquisition(counters), Acquisition.of(block.select(counters)))


def test_of_a_counter_that_began_anew_the_latest_pulses_count(block):
    recent = RecentPulses(80)
    again = dataclasses.replace(block, stamp_ns=block.stamp_ns + 10**9, tx_m=block.tx_m + 1.0)
    recent.add(concatenate([block, again.select(slice(0, 5))]))
    recent.add(again.select(slice(5, 20)))
    assert_same(recent.acquisition(np.arange(20)), Acquisition.of(again.select(slice(0, 20))))


def test_what_is_forgotten_is_told(block):
    recent = RecentPulses(20)
    for first in range(0, 40, 10):
        recent.add(block.select(slice(first, first + 10)))
    assert recent.acquisition(np.arange(20, 40)).n_pulses == 20
    with pytest.raises(ValueError, match='10 of 30 pulses are not remembered; expected pulses '
                                         'among the latest 20'):
        recent.acquisition(np.arange(10, 40))
    recent.add(dataclasses.replace(block, radar=dataclasses.replace(block.radar, carrier_hz=9e9)))
    assert recent.acquisition(np.arange(40)).radar.carrier_hz == 9e9


def test_without_pulses_there_is_no_acquisition():
    with pytest.raises(ValueError, match='all of 0 pulses are not remembered'):
        RecentPulses(5).acquisition(np.zeros(0))
