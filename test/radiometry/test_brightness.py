# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibrated brightness of simulated reflectors, rough surfaces and noise against the truth."""

import numpy as np
import pytest

from benchmarks.support.radiometry_scenes import GAIN, Flight, rough_surface
from sar_imaging.geometry import PlaneGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.impulse_response import measure_scatterer
from sar_imaging.radiometry import (
    RadarConstant,
    brightness,
    calibrated,
    equivalent_looks,
    image_response,
    multilook,
    noise_equivalent,
    noise_power,
    trihedral_cross_section_m2,
)


@pytest.mark.parametrize(('range_m', 'grazing_deg'), [(100.0, 40.0), (5e5, 50.0)])
def test_one_trihedral_calibrates_the_others(range_m, grazing_deg):
    """Of other sizes, elsewhere in the scene, dimmed by the pattern."""
    flight = Flight(range_m, grazing_deg, n=96, weighting='hamming')
    middle = np.array(flight.grid.centre_m)
    sizes = trihedral_cross_section_m2(np.array([0.3, 0.2, 0.5]), 0.03)
    places = middle + np.array([[-8.3, -7.2, 0], [7.4, 6.1, 0], [0.2, 8.3, 0]])
    pattern = Illumination.of_pulses(
        AntennaPattern(PatternCut.gaussian(30.0 / range_m)),
        Pointing.steered(flight.tx_m[:, 0], middle), flight.tx_m, flight.rx_m)
    block = flight.block(places, np.sqrt(sizes), pattern)
    taper = np.hamming(len(flight.tx_m))
    image = plan_image(flight.grid, flight.radar, flight.n_samples, pulse_weights=taper)(block)
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m,
                              illumination=pattern, weighting='hamming', pulse_weights=taper)
    peaks = [measure_scatterer(image.samples, flight.grid, place,
                               aperture_centre_m=flight.tx_m.mean(axis=(0, 1)),
                               wavenumber_rad_per_m=flight.radar.wavenumber_rad_per_m,
                               cut_half_width_range_m=4.0, cut_half_width_azimuth_m=4.0)
             .peak_amplitude for place in places]
    pixels = np.stack(flight.grid.to_pixels(places[:, 0], places[:, 1]), -1)
    gains = [RadarConstant.from_reflector(peak, pixel, response, size).gain
             for peak, pixel, size in zip(peaks, pixels, sizes, strict=True)]
    # 0.03 dB measured: sidelobes of the largest, 13 dB larger, on the smallest
    assert 20 * np.log10(np.array(gains) / GAIN) == pytest.approx(np.zeros(3), abs=0.1)


def test_rough_surface_has_its_sigma_nought_and_speckle():
    flight, sigma0 = Flight(1e3, n=96), 0.07
    points, amplitudes = rough_surface(flight, sigma0, np.random.default_rng(5))
    image = plan_image(flight.grid, flight.radar, flight.n_samples)(
        flight.block(points, amplitudes))
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m)
    inner = (slice(10, -10), slice(10, -10))
    level = brightness(image, response, RadarConstant(GAIN))[inner]
    scaled = calibrated(image, response, RadarConstant(GAIN))
    assert np.abs(scaled.samples[inner]) ** 2 == pytest.approx(level, rel=1e-5)
    cells = level.size * (flight.grid.spacing_m / flight.cell_m) ** 2
    # three standard deviations of the mean of so many independent cells: 0.2 dB
    assert 10 * np.log10(level.mean() / sigma0) == pytest.approx(0, abs=13 / np.sqrt(cells))
    # an exponential distribution has the variance of its squared mean; 12 % is three deviations
    assert equivalent_looks(level) == pytest.approx(1, abs=0.15)
    apart = level[::4, ::4].ravel()  # 2.4 cells apart: independent
    from scipy.stats import kstest  # 0.3 s, which each process that collects would spend
    assert kstest(apart / sigma0, 'expon').pvalue > 0.01
    looks = equivalent_looks(multilook(level, (5, 5)))
    # pixels k apart are alike by sinc(0.6 k); 0.2 is three deviations of so few blocks
    alike = sum((5 - abs(k)) * np.sinc(0.6 * k) ** 2 for k in range(-4, 5))
    assert looks == pytest.approx((5**2 / alike) ** 2, rel=0.2)
    ratio = brightness(image, response, RadarConstant(GAIN), 'beta0')[inner] / level
    assert ratio == pytest.approx(1 / np.cos(np.radians(40.0)), rel=0.02)
    gamma = brightness(image, response, RadarConstant(GAIN), 'gamma0')[inner] / level
    assert gamma == pytest.approx(1 / np.sin(np.radians(40.0)), rel=0.03)


def test_noise_has_the_noise_equivalent_level():
    flight, rng = Flight(1e3, n=128), np.random.default_rng(8)
    shape = (len(flight.tx_m), 1, flight.n_samples)
    spectrum = rng.normal(size=(*shape, 2)) @ [1, 1j]
    spectrum[..., abs(np.fft.fftfreq(shape[-1], 1 / flight.rate_hz)) > flight.bandwidth_hz / 2] = 0
    samples = np.fft.ifft(spectrum).astype(np.complex64)
    samples *= np.float32(np.sqrt(0.3 / np.mean(np.abs(samples) ** 2)))
    found = noise_power(samples)
    assert 0.25 < found < 0.3  # the quietest of many pieces is below the mean, by a tenth here
    image = plan_image(flight.grid, flight.radar, flight.n_samples)(flight.pulses(samples))
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m)
    constant = RadarConstant(GAIN, 0.3)
    level = brightness(image, response, constant)
    expected = noise_equivalent(response, constant)
    cells = level.size * 0.36
    assert 10 * np.log10((level / expected).mean()) == pytest.approx(0, abs=13 / np.sqrt(cells))


def test_multilook_leaves_out_what_is_unknown():
    power = np.array([[1.0, 3.0, np.nan], [np.nan, 5.0, np.nan], [7.0, 7.0, 7.0]])
    assert multilook(power, (2, 2)) == pytest.approx(np.array([[3.0]]))
    assert np.isnan(multilook(power, (1, 1))[0, 2])
    with pytest.raises(ValueError, match='rows and columns'):
        multilook(power, (4, 1))


@pytest.mark.parametrize(('make', 'message'), [
    (lambda response: RadarConstant(0.0), 'positive'),
    (lambda response: RadarConstant(1.0, -1.0), '0 or more'),
    (lambda response: RadarConstant.from_reflector(1.0, (99, 0), response, 1.0), 'place inside'),
    (lambda response: RadarConstant.from_reflector(1.0, (1, 1), response, 0.0), 'more than 0'),
    (lambda response: brightness(np.ones((3, 3)), response, RadarConstant(1.0)), 'shape'),
    (lambda response: brightness(np.ones((8, 8)), response, RadarConstant(1.0), 'sigma'),
     'expected one of rcs, beta0'),
    (lambda response: noise_power(np.ones(8)), '16 or more'),
])
def test_wrong_input_is_refused(make, message):
    flight = Flight(1e3, n=8)
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m)
    with pytest.raises(ValueError, match=message):
        make(response)


@pytest.mark.parametrize('quantity', ['sigma0', 'gamma0'])
def test_the_slant_plane_has_no_square_metres_of_ground(quantity):
    flight = Flight(1000.0, 40.0, n=32)
    grid = PlaneGrid.slant_plane(flight.tx_m[:, 0], flight.grid.centre_m, 8.0, 8.0, 0.5)
    response = image_response(grid, flight.radar, flight.tx_m, flight.tx_m)
    image, constant = np.ones(grid.shape, complex), RadarConstant(1.0)
    assert np.isfinite(brightness(image, response, constant, 'beta0')).all()
    with pytest.raises(ValueError, match=f'{quantity} is by square metre of the ground'):
        brightness(image, response, constant, quantity)
