# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Oddities of positions and times, each at the end of what is taken for right."""

import dataclasses
import re

import numpy as np
import pytest

from sar_imaging.diagnosis.hypotheses import reach_advice
from sar_imaging.diagnosis.track import track_doubts


def test_right_track_raises_no_doubt(right):
    assert track_doubts(right) == ()


def moved(block, change):
    return dataclasses.replace(block, tx_m=change(block.tx_m), rx_m=change(block.rx_m))


@pytest.mark.parametrize('every', [5, 8, 20])
def test_positions_left_out(right, every):
    kept = np.delete(np.arange(right.n_pulses), slice(0, None, every))
    block = dataclasses.replace(right.select(slice(0, len(kept))), tx_m=right.tx_m[kept],
                                rx_m=right.rx_m[kept])
    [doubt] = track_doubts(block)
    assert re.search(rf'one in {every - 1}, advance.*were left out', doubt)


def test_positions_repeated(right):
    held = np.arange(right.n_pulses)
    held[8::8] -= 1
    [doubt] = track_doubts(moved(right, lambda p: p[held]))
    assert 'one in 8' in doubt and 'positions were repeated' in doubt


def test_pulses_left_out_with_their_positions_are_right(right):
    kept = np.delete(np.arange(right.n_pulses), slice(0, None, 8))
    assert track_doubts(right.select(kept)) == ()


def test_platform_at_rest(right):
    [doubt] = track_doubts(moved(right, lambda p: np.broadcast_to(p[:1], p.shape)))
    assert 'phase centres of all 240 pulses are the same' in doubt


def test_degrees(right):
    [doubt] = track_doubts(moved(right, lambda p: [11.5, 48.1, 500.0] + p * [9e-6, 9e-6, 1.0]))
    assert 'degrees of longitude and latitude' in doubt


@pytest.mark.parametrize(('speed', 'named'), [(14e3, False), (16e3, True)])
def test_faster_than_a_satellite(right, speed, named):
    time_s = 1e-9 * (right.stamp_ns - right.stamp_ns[0])[:, None, None]
    doubts = track_doubts(moved(right, lambda p: np.concatenate(
        [speed * time_s, 0 * time_s, 0 * time_s + 5e5], axis=-1)))
    assert bool(doubts) == named


def test_times_in_whole_seconds(right):
    stamps = np.full(right.n_pulses, 1_700_000_000)
    doubts = track_doubts(dataclasses.replace(right, stamp_ns=stamps))
    assert any('have the time 1700000000 ns' in d for d in doubts)


def test_what_brings_the_grid_into_the_profiles(right, grid):
    profiles = dataclasses.replace(right, compressed=True, radar=dataclasses.replace(
        right.radar, first_sample_delay_s=2 * 4.0 / 3e8, sample_rate_hz=2e9))
    assert reach_advice(profiles, grid) == ''
    assert 'in millimetres' in reach_advice(moved(profiles, lambda p: 1000 * p), grid)
    late = dataclasses.replace(profiles, radar=dataclasses.replace(
        profiles.radar, first_sample_delay_s=1e6 * profiles.radar.first_sample_delay_s))
    assert 'meant in us' in reach_advice(late, grid)
    assert reach_advice(moved(profiles, lambda p: p + [0.0, 3e4, 0.0]), grid) == ''
