# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Zero-padded backprojection against the paper's equations and time-domain correlation."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.published.zero_padding import DELAYS, INTERPOLATORS, predicted_error_db
from sar_imaging.quality import error_db
from sar_imaging.signal import SPEED_OF_LIGHT
from sar_imaging.signal.spectra import band_spectrum

SETTINGS = [('nearest', 20), ('nearest', 50), ('nearest', 150), ('linear', 4), ('linear', 50),
            ('cubic', 2), ('cubic', 8), ('sinc', 1), ('sinc', 2), ('sinc', 4)]


@pytest.fixture(scope='module')
def case(make_case):
    # Turned, so that no coordinate of an antenna is zero.
    return make_case(1e3, channels=2, height_m=300.0, n=32, heading_rad=0.4)


def _imager(case, points=None, *, interpolator='nearest', **options):
    return plan_image(case.grid if points is None else points, case.block.radar,
                      case.block.n_samples, method='zero-padding', interpolator=interpolator,
                      **options)


def _image(case, points=None, **options):
    return _imager(case, points, **options)(case.block).samples


def _reference(block, points):
    return correlate(*band_spectrum(block), block.tx_m, block.rx_m, points)


@pytest.mark.parametrize(('interpolator', 'ratio'), SETTINGS)
def test_error_of_a_read_is_predicted(make_case, interpolator, ratio):
    # One scatterer has a flat spectrum, one pulse leaves nothing to average out, random points
    # over the whole profile catch all its energy and spread evenly between samples. The outermost
    # of 73 frequencies stand on the edge of the band, where cubic's error, the eighth power of
    # frequency, is largest: 0.45 dB more than of a continuous band.
    case = make_case(1e3, n=32, n_points=1, pulses=3)
    pulse, radar = case.block.select(slice(1, 2)), case.block.radar
    length = case.block.n_samples * radar.sample_spacing_m
    x = radar.range_start_m + np.random.default_rng(3).uniform(0, length, 20_000)
    points = pulse.tx_m[0, 0] + np.stack([x, 0 * x, 0 * x], axis=-1)
    image = _imager(case, points, interpolator=interpolator, ratio=ratio)(pulse)
    error = error_db(image.samples, _reference(pulse, points))
    assert error == pytest.approx(image.report.errors_db['range profiles'], abs=0.7)


@pytest.mark.parametrize(('interpolator', 'ratio'), SETTINGS)
def test_prediction_of_an_image_is_not_optimistic(case, interpolator, ratio):
    image = _imager(case, interpolator=interpolator, ratio=ratio)(case.block)
    error = error_db(image.samples, _reference(case.block, case.grid.points()))
    assert error <= image.report.predicted_error_db + 1.0


@pytest.mark.parametrize(('ratio', 'limit_db'), [(2, -72.0), (4, -95.0)])
def test_the_window_of_the_sinc_is_nearly_the_best(make_case, ratio, limit_db):
    """The best of all Kaiser windows of this length has -78.9 and -98.5 dB (by a scan)."""
    radar = make_case(1e3, pulses=2).block.radar
    assert (radar.bandwidth_hz, radar.sample_rate_hz) == (300e6, 400e6)
    assert predicted_error_db('sinc', ratio, radar) < limit_db


def test_nearest_is_predicted_in_closed_form(make_case):
    radar = make_case(1e3, pulses=2).block.radar
    # 10 GHz and 3 % bandwidth at 100 * 400 MHz: a quarter of a cycle per sample, over which the
    # band changes little (below 0.01 dB).
    expected = 10 * np.log10(2 - 2 * np.sinc(0.25))
    assert predicted_error_db('nearest', 100, radar) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize('delay', DELAYS)
def test_equations_14_to_19_as_written(case, delay):
    """Pixel by pixel in float64; the float32 transforms leave 1e-5."""
    block, ratio = case.block, 60
    radar, n = block.radar, block.n_samples
    points = case.grid.points()[::9, ::9].reshape(-1, 3)
    time_s = radar.first_sample_delay_s + np.arange(n * ratio) / (ratio * radar.sample_rate_hz)
    w_c = 2 * np.pi * radar.carrier_hz
    expected = np.zeros(len(points), complex)
    for m in range(block.n_pulses):
        reference = (block.tx_m[m].mean(axis=0) + block.rx_m[m].mean(axis=0)) / 2
        for c in range(block.n_channels):
            spectrum = np.fft.fftshift(np.fft.fft(block.samples[m, c]))
            padded = np.zeros(n * ratio, complex)
            padded[(n * ratio - n) // 2:][:n] = spectrum                            # (14)
            profile = np.fft.ifft(np.fft.ifftshift(padded)) * ratio
            profile *= np.exp(1j * w_c * time_s)                                    # (15)
            tx, rx = block.tx_m[m, c], block.rx_m[m, c]
            exact = (np.linalg.norm(points - tx, axis=1)
                     + np.linalg.norm(points - rx, axis=1)) / SPEED_OF_LIGHT
            temporal = 2 * np.linalg.norm(points - reference, axis=1) / SPEED_OF_LIGHT  # (1)
            middle = 2 * np.linalg.norm(points - (tx + rx) / 2, axis=1) / SPEED_OF_LIGHT
            tau = {'exact': exact, 'midpoint': middle, 'steering': temporal}[delay]
            nearest = np.abs(time_s[:, None] - tau).argmin(axis=0)                  # (16)
            steering = np.exp(-1j * w_c * (exact - temporal)) if delay == 'steering' else 1.0
            expected += np.conj(steering) * profile[nearest]                        # (17, 19)
    assert error_db(_image(case, points, ratio=ratio, delay=delay), expected) < -100.0


def test_steering_and_midpoint_are_approximations(make_case):
    # Antennas up to 30 mm from the transmitter at 15 m: the midpoint misses up to 15 um of path,
    # 0.2 degrees; the reference antenna's delay misses the envelope by up to 8 mm of 0.5 m.
    case = make_case(15.0, channels=5, n=24, aperture_m=20.0)
    reference = _reference(case.block, case.grid.points())
    errors = {delay: error_db(_image(case, interpolator='cubic', ratio=20, delay=delay),
                              reference) for delay in DELAYS}
    assert errors['exact'] < -105.0
    assert errors['midpoint'] == pytest.approx(-58.0, abs=3.0)
    assert errors['steering'] == pytest.approx(-42.0, abs=3.0)


def test_points_have_the_image_of_the_grid(case):
    grid = _image(case, ratio=50)
    points = _image(case, case.grid.points(), ratio=50)
    assert grid.shape == case.grid.shape and grid.dtype == np.complex64
    assert np.array_equal(grid, points)


@pytest.mark.parametrize('interpolator', INTERPOLATORS)
def test_pulses_are_taken_in_parts(case, interpolator, monkeypatch):
    whole = _image(case, interpolator=interpolator, ratio=10)
    monkeypatch.setattr('sar_imaging.published.zero_padding.CHUNK_BYTES', 1)
    # Another order of the same float64 sums, rounded once to float32; SciPy 1.18 also rounds the
    # float32 spectrum of a pulse by how many it transforms at once.
    np.testing.assert_allclose(_image(case, interpolator=interpolator, ratio=10), whole,
                               rtol=0.0, atol=2e-7 * np.abs(whole).max())


@pytest.mark.parametrize('interpolator', INTERPOLATORS)
def test_ranges_outside_the_profile_contribute_nothing(case, interpolator):
    radar = case.block.radar
    x = radar.range_start_m + np.array([-3.0, 0.5, 1.5]) * case.block.n_samples \
        * radar.sample_spacing_m
    antenna = case.block.tx_m[0, 0]
    points = antenna + np.stack([x, 0 * x, 0 * x], axis=-1)
    image = _image(case, points, interpolator=interpolator, ratio=4)
    assert image[0] == 0 and image[2] == 0 and image[1] != 0
    with pytest.raises(ValueError, match='the profiles cover'):
        _image(case, points[[2]], interpolator=interpolator, ratio=4)
    none = _imager(case, points[[0, 2]], interpolator=interpolator, ratio=4)(case.block)
    assert not none.samples.any() and '100.0 % of the image is missing' in none.report.warnings[0]


def test_the_least_ratio_that_meets_the_target(case):
    for interpolator, target_db in (('sinc', -60.0), ('cubic', -60.0), ('sinc', -90.0)):
        plan = _imager(case, interpolator=interpolator, target_db=target_db)(
            case.block).report.plan
        half = _imager(case, interpolator=interpolator, ratio=plan.ratio // 2)(
            case.block).report.plan
        assert plan.predicted_error_db <= target_db < half.predicted_error_db
    assert _imager(case, target_db=-60.0)(case.block).report.plan.ratio == 16  # none does


def test_no_pulses_make_an_empty_image(case):
    assert not _imager(case, ratio=2)(case.block.select(slice(0, 0))).samples.any()


@pytest.mark.parametrize(('options', 'message'), [
    ({'interpolator': 'spline'}, 'use one of nearest, linear, cubic, sinc'),
    ({'ratio': 0}, 'positive integer'),
    ({'ratio': 2.5}, 'positive integer'),
    ({'delay': 'paper'}, 'use one of exact, midpoint, steering'),
    ({'points': np.zeros((4, 2))}, r'expected \(\.\.\., 3\)'),
    ({'points': np.full((4, 3), np.nan)}, 'finite'),
])
def test_wrong_options_are_named(case, options, message):
    with pytest.raises(ValueError, match=message):
        _image(case, **options)


def test_blocks_of_another_radar_are_refused(case):
    other = dataclasses.replace(case.block.radar, first_sample_delay_s=6e-6)
    with pytest.raises(ValueError, match='this plan is for'):
        _imager(case, ratio=2)(dataclasses.replace(case.block, radar=other))
