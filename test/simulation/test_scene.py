# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scatterers and the letter S."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.simulation.scene import Scatterer, letter_s, positions_and_amplitudes


def test_amplitude_in_decibels():
    assert Scatterer('a', (0, 0, 0), 0.5j).amplitude_db == pytest.approx(-6.0206, abs=1e-4)
    assert Scatterer('a', (0, 0, 0), 0.0).amplitude_db == -np.inf


@pytest.mark.parametrize(('position', 'amplitude', 'message'), [
    ((0, 0), 1.0, 'three finite numbers'), ((0, 0, np.nan), 1.0, 'three finite numbers'),
    ((0, 0, 0), complex(0, np.inf), 'is not finite')])
def test_bad_scatterers_are_refused_by_name(position, amplitude, message):
    with pytest.raises(ValueError, match=message) as error:
        Scatterer('post', position, amplitude)
    assert "'post'" in str(error.value)


def test_no_scatterers_are_an_empty_scene():
    points, amplitudes = positions_and_amplitudes([])
    assert points.shape == (0, 3) and amplitudes.shape == (0,)


def test_letter_s_reads_as_an_s():
    points, amplitudes = positions_and_amplitudes(letter_s((10_000.0, 0.0, 2.0)))
    x, y = points[:, 0] - 10_000.0, points[:, 1]
    np.testing.assert_array_equal(amplitudes, 1)
    np.testing.assert_array_equal(points[:, 2], 2.0)
    # Inside its 5 m x 36 m box and filling it.
    assert np.ptp(x) == pytest.approx(5.0, abs=0.1) and np.ptp(y) == pytest.approx(36.0, abs=0.5)
    turned = np.stack([-x, -y], axis=1)[::-1]
    np.testing.assert_allclose(np.stack([x, y], axis=1), turned, atol=1e-9)
    # Strokes at the upper left and lower right, none at the upper right and lower left.
    between = (np.abs(y) > 2) & (np.abs(y) < 8)
    assert np.any(between & (x < -2) & (y > 0)) and np.any(between & (x > 2) & (y < 0))
    assert not np.any(between & (x * y > 0))
    # No gap wider than the resolution of the letter's radar, 0.5 m by 2.5 m.
    gap = np.hypot(np.diff(x) / 0.5, np.diff(y) / 2.5)
    assert gap.max() < 1.3
