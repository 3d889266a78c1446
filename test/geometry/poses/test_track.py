# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The track of poses: order, gaps, jumps, restarts, and what it tells about a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.geometry.poses import PoseStatus, PoseTrack, PoseVerdict

MS = 1_000_000
LEVEL = [0.0, 0.0, 0.0, 1.0]


def position(stamp_ns):
    """Accelerating at 2 m/s^2 from 3 m/s."""
    t = stamp_ns * 1e-9
    return np.array([3 * t + t ** 2, 1.0, 0.0])


def make_track(stamps_ms, shift=lambda stamp_ms: 0.0, **limits):
    track = PoseTrack(**limits)
    verdicts = [track.add(int(s * MS), position(s * MS) + [shift(s), 0, 0], LEVEL)
                for s in stamps_ms]
    return track, verdicts


def status(track, times_ms, **arguments):
    sample = track.sample(np.array([int(t * MS) for t in times_ms]), **arguments)
    ready = sample.status == PoseStatus.READY
    assert np.array_equal(ready, np.isfinite(sample.position_m).all(axis=1))
    assert np.array_equal(ready, sample.frame >= 0)
    assert not sample.attitude[~ready].magnitude().any()  # no rotation unless ready
    return [PoseStatus(s).name for s in sample.status]


def test_a_time_is_ready_once_three_poses_follow_it():
    track, _ = make_track(range(0, 100, 10))
    assert status(track, [-1, 0, 45, 60, 69, 70, 85, 90, 91]) == [
        'BEFORE', 'READY', 'READY', 'READY', 'READY', 'WAIT', 'WAIT', 'WAIT', 'WAIT']
    assert status(track, [69, 70, 85, 90, 91], final=True) == [
        'READY', 'READY', 'READY', 'READY', 'LATE']


def test_later_poses_change_nothing_that_was_ready():
    track, _ = make_track(range(0, 100, 10))
    times = np.arange(0, 70) * MS
    before = track.sample(times)
    for stamp in range(100, 200, 10):
        track.add(stamp * MS, position(stamp * MS), LEVEL)
    np.testing.assert_array_equal(before.position_m, track.sample(times).position_m)
    # Poses of a parabola: the cubic is exact.
    np.testing.assert_allclose(before.position_m, [position(t) for t in times], atol=1e-12)


def test_later_poses_change_nothing_of_a_track_that_no_polynomial_is():
    def swaying(stamp_ns):
        return [np.sin(20e-9 * stamp_ns), 0.1 * np.cos(33e-9 * stamp_ns), 0.0]

    track = PoseTrack(jump_m=1.0)  # 400 m/s^2
    for stamp in range(0, 100, 10):
        track.add(stamp * MS, swaying(stamp * MS), LEVEL)
    times = np.arange(0, 70) * MS  # all that is ready
    before = track.sample(times)
    assert (before.status == PoseStatus.READY).all()
    for stamp in range(100, 200, 10):
        track.add(stamp * MS, swaying(stamp * MS), LEVEL)
        np.testing.assert_array_equal(before.position_m, track.sample(times).position_m)


def test_what_lies_before_a_break_is_ready_with_the_pose_behind_it():
    for stamps, shift in (([*range(0, 100, 10), 500], 0.0), (range(0, 310, 10), 3.0)):
        track, verdicts = make_track(stamps, lambda s, shift=shift: shift if s >= 100 else 0.0)
        assert verdicts[-1] == PoseVerdict.GAP or PoseVerdict.JUMP in verdicts
        assert status(track, [65, 75, 85, 90]) == ['READY'] * 4


def test_a_gap_up_to_the_limit_is_bridged_and_a_wider_one_refused():
    track, verdicts = make_track([*range(0, 100, 10), *range(290, 390, 10)])
    assert verdicts.count(PoseVerdict.GAP) == 0  # 200 ms, bridged
    assert status(track, [200]) == ['READY']
    track, verdicts = make_track([*range(0, 100, 10), *range(291, 390, 10)])
    assert [i for i, v in enumerate(verdicts) if v == PoseVerdict.GAP] == [10]
    # The pose at 90 ms ends the segment; nothing is to be awaited before the gap.
    assert status(track, [85, 90, 90.5, 200, 290.5, 291]) == [
        'READY', 'READY', 'GAP', 'GAP', 'GAP', 'READY']
    assert track.frame == 0


def test_a_single_pose_between_gaps_carries_no_pulse():
    track, _ = make_track([0, 500, *range(1000, 1100, 10)])
    assert status(track, [0, 499, 500, 501]) == ['GAP'] * 4


@pytest.mark.parametrize('step_m', [0.08, -0.08, 3.0])
def test_a_jump_begins_a_new_frame(step_m):
    track, verdicts = make_track(range(0, 400, 10), lambda s: step_m if s >= 100 else 0.0)
    [jump] = track.take_departures()
    assert jump.jump and jump.first_ns == 100 * MS and verdicts.count(PoseVerdict.JUMP) == 1
    assert jump.away_m == pytest.approx(abs(step_m), abs=0.002)  # 2 m/s^2 over 30 ms
    assert status(track, [85, 90, 95, 100, 105]) == ['READY', 'READY', 'JUMP', 'READY', 'READY']
    frames = track.sample(np.array([85, 105]) * MS).frame
    assert frames.tolist() == [0, 1]
    # The pieces are interpolated as if the other did not exist.
    found = track.sample(np.array([89, 101]) * MS).position_m
    np.testing.assert_allclose(found[:, 0], [position(89 * MS)[0],
                                             position(101 * MS)[0] + step_m], atol=1e-12)


def test_a_jump_in_three_steps_is_seen_and_quiet_follows():
    track, _ = make_track(range(0, 900, 10), lambda s: 0.1 * min(max(s - 90, 0) // 10, 3))
    found = track.take_departures()
    # of a frame of three poses the first step tells the velocity, which the last one breaks
    assert found and all(100 * MS <= d.first_ns <= 130 * MS for d in found)
    assert status(track, [95, 500]) == ['JUMP', 'READY']


def test_a_turn_of_the_frame_is_a_jump():
    track = PoseTrack()
    for s in range(0, 100, 10):
        track.add(s * MS, position(s * MS),
                  LEVEL if s < 50 else [0, 0, np.sin(0.15), np.cos(0.15)])
    track.finish()
    [jump] = track.take_departures()
    assert (jump.jump, jump.first_ns) == (True, 50 * MS)
    assert jump.away_rad == pytest.approx(0.3)


def test_a_platform_that_brakes_hard_does_not_jump():
    track = PoseTrack()
    verdicts = []
    for s in range(0, 3000, 20):
        t = s * 1e-3
        x = 10 * t if t < 1 else 10 + 10 * (t - 1) - 5 * min(t - 1, 1.0) ** 2 - 10 * max(t - 2, 0)
        noise = np.random.default_rng(s).normal(0, 0.005, 3)
        verdicts.append(track.add(s * MS, noise + [x, 0, 0], LEVEL))
    assert set(verdicts) == {PoseVerdict.TAKEN}


@pytest.mark.parametrize(('place', 'turn'), [
    ([np.nan, 0, 0], LEVEL), ([0, np.inf, 0], LEVEL), ([0, 0, 0], [0, 0, 0, 0]),
    ([0, 0, 0], [0, 0, 0, 1.02]), ([0, 0, 0], [np.nan, 0, 0, 1]), ([0, 0], LEVEL),
    ([0, 0, 0], [0, 0, 1])])
def test_impossible_poses_are_dropped(place, turn):
    track, _ = make_track(range(0, 50, 10))
    assert track.add(50 * MS, place, turn) == PoseVerdict.CORRUPT
    assert len(track) == 5
    assert track.add(60 * MS, position(60 * MS), LEVEL) == PoseVerdict.TAKEN


def test_a_quaternion_that_is_nearly_one_is_normalised():
    track = PoseTrack()
    turn = np.array([0, 0, np.sin(0.3), np.cos(0.3)])
    for s in range(0, 60, 10):
        assert track.add(s * MS, position(s * MS), 1.009 * turn) == PoseVerdict.TAKEN
    [found] = track.sample(np.array([15 * MS])).attitude.as_rotvec()
    np.testing.assert_allclose(found, [0, 0, 0.6], atol=1e-12)


def test_repeated_and_older_poses_are_dropped():
    track, verdicts = make_track([0, 10, 10, 20, 5, 30, 30, 25, 40, 50])
    assert [v.name for v in verdicts] == ['TAKEN', 'TAKEN', 'OLD', 'TAKEN', 'OLD', 'TAKEN', 'OLD',
                                          'OLD', 'TAKEN', 'TAKEN']
    assert len(track) == 6


def test_a_clock_that_went_back_begins_a_new_track():
    track, verdicts = make_track([*range(1000, 2000, 10), *range(1500, 1550, 10)])
    assert [v.name for v in verdicts[-5:]] == ['OLD'] * 4 + ['RESTART']
    assert track.span_ns == (1000 * MS, 1990 * MS)  # as it was
    successor = track.successor()
    assert successor.span_ns == (1500 * MS, 1540 * MS)
    assert successor.frame == track.frame + 1
    assert successor.add(1550 * MS, position(1550 * MS), LEVEL) == PoseVerdict.TAKEN


def test_a_stuck_clock_is_no_restart():
    track, verdicts = make_track([0, 10, *[10] * 20, 20])
    assert set(verdicts[2:-1]) == {PoseVerdict.OLD}


def test_the_memory_is_bounded():
    track, _ = make_track(range(0, 2000, 10), capacity=64)
    assert len(track) <= 64
    assert status(track, [1955, 100]) == ['READY', 'BEFORE']


def test_without_poses_everything_waits():
    assert status(PoseTrack(), [0, 5]) == ['WAIT', 'WAIT']
    assert status(PoseTrack(), [0, 5], final=True) == ['LATE', 'LATE']


@pytest.mark.parametrize('limits', [{'max_gap_s': 0.0}, {'jump_m': -1.0}, {'jump_rad': np.nan}])
def test_impossible_limits_are_refused(limits):
    with pytest.raises(ValueError, match=f'{next(iter(limits))}=.* must be positive'):
        PoseTrack(**limits)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(-50, 2000), st.sampled_from([0.0, 1e-3, 5.0, np.nan]),
                          st.sampled_from([1.0, 0.0, 1.001, np.inf])), max_size=60),
       st.lists(st.integers(-100, 2100), min_size=1, max_size=10), st.booleans())
def test_any_stream_of_poses_gives_finite_positions_or_a_reason(stream, times, final):
    track = PoseTrack()
    for stamp, shift, norm in stream:
        if track.add(stamp * MS, position(stamp * MS) + shift, [0, 0, 0, norm]) \
                == PoseVerdict.RESTART:
            track = track.successor()
    sample = track.sample(np.array(times) * MS, final=final)
    ready = sample.status == PoseStatus.READY
    assert np.isfinite(sample.position_m[ready]).all()
    assert np.isnan(sample.position_m[~ready]).all()
    if final:
        assert PoseStatus.WAIT not in sample.status


def test_quaternions_that_flip_their_sign_are_the_same_attitude():
    track = PoseTrack()
    turn = np.array([0, 0, np.sin(0.3), np.cos(0.3)])
    verdicts = {track.add(s * MS, position(s * MS), (-1) ** (s // 10) * turn)
                for s in range(0, 100, 10)}
    assert verdicts == {PoseVerdict.TAKEN}
    [found] = track.sample(np.array([45 * MS])).attitude.as_rotvec()
    np.testing.assert_allclose(found, [0, 0, 0.6], atol=1e-12)


def judged(step_ms, *, away_m=0.0, turned_rad=0.0, n=5, **limits):
    """Verdict on a pose after n of 1 m/s along x that is off by so much, across or in heading."""
    track = PoseTrack(**limits)
    for k in range(n):
        assert track.add(k * step_ms * MS, [1e-3 * k * step_ms, 0, 0], LEVEL) == PoseVerdict.TAKEN
    turn = [0, 0, np.sin(turned_rad / 2), np.cos(turned_rad / 2)]
    for k in range(n, n + 30):  # long enough to be no outliers
        track.add(k * step_ms * MS, [1e-3 * k * step_ms, away_m, 0], turn)
    return 'JUMP' if [d for d in track.take_departures() if d.jump] else 'TAKEN'


# What 20 m/s^2 explain: the velocity is that of the middle of the poses before, so that it has
# changed over half their time and half the step: 20 dt (T + dt) / 2, with T = 4 dt for five poses.
@pytest.mark.parametrize(('step_ms', 'n', 'explained_m'), [
    (10, 5, 0.005), (50, 5, 0.125), (100, 9, 0.5)])
@pytest.mark.parametrize('jump_m', [0.05, 0.2])
def test_a_jump_begins_where_acceleration_ends_to_explain(step_ms, n, explained_m, jump_m):
    limit = jump_m + explained_m
    assert judged(step_ms, away_m=0.99 * limit, n=n, jump_m=jump_m) == 'TAKEN'
    assert judged(step_ms, away_m=1.01 * limit, n=n, jump_m=jump_m) == 'JUMP'


@pytest.mark.parametrize('step_ms', [10, 100])
@pytest.mark.parametrize('jump_rad', [0.1, 0.4])
def test_a_turn_is_a_jump_from_its_limit_on(step_ms, jump_rad):
    limit = jump_rad + 7.0 * 1e-3 * step_ms
    for sign in (-1, 1):
        assert judged(step_ms, turned_rad=sign * 0.99 * limit, jump_rad=jump_rad) == 'TAKEN'
        assert judged(step_ms, turned_rad=sign * 1.01 * limit, jump_rad=jump_rad) == 'JUMP'


@pytest.mark.parametrize(('norm', 'verdict'), [
    (0.9901, 'TAKEN'), (1.0099, 'TAKEN'), (0.9899, 'CORRUPT'), (1.0101, 'CORRUPT')])
def test_the_norm_of_a_quaternion_may_be_off_by_one_percent(norm, verdict):
    assert PoseTrack().add(0, [0, 0, 0], [0, 0, 0, norm]).name == verdict


def test_poses_of_an_interval():
    track = PoseTrack()
    for k in range(10):
        track.add(k * 10**7 + (k > 5) * 10**9, [0.1 * k, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    stamp_ns, position_m, attitude, segment = track.between(2 * 10**7, 10**9 + 7 * 10**7)
    np.testing.assert_array_equal(stamp_ns[[0, -1]], [2 * 10**7, 10**9 + 7 * 10**7])
    np.testing.assert_allclose(position_m[:, 0], 0.1 * np.arange(2, 8))
    assert len(attitude) == 6
    np.testing.assert_array_equal(np.diff(segment), [0, 0, 0, 1, 0])  # a gap of a second
    assert len(track.between(5 * 10**9, 6 * 10**9)[0]) == 0


@pytest.mark.parametrize('rate_hz', [20, 100])
@pytest.mark.parametrize(('n', 'away_m', 'turned_rad'), [
    (1, 0.0, np.pi), (1, 2.0, 0.0), (2, 0.0, np.pi), (2, 0.5, 1.0)])
def test_what_both_sides_contradict_is_left_out_and_bridged(rate_hz, n, away_m, turned_rad):
    track, step = PoseTrack(max_gap_s=0.2), 10**9 // rate_hz
    for k in range(100):
        off = 50 <= k < 50 + n
        half = 0.5 * turned_rad * off
        track.add(k * step, position(k * step) + [0, away_m * off, 0],
                  [np.sin(half), 0, 0, np.cos(half)])
    [found] = track.take_departures()
    assert (found.first_ns, found.n_poses, found.jump) == (50 * step, n, False)
    assert found.bridged and found.away_m == pytest.approx(away_m, abs=0.01)
    assert found.away_rad == pytest.approx(turned_rad)
    times = np.arange(45 * step, 55 * step, step // 4)
    poses = track.sample(times)
    # a parabola: the cubic is exact across the gap, too
    np.testing.assert_allclose(poses.position_m, [position(t) for t in times], atol=1e-9)
    assert poses.attitude.magnitude().max() < 1e-9
    assert (poses.frame == 0).all()


@pytest.mark.parametrize('seed', range(6))
def test_fast_turns_rolls_and_braking_are_no_outliers(seed):
    """Rolling by up to 12 rad/s, braking by 15 m/s^2, scatter of a centimetre."""
    rng = np.random.default_rng(seed)
    rate = (10, 20, 50, 100, 200, 100)[seed]
    t = np.arange(20 * rate) / rate
    roll = 12 / 6 * np.sin(6 * t) if seed % 2 else np.pi * np.clip((t - 5) / 0.6, 0, 1)
    speed = np.cumsum(np.where(t % 4 < 0.5, -15.0, 15 * 0.5 / 3.5)) / rate
    place = np.stack([np.cumsum(speed) / rate, 0 * t, 0 * t], axis=1)
    place += rng.normal(0, 0.01, place.shape)
    track = PoseTrack()
    for time_s, where, angle in zip(t, place, roll, strict=True):
        track.add(round(time_s * 1e9), where, [np.sin(angle / 2), 0, 0, np.cos(angle / 2)])
    track.finish()
    assert track.take_departures() == []
