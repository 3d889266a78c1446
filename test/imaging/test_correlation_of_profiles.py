# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Correlation of sampled profiles, and the error measured by it, for every waveform."""

import dataclasses
import pathlib

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate, correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.recordings import load
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.simulation.echoes import EchoSimulator

DATA = pathlib.Path(__file__).parents[3] / 'shared' / 'data'
RANGE_M = 100.0
GRID = MapGrid((RANGE_M, 0.0, 0.0), 64, 64, 0.25)


def _delay(range_m):
    return 2 * range_m / SPEED_OF_LIGHT


# Carriers and delays are no multiples of anything, so that no ramp closes over a profile.
RADARS = {
    'LFM': (RadarParameters(10.0123e9, 300e6, 400e6, _delay(68.3), 1e-6, 3e14), 800),
    'stepped frequency': (RadarParameters(
        10.0123e9, 300e6, 300e6, _delay(RANGE_M), waveform=Waveform.STEPPED_FREQUENCY), 96),
    'FMCW': (fmcw_parameters(start_frequency_hz=9.87e9, slope_hz_per_s=1e13, sample_rate_hz=11e6,
                             n_samples=330), 330),
    'passband': (RadarParameters(1.0123e9, 300e6, 4e9, _delay(80.1), waveform=Waveform.PASSBAND),
                 1100),
}


def _recording(radar, n_samples, *, pulses=24, seed=1):
    """Raw pulses of scatterers on the grid and up to the ends of the profiles."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(81.0, 119.0, 60)
    points = np.c_[along, rng.uniform(-8, 8, 60), np.zeros(60)]
    centres = np.zeros((pulses, 1, 3))
    centres[:, 0, 1] = np.linspace(-2.0, 2.0, pulses)
    samples = EchoSimulator(radar, n_samples, compressed=False, points_m=points,
                            amplitudes=np.exp(2j * np.pi * rng.random(60)))(centres, centres)
    return PulseBlock(radar, False, np.arange(pulses), np.arange(pulses), samples, centres,
                      centres)


@pytest.mark.parametrize('name', RADARS)
@pytest.mark.parametrize('window', ['none', 'hamming'])
def test_error_of_an_exact_image_keeps_its_prediction(name, window):
    raw = _recording(*RADARS[name])
    profiles = RangeCompressor.for_block(raw, window=window, oversampling=1.5)(raw)
    plan = plan_image(GRID, profiles.radar, profiles.n_samples, method='exact', target_db=-80.0)
    found = measure_error(plan(profiles), GRID, profiles)
    # A Fourier transform of the whole profile as reference gave -17 to -71 dB: profiles end
    # amid echoes, and those of a phase history repeat their beginning.
    assert found.error_db < plan.report.predicted_error_db + 1.5  # five deviations of the estimate
    assert found.covered_share == 1.0


def test_profiles_tell_what_their_phase_history_tells():
    raw = _recording(*RADARS['stepped frequency'])
    profiles = RangeCompressor.for_block(raw, oversampling=1.5)(raw)
    points = GRID.points().reshape(-1, 3)[::17]
    found, covered = correlate_profiles(profiles, points)
    expected = correlate(*band_spectrum(raw), raw.tx_m, raw.rx_m, points) / raw.n_samples
    assert covered.all()
    # float32 samples of the profiles: 1e-7; the series errs by 3e-7 at most
    assert np.linalg.norm(found - expected) < 5e-7 * np.linalg.norm(expected)


@pytest.mark.parametrize('oversampling', [1.1, 1.35, 3.0])
def test_series_is_as_exact_as_it_says_at_any_rate(make_case, oversampling):
    case = make_case(200.0, pulses=5)
    radar, n = case.block.radar, case.block.n_samples
    profiles = RangeCompressor(radar, n, compressed=True, oversampling=oversampling)(case.block)
    if oversampling < 400 / 300:  # coarser than what came: kept as it is; thin it out
        wanted = round(n * oversampling * 0.75)
        spectrum = np.fft.fft(case.block.samples.astype(complex))
        keep = wanted // 2
        cut = np.concatenate([spectrum[..., :wanted - keep], spectrum[..., n - keep:]], axis=-1)
        profiles = dataclasses.replace(
            case.block, samples=np.fft.ifft(cut) * wanted / n,
            radar=dataclasses.replace(radar, sample_rate_hz=radar.sample_rate_hz * wanted / n))
    points = case.grid.points().reshape(-1, 3)[::31]
    found, covered = correlate_profiles(profiles, points)
    expected = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m, points)
    assert covered.mean() > 0.3  # at 1.1 samples per bandwidth half a series is 55 samples long
    error = np.linalg.norm((found - expected)[covered]) / np.linalg.norm(expected[covered])
    assert error < 5e-7  # the series 3e-7, float32 samples 1e-7


def test_points_near_the_ends_of_profiles_are_not_covered():
    radar = RadarParameters(10e9, 300e6, 400e6, _delay(50.0))
    centres = np.zeros((1, 1, 3))
    block = PulseBlock(radar, True, [0], [0], np.ones((1, 1, 200)), centres, centres)
    place = np.arange(-40, 240)  # in samples
    points = np.zeros((place.size, 3))
    points[:, 0] = 50.0 + place * radar.sample_spacing_m
    image, covered = correlate_profiles(block, points)
    # asinh(10^6.5) = 15.66 and 1 - B / f_s = 1/4: half a series is 15.66 / pi * 4 = 19.9 samples.
    assert set(place[~covered]) == {*range(-19, 20), *range(180, 219)}
    inside = (place >= 0) & (place < 200)
    np.testing.assert_allclose(np.abs(image[covered]), inside[covered], atol=1e-6)


def _short_profiles():
    """Profiles that end within the grid, and the image of them."""
    raw = _recording(*RADARS['passband'])
    profiles = RangeCompressor.for_block(raw, oversampling=1.5)(raw)
    radar, first = profiles.radar, 46  # from 97 m on
    radar = dataclasses.replace(radar, first_sample_delay_s=radar.first_sample_delay_s
                                + first / radar.sample_rate_hz)
    profiles = dataclasses.replace(profiles, radar=radar, samples=profiles.samples[..., first:])
    return profiles, exact_image(GRID, profiles)


def test_pixels_near_the_ends_of_profiles_are_left_out():
    profiles, image = _short_profiles()
    found = measure_error(image, GRID, profiles, n_pixels=image.size, n_brightest=50)
    reference, covered = correlate_profiles(profiles, GRID.points().reshape(-1, 3))
    error = np.abs(image.reshape(-1) - reference)[covered]
    expected = 20 * np.log10(np.linalg.norm(error) / np.linalg.norm(reference[covered]))
    assert found.covered_share == covered.mean() and 0.4 < found.covered_share < 0.9
    assert found.error_db == pytest.approx(expected, abs=1e-6)
    assert found.error_db < -75.0  # measured: -77.3; the polar image spreads a little of the end
    assert f'{1 - covered.mean():.0%} of the pixels are left out' in str(found)
    # The others would spoil the figure: there the interpolators read beyond the profile.
    everywhere = np.linalg.norm(image.reshape(-1) - reference) / np.linalg.norm(reference)
    assert 20 * np.log10(everywhere) > -60.0


def test_random_pixels_stand_for_the_covered_ones():
    profiles, image = _short_profiles()
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((*image.shape, 2)) @ [1, 1j]
    image = image + 0.01 * np.abs(image).max() * noise
    whole = measure_error(image, GRID, profiles, n_pixels=image.size)
    part = measure_error(image, GRID, profiles, n_pixels=400, n_brightest=20)
    # About 280 covered pixels: five deviations of 4.3 / sqrt(280) dB, 0.3 dB for the power.
    assert part.error_db == pytest.approx(whole.error_db, abs=1.6)


def test_an_image_that_no_profile_covers_is_refused():
    profiles, image = _short_profiles()
    beside = dataclasses.replace(profiles, tx_m=profiles.tx_m + [0, 0, 300.0])
    near_end = MapGrid((97.5, 0.0, 0.0), 4, 4, 0.1)
    with pytest.raises(ValueError, match='none of 16 pixels is covered by all profiles'):
        measure_error(np.ones((4, 4)), near_end, profiles)
    with pytest.raises(ValueError, match='covered'):
        measure_error(np.ones((4, 4)), near_end, [profiles, beside])


@pytest.mark.parametrize(('change', 'message'), [
    ({'compressed': False}, 'compress raw pulses first'),
    ({'tx_m': None, 'rx_m': None}, 'give every pulse its position'),
    ({'samples': np.full((1, 1, 8), np.nan)}, 'samples contains NaN'),
    ({'radar': RadarParameters(10e9, 300e6, 310e6, 0.0)}, '1.05 times the bandwidth'),
])
def test_bad_profiles_are_named(change, message):
    centres = np.zeros((1, 1, 3))
    block = PulseBlock(RadarParameters(10e9, 300e6, 400e6, 0.0), True, [0], [0],
                       np.ones((1, 1, 8)), centres, centres)
    with pytest.raises(ValueError, match=message):
        correlate_profiles(dataclasses.replace(block, **change), np.ones((2, 3)))


def test_bad_points_are_named():
    centres = np.zeros((1, 1, 3))
    block = PulseBlock(RadarParameters(10e9, 300e6, 400e6, 0.0), True, [0], [0],
                       np.ones((1, 1, 8)), centres, centres)
    with pytest.raises(ValueError, match=r'points.shape=\(3,\); expected \(K, 3\)'):
        correlate_profiles(block, np.ones(3))
    with pytest.raises(ValueError, match='points contains NaN'):
        correlate_profiles(block, np.full((1, 3), np.nan))


def _measured(name):
    """Raw pulses with positions, and a grid of 100 to 500 pixels a side."""
    if name == 'gotcha_pass1_hh':
        return load(name[:6], DATA / name).block, MapGrid.from_size((0, 0, 0), 100, 100, 0.5)
    if name == 'bwsi2019_team6_rail':
        rail = load('team6_rail_fitted', DATA / name)
        track = rail.poses
        return locate(rail.block, track, rail.alignment), rail.scene.grid
    file = sorted((DATA / name).glob('*.bin'))[0]
    return (load('arcsar', file).block.select(slice(120, 280)),
            MapGrid.from_size((0, 3, 0), 6, 5, 0.03))


@pytest.mark.data
@pytest.mark.parametrize('name', ['gotcha_pass1_hh', 'bwsi2019_team6_rail', 'arcsar_77ghz'])
def test_images_of_measured_data_keep_their_prediction(name):
    if not (DATA / name).is_dir():
        pytest.skip(f'needs ../shared/data/{name} beside the repository')
    raw, grid = _measured(name)
    profiles = RangeCompressor.for_block(raw, window='hamming', oversampling=1.5)(raw)
    plan = plan_image(grid, profiles.radar, profiles.n_samples, method='exact', target_db=-80.0)
    found = measure_error(plan(profiles), grid, profiles)
    # Measured: -99.2, -92.5 and -97.1 dB, -82 to -84 dB predicted. A Fourier transform of the
    # whole profile as reference gave -54, -15 and -61 dB.
    assert found.error_db < plan.report.predicted_error_db + 1.5
    assert found.covered_share > 0.7
