# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the focus of the team 6 reflectors tells about the alignment, on the measured data."""

from __future__ import annotations

import dataclasses
import pathlib

import numpy as np
import pytest
from matplotlib.image import imread

from benchmarks.measured import team6_sensitivity
from benchmarks.measured.team6_sensitivity import (
    LEVER_NAMES,
    bounds,
    reflectors,
    scan,
    with_attitudes,
)
from sar_imaging.recordings import load

MEASURED = pathlib.Path(__file__).parents[4] / 'shared' / 'data' / 'bwsi2019_team6_rail'


def needs_data(test):
    """Mark a test that reads the recording."""
    return pytest.mark.data(pytest.mark.skipif(
        not MEASURED.is_dir(), reason='needs the team 6 recording in '
        '../shared/data/bwsi2019_team6_rail beside the repository')(test))


@pytest.fixture(scope='module')
def recording():
    rail = load('team6_rail', MEASURED)
    return rail.block, rail.poses, rail.alignment, reflectors(rail)


@needs_data
def test_the_sharpest_alignment_is_not_that_of_the_survey(recording):
    block, poses, nominal, survey_m = recording
    amplitude, place_m = scan(block, poses.track(), nominal, survey_m, [9.26, 9.28],
                              [0.1, 0.4, 0.744])
    assert np.isfinite(amplitude).all()
    power = np.sum(amplitude**2, axis=-1)
    assert np.unravel_index(power.argmax(), power.shape) == (1, 1)
    # Level of each reflector at the survey's bias: measured -0.35 and -0.83 dB.
    level_db = 20 * np.log10(amplitude[1, 2] / amplitude[1, 1])
    assert level_db == pytest.approx([-0.34, -0.81], abs=0.1)
    # With the nominal lever arm neither brings both within 0.10 m: measured 0.133 m at best.
    error_m = np.linalg.norm(place_m - survey_m[:, :2], axis=-1)
    assert error_m.max(axis=-1).min() == pytest.approx(0.133, abs=0.01)


@needs_data
def test_echoes_tell_the_time_offset_and_not_the_lever_arm(recording):
    block, poses, nominal, survey_m = recording
    best = dataclasses.replace(nominal, time_offset_s=9.28, range_bias_m=0.4)
    places_m = survey_m + [[0.048, 0.113, 0.0], [-0.05, -0.123, 0.0]]
    names = ('time_offset_s', 'range_bias_m', *LEVER_NAMES)
    level = bounds(block, poses.track(), best, places_m, names)
    assert level['time_offset_s'] < 0.003
    assert 0.03 < level['range_bias_m'] < 0.06  # measured 0.044 m
    assert level['lever_x_m'] == level['lever_y_m'] == np.inf
    turning = bounds(block, with_attitudes(MEASURED, poses).track(), best, places_m, names)
    assert 0.2 < turning['lever_x_m'] < 0.6  # measured 0.37 m; 0.31 m are to be found


def test_a_missing_recording_is_told(tmp_path, capsys):
    assert team6_sensitivity.main([str(tmp_path), '--output', str(tmp_path)]) == 1
    assert 'holds no file team6_rail_trial6.npz' in capsys.readouterr().err


def test_the_picture_shows_both_reflectors(tmp_path):
    biases = team6_sensitivity.RANGE_BIASES_M
    level = -np.stack([(biases - 0.4) ** 2, (biases - 0.3) ** 2], axis=-1)
    team6_sensitivity.draw(tmp_path / 'a.png', level, -level, {'nominal': 0.46})
    rgb = imread(tmp_path / 'a.png')[..., :3].astype(float)
    orange = (rgb[..., 0] > 0.9) & (rgb[..., 1] < 0.6) & (rgb[..., 2] < 0.2)
    middle = rgb.shape[1] // 2
    assert orange[:, :middle].any() and orange[:, middle:].any()
