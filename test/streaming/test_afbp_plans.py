# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans of AFBP from a track that is foreseen: when they hold, and when they are made anew."""

import dataclasses

import numpy as np
import pytest

from msg_conversions.subaperture_wire import as_received
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


def test_an_aperture_is_imaged_anew_when_its_track_was_foreseen_badly(make_case):
    """The turn that begins in the first aperture cannot be foreseen from its first pulses."""
    u = np.arange(2 * LENGTH)
    case = make_case(1e3, n=64, pulses=2 * LENGTH, n_points=20, track_m=np.c_[
        -0.0005 * np.maximum(u - 24, 0) ** 2, 0.3 * u - 30, 0 * u])
    stage, fusion = make_stage(case, pulses_per_subaperture=CUT), LiveFusion()
    subapertures = subapertures_of(stage, pieces_of(case.block))
    last = {s.aperture: s.revision for s in subapertures}
    assert last[0] > 0 == last[1]
    newest = [s for s in subapertures if s.revision == last[s.aperture]]
    assert [s.number for s in newest] == [*range(6), *range(6)]  # all of it, again
    images = fuse(fusion, subapertures)
    for k, result in enumerate(images):
        assert error_db(result.image,
                        exact_of(case, slice(k * LENGTH, (k + 1) * LENGTH))) <= -60.0
    assert fusion.statistics.revisions == last[0] == stage.statistics.plans_anew
    assert 'planned anew' in events_of(stage, 'plan')[0]
    # What was replaced does not come back.
    assert fusion.add(subapertures[0]) == []


def test_a_track_that_sways_a_little_is_planned_once(make_case):
    """Its slopes differ from those foreseen by more than they spread, and yet by next to nothing.

    Both apertures had been planned anew while that counted.
    """
    u = np.arange(2 * LENGTH)
    case = make_case(1e3, n=64, pulses=2 * LENGTH, n_points=20, track_m=np.c_[
        0.3 * np.sin(u / 40), 0.3 * u - 30, 300 + 0.2 * np.cos(u / 40)], height_m=300.0)
    stage = make_stage(case, pulses_per_subaperture=CUT)
    images = fuse(LiveFusion(), subapertures_of(stage, pieces_of(case.block)))
    assert stage.statistics.plans_anew == 0
    for k, result in enumerate(images):
        assert error_db(result.image,
                        exact_of(case, slice(k * LENGTH, (k + 1) * LENGTH))) <= -60.0


def test_the_end_of_a_track_that_cannot_be_foreseen_is_awaited(make_case):
    u, cut = np.arange(LENGTH), 8
    leaps = 0.7 * (-1) ** (u // cut) * (u // cut)
    case = make_case(1e3, n=64, pulses=LENGTH, n_points=20,
                     track_m=np.c_[leaps, 0.3 * u - 15 + leaps, 0 * u])
    stage = make_stage(case, pulses_per_subaperture=cut)
    [result] = fuse(LiveFusion(), subapertures_of(stage, pieces_of(case.block)))
    assert 'its end is awaited' in ' '.join(e.text for e in stage.take_events())
    assert result.n_pulses == LENGTH
    error = error_db(result.image, exact_of(case, slice(None)))
    assert error <= result.predicted_error_db + 3.0


def test_a_damaged_position_costs_its_own_aperture_alone(fly):
    """A byte of an exponent puts a phase centre far below the ground; the next is foreseen by it.

    No pixel has a range within all profiles then, so that the error is not known.
    """
    case = fly(n_pulses=3 * LENGTH)
    tx_m = case.block.tx_m.copy()
    tx_m[LENGTH + 50, 0, 2] -= 131_072.0
    stage = make_stage(case, pulses_per_subaperture=CUT)
    images = fuse(LiveFusion(), map(as_received, subapertures_of(stage, pieces_of(
        dataclasses.replace(case.block, tx_m=tx_m)))))
    whole = {i.aperture: i for i in images}
    assert {0, 2} <= set(whole)
    assert error_db(whole[2].image, exact_of(case, slice(2 * LENGTH, 3 * LENGTH))) <= -60.0


def _legs(case, starts, length=LENGTH):
    """One aperture after the other as its counters go on: pulses from these starts of the case."""
    parts = []
    for number, start in enumerate(starts):
        counter = np.arange(number * length, (number + 1) * length)
        parts.append(dataclasses.replace(
            case.block.select(slice(start, start + length)), counter=counter.astype(np.uint32),
            stamp_ns=case.block.stamp_ns[0] + counter * 10**6))
    return parts


@pytest.mark.parametrize('sliding', [False, True])
def test_a_leg_flown_again_is_not_planned_anew_every_time(fly, sliding):
    """A player in a loop, or a rail that goes back: the track carried on is not the one flown."""
    case, starts = fly(), [0, 0, 0, 0, 0]
    stage = make_stage(case, pulses_per_subaperture=CUT, sliding=sliding)
    fusion, images = LiveFusion(), []
    for leg in _legs(case, starts):
        for piece in pieces_of(leg, CUT):
            images += fuse(fusion, stage.add(piece))
            images += fuse(fusion, stage.catch_up())
            stage.plan_ahead()
    images += fuse(fusion, stage.flush()) + fusion.flush()
    # The second leg alone shows that it comes again; before, two sliding windows were begun.
    assert stage.statistics.plans_anew <= 2 * sliding
    assert any('takes over its plan' in text for text in events_of(stage, 'plan'))
    whole = {i.stamp_ns: i for i in images if i.n_pulses == LENGTH}
    exact = exact_of(case, slice(0, LENGTH))
    for number in range(len(starts)):
        middle = case.block.stamp_ns[0] + (number * LENGTH + (LENGTH - 1) / 2) * 10**6
        [image] = [i for stamp, i in whole.items() if abs(stamp - middle) <= 1]
        assert error_db(image.image, exact) <= -60.0


def test_a_leg_that_goes_on_after_all_is_planned(fly):
    case = fly(n_pulses=4 * LENGTH)
    starts = [0, 0, 0, LENGTH, 2 * LENGTH, 3 * LENGTH]
    stage = make_stage(case, pulses_per_subaperture=CUT)
    fusion, images = LiveFusion(), []
    for leg in _legs(case, starts):
        for piece in pieces_of(leg, CUT):
            images += fuse(fusion, stage.add(piece))
            stage.plan_ahead()
    assert len(images) == len(starts)
    for image, start in zip(images, starts, strict=True):
        assert error_db(image.image, exact_of(case, slice(start, start + LENGTH))) <= -60.0
    assert stage.statistics.plans_anew <= 2  # where it goes on, and the first again


def test_profiles_that_end_in_the_guards_are_warned_about_once(fly):
    case, cut = fly(), 40  # samples at both ends
    radar = case.block.radar
    radar = dataclasses.replace(radar, first_sample_delay_s=radar.first_sample_delay_s
                                + cut / radar.sample_rate_hz)
    short = dataclasses.replace(case.block, radar=radar, samples=case.block.samples[..., cut:-cut])
    stage = make_stage(case)
    subapertures_of(stage, pieces_of(short))
    assert len([text for text in events_of(stage, 'plan') if 'profiles end' in text]) == 1


@pytest.mark.parametrize('n_before', [LENGTH, LENGTH - CUT])
def test_plans_ahead_are_used(fly, n_before):
    case = fly()
    stage = make_stage(case, pulses_per_subaperture=CUT)
    stage.plan_ahead()  # nothing is known yet
    images = stage.add(case.block.select(slice(0, 2 * CUT)))
    stage.plan_ahead()  # too little is known
    assert stage.statistics.plans == 1
    images += stage.add(case.block.select(slice(2 * CUT, n_before)))
    for _ in range(2):  # the second time it is planned already
        stage.plan_ahead()
        assert stage.statistics.plans == 2
    images += stage.add(case.block.select(slice(n_before, None)))
    assert stage.statistics.plans == 2
    images = fuse(LiveFusion(), images)
    assert error_db(images[1].image, exact_of(case, slice(LENGTH, None))) <= -60.0


def test_planning_ahead_leaves_the_cuts_of_the_aperture_underway(fly):
    # Every aperture leaps back to where the one before began, so plans ahead are in vain.
    once = fly('bowed').block.select(slice(0, LENGTH))
    stage, fusion, images = make_stage(fly('bowed')), LiveFusion(), []
    for number in range(4):
        block = dataclasses.replace(
            once, counter=once.counter + np.uint32(number * LENGTH),
            stamp_ns=once.stamp_ns + number * 10**9)
        for piece in pieces_of(block):
            for subaperture in stage.add(piece):
                images += fusion.add(subaperture)  # refuses what was cut otherwise
            stage.plan_ahead()
    assert [(image.aperture, image.n_pulses) for image in images] == [
        (number, LENGTH) for number in range(4)]
