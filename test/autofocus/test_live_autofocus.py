# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus with the settings of the nodes: an aperture with holes, and a clock that is off."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from benchmarks.support.track_errors import moved_rigidly
from sar_imaging.autofocus import with_track_error
from sar_imaging.autofocus.live import live_autofocus
from sar_imaging.autofocus.models import nominal
from sar_imaging.quality import error_db
from sar_imaging.simulation import flawed_aperture


def test_track_and_clock_of_an_aperture_with_a_hole():
    case = flawed_aperture('clock', 0.05, 4, n_pulses=128, half_scene_m=14.0)
    there = np.r_[0:40, 65:128]
    stated, true = case.stated.select(there), case.true.select(there)
    image = exact_image(case.grid, stated)
    autofocus = live_autofocus(case.grid, time_offset_s=0.1, track_error_m=0.02)
    result = autofocus.process(stated, image)
    report = result.report
    assert report.accepted
    assert report.success, report.reason
    assert abs(report.parameters['time_offset_s']) < 0.2
    assert report.largest_move_m == pytest.approx(
        np.linalg.norm(result.block.tx_m - stated.tx_m, axis=-1).max())
    np.testing.assert_array_equal(result.image, exact_image(case.grid, result.block))
    found = exact_image(case.grid, moved_rigidly(result.block, true, case.points_m))
    wanted = exact_image(case.grid, true)
    factor = np.vdot(found, wanted) / np.vdot(found, found)
    assert error_db(factor * found, wanted) < -20.0


def test_track_errors_are_smooth_in_time():
    case = flawed_aperture('smooth', 0.1, 1, n_pulses=64, half_scene_m=5.0)
    model = with_track_error(nominal(case.true), degree=2, axes=[(0, 0, 1)])
    there = np.r_[0:10, 40:64]
    part = with_track_error(nominal(case.true.select(there)), degree=2, axes=[(0, 0, 1)],
                            time_s=3.0 + 0.1 * there)
    np.testing.assert_allclose(part([0.2, 0.3]).tx_m, model([0.2, 0.3]).tx_m[there], atol=1e-12)


def test_pulses_need_times():
    case = flawed_aperture('smooth', 0.1, 1, n_pulses=64, half_scene_m=5.0)
    timeless = dataclasses.replace(case.stated, stamp_ns=0 * case.stated.stamp_ns)
    with pytest.raises(ValueError, match='times of the pulses do not ascend'):
        live_autofocus(case.grid, track_error_m=0.1).process(timeless)
