# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phase gradient autofocus on polar images of spotlight apertures with known phase errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.autofocus.phase_gradient import PhaseGradient
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.quality import error_db
from sar_imaging.simulation import flawed_aperture

HALF_APERTURE_M = 15.0
N_ALPHA, N_RANGE, RANGE_SPACING_M = 400, 160, 0.33
# Without the margins, into which autofocus folds what blurs beyond the image.
INNER = (slice(110, 290), slice(5, 155))


@pytest.fixture(scope='module')
def spotlight():
    """Pulses without error, their polar grid, and a function that images them."""
    block = flawed_aperture('smooth', 1e-6, 11).true
    spacing = block.radar.wavelength_m / 2 / (2 * HALF_APERTURE_M) / 1.5
    start = np.hypot(1000.0, 200.0) - N_RANGE / 2 * RANGE_SPACING_M
    polar = PolarGrid((0.0, 0.0, 200.0), (1.0, 0.0), 1, 0.0, start, RANGE_SPACING_M, N_RANGE,
                      -N_ALPHA / 2 * spacing, spacing, N_ALPHA)
    points = polar.lines(*np.meshgrid(polar.range_m, polar.alpha))[0]
    return block, polar, lambda some: exact_image(points, some, target_db=-60.0)


def smooth(u):
    """19 rad from crest to trough."""
    return 6 * np.polynomial.legendre.legval(u, [0, 0, 1, 0.6, -0.5])


def broadband(u):
    """0.9 rad rms, eight sinusoids of 1.5 to 30 cycles per aperture."""
    rng = np.random.default_rng(0)
    return sum(0.4 * rng.standard_normal() * np.sin(np.pi * rng.uniform(3, 60) * u + i)
               for i in range(8))


def without_line(values):
    u = np.arange(len(values))
    return values - np.polyval(np.polyfit(u, values, 1), u)


@pytest.mark.parametrize('error', [smooth, broadband], ids=lambda f: f.__name__)
def test_known_phase_is_found(spotlight, error):
    block, polar, imager = spotlight
    phase = error(np.linspace(-1, 1, block.n_pulses))
    flawed = dataclasses.replace(block,
                                 samples=block.samples * np.exp(1j * phase)[:, None, None])
    plan = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M))
    image, wanted = imager(flawed), imager(block)
    found = plan(image)
    assert found.accepted
    assert found.contrast_after > 1.5 * found.contrast_before
    assert found.error_db < -15.0
    # A line over the aperture displaces the image, which no image shows: taken from the truth.
    true = np.interp(plan.position_m, block.tx_m[:, 0, 0],
                     -phase / block.radar.wavenumber_rad_per_m)
    line = true - without_line(true)
    aligned = plan.correct(image, found.half_path_m + line)[INNER]
    factor = np.vdot(aligned, wanted[INNER]) / np.vdot(aligned, aligned)
    # -21.5 dB measured of both; scatterers in one range bin disturb each other's phase
    assert error_db(factor * aligned, wanted[INNER]) < -20.5


def test_how_many_lines_an_image_has_does_not_matter():
    """Where lines of the spectrum fell at the ends of the aperture once decided on 6 dB."""
    block = flawed_aperture('smooth', 1e-6, 2, n_pulses=128, half_scene_m=12.0).true
    spacing = block.radar.wavelength_m / 2 / (2 * HALF_APERTURE_M) / 1.4
    start = np.hypot(1000.0, 200.0) - 56 * 0.32
    phase = without_line(smooth(np.linspace(-1, 1, block.n_pulses)))
    flawed = dataclasses.replace(block,
                                 samples=block.samples * np.exp(1j * phase)[:, None, None])
    errors = []
    for n in range(97, 106):
        polar = PolarGrid((0.0, 0.0, 200.0), (1.0, 0.0), 1, 0.0, start, 0.32, 112,
                          -n / 2 * spacing, spacing, n)
        points = polar.lines(*np.meshgrid(polar.range_m, polar.alpha))[0]
        plan = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M))
        found, wanted = (plan(exact_image(points, flawed, target_db=-60.0)),
                         exact_image(points, block, target_db=-60.0))
        assert found.accepted
        inner = (slice(25, -25), slice(5, -5))
        image, wanted = found.image[inner], wanted[inner]
        errors.append(error_db(np.vdot(image, wanted) / np.vdot(image, image) * image, wanted))
    # -24.5 to -21.2 dB measured; up to -19.3 dB with lines as far apart as the image's
    assert max(errors) < -20.3


def test_focused_image_stays(spotlight):
    block, polar, imager = spotlight
    image = imager(block)
    found = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M),
                          margin=0.05)(image)
    assert not found.accepted
    assert found.image is image


def test_noise_is_not_focused(spotlight):
    block, polar, imager = spotlight
    noise = np.random.default_rng(0).standard_normal((2, *block.samples.shape))
    image = imager(dataclasses.replace(block, samples=noise[0] + 1j * noise[1]))
    found = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M))(image)
    assert found.contrast_after > 1.005 * found.contrast_before  # it would be sharper,
    assert not found.accepted
    assert found.error_db > 0.0  # but half of the ranges says something else than the other half
    assert found.image is image


@pytest.mark.parametrize(('error_db', 'accepted'), [(-10.1, True), (-9.9, False)])
def test_a_sharper_image_is_taken_up_to_a_tenth_of_its_power_as_error(spotlight, monkeypatch,
                                                                      error_db, accepted):
    block, polar, imager = spotlight
    phase = smooth(np.linspace(-1, 1, block.n_pulses))
    image = imager(dataclasses.replace(
        block, samples=block.samples * np.exp(1j * phase)[:, None, None]))
    plan = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M))
    monkeypatch.setattr(plan, '_error_db', lambda image: error_db)
    assert plan(image).accepted is accepted


def test_correction_of_nothing_changes_nothing(spotlight):
    block, polar, imager = spotlight
    plan = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M))
    image = imager(block)
    again = plan.correct(image, np.zeros(len(plan.position_m)))
    assert error_db(again, image) < -100  # complex64


def test_refusals(spotlight):
    block, polar, _ = spotlight
    with pytest.raises(ValueError, match='too coarse for an aperture of 60.0 m'):
        PhaseGradient(polar, block.radar, (-30.0, 30.0))
    plan = PhaseGradient(polar, block.radar, (-HALF_APERTURE_M, HALF_APERTURE_M))
    with pytest.raises(ValueError, match=r'expected \(n_alpha, n_range\)=\(400, 160\)'):
        plan(np.zeros((3, 4), np.complex64))
