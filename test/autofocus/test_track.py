# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phase centres as functions of time, from poses and from pulses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.autofocus.track import PhaseCentreTrack, on_track
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.poses import PoseTrack
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

ALIGNMENT = Alignment([[0.1, 0.2, 0.3]], [[0.1, -0.2, 0.3]], 3.0)


def poses(times):
    track = PoseTrack()
    for t in times:
        turn = Rotation.from_rotvec([0, 0, 0.2 * np.sin(t)]).as_quat()
        track.add(round(t * 1e9), [np.sin(t), 2 * t, 1.0], turn)
    return track


def pulses(n_channels=1):
    stamp = np.arange(0, 2_000_000_000, 25_000_000)
    return PulseBlock(RadarParameters(10e9, 600e6, 720e6, 1e-6), True, stamp,
                      np.arange(stamp.size), np.zeros((stamp.size, n_channels, 8)))


def test_it_is_where_the_poses_put_the_pulses():
    track, block = poses(np.arange(1.0, 7.0, 0.01)), pulses()
    centres = PhaseCentreTrack.of_poses(track, ALIGNMENT, 1, (-10**9, 3 * 10**9))
    for offset_s in (-0.9, 0.0, 0.7):
        wanted = locate(block, track, Alignment(ALIGNMENT.tx_m, ALIGNMENT.rx_m, 3.0 + offset_s))
        tx, rx = centres.at(block.stamp_ns, offset_s)
        # both interpolations are exact to h^4 |x''''| / 384, 3e-11 m for poses 10 ms apart
        np.testing.assert_allclose(tx, wanted.tx_m, atol=1e-9)
        np.testing.assert_allclose(rx, wanted.rx_m, atol=1e-9)
        assert centres.covers(block.stamp_ns, offset_s)
    model = on_track(block, centres, scale_s=0.5)
    np.testing.assert_array_equal(model([0.7]).tx_m, tx)


def test_what_no_pose_tells_is_refused():
    block = pulses()
    gap = np.concatenate([np.arange(1.0, 4.0, 0.01), np.arange(4.5, 7.0, 0.01)])
    centres = PhaseCentreTrack.of_poses(poses(gap), ALIGNMENT, 1, (-10**9, 3 * 10**9))
    assert not centres.covers(block.stamp_ns, 0.0)  # some pulses fall into the gap
    with pytest.raises(ValueError, match='for 20 of 80 pulses at an offset of 0 s'):
        centres.at(block.stamp_ns)
    assert centres.covers(block.stamp_ns[:40], 0.0)
    assert not centres.covers(block.stamp_ns, 1.5)  # beyond the span
    empty = PhaseCentreTrack.of_poses(PoseTrack(), ALIGNMENT, 1, (0, 10**9))
    assert not empty.covers(block.stamp_ns, 0.0)


def test_pulses_without_phase_centres_tell_no_track():
    with pytest.raises(ValueError, match='the pulses have no phase centres; give tx_m and rx_m'):
        PhaseCentreTrack.of_pulses([pulses()])


def test_no_pulses_have_no_centres():
    centres = PhaseCentreTrack.of_poses(poses(np.arange(1.0, 7.0, 0.01)), ALIGNMENT, 1,
                                        (-10**9, 3 * 10**9))
    assert [v.shape for v in centres.at([], 0.0)] == [(0, 1, 3)] * 2


def test_channels_that_take_turns_have_their_own_times():
    track, block = poses(np.arange(1.0, 7.0, 0.01)), pulses(2)
    centres = PhaseCentreTrack.of_poses(track, ALIGNMENT, 2, (-10**9, 3 * 10**9), (0.0, 0.01))
    tx, _ = centres.at(block.stamp_ns, 0.2)
    later, _ = centres.at(block.stamp_ns + 10_000_000, 0.2)
    np.testing.assert_allclose(tx[:, 1], later[:, 0], atol=1e-9)


def test_pulses_tell_a_tenth_more_than_their_own_time():
    block = locate(pulses(), poses(np.arange(1.0, 7.0, 0.01)), ALIGNMENT)
    centres = PhaseCentreTrack.of_pulses([block.select(slice(0, 30)),
                                          block.select(slice(30, 80))])
    np.testing.assert_allclose(centres.at(block.stamp_ns)[0], block.tx_m, atol=1e-12)
    assert centres.covers(block.stamp_ns, 0.19) and centres.covers(block.stamp_ns, -0.19)
    assert not centres.covers(block.stamp_ns, 0.21)
    with pytest.raises(ValueError, match='times of the pulses do not ascend'):
        PhaseCentreTrack.of_pulses([block, block])
