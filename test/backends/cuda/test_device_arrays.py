# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of the device in, arrays of the device out: blocks, images, and what refuses them."""

import dataclasses
import logging

import numpy as np
import pytest

from sar_imaging.backends import DeviceError, backend
from sar_imaging.backends.cuda import backprojection
from sar_imaging.backends.cuda.arrays import given, xp
from sar_imaging.device_arrays import are_finite, beside, on_device, to_host, zeros_beside
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal import concatenate

AGREE_DB = -100.0  # float32 sums in another order


@pytest.fixture(scope='module')
def scene(make_scene):
    return make_scene(1000.0, n=8, pulses=4, channels=2)


@pytest.fixture(scope='module')
def there(scene):
    """The block with its samples on the device."""
    return dataclasses.replace(scene.block, samples=given(xp.asarray(scene.block.samples)))


def imager(scene, **options):
    block = scene.block
    return plan_image(scene.grid, block.radar, block.n_samples, **{
        'method': 'exact', 'target_db': -80.0, **options})


def test_images_stay_where_samples_are(scene, there, error_db):
    options = {'weights': [1.0, 1j], 'pulse_weights': [0.5, 1.0, 1.0, 0.5]}
    wanted = imager(scene, backend='cpu', **options)(scene.block)
    for name in ('cuda', 'auto'):
        image = imager(scene, backend=name, **options)(there)
        assert on_device(image.samples) and image.n_pulses == 4
        assert error_db(to_host(image.samples), wanted.samples) < AGREE_DB
    assert isinstance(imager(scene, backend='cuda', **options)(scene.block).samples, np.ndarray)


@pytest.mark.parametrize(('block_there', 'image_there'), [
    (True, True), (False, True), (True, False)])
def test_images_grow_on_the_device_and_from_there(scene, there, error_db, block_there,
                                                  image_there):
    wanted = imager(scene, backend='cpu', per_channel=True)(scene.block)
    block = there if block_there else scene.block
    made = imager(scene, backend='cuda', per_channel=True)
    image = made.new_image(2, there.samples if image_there else None)
    for part in (slice(0, 3), slice(3, 4)):
        made.accumulate(block.select(part), image)
    assert on_device(image.samples) == image_there
    assert error_db(to_host(image.samples), wanted.samples) < AGREE_DB


@pytest.mark.parametrize('name', ['cpu', 'reference'])
def test_other_backends_say_what_to_do(scene, there, name):
    with pytest.raises(ValueError, match=f'samples lie on a CUDA device, where backend={name!r} '
                       r"does not reach them; use backend='cuda' or 'auto', or copy them to the "
                       r'host with samples.get\(\)'):
        imager(scene, backend=name)(there)


def test_the_processor_takes_over_where_the_device_fails(scene, there, error_db, monkeypatch,
                                                         caplog):
    wanted = imager(scene, backend='cpu')(scene.block)

    def fail(*_):
        raise DeviceError('out of device memory: 3 MB')

    monkeypatch.setattr(backprojection.Backprojection, 'add', fail)
    with pytest.raises(DeviceError, match='out of device memory: 3 MB'):
        imager(scene, backend='cuda')(there)
    with caplog.at_level(logging.WARNING):
        made = imager(scene, backend='auto')
        image = made.new_image(2, there.samples)
        made.accumulate(there, image)
    # others tell of few pulses and short profiles
    failures = [text for text in caplog.messages if 'the processor' in text]
    assert failures == ['out of device memory: 3 MB; the processor computes']
    assert on_device(image.samples)
    np.testing.assert_array_equal(to_host(image.samples), wanted.samples)


def test_blocks_are_cut_and_joined_there(scene, there):
    mask = np.array([True, False, True, True])
    for index in (slice(1, 3), mask, np.array([3, 0])):
        part = there.select(index)
        assert on_device(part.samples)
        np.testing.assert_array_equal(to_host(part.samples), scene.block.samples[index])
    for first, second in ((there, there), (there, scene.block), (scene.block, there)):
        joined = concatenate([first.select(slice(0, 1)), second.select(slice(1, 4))])
        assert on_device(joined.samples) == (first is there)
        np.testing.assert_array_equal(to_host(joined.samples), scene.block.samples)


def test_samples_that_are_not_finite_are_found_there(scene, there):
    samples = scene.block.samples.copy()
    samples[2, 0, 5] = np.nan
    broken = dataclasses.replace(scene.block, samples=given(xp.asarray(samples)))
    with pytest.raises(ValueError, match=r'1 of \d+ samples are NaN or infinite, in 1 of 4 '
                                         r'pulses \(2 '):
        imager(scene, backend='cuda')(broken)
    largest = given(xp.full((2, 1, 3), np.finfo(np.float32).max, np.complex64))
    assert are_finite(largest) and are_finite(there.samples)


def test_arrays_are_told_apart():
    here, other = np.ones(3, np.complex64), given(xp.zeros(2, np.complex64))
    assert on_device(other) and not on_device(here) and not on_device(None)
    assert beside(here, here) is here and beside(other, here) is other
    assert on_device(beside(here, other)) and on_device(zeros_beside((2,), other))
    with pytest.raises(TypeError, match='(?i)implicit conversion to a NumPy array'):
        np.asarray(other)
    with pytest.raises(TypeError, match='Unsupported type'):
        other * np.ones(2)
    assert getattr(backend('cuda'), 'DEVICE_ARRAYS', False)
