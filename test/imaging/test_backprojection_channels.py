# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Weights, images per channel and the midpoint approximation; blocks that need a decision."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.spectra import band_spectrum


@pytest.fixture(name='case', scope='module')
def case_fixture(make_case):
    return make_case(1e3, channels=3, n=64, pulses=32)


def _plan(case, **options):
    return plan_image(case.grid, case.block.radar, case.block.n_samples, method='exact',
                      target_db=-80.0, **options)


def _image(case, block=None, **options):
    return _plan(case, **options)(block or case.block).samples


def _reference(block, points, weights=1.0, tx=None, rx=None):
    frequencies, spectra = band_spectrum(block)
    spectra = spectra * np.reshape(weights, (1, -1, 1))
    return correlate(frequencies, spectra, block.tx_m if tx is None else tx,
                     block.rx_m if rx is None else rx, points)


def _error_db(image, reference):
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2) / np.sum(np.abs(reference) ** 2))


def _channel(block, c):
    pick = slice(c, c + 1)
    return dataclasses.replace(block, samples=block.samples[:, pick], tx_m=block.tx_m[:, pick],
                               rx_m=block.rx_m[:, pick])


def _bright(image, n=200):
    return np.argsort(np.abs(image).ravel())[-n:]


def test_weights_multiply_the_channels(case):
    weights = np.array([1.0, 0.5 * np.exp(1j), -0.3j])
    image = _image(case, weights=weights).ravel()
    bright = _bright(image)
    points = case.grid.points().reshape(-1, 3)[bright]
    assert _error_db(image[bright], _reference(case.block, points, weights)) <= -80.0


@pytest.mark.parametrize('height', [False, True], ids=['map', 'terrain'])
def test_images_per_channel(case, height):
    heights = {'height_m': np.zeros(case.grid.shape)} if height else {}
    images = _image(case, per_channel=True, weights=[1, 2, 3j], **heights)
    assert images.shape == (3, *case.grid.shape)
    points = case.grid.points().reshape(-1, 3)
    for c, (image, weight) in enumerate(zip(images, (1, 2, 3j), strict=True)):
        bright = _bright(image)
        reference = weight * _reference(_channel(case.block, c), points[bright])
        assert _error_db(image.ravel()[bright], reference) <= -80.0


def test_images_per_channel_sum_to_the_image(case):
    whole = _image(case)
    images = _image(case, per_channel=True)
    # four -80 dB images; the largest single error is some times the rms one
    assert np.abs(images.sum(axis=0) - whole).max() <= 1e-3 * np.abs(whole).max()


def test_midpoint_is_the_displaced_phase_centre(make_case):
    # Receivers to 1.5 m from the transmitter at 60 m: the path is off by d^2 / 8 R, 4.7 mm.
    case = make_case(60.0, channels=3, n=48, spacing_m=0.1, pulses=32)
    rx = case.block.rx_m.copy()
    rx[..., 1] += np.array([-1.5, 0.0, 1.5])
    block = dataclasses.replace(case.block, rx_m=rx)
    case = dataclasses.replace(case, block=block)
    points = case.grid.points().reshape(-1, 3)
    exact = _image(case, block).ravel()
    bright = _bright(exact)
    image = _image(case, block, midpoint=True).ravel()[bright]
    middle = 0.5 * (block.tx_m + block.rx_m)
    assert _error_db(image, _reference(block, points[bright], tx=middle, rx=middle)) <= -80.0
    assert _error_db(exact[bright], _reference(block, points[bright])) <= -80.0
    # 2 of 3 channels turned by 4 pi 4.7 mm / lambda = 113 degrees
    assert _error_db(image, exact[bright]) > -10.0


def test_order_and_repetition_of_pulses_do_not_matter(case):
    order = np.random.default_rng(4).permutation(case.block.n_pulses)
    image = _image(case)
    shuffled = _image(case, case.block.select(order))
    # two -80 dB images
    assert np.abs(shuffled - image).max() <= 5e-4 * np.abs(image).max()
    twice = _image(case, case.block.select(np.r_[order, order]))
    assert np.abs(twice - 2 * image).max() <= 1e-3 * np.abs(image).max()


def test_pulses_from_one_place(case):
    still = case.block.select(np.zeros(8, int))  # a radar that stands
    image = _image(case, still).ravel()
    bright = _bright(image)
    points = case.grid.points().reshape(-1, 3)[bright]
    assert _error_db(image[bright], _reference(still, points)) <= -80.0


def test_empty_block_adds_nothing(case):
    image = _plan(case)(case.block.select(slice(0, 0)))
    assert not image.samples.any() and image.n_pulses == 0
    assert image.report.predicted_error_db is None


def test_positions_that_are_not_finite_are_refused(case):
    tx = case.block.tx_m.copy()
    tx[3] = np.nan
    with pytest.raises(ValueError, match=r'phase centres of 1 of \d+ pulses contain NaN'):
        dataclasses.replace(case.block, tx_m=tx)


def test_grid_too_large_for_memory_is_refused(case):
    vast = MapGrid(case.grid.centre_m, 4_000_000, 3_000_000, 1e-5)
    with pytest.raises(MemoryError, match=r'an image of 4000000 x 3000000 pixels needs '
                       r'96000000 MB, \d+ MB are available; choose a smaller grid'):
        plan_image(vast, case.block.radar, case.block.n_samples, method='exact')


def test_too_many_images_for_memory_are_refused(case):
    plan = _plan(case, per_channel=True)
    with pytest.raises(MemoryError, match='64 x 64 x 1000000000 pixels'):
        plan.new_image(10**9)


@pytest.mark.parametrize(('weights', 'message'), [
    ([1.0, np.nan, 1.0], 'expected one finite complex number per channel'),
    (2.0, 'expected one finite complex number per channel'),
    ([1.0, 1.0], 'the block has 3 channels, weights are for 2'),
])
def test_bad_weights_are_refused(case, weights, message):
    with pytest.raises(ValueError, match=message):
        _image(case, weights=weights)


def test_image_of_another_shape_is_refused(case):
    with pytest.raises(ValueError, match=r'that of the block complex64 \(3, 64, 64\)'):
        _plan(case, per_channel=True).accumulate(case.block, _plan(case).new_image())
