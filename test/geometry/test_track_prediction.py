# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks that are foreseen from their first pulses."""

import numpy as np
import pytest

from sar_imaging.geometry.track import predict_track


def _track(numbers, turns=1):
    """A parabola, and antennas that take turns."""
    n = np.asarray(numbers, float)
    place = np.stack([0.3 * n, 1e-3 * n**2, 0.05 * np.abs(n % turns - turns // 2)],
                     axis=-1)[:, None]
    return place, place + [0.0, 0.1, 0.0]


def _foreseen(n_known, n_wanted, turns=1):
    known, wanted = np.arange(n_known), np.arange(n_wanted)
    return predict_track(known, *_track(known, turns), wanted), _track(wanted, turns)


@pytest.mark.parametrize(('n_known', 'n_wanted', 'curved'), [
    # A quarter of the way that is wanted, and eight pulses.
    (26, 101, True), (25, 101, False), (8, 29, True), (7, 25, False)])
def test_a_curve_is_foreseen_from_a_quarter_of_it_on(n_known, n_wanted, curved):
    found, expected = _foreseen(n_known, n_wanted)
    error = max(np.abs(a - b).max() for a, b in zip(found, expected, strict=True))
    assert (error < 1e-6) == curved
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a[:n_known], b[:n_known])  # as given


@pytest.mark.parametrize('turns', [2, 4])
def test_antennas_that_take_turns_are_foreseen_in_turn(turns):
    found, expected = _foreseen(64, 128, turns)
    height_m = np.ptp(expected[0][..., 2])
    # Least squares give the curve a part of the pattern: measured 4.7 %.
    assert np.abs(found[0][..., 2] - expected[0][..., 2]).max() < 0.08 * height_m


def test_one_pulse_tells_a_place_and_two_a_direction():
    known = np.array([5])
    tx_m, _ = predict_track(known, *_track(known), np.arange(4, 9))
    np.testing.assert_allclose(tx_m, np.broadcast_to(_track(known)[0], (5, 1, 3)))
    known = np.array([5, 7])
    tx_m, _ = predict_track(known, *_track(known), np.arange(5, 11))
    np.testing.assert_allclose(np.diff(tx_m[1:, 0, 0]), 0.3, atol=1e-9)
    with pytest.raises(ValueError, match='at least that of one pulse'):
        predict_track(known[:0], *(a[:0] for a in _track(known)), [1, 2])


def test_only_the_latest_pulses_count():
    """As many as are wanted: what was long ago is no part of the curve."""
    known, wanted = np.arange(-200, 40), np.arange(0, 60)
    tx_m, rx_m = _track(known)
    tx_m, rx_m = tx_m.copy(), rx_m.copy()
    tx_m[known <= -21], rx_m[known <= -21] = 1e3, -1e3
    found = predict_track(known, tx_m, rx_m, wanted)
    np.testing.assert_allclose(found[0], _track(wanted)[0], atol=1e-6)
