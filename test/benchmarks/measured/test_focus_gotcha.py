# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus of measured data with positions made wrong in a known way."""

from __future__ import annotations

import json
import pathlib

import numpy as np
import pytest

from benchmarks.measured import focus_gotcha
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.simulation import flawed_aperture

FOLDER = pathlib.Path(__file__).parents[3] / '../shared/data/gotcha_pass1_hh'


def test_positions_are_made_wrong_by_what_is_said():
    profiles = flawed_aperture('smooth', 1e-6, 1, n_pulses=64, half_scene_m=5.0).true
    wrong = focus_gotcha.flawed(profiles)
    bias_m = wrong.radar.range_start_m - profiles.radar.range_start_m
    assert bias_m == pytest.approx(focus_gotcha.RANGE_BIAS_M, abs=1e-9)
    # A straight track along x, a pulse every 10 ms: the offset moves it by a constant there.
    step_m = profiles.tx_m[1, 0, 0] - profiles.tx_m[0, 0, 0]
    error = (wrong.tx_m - profiles.tx_m)[:, 0]
    error[:, 0] -= focus_gotcha.TIME_OFFSET_S / 0.01 * step_m
    assert np.abs(error).max() == pytest.approx(focus_gotcha.TRACK_ERROR_M, rel=1e-6)
    assert np.abs(error.mean(axis=0)).max() < 0.1 * focus_gotcha.TRACK_ERROR_M


@pytest.mark.data
@pytest.mark.skipif(not FOLDER.exists(), reason='the Gotcha recording is not here')
def test_measured_reflector_comes_into_focus(tmp_path):
    # The brighter reflector and some cars
    grid = MapGrid.from_size((-10.0, 5.0, 0.0), 50.0, 50.0, 0.125)
    figures, images = focus_gotcha.compare(focus_gotcha.read_profiles(FOLDER), grid)
    recorded, wrong, after = (figures[name] for name in ('recorded', 'wrong', 'autofocus'))
    report = figures['report']
    assert report['accepted']
    # Three wavelengths of error: a fifth of the contrast, 10 dB of the peak
    assert wrong['contrast'] < 0.5 * recorded['contrast']
    assert wrong['peak_db'] < recorded['peak_db'] - 6.0
    assert report['contrast_before'] == wrong['contrast']
    assert after['contrast'] > 0.9 * recorded['contrast']
    assert after['peak_db'] > recorded['peak_db'] - 1.0
    for name in ('irw_range_m', 'irw_azimuth_m'):
        assert after[name] == pytest.approx(recorded[name], rel=0.05)
    focus_gotcha.draw(tmp_path / 'picture.png', images, grid)
    assert (tmp_path / 'picture.png').stat().st_size > 10_000
    json.dumps(figures, allow_nan=False)
