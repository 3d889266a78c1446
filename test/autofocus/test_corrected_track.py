# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Corrected tracks against simulated ones: what the image tells, and what it cannot."""

import dataclasses
import json
import pathlib

import numpy as np
import pytest

from sar_imaging.autofocus import AutofocusReport, AutofocusResult, nominal
from sar_imaging.autofocus.corrected_track import corrected_track
from sar_imaging.autofocus.models import apply_geometry, with_track_error
from sar_imaging.imaging.imager import plan_image
from sar_imaging.simulation import flawed_aperture

ROOT = pathlib.Path(__file__).parents[2]
RESULTS = ROOT / 'benchmarks' / 'results' / 'autofocus_tracks.json'
PAGE = ROOT / 'docs' / 'autofocus.md'
SCALE_M = 0.05
WRONG_M = np.array([0.004, 0.003, -0.002, 0.002, 0.001])  # of Legendre degrees 1 to 5, along y
REPORT = AutofocusReport(True, False, 'sharper', 1.0, 2.0, 9.0, 8.0)


def wrong_track(seed):
    """Pulses whose positions are wrong along y, the model of that, and what autofocus found."""
    case = flawed_aperture('smooth', 1e-6, seed=seed, n_pulses=96, half_scene_m=10.0)
    u = np.linspace(-1.0, 1.0, 96)
    moved = np.zeros((96, 1, 3))
    moved[:, 0, 1] = np.polynomial.legendre.legval(u, [0.0, *WRONG_M])
    block = dataclasses.replace(case.stated, tx_m=case.stated.tx_m + moved,
                                rx_m=case.stated.rx_m + moved)
    model = with_track_error(nominal(block), scale_m=SCALE_M, axes=[[0.0, 1.0, 0.0]])
    nearly = -WRONG_M + [0.0, 3e-4, 0.0, -2e-4, 0.0]  # k 0.3 mm = 0.13 rad
    corrected = apply_geometry(block, model(nearly))
    imager = plan_image(case.grid, block.radar, block.n_samples, method='exact')
    report = dataclasses.replace(REPORT, parameters=dict(zip(model.names, nearly, strict=True)))
    result = AutofocusResult(imager(corrected).samples, corrected, report)
    return case, model, result


def test_what_the_image_tells_is_known_within_its_covariance_and_no_more():
    squares = []
    for seed in range(4):
        case, model, result = wrong_track(seed)
        track = corrected_track(result, model, case.grid)
        std = np.array(list(track.std.values()))
        error = np.array(list(track.parameters.values())) + WRONG_M
        assert std[0] == pytest.approx(SCALE_M, rel=0.01)  # a line only displaces the image
        assert (std[1:] < SCALE_M / 50).all()
        squares.append(np.sum((error[1:] / std[1:]) ** 2))
        # the ends lie a whole line's coefficient away, the middle nowhere near
        assert track.covariance_m2[0, 1, 1] == pytest.approx(SCALE_M**2, rel=0.05)
        assert track.covariance_m2[47, 1, 1] < (SCALE_M / 25) ** 2
        assert np.abs(track.covariance_m2[:, [0, 2]]).max() == 0.0  # the model has no x and z
    # chi-squared of 16: 39.3 is exceeded once in a thousand; small only where claims are too wide
    assert 3.0 < sum(squares) < 39.3


def test_errors_of_the_poses_themselves_remain():
    case, model, result = wrong_track(0)
    track, noisy = (corrected_track(result, model, case.grid, position_std_m=s)
                    for s in (0.0, 0.01))
    assert noisy.position_m == pytest.approx(track.position_m)
    wider = noisy.covariance_m2 - track.covariance_m2
    assert wider[10, 0, 0] == pytest.approx(1e-4) and wider[47, 1, 1] > 1e-4


def test_refused_answers_and_scenes_without_points_are_errors():
    case, model, result = wrong_track(0)
    refused = dataclasses.replace(result, report=dataclasses.replace(
        result.report, accepted=False, reason='perhaps ghosts'))
    with pytest.raises(ValueError, match='refused its answer: perhaps ghosts'):
        corrected_track(refused, model, case.grid)
    lone = dataclasses.replace(result, image=np.where(
        np.abs(result.image) == np.abs(result.image).max(), result.image, 0))
    with pytest.raises(ValueError, match='1 bright points do not tell 4 unknowns; expected 7'):
        corrected_track(lone, model, case.grid)


def test_tracks_of_the_campaign_are_as_the_page_says():
    claimed = json.loads(RESULTS.read_text())['summary']['claimed']
    low, high = claimed['nees_bounds']
    row = (f'| {claimed["at_most_a_third"]} | {claimed["nees"]} ({low} to {high}) |')
    assert row in PAGE.read_text()
    assert claimed['at_most_a_third'] == claimed['flights'] and low < claimed['nees'] < high


def test_measured_tracks_are_as_the_page_says():
    found = json.loads(RESULTS.with_name('gotcha_tracks.json').read_text())
    for name in ('claimed', 'used'):
        row = found['summary'][name]
        before, after = row['sight_error_mm']
        told = (f'| {name} | {row["tracks"]} of {found["summary"]["trials"]} | {before} mm | '
                f'{after} mm | {row["std_mm"]} mm | {row["across_mm"]} mm | {row["nees"]} |')
        assert told in PAGE.read_text()
        assert after < before / 3 and row['worst'] < 3.3  # once in a thousand
