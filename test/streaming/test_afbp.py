# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP while the pulses arrive, against exact backprojection of the same pulses."""

import numpy as np
import pytest

from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.streaming.fusion import LiveFusion

from .conftest import (
    CUT,
    LENGTH,
    TRACKS,
    error_db,
    exact_of,
    fuse,
    make_stage,
    pieces_of,
    subapertures_of,
)


@pytest.mark.parametrize('target_db', [-60.0, -70.0])
@pytest.mark.parametrize('track', TRACKS)
def test_target_is_met_on_any_track(fly, track, target_db):
    case = fly(track)
    stage, fusion = make_stage(case, target_db=target_db), LiveFusion()
    images = fuse(fusion, subapertures_of(stage, pieces_of(case.block)))
    assert [(i.aperture, i.final, i.n_pulses, i.n_missing) for i in images] == [
        (0, True, LENGTH, 0), (1, True, LENGTH, 0)]
    for k, result in enumerate(images):
        error = error_db(result.image, exact_of(case, slice(k * LENGTH, (k + 1) * LENGTH)))
        # Scatterers reach the edges of the grid, where the fusion errs; see test_afbp.
        assert error <= target_db and error <= result.predicted_error_db + 3.0
    assert stage.statistics.imaged == 2 * LENGTH and fusion.statistics.images == 2


def test_live_is_as_good_as_offline_and_both_agree_with_correlation(fly):
    case = fly('shaken')
    images = fuse(LiveFusion(), subapertures_of(make_stage(case, target_db=-70.0),
                                                pieces_of(case.block)))
    block = case.block.select(slice(0, LENGTH))
    offline = plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                         method='afbp', target_db=-70.0)(block).samples
    assert error_db(images[0].image, offline) <= -65.0  # two errors of -70 dB at most
    checked = measure_error(images[0].image, case.grid, [block], n_pixels=100, n_brightest=50)
    assert checked.error_db <= -70.0


def test_same_images_whatever_the_blocks(fly):
    case = fly()
    images = [fuse(LiveFusion(), subapertures_of(make_stage(case, pulses_per_subaperture=CUT),
                                                 pieces_of(case.block, size)))
              for size in (1, CUT, 50, 2 * LENGTH)]
    for other in images[1:]:
        difference = np.linalg.norm(other[1].image - images[0][1].image)
        assert difference <= 1e-3 * np.linalg.norm(images[0][1].image)
        assert [i.stamp_ns for i in other] == [i.stamp_ns for i in images[0]]


def test_images_so_far(fly):
    case = fly()
    stage, fusion = make_stage(case, pulses_per_subaperture=CUT), LiveFusion(images_every=2)
    images = fuse(fusion, subapertures_of(stage, pieces_of(case.block)))
    assert [(i.aperture, i.n_subapertures, i.final) for i in images] == [
        (k, n, n == 6) for k in (0, 1) for n in (2, 4, 6)]
    for result in images:
        start = result.aperture * LENGTH
        stop = start + result.n_subapertures * CUT
        assert error_db(result.image, exact_of(case, slice(start, stop))) <= -60.0
        # the stamps of the pulses are their numbers
        assert abs(result.stamp_ns - (start + stop - 1) / 2) <= 1
        assert (result.n_pulses, result.n_missing) == (stop - start, 0)
