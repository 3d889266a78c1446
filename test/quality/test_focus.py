# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The focus figure: noise is told from what stands out, by its closed form."""

import math

import numpy as np
import pytest

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality import contrast, entropy, focus_figure
from sar_imaging.streaming.aperture import ApertureImage


def speckle(shape, seed):
    rng = np.random.default_rng(seed)
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)


def test_figures_are_those_of_the_measures():
    image = speckle((60, 80), 1)
    image[7, 9] = 40.0
    figure = focus_figure(image)
    intensity = np.abs(image.astype(complex)) ** 2
    # float32 shares against float64
    assert figure.contrast == pytest.approx(contrast(image), rel=1e-4)
    assert figure.entropy == pytest.approx(entropy(image), rel=1e-4)
    assert figure.peak_over_median_db == pytest.approx(
        10 * math.log10(intensity.max() / np.median(intensity)), abs=0.01)
    assert not figure.at_noise_level


def test_one_image_of_noise_in_a_thousand_stands_out():
    n = 400
    bound = focus_figure(speckle(n, 0)).noise_db
    assert bound == pytest.approx(10 * math.log10(math.log(n / 1e-3) / math.log(2)))
    raised = sum(not focus_figure(speckle(n, seed)).at_noise_level for seed in range(4000))
    # 4 expected of the peak alone; the median of 400 pixels scatters by 5 %, which raises it.
    assert 1 <= raised <= 20


def test_a_pixel_just_above_the_bound_stands_out():
    image = speckle((100, 100), 3)
    figure = focus_figure(image)
    median = np.median(np.abs(image) ** 2)
    for beyond_db, at_noise_level in ((-0.1, True), (0.1, False)):
        image[50, 50] = math.sqrt(median * 10 ** ((figure.noise_db + beyond_db) / 10))
        assert focus_figure(image).at_noise_level == at_noise_level


def test_pixels_that_no_profile_reached_do_not_count():
    inside = speckle((50, 50), 4)
    image = np.zeros((200, 200), np.complex64)
    image[:50, :50] = inside
    assert focus_figure(image) == focus_figure(inside)


def test_empty_image_is_told():
    figure = focus_figure(np.zeros((4, 4), np.complex64))
    assert figure.at_noise_level and figure.n_pixels == 0
    assert str(figure) == 'the image is zero everywhere'


def test_scale_does_not_matter():
    image = speckle((30, 30), 5)
    for scale in (1e-15, 1e25):  # the squares leave the range of float32
        assert focus_figure((scale * image).astype(np.complex64)).contrast == pytest.approx(
            focus_figure(image).contrast, rel=1e-3)


def test_nan_is_counted():
    image = speckle((4, 4), 6)
    image[1, 2] = np.nan
    with pytest.raises(ValueError, match='1 of 16 pixels are NaN or infinite'):
        focus_figure(image)


def test_figure_in_words():
    assert 'contrast 1' in str(focus_figure(speckle((300, 300), 7)))


def test_images_of_apertures_carry_it():
    image = speckle((20, 30), 8)
    product = ApertureImage(image, MapGrid((0.0, 0.0, 0.0), 30, 20, 1.0), 0, 0, np.arange(3),
                            np.arange(0), -80.0, 10e9)
    assert product.focus_figure == focus_figure(image)
