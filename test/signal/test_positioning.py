# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses without positions meet the poses of their platform."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.antenna import Mount
from sar_imaging.geometry.illumination import Pointing
from sar_imaging.geometry.poses import PoseTrack
from sar_imaging.signal.positioning import Positioner, locate, without_range_bias
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters

RADAR = RadarParameters(10e9, 600e6, 720e6, 1e-6)
MS = 1_000_000
OFFSET_S = 100.0  # the poses' clock is ahead
ALIGNMENT = Alignment(tx_m=[[0.5, 0.0, 0.0]], rx_m=[[0.4, 0.1, 0.0], [0.4, -0.1, 0.0]],
                      time_offset_s=OFFSET_S, range_bias_m=0.3)


def turn(t):
    return Rotation.from_rotvec(np.multiply.outer(t, [0.0, 0.0, 0.5]))


def place(t):
    return np.stack([4 * t, 0.1 * t ** 2, np.full_like(t, 2.0)], axis=-1)


def pulses(first_ms, stop_ms, *, first_counter=None):
    """One pulse per millisecond of the radar's clock, numbered by it."""
    stamp = np.arange(first_ms, stop_ms) * MS
    counter = np.arange(stamp.size) + (first_ms if first_counter is None else first_counter)
    return PulseBlock(RADAR, False, stamp, counter, np.zeros((stamp.size, 2, 8)))


def send_poses(positioner, times_ms, shift_m=0.0):
    """Poses at times of the radar's clock; returns the blocks decided meanwhile."""
    out = []
    for time in times_ms:
        t = np.float64(time * 1e-3)
        out += positioner.add_pose(round((time * 1e-3 + OFFSET_S) * 1e9),
                                   place(t) + [0, shift_m, 0], turn(t).as_quat())
        out += positioner.advance(0.0)
    return out


def make(**arguments):
    return Positioner(PoseTrack(), ALIGNMENT, **{'pulses_per_aperture': 100_000} | arguments)


def numbers(blocks):
    return [int(c) for b in blocks for c in b.counter]


def texts(positioner, kind):
    return [e.text for e in positioner.take_events() if e.kind == kind]


def balanced(positioner):
    s = positioner.statistics
    return s.received == (s.positioned + s.without_pose + s.other_frame + s.reset
                          + positioner.waiting_pulses)


def test_an_antenna_on_the_platform_looks_where_its_attitude_says():
    positioner = make(mount=Mount('platform', boresight=(0, 1, -1), up=(0, 0, 1)))
    send_poses(positioner, range(0, 200, 10))
    [block] = positioner.push(pulses(40, 60), 0.0)
    expected = Pointing.fixed(turn(np.arange(40, 60) * 1e-3), (0, 1, -1))
    # a turn at an even rate is interpolated exactly, but for float64
    np.testing.assert_allclose(block.pointing.boresight, expected.boresight, atol=1e-9)
    np.testing.assert_allclose(block.pointing.up, expected.up, atol=1e-9)


def test_pulses_get_the_phase_centres_of_their_times():
    positioner = make()
    send_poses(positioner, range(0, 200, 10))
    [block] = positioner.push(pulses(50, 150), 0.0)
    t = np.arange(50, 150) * 1e-3
    np.testing.assert_allclose(block.tx_m[:, 0], place(t) + turn(t).apply([0.5, 0, 0]),
                               atol=1e-9)
    np.testing.assert_array_equal(block.tx_m[:, 0], block.tx_m[:, 1])
    for channel, arm in enumerate([[0.4, 0.1, 0.0], [0.4, -0.1, 0.0]]):
        np.testing.assert_allclose(block.rx_m[:, channel], place(t) + turn(t).apply(arm),
                                   atol=1e-9)
    assert block.radar.range_start_m == pytest.approx(RADAR.range_start_m - 0.3)
    np.testing.assert_array_equal(block.stamp_ns, pulses(50, 150).stamp_ns)  # the radar's clock
    [alone] = positioner.push(pulses(150, 151), 0.0)
    np.testing.assert_allclose(alone.tx_m[0, 0], place(0.15) + turn(0.15).apply([0.5, 0, 0]),
                               atol=1e-9)


def test_pulses_wait_for_their_poses_and_keep_their_order():
    positioner = make()
    send_poses(positioner, range(0, 50, 10))
    assert positioner.push(pulses(5, 15), 0.0) != []
    assert positioner.push(pulses(15, 35), 0.0) == []  # 35 needs the poses up to 60
    assert positioner.push(pulses(2, 5), 0.0) == []
    assert positioner.waiting_pulses == 23
    assert numbers(send_poses(positioner, [50])) == []
    assert numbers(send_poses(positioner, [60])) == [*range(15, 35), 2, 3, 4]
    assert balanced(positioner)


def test_the_wait_is_bounded_and_what_has_no_pose_is_dropped():
    positioner = make(wait_s=0.5)
    send_poses(positioner, range(0, 60, 10))
    assert positioner.push(pulses(40, 70), 10.0) == []
    assert positioner.advance(10.4) == []
    [block] = positioner.advance(10.5)
    assert numbers([block]) == list(range(40, 51))  # up to the newest pose
    assert positioner.statistics.without_pose == 19
    assert texts(positioner, 'without_pose') == [
        'dropped pulses 51..69 (19): no pose came in time; the newest is up to 0.019 s older']
    assert balanced(positioner)


def test_missing_odometry_costs_its_pulses_and_nothing_else():
    positioner = make(wait_s=0.5)
    send_poses(positioner, range(0, 1000, 10))
    emitted, now = [], 0.0
    for first in range(0, 7000, 50):  # no poses from 1000 to 6000 ms
        now = first * 1e-3
        emitted += positioner.push(pulses(first, first + 50), now)
        assert positioner.waiting_pulses <= 600  # half a second and the block at hand
        if first >= 6000:
            emitted += send_poses(positioner, range(first, first + 50, 10))
    emitted += positioner.advance(now + 1.0)
    # 990 and 6000 are the poses beside the gap.
    assert numbers(emitted) == [*range(0, 991), *range(6000, 6991)]
    assert positioner.statistics.pose_gaps == 1
    assert balanced(positioner)
    assert 'no pose for 5.01 s of their clock, more than max_gap_s' in texts(positioner,
                                                                            'pose_gap')


def test_the_memory_of_waiting_pulses_is_bounded():
    positioner = make(wait_s=1e9, max_waiting_pulses=100)
    for first in range(0, 500, 20):
        positioner.push(pulses(first, first + 20), 0.0)
        assert positioner.waiting_pulses <= 100
    assert positioner.statistics.without_pose == 400
    assert balanced(positioner)


def test_after_a_jump_the_rest_of_the_aperture_is_dropped():
    positioner = make(pulses_per_aperture=100)
    send_poses(positioner, range(0, 145, 10))
    send_poses(positioner, range(150, 400, 10), shift_m=1.0)
    emitted = []
    for first in range(0, 300, 50):
        emitted += positioner.push(pulses(first, first + 50), 0.0)
    # The poses at 140 and 150 have no common frame; 200 begins an aperture of the new one.
    assert numbers(emitted) == [*range(0, 141), *range(200, 300)]
    s = positioner.statistics
    assert (s.without_pose, s.other_frame, s.pose_jumps) == (9, 50, 1)
    assert balanced(positioner)
    t = np.arange(200, 250) * 1e-3
    np.testing.assert_allclose(emitted[-2].tx_m[:, 0],
                               place(t) + turn(t).apply([0.5, 0, 0]) + [0, 1, 0], atol=1e-9)
    events = {e.kind: e.text for e in positioner.take_events()}
    assert events['other_frame'] == ('dropped pulses 150..199 (50): the frame of the poses '
                                     'jumped within their aperture')
    assert 'cannot have moved like that within 0.01 s' in events['pose_jump']


def test_a_looping_recording_gives_the_same_positions_again():
    positioner = make(pulses_per_aperture=1000)
    loops = []
    for _ in range(3):
        emitted = []
        for first in range(0, 300, 50):
            emitted += send_poses(positioner, range(first, first + 50, 10))
            emitted += positioner.push(pulses(first, first + 50), 0.0)
        loops.append(emitted)
    emitted = [b for loop in loops for b in loop] + positioner.advance(1e9)
    assert numbers(emitted) == list(range(291)) * 3  # 290 is the last pose
    for n, block in enumerate(emitted):
        t = block.stamp_ns * 1e-9
        np.testing.assert_allclose(block.tx_m[:, 0], place(t) + turn(t).apply([0.5, 0, 0]),
                                   atol=1e-9, err_msg=str(n))
    s = positioner.statistics
    assert (s.pose_restarts, s.other_frame) == (2, 0)
    # 30 poses each time; the first four of a loop come behind the newest, the fifth tells.
    assert (s.poses, s.poses_old, s.poses_corrupt, s.pose_gaps) == (90, 8, 0, 0)
    assert balanced(positioner)


def test_one_line_tells_of_a_run_of_bad_poses():
    positioner = make()
    for stamp in range(20):
        positioner.add_pose(stamp * MS, [0, 0, 0], [0, 0, 0, 0])
    assert positioner.statistics.poses_corrupt == 20
    assert len(texts(positioner, 'pose_corrupt')) == 1


def test_lever_arms_that_do_not_fit_reject_the_block():
    block = dataclasses.replace(pulses(0, 10), samples=np.zeros((10, 3, 8)))
    positioner = make()
    with pytest.raises(ValueError, match='2 lever arms rx_m for 3 channels'):
        positioner.push(block, 0.0)
    assert positioner.statistics.received == 0


@pytest.mark.parametrize(('arms', 'told'), [
    (Alignment(), 1), (Alignment(rx_m=[[0.4, 0.0, 0.0]] * 2), 1), (ALIGNMENT, 0)])
def test_channels_without_lever_arms_of_their_own_are_told_of_once(arms, told):
    positioner = Positioner(PoseTrack(), arms, pulses_per_aperture=100)
    for first in (0, 10, 20):
        positioner.push(pulses(first, first + 10), 0.0)
    found = texts(positioner, 'one_place')
    assert len(found) == told
    assert all(text.startswith('2 channels with the same lever arms: all are imaged as if')
               for text in found)
    single = Positioner(PoseTrack(), Alignment(), pulses_per_aperture=100)
    single.push(dataclasses.replace(pulses(0, 10), samples=np.zeros((10, 1, 8))), 0.0)
    assert not texts(single, 'one_place')


def test_channels_that_take_turns_have_places_of_their_own():
    positioner = make(channel_offset_s=[0.004, 0.0])
    send_poses(positioner, range(0, 101, 10))
    assert numbers(positioner.push(pulses(0, 60), 0.0)) == list(range(60))
    # 75 + 4 ms needs the poses up to 100 ms, 76 + 4 ms the one after; both channels wait.
    [block] = positioner.push(pulses(60, 76), 0.0)
    assert positioner.push(pulses(76, 80), 0.0) == []
    t = np.arange(60, 76) * 1e-3
    for channel, sent in enumerate((t + 0.004, t)):
        np.testing.assert_allclose(block.tx_m[:, channel],
                                   place(sent) + turn(sent).apply([0.5, 0, 0]), atol=1e-9)
        np.testing.assert_allclose(
            block.rx_m[:, channel],
            place(sent) + turn(sent).apply([[0.4, 0.1, 0], [0.4, -0.1, 0]][channel]), atol=1e-9)
    assert numbers(positioner.advance(1e9)) == [76, 77, 78, 79]
    positioner.push(pulses(95, 105), 0.0)
    positioner.advance(1e9)  # the last pose is at 100 ms: 96 + 4 ms is the last that has both
    assert positioner.statistics.without_pose == 8
    assert balanced(positioner)
    with pytest.raises(ValueError, match='2 channel offsets for 3 channels; give one for all'):
        Positioner(PoseTrack(), Alignment(), pulses_per_aperture=9,
                   channel_offset_s=[0.0, 0.1]).push(
            dataclasses.replace(pulses(0, 2), samples=np.zeros((2, 3, 8))), 0.0)


def test_a_reset_drops_what_waits():
    positioner = make()
    positioner.push(pulses(0, 30), 0.0)
    assert positioner.reset() == 30
    assert (positioner.waiting_pulses, positioner.statistics.reset) == (0, 30)
    assert balanced(positioner)


def test_the_forward_model_of_a_whole_recording():
    track = PoseTrack()
    for time in range(0, 200, 10):
        t = np.float64(time * 1e-3)
        track.add(round((t + OFFSET_S) * 1e9), place(t), turn(t).as_quat())
    block = pulses(20, 120)
    located = locate(block, track, ALIGNMENT)
    t = np.arange(20, 120) * 1e-3
    np.testing.assert_allclose(located.tx_m[:, 0], place(t) + turn(t).apply([0.5, 0, 0]),
                               atol=1e-9)
    later = locate(block, track, dataclasses.replace(ALIGNMENT, time_offset_s=OFFSET_S + 0.01))
    np.testing.assert_allclose(later.tx_m[:-10], located.tx_m[10:], atol=1e-9)
    with pytest.raises(ValueError, match='10 of 100 pulses have no pose: no pose came in time'):
        locate(pulses(101, 201), track, ALIGNMENT)


def test_a_range_bias_moves_the_profiles_and_nothing_else():
    radar = without_range_bias(RADAR, Alignment(range_bias_m=0.3))
    assert radar.first_sample_delay_s == pytest.approx(1e-6 - 2 * 0.3 / SPEED_OF_LIGHT)
    assert dataclasses.replace(radar, first_sample_delay_s=1e-6) == RADAR


def test_a_jump_between_the_turns_of_a_pulse_costs_that_pulse():
    """Channel 0 is sent 15 ms after the stamp; poses at 140 and 150 ms have no common frame."""
    positioner = make(channel_offset_s=[0.015, 0.0])
    send_poses(positioner, range(0, 145, 10))
    send_poses(positioner, range(150, 400, 10), shift_m=1.0)
    emitted = positioner.push(pulses(100, 130), 0.0) + positioner.push(pulses(150, 200), 0.0)
    assert numbers(emitted) == [*range(100, 126)]  # 125 + 15 ms is the last in the first frame
    positioner.take_events()
    # Both turns of 135 to 140 have poses, before the jump and after it.
    assert positioner.push(pulses(130, 150), 0.0) == []
    [text] = texts(positioner, 'without_pose')
    assert text == 'dropped pulses 130..149 (20): the frame of the poses jumped'
    assert balanced(positioner)
