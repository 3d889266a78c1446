# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time offset, range bias and lever arm as unknowns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.autofocus.models import aligned, alignment_model
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.poses import PoseTrack
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

START = Alignment(tx_m=[[0.1, 0.2, 0.3]], rx_m=[[0.1, -0.2, 0.3]], time_offset_s=3.0,
                  range_bias_m=0.5)


@pytest.fixture
def track():
    out = PoseTrack()
    for t in np.arange(2.0, 6.0, 0.01):
        turn = Rotation.from_rotvec([0, 0, 0.2 * np.sin(t)]).as_quat()
        out.add(round(t * 1e9), [np.sin(t), 2 * t, 1.0], turn)
    return out


@pytest.fixture
def block(track):
    radar = RadarParameters(10e9, 600e6, 720e6, 1e-6)
    stamp = np.arange(0, 2_000_000_000, 25_000_000)
    return locate(PulseBlock(radar, True, stamp, np.arange(stamp.size),
                             np.zeros((stamp.size, 1, 8))), track, START)


def test_the_start_is_what_the_pulses_have(block, track):
    model = alignment_model(block, track, START, time_offset_s=0.05, lever_x_m=0.1,
                            range_bias_m=0.2)
    assert model.names == ('time_offset_s', 'range_bias_m', 'lever_x_m')
    np.testing.assert_array_equal(model.start, [3.0, 0.5, 0.0])
    np.testing.assert_array_equal(model.scale, [0.05, 0.2, 0.1])
    geometry = model(model.start)
    np.testing.assert_array_equal(geometry.tx_m, block.tx_m)
    assert geometry.range_bias_m == 0.0


def test_parameters_are_those_of_an_alignment(block, track):
    model = alignment_model(block, track, START, time_offset_s=0.05, range_bias_m=0.2,
                            lever_x_m=0.1, lever_z_m=0.1)
    geometry = model([3.02, 0.75, 0.4, -0.1])
    changed = Alignment(tx_m=[[0.5, 0.2, 0.2]], rx_m=[[0.5, -0.2, 0.2]], time_offset_s=3.02,
                        range_bias_m=0.75)
    expected = locate(block, track, changed)
    np.testing.assert_allclose(geometry.tx_m, expected.tx_m, atol=1e-12)
    np.testing.assert_allclose(geometry.rx_m, expected.rx_m, atol=1e-12)
    assert geometry.range_bias_m == pytest.approx(0.25)
    found = aligned(START, {'lever_x_m': 0.4, 'lever_z_m': -0.1, 'time_offset_s': 3.02,
                            'range_bias_m': 0.75})
    np.testing.assert_allclose(found.rx_m, changed.rx_m)
    assert (found.time_offset_s, found.range_bias_m) == (3.02, 0.75)


def test_unknown_parameters_are_refused(block, track):
    with pytest.raises(ValueError, match='unknown parameters heading; use some of time_offset_s'):
        alignment_model(block, track, START, heading=0.1)
    with pytest.raises(ValueError, match='pulses have no pose'):
        alignment_model(block, track, START, time_offset_s=0.1)([30.0])
