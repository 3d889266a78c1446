# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lever arms turned with the platform."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.alignment import Alignment


def test_lever_arms_turn_with_the_body():
    alignment = Alignment(tx_m=[[1.0, 0.0, 0.5]], rx_m=[[0.0, 2.0, 0.0], [0.0, -2.0, 0.0]])
    attitude = Rotation.from_euler('Z', [[0.0], [90.0]], degrees=True)
    tx, rx = alignment.phase_centres(np.array([[10.0, 0, 0], [0, 0, 3.0]]), attitude, 2)
    # Forward becomes left (+y) after a quarter turn to the left, left becomes backward (-x).
    np.testing.assert_allclose(tx, [[[11, 0, 0.5]] * 2, [[0, 1, 3.5]] * 2], atol=1e-12)
    np.testing.assert_allclose(rx, [[[10, 2, 0], [10, -2, 0]], [[-2, 0, 3], [2, 0, 3]]],
                               atol=1e-12)


def test_without_lever_arms_all_channels_are_at_the_platform():
    tx, rx = Alignment().phase_centres(np.ones((4, 3)), Rotation.identity(4), 3)
    assert tx.shape == rx.shape == (4, 3, 3)
    assert (tx == 1).all() and (rx == 1).all()


@pytest.mark.parametrize(('changes', 'message'), [
    ({'tx_m': [1.0, 2.0, 3.0]}, r'tx_m.shape=\(3,\); expected \(channels, 3\)'),
    ({'rx_m': np.zeros((0, 3))}, 'rx_m.shape'),
    ({'rx_m': [[0.0, np.nan, 0.0]]}, 'rx_m holds NaN'),
    ({'time_offset_s': np.inf}, 'time_offset_s=inf is not finite'),
    ({'range_bias_m': np.nan}, 'range_bias_m=nan is not finite')])
def test_impossible_alignments_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Alignment(**changes)


def test_the_number_of_lever_arms_must_fit():
    with pytest.raises(ValueError, match='2 lever arms rx_m for 3 channels; give one for all'):
        Alignment(rx_m=np.zeros((2, 3))).phase_centres(np.zeros((1, 3)), Rotation.identity(1), 3)
