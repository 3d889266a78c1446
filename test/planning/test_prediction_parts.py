# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What predicted errors are made of: power of echoes, windows of profiles, interpolators."""

import dataclasses

import numpy as np
import pytest

from benchmarks.support.random_cases import random_case
from sar_imaging.backends.cpu.profiles import spectra
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.echo_power import chance_db, echo_cells, echo_power, echo_powers
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.profiles import RangeGate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters


def test_rows_from_one_place_have_the_power():
    case = random_case(1, 'straight')
    radar, wavelength = case.profiles.radar, case.profiles.radar.wavelength_m
    u = np.linspace(-1, 1, 200)
    moving = 1e3 * np.c_[-np.ones(200), 0.05 * u, 0 * u]
    standing = np.repeat(moving[-1:], 100, axis=0)
    track = np.concatenate([moving, standing])
    size = 40 * wavelength / 0.2  # 40 cells wide
    sides = [[size, 0, 0], [0, size, 0]]
    weight = echo_power(track, track, (0.0, 0.0, 0.0), sides, radar)
    assert weight.mean() == pytest.approx(1.0)
    image = np.zeros(400, complex)  # of scatterers everywhere, along the track
    y = np.linspace(-0.5, 0.5, 400) * size
    share = np.zeros(2)
    for part, rows in enumerate((moving, standing)):
        image[:] = 0
        for centre in rows:
            path = np.hypot(1e3, y - centre[1])
            image += np.exp(2j * np.pi * np.fmod(2 * path / wavelength, 1.0)
                            - 2j * np.pi * np.fmod(2 * np.hypot(1e3, y[200] - centre[1])
                                                   / wavelength, 1.0))
        share[part] = np.sum(np.abs(image) ** 2)
    # 200 rows in some 80 cells, 100 in one
    assert weight[200:].sum() / weight[:195].sum() == pytest.approx(share[1] / share[0], rel=0.5)


def test_what_one_place_sees_may_be_faint():
    """Speckle of so many ranges, drawn many times, is fainter than counted once in twenty."""
    radar, wavelength = RadarParameters(10e9, 20e6, 30e6, 0.0), SPEED_OF_LIGHT / 10e9
    u = np.linspace(-1, 1, 100)
    track = 1e3 * np.c_[-np.ones(300), 0.05 * np.append(u, np.ones(200)), np.zeros(300)]
    sides = [[30.0, 0, 0], [0, 40 * wavelength / 0.2, 0]]
    powers = echo_powers(track, track, (0.0, 0.0, 0.0), sides, radar)
    assert powers.shape == (3, 300)
    assert (powers[2] == 1.0).all()  # of noise
    np.testing.assert_allclose(powers[0], echo_power(track, track, (0.0, 0.0, 0.0), sides, radar))
    # of those that stand to those that move
    faint = np.divide(*(power[105:].mean() / power[:95].mean() for power in powers[1::-1]))
    n_ranges = 30.0 / radar.range_resolution_m  # 4 that are resolved
    speckle = np.random.default_rng(1).gamma(n_ranges, 1 / n_ranges, 40_000)
    # most of the power is that of the halt: measured 0.053
    assert np.mean(speckle < faint) == pytest.approx(0.05, abs=0.02)
    # a track without halts has one case only, a halt before a deep scene that of noise besides
    assert len(echo_powers(track[:100], track[:100], (0.0, 0.0, 0.0), sides, radar)) == 1
    sides[0][0] = 4000.0
    assert len(echo_powers(track, track, (0.0, 0.0, 0.0), sides, radar)) == 2


@pytest.mark.parametrize('side_m', [2.0, 5.0, 10.0])
def test_resolution_cells_are_those_of_the_textbook(side_m):
    """Of a broadside track: band over c / 2, and angle over half a wavelength.

    Echoes are shared out to two neighbouring cells each, which makes of n effectively 2 n / 3.
    """
    radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-6)
    track = np.c_[np.full(400, -1e3), np.linspace(-50, 50, 400), np.zeros(400)]
    cells = (side_m * 2 * radar.bandwidth_hz / SPEED_OF_LIGHT) * (
        side_m * 2 / radar.wavelength_m * 0.1)
    found = echo_cells(track, track, np.zeros(3), side_m * np.eye(3)[:2], radar)
    assert found == pytest.approx(2 / 3 * cells, rel=0.1)
    assert echo_cells(track, track, np.zeros(3), np.zeros((2, 3)), radar) == pytest.approx(1.0)


def test_few_cells_err_more_by_chance_and_many_do_not():
    chances = [chance_db(n, 0.5) for n in (1, 16, 20, 40, 64, 1e6)]
    assert chances == sorted(chances, reverse=True)
    assert chances[0] == chances[1] > 6.0 and chances[-2] == chances[-1] == 0.5


def test_error_at_a_frequency_is_that_of_a_tone():
    interpolator = design_interpolator(1.3, taps=14, degree=5)
    t = np.linspace(0, 1, 200)
    for frequency in (0.1, 0.3, 0.38, 0.42):
        tones = np.exp(2j * np.pi * frequency * (np.arange(14) + interpolator.first))
        read = tones @ (interpolator.weights.T.astype(float) @ t ** np.arange(6)[:, None])
        measured = np.mean(np.abs(read - np.exp(2j * np.pi * frequency * t)) ** 2)
        assert 10 * np.log10(interpolator.error_at(frequency)) == pytest.approx(
            10 * np.log10(measured), abs=0.3)  # quadrature and table
    assert interpolator.error_at(0.6) == 2.0


@pytest.mark.parametrize('chirp', [5e-4, 3e-3, 0.02, 0.1])
def test_error_of_a_chirp_is_that_of_a_tone_that_bends(chirp):
    interpolator = design_interpolator(1.9, taps=10, degree=5)
    t = np.linspace(0, 1, 200)
    for frequency in (-0.2, 0.0, 0.1, 0.23):
        def read_from(place, frequency=frequency):  # phases are from the middle of the interval
            return np.exp(1j * (2 * np.pi * frequency * place + chirp * (place - 0.5) ** 2))
        read = read_from(np.arange(10) + interpolator.first) @ (
            interpolator.weights.T.astype(float) @ t ** np.arange(6)[:, None])
        measured = np.mean(np.abs(read - read_from(t)) ** 2)
        (found,) = interpolator.error_of_chirps(np.array([frequency]), np.array([chirp]))
        # between the chirps of a table, at frequencies of it: measured 0.6 dB
        assert 10 * np.log10(found) == pytest.approx(10 * np.log10(measured), abs=1.0)
    assert interpolator.error_of_chirps(np.array([0.1]), np.array([1.0])) == 2.0


def test_error_with_drift_is_that_of_positions_that_drift():
    interpolator = design_interpolator(2.4, 0.5, degree=4)
    rng = np.random.default_rng(1)
    frequency = rng.uniform(0, 0.5 / 2.4, 400)
    for drift in (0.0, 0.2, 0.5):
        t = rng.random(400) + drift * rng.uniform(-1, 1, 400)
        tones = np.exp(2j * np.pi * np.outer(frequency, np.arange(10) + interpolator.first))
        read = tones @ (interpolator.weights.T.astype(float) @ t ** np.arange(5)[:, None])
        measured = np.mean(np.abs(read - np.exp(2j * np.pi * np.outer(frequency, t))) ** 2)
        assert 10 * np.log10(interpolator.error_with_drift(drift)) == pytest.approx(
            10 * np.log10(measured), abs=0.5)  # 400 tones


@pytest.mark.parametrize('oversampling', [1.14, 1.24, 1.4, 1.58])
def test_gain_of_a_spectrum_stays_near_its_line(oversampling):
    """Sharp features beyond the band would spread what tapers do: -41 dB over all lines."""
    interpolator = design_interpolator(oversampling, taps=6, degree=5, deapodised=True)
    n = 512
    kernel = np.abs(np.fft.ifft(interpolator.gain(np.fft.fftfreq(n))))
    far = kernel[40:n - 40].max() / kernel.max()
    assert 20 * np.log10(far) < -70.0


@pytest.mark.parametrize(('first', 'last'), [(0.0, 0.3), (0.35, 1.0)])
def test_what_the_ends_of_a_window_cost(make_case, first, last):
    """Of band-limited noise, read as far from the ends as half the reach and more."""
    radar = make_case(1e3, pulses=2).block.radar
    n = 1024
    rng = np.random.default_rng(2)
    spectrum = rng.normal(size=(64, n)) + 1j * rng.normal(size=(64, n))
    spectrum[:, np.abs(np.fft.fftfreq(n)) > 0.5 * radar.bandwidth_hz / radar.sample_rate_hz] = 0
    samples = np.fft.ifft(spectrum).astype(np.complex64)
    spacing = SPEED_OF_LIGHT / 2 / radar.sample_rate_hz
    start = radar.range_start_m
    reach = start + first * n * spacing, start + last * n * spacing
    window = RangeGate.around(radar, n, reach)
    back = np.fft.ifft(spectra(window, samples, window.n_samples, lambda *a: np.empty(*a[1:]))
                       * window.gain(window.n_samples) * window.n_samples)
    place = np.arange(window.n_samples)
    expected = window.end_error(window.range_start_m + place * spacing)
    error = np.mean(np.abs(back - samples[:, window.first:][:, :window.n_samples]) ** 2, axis=0)
    error /= np.mean(np.abs(samples) ** 2)
    some = (expected < 1e-3) & (expected > 1e-9)  # above float32
    assert some.sum() > 10
    ratio = 10 * np.log10(error[some] / expected[some])
    assert np.median(np.abs(ratio)) < 3.0 and ratio.max() < 6.0


@pytest.mark.parametrize('oversampling', [1.34, 2.0, 3.0])
@pytest.mark.parametrize('target_db', [-50.0, -70.0, -80.0])
@pytest.mark.parametrize('points', [False, True])
def test_profiles_that_are_full_to_their_ends(oversampling, target_db, points):
    """Clutter everywhere, cut by the profiles' ends a few metres beside the map.

    The range grid is coarser than these samples. Without a taper up to its own highest frequency
    the ends rang over the map, 14 dB above the prediction at worst.
    """
    rng = np.random.default_rng(0)
    spacing_m = SPEED_OF_LIGHT / 2 / (oversampling * 300e6)
    n, start_m, n_pulses = round(68.0 / spacing_m), 968.0, 48
    radar = RadarParameters(10e9, 300e6, oversampling * 300e6, 2 * start_m / SPEED_OF_LIGHT)
    longer = dataclasses.replace(
        radar, first_sample_delay_s=2 * (start_m - n * spacing_m) / SPEED_OF_LIGHT)
    whole = rng.normal(size=(n_pulses, 1, 4 * n, 2)).view(complex)[..., 0]
    whole[..., np.abs(np.fft.fftfreq(4 * n)) * oversampling > 0.5] = 0.0
    samples = np.fft.ifft(whole).astype(np.complex64)
    centres = np.zeros((n_pulses, 1, 3))
    centres[:, 0, 1] = np.linspace(-15.0, 15.0, n_pulses)
    numbers = np.arange(n_pulses)
    block = PulseBlock(radar, True, numbers, numbers, samples[..., n:2 * n], centres, centres)
    grid = MapGrid((1000.0, 0.0, 0.0), 48, 48, 1.1)
    formed = plan_image(grid.points() if points else grid, radar, n, method='exact',
                        target_db=target_db)(block)
    some = rng.choice(48 * 48, 600, replace=False)
    image = formed.samples.reshape(-1)[some]
    exact, covered = correlate_profiles(dataclasses.replace(block, radar=longer, samples=samples),
                                        grid.points().reshape(-1, 3)[some])
    assert covered.all()
    error = np.sum(np.abs(image - exact) ** 2) / np.sum(np.abs(exact) ** 2)
    # measured: 9 dB below to 2.0 dB above the prediction, of which places at the edge are few
    assert 10 * np.log10(error) <= formed.report.predicted_error_db + 2.5
