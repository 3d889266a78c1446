# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP and exact images of phase histories without range compression, against correlation."""

import dataclasses
import functools
import itertools

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid, PlaneGrid, TerrainGrid, VolumeGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.profiles import PhaseHistory
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor

RANGE_M = 3e3


@functools.cache
def _block(n_frequencies, *, channels=1, pulses=192, n_side=96):
    """Phase history of random scatterers on a map of 48 m, referred to its middle."""
    rng = np.random.default_rng(4)
    reference_s = 2 * RANGE_M / SPEED_OF_LIGHT
    radar = RadarParameters(10e9, 300e6, 300e6, reference_s,
                            waveform=Waveform.STEPPED_FREQUENCY)
    tx = np.zeros((pulses, channels, 3))
    tx[..., 0] = -RANGE_M
    tx[..., 1] = 90.0 * np.linspace(-0.5, 0.5, pulses)[:, None]
    rx = tx.copy()
    rx[..., 1] += 0.015 * np.arange(channels)
    points = np.c_[(rng.random((40, 2)) - 0.5) * 0.5 * n_side, np.zeros(40)]
    delay_s = sum(np.linalg.norm(a[:, :, None] - points, axis=-1)
                  for a in (tx, rx)) / SPEED_OF_LIGHT - reference_s
    frequency = 10e9 + (np.arange(n_frequencies) - (n_frequencies - 1) / 2) * 300e6 / n_frequencies
    samples = np.exp(-2j * np.pi * np.multiply.outer(delay_s, frequency)).sum(axis=2)
    return PulseBlock(radar, False, np.arange(pulses), np.arange(pulses),
                      samples, tx, rx), MapGrid((0.0, 0.0, 0.0), n_side, n_side, 0.5)


def _plan(block, grid, target_db=-50.0, **options):
    return plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m, method='afbp',
                      target_db=target_db, compressed=False, **options)


@pytest.mark.parametrize('target_db', [-50.0, -70.0])
@pytest.mark.parametrize(('n_frequencies', 'channels'), [(256, 1), (255, 1), (128, 1), (256, 5)])
def test_target_is_met(n_frequencies, channels, target_db):
    """With 128 frequencies the period, 64 m, ends within the guards."""
    block, grid = _block(n_frequencies, channels=channels)
    plan = _plan(block, grid, target_db=target_db)
    error = measure_error(plan(block), grid, block, fit_scale=True)
    assert max(error.error_db, error.brightest_error_db) <= target_db
    assert not plan.report.warnings
    assert np.isfinite([*plan.report.errors_db.values()]).all()


def test_it_is_the_image_of_compressed_profiles():
    block, grid = _block(256)
    profiles = RangeCompressor.for_block(block, window='hamming')(block)
    other = plan_image(grid, profiles.radar, profiles.n_samples, profiles.tx_m, profiles.rx_m,
                       method='afbp', target_db=-70.0)(profiles).samples
    image = _plan(block, grid, weighting='hamming', target_db=-70.0)(block).samples
    # Both are within -70 dB of the exact image, and each its own way off it.
    difference = np.sum(np.abs(image - other) ** 2) / np.sum(np.abs(other) ** 2)
    assert 10 * np.log10(difference) <= -67.0


def test_pulses_are_weighted():
    block, grid = _block(256)
    weights = np.hamming(block.n_pulses)
    weighted = dataclasses.replace(block, samples=block.samples * weights[:, None, None])
    image = _plan(block, grid, pulse_weights=weights)(block).samples
    np.testing.assert_allclose(image, _plan(block, grid)(weighted), rtol=1e-4,
                               atol=1e-5 * np.abs(image).max())
    with pytest.raises(ValueError, match='192 finite numbers'):
        _plan(block, grid, pulse_weights=weights[1:])(block)


def test_scenes_beyond_the_unambiguous_range_are_warned_about():
    block, grid = _block(64)
    plan = _plan(block, grid)
    assert any('64 frequencies tell apart' in warning for warning in plan.report.warnings)


def test_the_carrier_is_a_frequency_of_the_pulse():
    for n_frequencies in (8, 9):
        band = PhaseHistory(_block(n_frequencies)[0].radar, n_frequencies)
        frequency = 10e9 + (np.arange(n_frequencies) - (n_frequencies - 1) / 2) * (
            300e6 / n_frequencies)
        assert frequency[band.zero] == pytest.approx(band.radar.carrier_hz, rel=1e-12)


def test_what_does_not_fit_is_refused():
    block, grid = _block(256)
    with pytest.raises(ValueError, match='apply range compression'):
        PhaseHistory(dataclasses.replace(block.radar, waveform=Waveform.LFM, pulse_length_s=1e-6,
                                      chirp_rate_hz_per_s=3e14), 256)
    profiles = RangeCompressor.for_block(block)(block)
    with pytest.raises(ValueError, match='plan is for raw pulses'):
        _plan(block, grid)(profiles)
    with pytest.raises(ValueError, match='is for phase histories'):
        plan_image(grid, profiles.radar, profiles.n_samples, profiles.tx_m, profiles.rx_m,
                   method='afbp', target_db=-50.0, weighting='hamming')


_MAP = MapGrid((0.0, 0.0, 0.0), 96, 64, 0.5)
_EXACT = {  # by the route that each leads to
    'groups': MapGrid((0.0, 0.0, 0.0), 192, 192, 0.25),
    'lines': PlaneGrid((-24.0, -16.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.01), 96, 64),
    'volume': VolumeGrid.above(dataclasses.replace(_MAP, n_x=32), 1.0, 0.5),
    'points': TerrainGrid(_MAP, 0.02 * np.add.outer(np.arange(64.0), np.arange(96.0)))}


@pytest.mark.parametrize(('grid', 'n_frequencies', 'target_db'), [
    (grid, n, target_db) for grid, (n, target_db) in itertools.product(
        _EXACT, [(256, -60.0), (251, -80.0)])])  # 251 is prime
def test_exact_images_keep_their_word(grid, n_frequencies, target_db):
    block, _ = _block(n_frequencies, channels=2)
    image = plan_image(_EXACT[grid], block.radar, block.n_samples, method='exact',
                       target_db=target_db, compressed=False)(block)
    plan = image.report.plan
    assert plan.route.window.periodic
    assert plan.method == {'volume': 'lines'}.get(grid, grid)
    error = measure_error(image, _EXACT[grid], block, fit_scale=True)
    assert max(error.error_db, error.brightest_error_db) <= image.report.predicted_error_db + 1.0
    assert image.report.predicted_error_db <= target_db + 0.1 and not image.report.warnings
    assert np.isfinite([*image.report.errors_db.values()]).all()  # JSON knows no other numbers


def test_exact_images_are_in_the_scale_of_profiles():
    block, grid = _block(256)
    profiles = RangeCompressor.for_block(block, window='hamming')(block)
    other = plan_image(grid, profiles.radar, profiles.n_samples, method='exact',
                       target_db=-80.0)(profiles)
    image = plan_image(grid, block.radar, block.n_samples, method='exact', target_db=-80.0,
                       weighting='hamming', compressed=False)(block)
    difference = np.sum(np.abs(image - other.samples) ** 2) / np.sum(np.abs(other) ** 2)
    assert 10 * np.log10(difference) <= -77.0  # each is within -80 dB


def test_profiles_end_where_an_exact_image_reaches_beyond_the_period():
    """As range compression ends them, whose image this is; phase histories would repeat."""
    block, grid = _block(64)  # tell 32 m apart, the map has 48
    profiles = RangeCompressor.for_block(block)(block)
    wanted = plan_image(grid, profiles.radar, profiles.n_samples, method='exact')(profiles)
    imager = plan_image(grid, block.radar, block.n_samples, method='exact', compressed=False)
    for _ in range(2):
        image = imager(block)
        np.testing.assert_array_equal(image.samples, wanted.samples)
        assert image.report.warnings == wanted.report.warnings != ()


def test_dark_exact_images_tell_as_those_of_profiles():
    block, _ = _block(256, pulses=256)
    profiles = RangeCompressor.for_block(block)(block)
    beside = MapGrid((0.0, 60.0, 0.0), 96, 64, 0.5)  # in the same ranges as all that is bright
    dark = [plan_image(beside, p.radar, p.n_samples, method='exact', compressed=p.compressed)(
        p).report for p in (block, profiles)]
    assert all('bright surroundings' in report.errors_db for report in dark)
    powers = [report.pulse_power for report in dark]
    # 512 pairs each, of other echoes and places: 0.2 dB each, three standard deviations
    assert abs(10 * np.log10(powers[0] / powers[1])) < 0.9


@pytest.mark.parametrize('method', ['auto', 'exact', 'afbp'])
def test_images_of_raw_pulses_agree_with_those_of_profiles(method):
    raw, grid = _block(256)
    profiles = RangeCompressor.for_block(raw)(raw)
    wanted = plan_image(grid, profiles.radar, profiles.n_samples, method='exact',
                        target_db=-80.0)(profiles)
    imager = plan_image(grid, raw.radar, raw.n_samples, method=method, compressed=False)
    # to a target of -60 dB; measured -66 dB for AFBP
    assert 10 * np.log10(np.sum(np.abs(imager(raw) - wanted.samples) ** 2)
                         / np.sum(np.abs(wanted.samples) ** 2)) <= -60.0
