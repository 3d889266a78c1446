# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fits of straight tracks and refusals of others."""

import numpy as np
import pytest

from sar_imaging.geometry.track import check_straight, fit_straight_track

DIRECTION = np.array([2.0, -1.0, 0.5]) / np.sqrt(5.25)
ORIGIN = np.array([1e6, -2e6, 3e3])
OFFSETS = np.array([-0.2, 0.05, 0.15])  # of the channels' midpoints


def _centres(pulses=50, spacing=0.7):
    u = (np.arange(pulses) - (pulses - 1) / 2)[:, None] * spacing
    tx = ORIGIN + np.repeat(u, 3, axis=1)[..., None] * DIRECTION
    return tx, tx + 2 * OFFSETS[:, None] * DIRECTION


def test_fit_finds_line_spacing_and_offsets():
    tx, rx = _centres()
    track = fit_straight_track(tx, rx)
    # float64 holds coordinates of 2e6 m to 2e-10 m
    np.testing.assert_allclose(track.origin_m, ORIGIN, rtol=0, atol=1e-8)
    np.testing.assert_allclose(track.direction, DIRECTION, atol=1e-10)
    assert track.spacing_m == pytest.approx(0.7, abs=1e-10)
    np.testing.assert_allclose(track.offsets_m, OFFSETS, atol=1e-8)
    np.testing.assert_allclose(track.along_m[0], OFFSETS - 24.5 * 0.7, atol=1e-8)
    along, distance = track.coordinates(0.5 * (tx + rx))
    np.testing.assert_allclose(along, track.along_m, atol=1e-8)
    assert distance.max() < 1e-8


def test_coordinates_of_points_beside_the_line():
    track = fit_straight_track(*_centres())
    across = np.cross(DIRECTION, [0.0, 0.0, 1.0])
    points = ORIGIN + [[7.0 * DIRECTION + 3.0 * across], [-2.0 * DIRECTION - 5.0 * across]]
    along, distance = track.coordinates(points)
    np.testing.assert_allclose(along, [[7.0], [-2.0]], atol=1e-8)
    np.testing.assert_allclose(distance, np.linalg.norm(across) * np.array([[3.0], [5.0]]),
                               atol=1e-8)


@pytest.mark.parametrize(('tx', 'message'), [
    (np.zeros((0, 2, 3)), '0 pulses make no track'),
    (np.zeros((1, 2, 3)), '1 pulses make no track; expected at least two'),
    (np.ones((5, 2, 3)), 'move by 0 m from pulse to pulse; expected a moving platform'),
])
def test_too_little_for_a_track(tx, message):
    with pytest.raises(ValueError, match=message):
        fit_straight_track(tx, tx)


def test_only_deviations_that_change_the_path_count():
    tx, rx = _centres()
    across = np.cross(DIRECTION, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    up = np.cross(DIRECTION, across)
    point = ORIGIN + 1e4 * across

    def check(offset, **options):
        moved_tx, moved_rx = tx.copy(), rx.copy()
        moved_tx[20], moved_rx[20] = tx[20] + offset, rx[20] + offset
        track = fit_straight_track(moved_tx, moved_rx)
        check_straight(track, moved_tx, moved_rx, point[None],
                       **({'wavelength_m': 0.03, 'tolerance_wavelengths': 0.1} | options))

    check(0.001 * across)  # 2 mm of path
    check(0.1 * up)        # at a right angle to the line of sight: 1 um
    with pytest.raises(ValueError, match=r'pulse 20, channel \d is 0\.0019\d* m \(0\.06\d* '
                                         r'wavelengths\) off the best-fit line and .* off its '
                                         r'place along it; steps between pulses are 0\.7 to '
                                         r'0\.70000\d m; .*wrong by 0\.13\d* wavelengths'):
        check(0.002 * across)
    check(0.002 * across, wavelength_m=0.06)


@pytest.mark.parametrize('scale_m', [0.5, 1e6])
def test_two_pulses_that_just_move_are_a_track(scale_m):
    """A billionth of the coordinates, and of a metre where these are small."""
    for share, moves in ((1.1, True), (0.9, False)):
        step = share * 1e-9 * max(1.0, scale_m)
        tx = np.full((2, 1, 3), scale_m)
        tx[1, :, 0] += step
        if moves:
            track = fit_straight_track(tx, tx)
            # float64 holds 1e6 m to 1.2e-10 m
            assert track.spacing_m == pytest.approx(step, rel=0.2)
            np.testing.assert_allclose(track.direction, [1, 0, 0], atol=1e-9)
        else:
            with pytest.raises(ValueError, match='expected a moving platform'):
                fit_straight_track(tx, tx)


def test_the_tolerance_is_the_largest_error_of_a_path():
    tx, rx = _centres()
    track = fit_straight_track(tx, rx)
    point = ORIGIN + 1e4 * np.cross(DIRECTION, [0.0, 0.0, 1.0])
    moved = rx + [0.0, 0.0, 0.01]

    def check(tolerance):
        check_straight(track, tx, moved, point[None], wavelength_m=0.03,
                       tolerance_wavelengths=tolerance)

    exact = sum(np.linalg.norm(a - point, axis=-1) for a in (tx, moved))
    u, (along, distance) = track.along_m, track.coordinates(point[None])
    error = np.abs(exact - 2 * np.hypot(distance, along - u)).max() / 0.03
    check(error * (1 + 1e-9))
    with pytest.raises(ValueError, match='use backprojection for this track'):
        check(error * (1 - 1e-6))
