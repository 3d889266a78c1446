# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What live AFBP says about an image and its memory, and which sub-apertures and pulses count."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from sar_imaging.streaming import fusion as fusion_module
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

STEP_M = 0.3  # from pulse to pulse
LENGTH, CUT = 96, 16


@pytest.fixture(name='case', scope='module')
def case_fixture(make_case):
    """A straight track of two apertures along y, as long again to the right of the map."""
    n = 2 * LENGTH
    return make_case(1e3, n=64, pulses=n, n_points=20,
                     track_m=np.c_[0 * np.arange(n), np.arange(n) * STEP_M, 0 * np.arange(n)])


def _sent(case, pulses=slice(None), **options):
    stage = LiveSubapertures(case.grid, **{
        'pulses_per_aperture': LENGTH, 'pulses_per_subaperture': CUT} | options)
    return stage.add(case.block.select(pulses)) + stage.flush()


def _fuse(fusion, subapertures):
    return [image for s in subapertures for image in fusion.add(s)] + fusion.flush()


@pytest.fixture(name='sent', scope='module')
def sent_fixture(case):
    return _sent(case)


def test_the_predicted_error_is_the_mean_of_those_of_its_subapertures(sent):
    errors_db = np.array([-60.0, -50.0, -65.0, -61.0, -70.0, -58.0])
    [image] = _fuse(LiveFusion(), [
        dataclasses.replace(s, predicted_error_db=db)
        for s, db in zip(sent[:6], errors_db, strict=True)])
    assert image.predicted_error_db == pytest.approx(
        10 * np.log10(np.mean(10 ** (errors_db / 10))), abs=1e-9)


@pytest.mark.parametrize('sliding', [False, True])
def test_as_much_memory_is_asked_for_as_is_taken(make_case, monkeypatch, sliding):
    case = make_case(1e3, n=400, pulses=2 * LENGTH, n_points=1, aperture_m=2 * LENGTH * STEP_M)
    asked = []
    monkeypatch.setattr(fusion_module, 'check_memory',
                        lambda n_bytes, what, remedy: asked.append(n_bytes))
    sent = _sent(case, sliding=sliding)
    _fuse(LiveFusion(images_every=1), sent)  # what is compiled or read from disk is not counted
    asked.clear()
    fusion = LiveFusion(images_every=1)
    tracemalloc.start()
    try:
        for sub in sent:
            fusion.add(sub)
        _, taken = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # Measured 1.2 times as much as is taken, sliding 2.1: nobody is refused for no reason.
    assert taken < max(asked) < 3 * taken


@pytest.mark.parametrize(('length', 'last'), [(CUT, CUT), (28, 12), (40, 16)])
def test_autofocus_is_told_the_ends_of_the_aperture(case, length, last):
    sent = _sent(case, pulses_per_subaperture=length)
    assert sent[-1].length == last
    told = []

    def focus(polar, fusion, ends_m):
        told.append((fusion.polar.origin_m, ends_m))
        return polar, None

    fusion = LiveFusion()
    fusion.focus = focus
    _fuse(fusion, sent)
    for k, (origin_m, ends_m) in enumerate(told):
        # Half a pulse beyond the middles of the first and the last one.
        y = STEP_M * (LENGTH * (k + np.array([0.0, 1.0])) - 0.5) - origin_m[1]
        # Bands are centred by the extremes of their slopes over the grid: 2 % of the aperture.
        np.testing.assert_allclose(ends_m, y, atol=0.02 * LENGTH * STEP_M)
    assert len(told) == 2


def test_a_subaperture_is_late_from_one_window_behind_the_newest_on(case):
    sent = _sent(case, slice(0, 2 * LENGTH), sliding=True)
    anchor = {s.number: s for s in sent if s.sequence == sent[0].sequence}
    assert anchor[0].n_window == 6
    fusion = LiveFusion()
    for number in (0, 1, 4, 5, 6, 7, 8):
        fusion.add(anchor[number])
    assert fusion.add(anchor[2]) == []
    assert (fusion.statistics.late, fusion.statistics.fused) == (1, 7)
    fusion.add(anchor[3])  # one of the six that end with the newest
    assert (fusion.statistics.late, fusion.statistics.fused) == (1, 8)
    [image] = fusion.add(anchor[9])
    assert (image.n_subapertures, image.n_missing) == (6, 0)


def test_a_subaperture_waits_for_a_pulse_that_changed_places_with_its_last(case):
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT)

    def add(*numbers):
        return [(s.number, s.n_pulses) for s in stage.add(case.block.select(list(numbers)))]

    assert add(*range(CUT)) == [(0, CUT)]
    assert add(*range(CUT, CUT + 7), *range(CUT + 8, 2 * CUT)) == []
    assert add(CUT + 7) == []  # a restart or a straggler: the next block tells
    assert add(2 * CUT) == [(1, CUT)]
    # A pulse of the next one ends the wait.
    assert add(*range(2 * CUT + 1, 2 * CUT + 7), *range(2 * CUT + 8, 3 * CUT)) == []
    assert add(3 * CUT) == [(2, CUT - 1)]
