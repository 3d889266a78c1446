# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Corrected phase centres in an image that is there already."""

from __future__ import annotations

import dataclasses
import types

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.backends import cpu
from sar_imaging.imaging.afbp import image_of_polar
from sar_imaging.streaming.reimaging import RevisableImage


@pytest.fixture(name='case', scope='module')
def case_fixture(make_case):
    return make_case(1e3, n=96, pulses=128, n_points=20, channels=2)


def shifted(block, pulses, by_m):
    """Phase centres with some pulses moved."""
    tx, rx = block.tx_m.copy(), block.rx_m.copy()
    tx[pulses] += by_m
    rx[pulses] += by_m
    return tx, rx


def error_db(image, grid, block):
    exact = exact_image(grid, block)
    return 10 * np.log10(np.sum(np.abs(image - exact) ** 2) / np.sum(np.abs(exact) ** 2))


def redone(revisable):
    """Every sub-aperture imaged again with the present phase centres and plan."""
    plan = revisable.plan.subapertures
    stage, fusion = cpu.SubapertureImager(plan), cpu.SpectrumFusion(plan.fusion_grid)
    for number, some in enumerate(plan.sampling.pulses):
        part = revisable.block.select(some)
        fusion.add(number, stage.image(number, part), plan.check(part.tx_m, part.rx_m)[0])
    return image_of_polar(revisable.plan, fusion.polar_image(), cpu)


def test_only_the_touched_subapertures_are_redone_and_the_image_is_that_of_all(case):
    revisable = RevisableImage(case.grid, case.block, pulses_per_subaperture=16)
    before = revisable.image()
    # What was wrong with the pulses 40 to 69: a quarter of a wavelength of the two-way path.
    tx, rx = shifted(case.block, slice(40, 70), [0.004, 0.001, 0.0])
    assert revisable.revise(tx, rx) == (2, 3, 4)
    image = revisable.image()
    np.testing.assert_array_equal(image, redone(revisable))
    assert revisable.plans_made == 1
    moved = dataclasses.replace(case.block, tx_m=tx, rx_m=rx)
    assert error_db(image, case.grid, moved) <= -50.0
    # It is another image, by far more than the error.
    assert error_db(image, case.grid, case.block) > -20.0
    # And the way back leaves no trace.
    assert revisable.revise(case.block.tx_m, case.block.rx_m) == (2, 3, 4)
    np.testing.assert_array_equal(revisable.image(), before)


def test_the_same_positions_cost_nothing(case):
    revisable = RevisableImage(case.grid, case.block, pulses_per_subaperture=32)
    assert revisable.revise(case.block.tx_m, case.block.rx_m) == ()


def test_a_single_transmitter_of_one_channel_counts(case):
    revisable = RevisableImage(case.grid, case.block, pulses_per_subaperture=32)
    tx = case.block.tx_m.copy()
    tx[64, 1, 0] += 0.01
    assert revisable.revise(tx, case.block.rx_m) == (2,)
    np.testing.assert_array_equal(revisable.image(), redone(revisable))


def test_what_the_plan_was_not_made_for_is_planned_anew(case):
    revisable = RevisableImage(case.grid, case.block, pulses_per_subaperture=32)
    tx, rx = shifted(case.block, slice(0, 32), [0.0, -8.0, 0.0])  # a quarter of the aperture
    assert len(revisable.revise(tx, rx)) == revisable.n_subapertures
    assert revisable.plans_made == 2
    moved = dataclasses.replace(case.block, tx_m=tx, rx_m=rx)
    assert error_db(revisable.image(), case.grid, moved) <= -50.0


def test_a_correction_that_cannot_be_imaged_leaves_the_image(case):
    revisable = RevisableImage(case.grid, case.block, pulses_per_subaperture=32)
    before = revisable.image()
    on_top = np.broadcast_to(case.grid.centre_m, case.block.tx_m.shape)
    with pytest.raises(ValueError, match='use exact backprojection'):
        revisable.revise(on_top, on_top)
    np.testing.assert_array_equal(revisable.image(), before)
    with pytest.raises(ValueError, match='tx_m.shape'):
        revisable.revise(case.block.tx_m[:5], case.block.rx_m[:5])


def test_the_backend_that_was_asked_for_computes(case):
    """First images and corrected ones, to the bit."""
    made = []

    class Imager(cpu.SubapertureImager):
        def image(self, *arguments):
            made.append(arguments[0])
            return super().image(*arguments)

    own = types.SimpleNamespace(Backprojection=cpu.Backprojection, SubapertureImager=Imager,
                                SpectrumFusion=cpu.SpectrumFusion, form_map=cpu.form_map)
    images = []
    for chosen in (own, 'cpu'):
        revisable = RevisableImage(case.grid, case.block, pulses_per_subaperture=16,
                                   backend=chosen)
        revisable.revise(*shifted(case.block, slice(0, 4), 1e-3))
        images.append(revisable.image().samples)
    assert made == [*range(revisable.n_subapertures), 0]
    np.testing.assert_array_equal(*images)


def test_pulses_without_phase_centres_are_refused(case):
    with pytest.raises(ValueError, match='no phase centres'):
        RevisableImage(case.grid, dataclasses.replace(case.block, tx_m=None, rx_m=None))
