# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP while pulses arrive: what a device forms stays there until the map is formed."""

import dataclasses
import logging

import numpy as np
import pytest

from sar_imaging.backends import DeviceError, automatic, backend, cpu, device
from sar_imaging.backends.cuda import fusion as device_fusion
from sar_imaging.backends.cuda.arrays import given, xp
from sar_imaging.backends.edge_brightness import EdgeBrightness
from sar_imaging.device_arrays import on_device, to_host
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.streaming.aperture import ApertureImager
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures


def live_images(scene, block, name):
    """Images of an aperture by a backend, and the sub-aperture images that they are made of."""
    stage = LiveSubapertures(scene.grid, pulses_per_aperture=16, pulses_per_subaperture=8,
                             target_db=-50.0, backend=name)
    fusion, parts = LiveFusion(backend=name), []
    for cut in (slice(0, 5), slice(5, 16)):
        parts += stage.add(block.select(cut))
    return parts, [image for part in parts for image in fusion.add(part)]


@pytest.mark.campaign
def test_subaperture_images_and_spectra_stay_there(make_scene, error_db):
    scene = make_scene(1000.0, n=16, pulses=16)
    parts, [image] = live_images(scene, scene.block, 'cuda')
    _, [wanted] = live_images(scene, scene.block, 'cpu')
    assert len(parts) == 2 and all(on_device(part.image) for part in parts)
    assert isinstance(image.image, np.ndarray) and image.final
    assert error_db(image.image, wanted.image) < -100.0
    assert image.predicted_error_db == pytest.approx(wanted.predicted_error_db)
    # an image of another process's device, or of this one where the processor fuses
    fusion = LiveFusion(backend='cpu')
    [mixed] = [found for part in parts for found in fusion.add(part)]
    assert error_db(mixed.image, wanted.image) < -100.0


@pytest.mark.parametrize('keep', [False, True])
def test_the_processor_goes_on_with_what_lay_there(make_scene, monkeypatch, caplog, error_db,
                                                   keep):
    scene = make_scene(1000.0, n=16, pulses=16)
    block = scene.block
    plan = plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     target_db=-50.0, pulses_per_subaperture=8).subapertures
    grid, rng = plan.fusion_grid, np.random.default_rng(2)
    images = (rng.standard_normal((3, grid.n_coarse, 2 * grid.n_coarse_range), np.float32)
              .view(np.complex64))

    def fail(*_, **__):
        raise DeviceError('the CUDA device failed: gone')

    monkeypatch.setattr(device, 'device_backend', lambda: backend('cuda'))
    monkeypatch.setattr(automatic, '_sooner', lambda there, *_: there)
    monkeypatch.setattr(device_fusion.SpectrumFusion, 'polar_image', fail)
    monkeypatch.setattr(device_fusion.SpectrumFusion, '_add_bands', lambda *_: None)
    made = [automatic.SpectrumFusion(grid, keep=keep), cpu.SpectrumFusion(grid, keep=keep)]
    for number, some in enumerate(images):
        made[0].add(number, given(xp.asarray(some)), 10.0 * number)
        made[1].add(number, some, 10.0 * number)
    # all but the latest have been brought to the host
    kept = [image for image, _ in made[0]._added.values()]
    assert [on_device(image) for image in kept] == [False, False, True]
    with caplog.at_level(logging.WARNING):
        found, wanted = (fusion.polar_image() for fusion in made)
    np.testing.assert_array_equal(found, wanted)
    assert caplog.messages == ['the CUDA device failed: gone; the processor computes']
    there = given(xp.asarray(wanted))  # of a device that fails before the map
    monkeypatch.setattr(device_fusion, 'polar_to_map', fail)
    np.testing.assert_array_equal(to_host(automatic.form_map(there, grid, scene.grid)),
                                  cpu.form_map(wanted, grid, scene.grid))


def test_the_processor_takes_blocks_of_the_device(make_scene, monkeypatch):
    scene = make_scene(1000.0, n=16, pulses=16)
    block = scene.block
    plan = plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     target_db=-50.0, pulses_per_subaperture=8).subapertures
    monkeypatch.setattr(device, 'device_backend', lambda: backend('cuda'))
    monkeypatch.setattr(automatic, '_sooner', lambda *_: cpu)
    part = block.select(plan.sampling.pulses[0])
    there = dataclasses.replace(part, samples=given(xp.asarray(part.samples)))
    found, wanted = (made.SubapertureImager(plan).image(0, some)
                     for made, some in ((automatic, there), (cpu, part)))
    np.testing.assert_array_equal(found, wanted)


def test_exact_images_grow_there(make_scene, error_db):
    """Until their aperture ends."""
    scene, images = make_scene(1000.0, n=8, pulses=4), {}
    for name in ('cuda', 'cpu'):
        live = ApertureImager(scene.grid, pulses_per_aperture=4, target_db=-80.0, backend=name)
        live.add(scene.block.select(slice(0, 3)))
        assert on_device(live._image.samples) == (name == 'cuda')
        [images[name]] = live.add(scene.block.select(slice(3, 4)))
    assert isinstance(images['cuda'].image, np.ndarray)
    assert error_db(images['cuda'].image, images['cpu'].image) < -100.0


def test_edges_are_judged_there(make_scene):
    scene = make_scene(1000.0, n=16, pulses=16)
    block = scene.block
    grid = plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     target_db=-50.0, pulses_per_subaperture=8).subapertures.fusion_grid
    image = np.random.default_rng(3).standard_normal(
        (2, grid.n_coarse, grid.n_coarse_range)).astype(np.float32)
    image[:, :1] *= 30.0
    made = EdgeBrightness(grid), EdgeBrightness(grid)
    for brightness, some in zip(made, (image, given(xp.asarray(image))), strict=True):
        brightness.add(some)
    assert made[0].uneven_db > 3.0
    assert made[1].uneven_db == pytest.approx(made[0].uneven_db, abs=1e-4)
