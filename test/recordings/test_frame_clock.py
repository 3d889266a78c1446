# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""When frames began, and whether the period of a description fits the stamps."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.recordings.frames import FrameClock

PERIOD_S = 0.02
STARTS_S = PERIOD_S * np.arange(60)


def doubts(period_s, starts_s):
    clock = FrameClock(period_s, 0.0, jitter=True)
    for start_s in starts_s:
        clock.place(10**18 + round(1e9 * start_s))
    return clock.doubts()


@pytest.mark.parametrize('starts_s', [
    STARTS_S, STARTS_S[::3],  # two of three are lost
    np.delete(STARTS_S, [30, 31, 45, 50, 51, 52]), np.repeat(STARTS_S[::2], 2),  # in bunches
    STARTS_S + 0.008 * np.random.default_rng(2).random(60)])  # received late
def test_a_right_period_is_not_doubted(starts_s):
    assert doubts(PERIOD_S, starts_s) == ()


@pytest.mark.parametrize('period_s', [20.0, 50.0, 0.03, 0.013, 0.05])
def test_a_wrong_period_is(period_s):
    [text] = doubts(period_s, STARTS_S)
    assert text.startswith('frames come every 0.02 s; expected frames.period_s=')


def test_few_frames_and_unknown_periods_tell_nothing():
    assert doubts(0.03, STARTS_S[:20]) == doubts(0.0, STARTS_S) == ()
