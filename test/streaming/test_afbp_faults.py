# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP of pulses and sub-apertures that are lost, late, repeated or contradict each other."""

import dataclasses

import numpy as np
import pytest

from msg_conversions import subaperture_wire
from sar_imaging.geometry import MapGrid
from sar_imaging.streaming.fusion import LiveFusion

from .conftest import (
    CUT,
    LENGTH,
    error_db,
    events_of,
    exact_of,
    fuse,
    make_stage,
    pieces_of,
    subapertures_of,
)


def test_missing_pulses_do_not_move_the_cuts(fly):
    case = fly()
    rng = np.random.default_rng(0)
    kept = np.flatnonzero(rng.random(2 * LENGTH) > 0.2)
    kept = kept[(kept // CUT != 2) & (kept != LENGTH - 1)]  # one sub-aperture is missing wholly
    subapertures = subapertures_of(make_stage(case, pulses_per_subaperture=CUT),
                                   pieces_of(case.block.select(kept)))
    assert [s.first_counter for s in subapertures] == [
        CUT * i for i in range(2 * LENGTH // CUT) if i != 2]
    assert all(s.n_pulses + s.n_missing == CUT for s in subapertures)
    images = fuse(LiveFusion(min_pulse_fraction=0.1), subapertures)
    for k, result in enumerate(images):
        pulses = kept[kept // LENGTH == k]
        assert error_db(result.image, exact_of(case, pulses)) <= -60.0
        assert (result.n_pulses, result.n_missing) == (len(pulses), LENGTH - len(pulses))
        assert abs(result.stamp_ns - (k + 0.5) * LENGTH) <= 2


def test_pulses_twice_and_late(fly):
    case = fly()
    pieces = pieces_of(case.block, CUT)
    stage = make_stage(case, pulses_per_subaperture=CUT)
    order = [pieces[0], pieces[2], pieces[2], pieces[1], *pieces[3:]]
    subapertures = subapertures_of(stage, order)
    # The second sub-aperture had been given up when the third one came.
    assert [s.number for s in subapertures if s.aperture == 0] == [0, 2, 3, 4, 5]
    assert (stage.statistics.late, stage.statistics.duplicate) == (CUT, CUT)
    assert events_of(stage, 'duplicate') and not stage.statistics.restarts


def test_subapertures_in_any_order_and_twice(fly, sent):
    rng = np.random.default_rng(1)
    fusion, order = LiveFusion(), [*rng.permutation(6), *6 + rng.permutation(6)]
    images = fuse(fusion, [sent[i] for i in order for _ in range(2)])
    for k, result in enumerate(images):
        assert error_db(result.image,
                        exact_of(fly(), slice(k * LENGTH, (k + 1) * LENGTH))) <= -60.0
    assert fusion.statistics.fused == 12
    # The last one of each completes its aperture; when it comes again, that is closed.
    assert (fusion.statistics.duplicate, fusion.statistics.late) == (10, 2)


def test_subapertures_that_never_come(fly, sent):
    fusion = LiveFusion()
    images = fuse(fusion, [s for s in sent if s.number not in (1, 5)]) + fusion.flush()
    pulses = np.r_[0:CUT, 2 * CUT:5 * CUT]
    for k, result in enumerate(images):
        assert error_db(result.image, exact_of(fly(), k * LENGTH + pulses)) <= -60.0
        assert (result.n_pulses, result.n_missing) == (4 * CUT, 2 * CUT)
        assert abs(result.stamp_ns - (k + 0.5) * LENGTH) <= 1
    assert len(images) == 2 and fusion.add(sent[1]) == []
    assert fusion.statistics.late == 1 and 'closed before' in events_of(fusion, 'late')[0]


@pytest.mark.parametrize('lost', [{3}, {0, 3}, {1, 2}, {0, 1, 2}])
def test_pulses_of_a_shorter_last_subaperture_are_counted_as_they_are(fly, lost):
    """Apertures of 96 pulses in sub-apertures of 28, 28, 28 and 12."""
    stage = make_stage(fly(), pulses_per_subaperture=28)
    subapertures = subapertures_of(stage, pieces_of(fly().block))
    fusion = LiveFusion(min_pulse_fraction=0.0)
    images = fuse(fusion, [s for s in subapertures if s.number not in lost]) + fusion.flush()
    n_pulses = LENGTH - sum(12 if number == 3 else 28 for number in lost)
    assert [(i.n_pulses, i.n_missing) for i in images] == 2 * [(n_pulses, LENGTH - n_pulses)]
    if lost == {1, 2}:  # from one sub-aperture alone no line of time is known
        assert all(abs(i.stamp_ns - (k + 0.5) * LENGTH) <= 1 for k, i in enumerate(images))


def test_too_little_for_an_image(sent):
    fusion = LiveFusion(min_pulse_fraction=0.5)
    assert fuse(fusion, [s for s in sent if s.number < 2]) + fusion.flush() == []
    assert fusion.statistics.apertures_dropped == 2
    assert 'aperture 0 dropped: 32 of 96 pulses' in events_of(fusion, 'aperture')[0]


def test_a_sender_that_was_started_again(fly, sent):
    again = subapertures_of(make_stage(fly(), pulses_per_subaperture=CUT), pieces_of(fly().block))
    fusion = LiveFusion(min_pulse_fraction=0.0)
    images = fuse(fusion, [*sent[:3], *again[:2], sent[3], *again[2:6]])
    assert [(i.n_subapertures, i.n_missing) for i in images] == [(3, 3 * CUT), (6, 0)]
    np.testing.assert_array_equal(images[1].image, fuse(LiveFusion(), sent[:6])[0].image)
    assert (fusion.statistics.restarts, fusion.statistics.late) == (1, 1)


def test_a_looping_recording_gives_the_same_images_again(fly):
    pieces = pieces_of(fly().block)
    stage = make_stage(fly(), pulses_per_subaperture=CUT)
    images = fuse(LiveFusion(), subapertures_of(stage, pieces * 2))
    assert [i.aperture for i in images] == [0, 1, 0, 1]
    for first, second in zip(images[:2], images[2:], strict=True):
        np.testing.assert_array_equal(first.image, second.image)
    assert stage.statistics.restarts == 1


def test_the_counter_wraps_around(fly):
    case = fly()
    number = (2**32 - 1) // LENGTH
    short = 2**32 - number * LENGTH  # pulses of the last aperture
    counter = (np.arange(2 * LENGTH) + 2**32 - short - LENGTH) % 2**32
    block = dataclasses.replace(case.block, counter=counter.astype(np.uint32))
    stage = make_stage(case, pulses_per_subaperture=CUT)
    images = fuse(LiveFusion(), subapertures_of(stage, pieces_of(block)))
    assert [(i.aperture, i.n_pulses) for i in images] == [
        (number - 1, LENGTH), (number, short)]
    assert error_db(images[1].image, exact_of(case, slice(LENGTH, LENGTH + short))) <= -60.0
    assert stage.statistics.restarts == 0


def test_geometry_that_polar_images_do_not_suit(make_case):
    case = make_case(12.0, n=64, pulses=LENGTH)
    stage = make_stage(case)
    assert subapertures_of(stage, pieces_of(case.block)) == []
    [text] = events_of(stage, 'aperture')  # once, whatever the number of blocks
    assert 'aperture 0 cannot be imaged by sub-apertures' in text and 'use mode image' in text
    assert stage.statistics.apertures_dropped == 1


def test_subapertures_that_contradict_are_refused(sent):
    fusion = LiveFusion()
    fusion.add(sent[0])
    other = dataclasses.replace(sent[1].map_grid, spacing_m=0.3)
    with pytest.raises(ValueError, match='another grid, map'):
        fusion.add(dataclasses.replace(sent[1], map_grid=other))
    with pytest.raises(ValueError, match='map, length or number'):
        fusion.add(dataclasses.replace(sent[1], pulses_per_aperture=LENGTH + 1))
    far = MapGrid((5e3, 0.0, 0.0), 64, 64, 0.25)
    with pytest.raises(ValueError, match='does not cover its map'):
        fusion.add(dataclasses.replace(sent[6], map_grid=far))
    with pytest.raises(ValueError, match='max_image_pixels=100'):
        LiveFusion(max_image_pixels=100).add(sent[0])
    assert len(fuse(fusion, sent[1:6])) == 1 and fusion.statistics.refused == 3


def test_a_map_whose_messages_do_not_fit_into_memory_is_refused(sent):
    grid = sent[0].map_grid
    vast = dataclasses.replace(grid, n_x=400_000, n_y=400_000,
                               spacing_m=grid.spacing_m * grid.n_x / 400_000)
    # 24 bytes a pixel: the image, its message, the message serialised; the spectra need 1 MB
    with pytest.raises(MemoryError, match='needs 38400[0-9]{2} MB, .* choose a smaller map'):
        LiveFusion(max_image_pixels=2**40).add(dataclasses.replace(sent[0], map_grid=vast))


def test_reset_forgets(fly, sent):
    stage, fusion = make_stage(fly(), pulses_per_subaperture=CUT), LiveFusion()
    pieces = pieces_of(fly().block)
    fuse(fusion, [s for piece in pieces[:4] for s in stage.add(piece)])
    assert (stage.reset(), fusion.reset()) == (48, 3)
    assert (stage.flush(), fusion.flush()) == ([], [])
    images = fuse(fusion, subapertures_of(stage, pieces))
    np.testing.assert_array_equal(images[0].image, fuse(LiveFusion(), sent[:6])[0].image)


def test_messages_and_objects_give_the_same_bits(sent):
    through = [subaperture_wire.from_array(*subaperture_wire.to_array(s)) for s in sent]
    direct = [subaperture_wire.as_received(s) for s in sent]
    for one, other in zip(fuse(LiveFusion(), through), fuse(LiveFusion(), direct), strict=True):
        np.testing.assert_array_equal(one.image, other.image)
