# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Both stages of AFBP against the formulas and the processor's backend."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.backends import backend
from sar_imaging.backends.cuda import beams, fusion, subapertures
from sar_imaging.backends.cuda.arrays import given, launch, on_device, xp
from sar_imaging.backends.cuda.transfers import to_host
from sar_imaging.backends.edge_brightness import EdgeBrightness
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.beams import plan_beams
from sar_imaging.planning.afbp.plan import plan_afbp

TARGET_DB = -50.0


@pytest.fixture(scope='module')
def scene(make_scene):
    return make_scene(1000.0, n=16, pulses=16)


@pytest.fixture(scope='module')
def plan(scene):
    block = scene.block
    return plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     target_db=TARGET_DB, pulses_per_subaperture=8).subapertures


def from_beams(plan, block, group=8, n_weighed=0):
    """The plan by way of beams, so many of which share phases; images that are weighed apart."""
    some = block.select(plan.sampling.pulses[0])
    beams = plan_beams(
        plan.coarse, plan.radar, plan.resampling, [(some.tx_m[:, 0], some.rx_m[:, 0])],
        TARGET_DB, plan.range_m[1] - plan.range_m[0])
    return dataclasses.replace(plan, beams=dataclasses.replace(
        beams, group=group, n_weighed=n_weighed))


@pytest.mark.parametrize(('group', 'agree_db'), [
    (1, -92.0),  # float32 phases of the rows and gains from a table; polynomials of the sine
    (8, -65.0)])  # -67.8 measured; eight share a gain, and hardly bend
def test_images_from_beams_are_those_of_the_formulas(scene, plan, error_db, group, agree_db):
    some = scene.block.select(plan.sampling.pulses[0])
    plan = from_beams(plan, scene.block, group)
    weights = np.linspace(0.5, 1.0, some.n_pulses).astype(np.float32)
    out = np.empty((2, *plan.coarse.shape), np.float32)
    image, wanted = (backend(name).SubapertureImager(plan).image(0, some, weights, out=memory)
                     for name, memory in (('cuda', out), ('reference', None)))
    assert image is out
    assert error_db(image, wanted) < agree_db
    with pytest.raises(ValueError, match='number=2; the plan has sub-apertures 0 to 1'):
        backend('cuda').SubapertureImager(plan).image(2, some)


@pytest.mark.parametrize('n_channels', [pytest.param(1, marks=pytest.mark.campaign), 2])
def test_images_of_lit_echoes(scene, error_db, n_channels):
    """From beams as of the formulas, directly as of the processor; one pulse lights little.

    Neighbouring pulses are taken for channels of one, with beams of their own.
    """
    n = 16 // n_channels
    squint = 0.05 * np.linspace(-1.0, 1.0, n) + 0.4 * (np.arange(n) == 7)
    echoes = {name: getattr(scene.block, name).reshape(n, n_channels, -1)
              for name in ('samples', 'tx_m', 'rx_m')}
    block = dataclasses.replace(scene.block, **echoes, stamp_ns=scene.block.stamp_ns[:n],
                                counter=scene.block.counter[:n], pointing=Pointing(np.stack(
                                    [np.cos(squint), np.sin(squint), 0 * squint], axis=-1)))
    pattern = AntennaPattern(PatternCut.gaussian(0.3), PatternCut.cosine(0.5))
    light = Illumination.of_pulses(pattern, block.pointing, block.tx_m, block.rx_m)
    plan = plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     target_db=-40.0, pulses_per_subaperture=n // 2,
                     illumination=light).subapertures
    assert plan.beams is None
    some = block.select(plan.sampling.pulses[0])
    found, wanted = (to_host(backend(name).SubapertureImager(plan).image(0, some))
                     for name in ('cuda', 'cpu'))
    assert error_db(found, wanted) < -100.0
    plan = dataclasses.replace(
        from_beams(plan, block, 1, n_channels),
        amplitudes=dataclasses.replace(plan.amplitudes, lines=None))
    found, wanted = (to_host(backend(name).SubapertureImager(plan).image(0, some))
                     for name in ('cuda', 'reference'))
    assert error_db(found, wanted) < -92.0  # as without illumination


def test_fusion_is_that_of_the_formulas(plan, error_db):
    """Added, replaced, removed, and given at baseband along direction."""
    rng, grid = np.random.default_rng(5), plan.fusion_grid
    images = rng.standard_normal((4, 2, grid.n_coarse, grid.n_coarse_range)).astype(np.float32)
    made = [backend(name).SpectrumFusion(grid, keep=True) for name in ('cuda', 'reference')]
    for each in made:
        for number in range(3):
            each.add(number, images[number], 10.0 * number)
        each.add(1, images[3][0] + 1j * images[3][1], -7.0)
        each.remove(0)
        assert each.included == {1, 2}
    image, wanted = (to_host(each.polar_image(15.0)) for each in made)
    assert error_db(image, wanted) < -125.0  # float32 in transforms and tapers
    once = backend('cuda').SpectrumFusion(grid)
    once.add(1, images[3], -7.0)
    once.add(2, images[2], 20.0)
    assert error_db(to_host(once.polar_image(15.0)), wanted) < -125.0
    np.testing.assert_array_equal(to_host(made[0].take_polar_image()),
                                  to_host(once.take_polar_image()))
    assert not once.included and not made[0].included
    with pytest.raises(ValueError, match='contributions are not kept'):
        once.remove(0)
    once.add(0, images[0], 0.0)
    with pytest.raises(ValueError, match='already; fuse with keep=True'):
        once.add(0, images[0], 0.0)


def test_subapertures_are_computed_together(scene, plan, monkeypatch, error_db):
    """One launch of each kernel does them all; images and brightness are the formulas'."""
    plan, launched = from_beams(plan, scene.block), []

    def counted(work, *given):
        launched.append((work, given))
        launch(work, *given)

    for module in (subapertures, beams, fusion):
        monkeypatch.setattr(module, 'launch', counted)
    s = plan.sampling
    wanted, there = (EdgeBrightness(plan.fusion_grid, s.coverage) for _ in range(2))
    whole = backend('cuda').ApertureFusion(plan)
    image = to_host(whole.polar_image(scene.block, brightness=there))
    assert list(whole.groups()) == [[0, 1]] and len(launched) == 6
    formulas = backend('reference')
    imager, fused = formulas.SubapertureImager(plan), formulas.SpectrumFusion(plan.fusion_grid)
    for number, some in enumerate(s.pulses):
        one = imager.image(number, scene.block.select(some))
        wanted.add(one)
        fused.add(number, one, s.centre[number])
    assert error_db(image, fused.take_polar_image()) < -65.0  # as of sub-apertures
    assert there.excess_db == pytest.approx(wanted.excess_db, abs=0.01)
    monkeypatch.setattr(subapertures, '_TOGETHER', 1)
    assert list(whole.groups()) == [[0], [1]]


@pytest.mark.campaign
def test_maps_are_those_of_the_processor(scene, error_db):
    """From samples on the device, where the map stays."""
    block = scene.block
    there = dataclasses.replace(block, samples=given(xp.asarray(block.samples)))
    found, wanted = (plan_image(scene.grid, block.radar, block.n_samples, method='afbp',
                                target_db=TARGET_DB, pulses_per_subaperture=8,
                                backend=name)(some) for name, some in (('cuda', there),
                                                                       ('cpu', block)))
    assert on_device(found.samples)
    assert error_db(to_host(found.samples), wanted.samples) < -100.0
    assert found.report.predicted_error_db == pytest.approx(wanted.report.predicted_error_db)
