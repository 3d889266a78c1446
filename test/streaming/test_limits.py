# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits of imaging while pulses arrive, just inside and just outside."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.planning.afbp.live import extension
from sar_imaging.streaming.aperture import ApertureImager
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.mosaic import StripMosaic
from sar_imaging.streaming.subapertures import LiveSubapertures

LENGTH, CUT = 96, 24
GRID = MapGrid((1e3, 0.0, 0.0), 8, 8, 0.5)


# ------------------------------------------------------------------------------- options

@pytest.mark.parametrize(('name', 'inside', 'outside'), [
    ('pulses_per_subaperture', (0, 96), (-1, 97)), ('target_db', (-85.0, -20.0), (-85.1, -19.9)),
    ('pulses_per_aperture', (1,), (0,))])
def test_options_of_live_subapertures(name, inside, outside):
    for value in inside:
        LiveSubapertures(GRID, **{'pulses_per_aperture': LENGTH} | {name: value})
    for value in outside:
        with pytest.raises(ValueError, match=f'{name}={value}'):
            LiveSubapertures(GRID, **{'pulses_per_aperture': LENGTH} | {name: value})


@pytest.mark.parametrize('make', [LiveFusion, lambda **o: ApertureImager(
    GRID, pulses_per_aperture=1, **o)])
def test_the_share_of_pulses_is_from_zero_to_one(make):
    for value in (0.0, 1.0):
        assert make(min_pulse_fraction=value).min_pulse_fraction == value
    for value in (-1e-9, 1 + 1e-9):
        with pytest.raises(ValueError, match='min_pulse_fraction'):
            make(min_pulse_fraction=value)


# ------------------------------------------------------------------------------- apertures

def test_an_image_needs_its_share_of_the_pulses_and_no_more(make_case):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT)
    sent = stage.add(case.block)
    for share, n_images in ((0.5, 1), (0.5 + 1e-9, 0)):
        fusion = LiveFusion(min_pulse_fraction=share)
        images = [image for sub in sent[:2] for image in fusion.add(sub)] + fusion.flush()
        assert len(images) == n_images == 1 - fusion.statistics.apertures_dropped
        imager = ApertureImager(case.grid, pulses_per_aperture=LENGTH, min_pulse_fraction=share)
        images = imager.add(case.block.select(slice(0, 48))) + imager.flush()
        assert len(images) == n_images == 1 - imager.statistics.apertures_dropped
    assert ApertureImager(case.grid, pulses_per_aperture=LENGTH, min_pulse_fraction=0.0).flush() \
        == []


@pytest.mark.parametrize(('n_known', 'plans'), [(71, 1), (72, 2)])
def test_plans_are_made_ahead_from_three_quarters_on(make_case, n_known, plans):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT)
    stage.add(case.block.select(slice(0, n_known)))
    stage.plan_ahead()
    assert stage.statistics.plans == plans


@pytest.mark.parametrize(('n_pulses', 'plans'), [(15, 0), (16, 1)])
def test_a_track_is_foreseen_from_sixteen_pulses_on(make_case, n_pulses, plans):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH)
    stage.add(case.block.select(slice(0, n_pulses)))
    assert stage.statistics.plans == plans


def test_maps_of_as_many_pixels_as_allowed_are_fused(make_case):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    [first, *_] = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH,
                                   pulses_per_subaperture=CUT).add(case.block)
    LiveFusion(max_image_pixels=32 * 32).add(first)
    with pytest.raises(ValueError, match='max_image_pixels=1023'):
        LiveFusion(max_image_pixels=1023).add(first)


@pytest.mark.parametrize(('n_pulses', 'length', 'slack', 'expected'), [
    (100, 1, 1.0, (5, 5)), (100, 25, 1.0, (12, 13)), (100, 25, 0.0, (0, 0)),
    (101, 1, 1.0, (6, 6)), (90, 25, 0.0, (5, 5)), (100, 55, 1.0, (5, 5)),
    (100, 54, 1.0, (31, 31))])
def test_an_aperture_is_extended_by_a_twentieth_to_whole_subapertures(n_pulses, length, slack,
                                                                      expected):
    assert extension(n_pulses, length, slack) == expected


def test_counters_are_those_of_the_pulses_that_are_there(make_case):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    late = dataclasses.replace(case.block, counter=case.block.counter + 2**20 * LENGTH)
    imager = ApertureImager(case.grid, pulses_per_aperture=LENGTH)
    [image] = imager.add(late)
    assert (image.aperture, image.n_missing) == (2**20, 0)


# ------------------------------------------------------------------------------- mosaic

@pytest.mark.parametrize(('off', 'taken'), [(9e-4, True), (-9e-4, True), (1.1e-3, False)])
def test_patches_may_be_off_the_lattice_by_a_thousandth_of_a_pixel(off, taken):
    mosaic = StripMosaic()
    image = np.ones((4, 4), np.complex64)
    mosaic.add(image, MapGrid((0.0, 0.0, 0.0), 4, 4, 0.2))
    grid = MapGrid((0.2 * (3 + off), 0.0, 0.0), 4, 4, 0.2)
    if taken:
        mosaic.add(image, grid)
        assert mosaic.form()[0].shape == (4, 7)
    else:
        with pytest.raises(ValueError, match='not on the lattice'):
            mosaic.add(image, grid)


def test_a_strip_has_as_many_pixels_as_allowed():
    image = np.ones((4, 4), np.complex64)
    for max_pixels, columns in ((28, 7), (27, 4), (16, 4)):
        mosaic = StripMosaic(max_pixels=max_pixels)
        for x in (0.0, 0.6):
            mosaic.add(image, MapGrid((x, 0.0, 0.0), 4, 4, 0.2))
        assert mosaic.form()[0].shape == (4, columns)
    with pytest.raises(ValueError, match='expected at most max_pixels=15'):
        StripMosaic(max_pixels=15).add(image, MapGrid((0.0, 0.0, 0.0), 4, 4, 0.2))
