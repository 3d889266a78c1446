# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What autofocus accepts and what it claims, each condition against data that meets the others."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.autofocus import Autofocus
from sar_imaging.quality import contrast, entropy
from sar_imaging.simulation import flawed_aperture


@pytest.fixture(name='case', scope='module')
def case_fixture():
    return flawed_aperture('smooth', 0.3, 1, n_pulses=128, half_scene_m=14.0)


def speckle(shape):
    parts = np.random.default_rng(0).standard_normal((2, *shape)) / np.sqrt(2)
    return parts[0] + 1j * parts[1]


def test_an_image_of_higher_contrast_and_higher_entropy_is_not_accepted(case):
    """One bright patch above a haze: contrast rises though the image is smeared all over."""
    def imager(block):
        image = exact_image(case.grid, block)
        if block is case.stated:
            return image
        power = np.abs(image)
        row, column = np.unravel_index(power.argmax(), power.shape)
        image = image + 0.1 * power.max() * speckle(image.shape)
        image[max(0, row - 2):row + 3, max(0, column - 2):column + 3] *= 3
        return image.astype(np.complex64)

    before, after = imager(case.stated), imager(case.true)
    assert contrast(after) > 1.1 * contrast(before)
    assert entropy(after) > entropy(before) + 0.5
    result = Autofocus(case.grid, scale_m=0.1, imager=imager).process(case.stated)
    assert not result.report.accepted
    assert not result.report.success
    np.testing.assert_array_equal(result.image, before)


@pytest.mark.parametrize('n_phases', [0, 512])
def test_points_out_of_phase_are_no_claim_whatever_error_would_do(case, n_phases):
    """In noise 6 dB above the strongest echo contributions are far from phase: 0.43 of 1."""
    noisy = dataclasses.replace(
        case.stated, samples=case.stated.samples + 2.0 * speckle(case.stated.samples.shape))
    autofocus = Autofocus(case.grid, scale_m=0.1, n_phases=n_phases, claim_db=40.0)
    report = autofocus.process(noisy).report
    assert report.contrast_after >= report.contrast_before
    assert not report.success
    # The same geometry without that noise is claimed.
    assert autofocus.process(case.stated).report.success
