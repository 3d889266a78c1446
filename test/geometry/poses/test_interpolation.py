# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Interpolation between poses, against tracks known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.poses.track import interpolate_poses

OMEGA = 2 * np.pi * 0.8  # rad/s, a robot that sways
AMPLITUDE = np.array([0.3, 0.1, 0.05])


def position(t):
    return np.stack([5 * t + 0.3 * np.sin(OMEGA * t), 0.1 * np.cos(OMEGA * t),
                     0.05 * np.sin(OMEGA * t + 1)], axis=-1)


def attitude(t):
    return Rotation.from_euler('ZYX', np.stack([
        0.5 * t, 0.1 * np.sin(OMEGA * t), 0.15 * np.cos(OMEGA * t)], axis=-1))


def interpolate(time_s, query_s, segment=None, turn=attitude, place=position):
    """Interpolated track; quaternions have either sign, as drivers send them."""
    stamp = np.rint(np.asarray(time_s) * 1e9).astype(np.int64)
    query = np.rint(np.asarray(query_s) * 1e9).astype(np.int64)
    signs = np.random.default_rng(0).choice([-1, 1], stamp.size)
    quaternion = turn(stamp * 1e-9).as_quat() * signs[:, None]
    segment = np.zeros(stamp.size, np.int64) if segment is None else np.asarray(segment)
    left = np.searchsorted(stamp, query, 'right') - 1
    return interpolate_poses(stamp, place(stamp * 1e-9), quaternion, segment, left, query)


@pytest.mark.parametrize('step_s', [0.1, 0.05, 0.02, 0.01])
def test_the_error_is_the_stated_one(step_s):
    time = np.arange(0, 6, step_s)
    query = np.random.default_rng(1).uniform(0.5, 5.5, 400)
    found, turn = interpolate(time, query)
    stated = AMPLITUDE.max() * ((OMEGA * step_s) ** 4 / 384 + (OMEGA * step_s) ** 5 / 310)
    error = np.abs(found - position(query)).max()
    assert error < 1.1 * stated + 1e-8  # times are rounded to 1 ns, at 5 m/s
    assert error > 0.3 * stated - 1e-8  # the statement is no empty one
    # 0.15 rad of the same frequency, and products of the three rotations.
    assert (turn.inv() * attitude(query)).magnitude().max() < 0.7 * stated + 1e-8


def test_poses_are_reproduced_and_the_track_is_continuous():
    time = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.05, 100))
    found, turn = interpolate(time, time[:-1])
    np.testing.assert_allclose(found, position(np.rint(time[:-1] * 1e9) * 1e-9), atol=1e-12)
    inner = np.rint(time[1:-1] * 1e9) * 1e-9
    before, turn_before = interpolate(time, inner - 1e-9)
    after, turn_after = interpolate(time, inner + 1e-9)
    # 7 m/s and 2 rad/s over 2 ns; a kink at a pose of 1 mm would be 1e-3.
    np.testing.assert_allclose(before, after, atol=2e-8)
    assert (turn_before.inv() * turn_after).magnitude().max() < 2e-8


def test_a_cubic_is_exact_whatever_the_spacing():
    def place(t):
        return np.stack([t ** 3, 2 * t ** 3 - t, 5 - t], axis=-1)

    time = np.cumsum(np.random.default_rng(3).uniform(0.05, 0.25, 60))
    query = np.random.default_rng(4).uniform(time[3], time[-4], 300)
    found, _ = interpolate(time, query, place=place)
    # Rounding of sums of numbers up to 700.
    np.testing.assert_allclose(found, place(np.rint(query * 1e9) * 1e-9), atol=1e-9)


def test_segments_do_not_see_each_other():
    time = np.arange(0, 4, 0.05)
    jumped = time >= 2.0

    def place(t):
        return position(t) + np.where(t >= 2.0, 100.0, 0.0)[:, None]

    inside = np.r_[np.linspace(0.5, 1.94, 100), np.linspace(2.0, 3.5, 100)]
    found, _ = interpolate(time, inside, segment=jumped.astype(int), place=place)
    # One-sided stencils at the jump: measured 6e-6 m.
    np.testing.assert_allclose(found, place(inside), atol=2e-5)


@pytest.mark.parametrize('n', [2, 3, 4])
def test_short_segments_have_what_their_poses_allow(n):
    time = 1.0 + 0.05 * np.arange(n)
    found, turn = interpolate(time, [1.02], place=lambda t: np.stack([t, -t, 2 * t], axis=-1),
                              turn=lambda t: Rotation.from_rotvec(np.outer(t, [0, 0, 0.4])))
    np.testing.assert_allclose(found, [[1.02, -1.02, 2.04]], atol=1e-12)
    np.testing.assert_allclose(turn.as_rotvec(), [[0, 0, 0.408]], atol=1e-12)


def test_a_fast_spin_falls_back_to_slerp():
    # 12 rad/s and poses of 10 Hz: 4.8 rad within a stencil, which a rotation vector cannot hold.
    def turn(t):
        return Rotation.from_rotvec(np.outer(t, [0, 0, 12.0]))

    time = np.arange(0, 2, 0.1)
    query = np.linspace(0.5, 1.5, 77)
    _, found = interpolate(time, query, turn=turn)
    assert (found.inv() * turn(query)).magnitude().max() < 1e-7  # 1 ns at 12 rad/s
