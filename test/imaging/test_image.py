# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""An image in arithmetic is the array that it holds."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.image import Image, Report


@pytest.fixture
def image():
    samples = np.arange(12).reshape(3, 4) * np.complex64(1 + 2j)
    return Image(samples, MapGrid((0.0, 0.0, 0.0), 4, 3, 0.5), 10e9, Report('exact', '', -60.0))


@pytest.mark.parametrize('act', [
    lambda x: x / 7, lambda x: 2 * x, lambda x: x + x, lambda x: -x, lambda x: abs(x),
    lambda x: np.ones((3, 4)) - x, lambda x: x * np.conj(x), lambda x: x == 0,
    lambda x: np.float32(3) / (1 + x), lambda x: x @ np.ones(4), lambda x: np.add.reduce(x),
    lambda x: np.sum(x, axis=0), lambda x: x.samples * x, lambda x: x[1], lambda x: x[1:, ::2],
    lambda x: x[x != 0], lambda x: x.real, lambda x: x.imag, lambda x: np.array(list(x))])
def test_arithmetic_is_that_of_the_samples(image, act):
    samples = image.samples

    class Held(np.ndarray):  # an array that has samples, for the last case
        samples = property(lambda self: samples)

    found, expected = act(image), act(samples.view(Held))
    assert type(found) is not Image
    assert np.asarray(found).dtype == np.asarray(expected).dtype
    assert np.array_equal(found, expected)


def test_in_place_the_image_stays_one(image):
    kept, samples, expected = image, image.samples, image.samples / 2
    image /= 2
    assert image is kept
    assert image.samples is samples
    assert np.array_equal(samples, expected)
    image[1:] = image[:2]
    assert np.array_equal(samples[1:], expected[:2])
    assert np.abs(image, out=np.zeros((3, 4), np.float32)).dtype == np.float32


def test_it_has_the_form_of_the_samples(image):
    for name in ('shape', 'ndim', 'size', 'dtype'):
        assert getattr(image, name) == getattr(image.samples, name)
    assert len(image) == 3


def test_an_image_is_a_key_by_itself(image):
    assert {image: 'here'}[image] == 'here'
