# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits of plans, just inside and just outside."""

import numpy as np
import pytest

from sar_imaging import memory
from sar_imaging.planning.afbp.subapertures import cut_pulses, pieces_between_gaps
from sar_imaging.planning.profiles import RangeGate
from sar_imaging.signal import RadarParameters


def test_memory_that_is_just_enough_is_enough(monkeypatch):
    monkeypatch.setattr(memory, 'available_bytes', lambda: 5_000_000)
    memory.check_memory(5_000_000, 'it', 'do something')
    with pytest.raises(MemoryError, match='it needs 5 MB, 5 MB are available; do something'):
        memory.check_memory(5_000_001, 'it', 'do something')


def test_what_is_little_is_checked_where_a_plan_grants_less(monkeypatch):
    monkeypatch.setattr(memory, '_machine_bytes', lambda: 0)
    memory.check_memory(4 << 20, 'it', 'do something')  # where even that is missing nothing runs
    with pytest.raises(MemoryError, match='do something'):
        memory.check_memory((4 << 20) + 1, 'it', 'do something')
    with memory.granting(1000), pytest.raises(MemoryError, match='do something'):
        memory.check_memory(1001, 'it', 'do something')


# ------------------------------------------------------------------------------- the cut

@pytest.mark.parametrize(('step_m', 'pieces'), [
    (3.99, [(0, 20)]), (4.01, [(0, 8), (8, 20)])])
def test_a_gap_is_four_times_the_usual_step(step_m, pieces):
    along = np.arange(20.0)
    along[8:] += step_m - 1
    middles = np.stack([along, 0 * along, 0 * along], axis=1)
    assert pieces_between_gaps(middles) == pieces


@pytest.mark.parametrize(('n', 'length', 'lengths'), [
    (20, 20, [20]), (20, 19, [10, 10]), (21, 10, [7, 7, 7]), (1, 1, [1]), (5, 2, [2, 1, 2])])
def test_subapertures_are_as_few_and_as_equal_as_possible(n, length, lengths):
    cuts = cut_pulses([(3, 3 + n)], length)
    assert sorted(c.stop - c.start for c in cuts) == sorted(lengths)
    assert cuts[0].start == 3 and cuts[-1].stop == 3 + n
    assert all(a.stop == b.start for a, b in zip(cuts[:-1], cuts[1:], strict=True))


def test_one_pulse_and_a_platform_that_stands_have_no_gaps():
    assert pieces_between_gaps(np.zeros((1, 3))) == [(0, 1)]
    still = np.zeros((9, 3))
    still[5:] = 7.0
    assert pieces_between_gaps(still) == [(0, 9)]


# ------------------------------------------------------------------------------- range window

RADAR = RadarParameters(10e9, 75e6, 150e6, 1e-6)  # oversampled twice: 48 samples beyond


def _around(first, last, n=1000):
    start, spacing = RADAR.range_start_m, RADAR.sample_spacing_m
    return RangeGate.around(RADAR, n, (start + first * spacing, start + last * spacing))


@pytest.mark.parametrize(('first', 'last', 'expected'), [
    # First sample, how many, rise and fall: three tenths of 48.
    (200.2, 299.8, (152, 196, 14, 14)), (48.2, 299.8, (0, 348, 0, 14)),
    (49.2, 299.8, (1, 347, 14, 14)), (700.2, 951.8, (652, 348, 14, 0)),
    (700.2, 950.8, (652, 347, 14, 14)),
    # Nine tenths are worth a copy, more are not.
    (148.2, 999.0, (100, 900, 14, 0)), (147.2, 999.0, (0, 1000, 0, 0)),
    # A window of less than both of its slopes is none.
    (-47.8, -0.2, (0, 1000, 0, 0)), (30.2, 47.8, (0, 96, 0, 14)), (30.2, 46.8, (0, 1000, 0, 0))])
def test_a_window_keeps_what_its_slopes_need(first, last, expected):
    window = _around(first, last)
    assert (window.first, window.n_samples, window.n_rise, window.n_fall) == expected
    start = RADAR.range_start_m + expected[0] * RADAR.sample_spacing_m
    assert window.range_start_m == pytest.approx(start, abs=1e-9)
