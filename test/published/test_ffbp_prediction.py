# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Predicted errors of FFBP hold over random geometries, samplings and scenes."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np
import pytest
import scipy.fft

from benchmarks.support.random_cases import random_case
from sar_imaging.imaging.correlation import correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.published.ffbp import plan_ffbp
from sar_imaging.quality.verification import measure_error
from sar_imaging.simulation.echoes import scene_spectrum, two_way_delays

# Coarsest oversampling to draw from: below it kernels make noise of an image.
COARSEST = {'knab8': 1.4, 'cubic': 1.6, 'linear': 2.0}
MOST_DB, MEDIAN_DB = 3.0, -10.0  # measured minus predicted


@pytest.fixture(autouse=True)
def one_thread():
    """Images are so small that threads wait for each other."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(threads)


def drawn_imager(seed):
    """A random case and an imager of random options, or of a random target."""
    rng, case = np.random.default_rng([seed, 7]), random_case(seed)
    profiles, per_subaperture = case.profiles, int(rng.integers(2, 25))
    if seed % 2:
        options = {'target_db': -rng.uniform(15, 75)}
    else:
        kernel = str(rng.choice(list(COARSEST)))
        along_range, along_alpha = COARSEST[kernel] * rng.uniform(1.0, 2.2, 2)
        options = {'kernel': kernel, 'merge_factor': int(rng.integers(2, 9)),
                   'range_oversampling': along_range, 'angle_oversampling': along_alpha}
    return rng, case, imager_for(case.grid, profiles, pulses_per_subaperture=per_subaperture,
                                 **options)


def imager_for(grid, block, **options):
    return plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m, method='ffbp',
                      **options)


def band_noise(rng, block):
    """Profiles that are bright at all ranges and frequencies, other ones from pulse to pulse."""
    n, radar = block.n_samples, block.radar
    half = int(0.5 * radar.bandwidth_hz / radar.sample_rate_hz * n)
    spectra = rng.standard_normal((*block.tx_m.shape[:2], 2 * half + 1, 2)).view(complex)[..., 0]
    return with_spectra(block, spectra)


def corner_scatterers(grid, block):
    """Four scatterers of the same size near the corners of the map."""
    n, radar = block.n_samples, block.radar
    step = radar.sample_rate_hz / n
    half = int(0.5 * radar.bandwidth_hz / step)
    points = grid.points()[[2, 2, -3, -3], [2, -3, 2, -3]]
    return with_spectra(block, scene_spectrum(
        radar.carrier_hz, -half, 2 * half + 1, step, two_way_delays(block.tx_m, block.rx_m,
                                                                    points),
        np.ones(4), radar.first_sample_delay_s))


def with_spectra(block, spectra):
    half = spectra.shape[-1] // 2
    padded = np.zeros((*spectra.shape[:2], block.n_samples), complex)
    padded[..., np.arange(-half, half + 1)] = spectra
    return dataclasses.replace(block, samples=scipy.fft.ifft(padded).astype(np.complex64))


def error_db(image, points, block):
    reference, covered = correlate_profiles(block, points)
    power = np.sum(np.abs(reference[covered]) ** 2)
    return 10 * np.log10(np.sum(np.abs(image - reference)[covered] ** 2) / power)


def test_errors_stay_within_their_prediction():
    """Scenes of scatterers within the map and beyond it, with noise or without."""
    above = []
    for seed in range(100):
        if len(above) == 64:
            break
        try:
            _, case, imager = drawn_imager(seed)
        except ValueError:  # too near, around or below: nothing to measure
            continue
        if imager.report.warnings:  # profiles that are too short
            continue
        image = imager(case.profiles).samples * np.float32(case.scale)
        found = measure_error(image, case.grid, case.pulses, n_pixels=80, n_brightest=40)
        above.append(found.error_db - imager.report.predicted_error_db)
    assert len(above) == 64
    assert max(above) <= MOST_DB  # measured: 1.0
    assert np.median(above) >= MEDIAN_DB  # measured: -3.0


@pytest.mark.parametrize('seed', range(200, 216))
def test_full_bands_and_bright_corners_stay_within_their_prediction(seed):
    try:
        rng, case, imager = drawn_imager(seed)
    except ValueError as reason:
        pytest.skip(str(reason))
    if imager.report.warnings:
        pytest.skip(imager.report.warnings[0])
    points = case.grid.points()
    noise = band_noise(rng, case.profiles)
    image, most_db = imager(noise).samples, imager.report.predicted_error_db + MOST_DB
    rows, columns = (n // 8 for n in image.shape)
    for part in (np.s_[::9, ::9], np.s_[:rows:3, :columns:3], np.s_[-rows::3, -columns::3]):
        assert error_db(image[part].ravel(), points[part].reshape(-1, 3), noise) <= most_db
    corners = corner_scatterers(case.grid, case.profiles)
    image = imager(corners).samples.ravel()
    bright = np.argsort(np.abs(image))[-200:]
    assert error_db(image[bright], points.reshape(-1, 3)[bright], corners) <= most_db


@pytest.mark.parametrize(('kernel', 'along_range', 'along_alpha'), [
    ('knab8', 1.8, 1.8), ('cubic', 2.5, 2.5), ('knab8', 3.0, 3.0), ('linear', 6.0, 8.0)])
def test_many_interpolations_in_a_row(make_case, kernel, along_range, along_alpha):
    """Places along range are alike within a level: their errors add up over nine levels."""
    block = (case := make_case(1e4, pulses=1024)).block
    imager = imager_for(case.grid, block, pulses_per_subaperture=2, merge_factor=2, kernel=kernel,
                        range_oversampling=along_range, angle_oversampling=along_alpha)
    assert len(imager.report.plan.levels) == 9
    noise = band_noise(np.random.default_rng(0), block)
    for some in (block, noise):
        image = imager(some)
        found = measure_error(image.samples, case.grid, some, n_pixels=100, n_brightest=60)
        # measured: -3.0 to -1.1 dB
        assert -8.0 <= found.error_db - image.report.predicted_error_db <= MOST_DB


@pytest.mark.parametrize(('range_m', 'options'), [
    (1e3, {}), (1e4, {'channels': 3}), (1e3, {'bend_m': 5.0}), (100.0, {'spacing_m': 0.1})])
@pytest.mark.parametrize('target_db', [-20.0, -40.0, -60.0, -70.0])
def test_targets_are_met_and_not_missed_by_far(make_case, range_m, options, target_db):
    case = make_case(range_m, pulses=72, **options)
    block = case.block
    image = imager_for(case.grid, block, target_db=target_db, pulses_per_subaperture=8)(block)
    assert image.report.predicted_error_db <= target_db
    found = measure_error(image.samples, case.grid, block, n_pixels=150, n_brightest=100)
    assert found.error_db <= target_db


def test_lower_targets_cost_more(make_case):
    case = make_case(1e3, pulses=128)
    block = case.block
    plans = [plan_ffbp(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                       target_db=t) for t in (-20.0, -40.0, -60.0, -70.0)]
    assert np.all(np.diff([plan.seconds for plan in plans]) > 0)
    assert plans[0].sampling.kernel != plans[-1].sampling.kernel == 'knab8'


def test_what_is_out_of_reach_is_refused_with_what_is_not(make_case):
    block = (case := make_case(1e3, pulses=128)).block
    arguments = case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m
    with pytest.raises(ValueError, match=r'reaches -8\d\.\d dB here, target_db=-90'):
        plan_ffbp(*arguments, target_db=-90.0, pulses_per_subaperture=2)
    with pytest.raises(ValueError, match=r'reaches -3\d\.\d dB here, target_db=-60'):
        plan_ffbp(*arguments, target_db=-60.0, kernel='linear')
    with pytest.raises(ValueError, match='expected -90 to -10 dB'):
        plan_ffbp(*arguments, target_db=-5.0)
