# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Radar in the ground and sonar: waves of another speed, imaged by every imager.

Where all lengths and the speed shrink by the same power of two, all delays and phases stay what
they are to the last bit. So must images, whatever an imager does; one place that still takes the
waves for light would show.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from msg_conversions import subaperture_wire
from sar_imaging.exploitation.calibration import calibrate_at_reflector
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate, correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

SHRINK = 2.0 ** -10


def shrunk(case):
    """The case with lengths and speed shrunk."""
    grid, block = case.grid, case.block
    radar = dataclasses.replace(block.radar, propagation_speed_m_per_s=SHRINK * SPEED_OF_LIGHT)
    return dataclasses.replace(
        case, grid=MapGrid(SHRINK * np.array(grid.centre_m), grid.n_x, grid.n_y,
                           SHRINK * grid.spacing_m), points=SHRINK * case.points,
        block=dataclasses.replace(block, radar=radar, tx_m=SHRINK * block.tx_m,
                                  rx_m=SHRINK * block.rx_m))


def exact(case):
    return exact_image(case.grid, case.block)


def by_points(case):
    return exact_image(case.grid.points(), case.block)


def afbp(case):
    block = case.block
    return plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                      method='afbp', target_db=-50.0)(block).samples


def ffbp(case):
    return by(case, 'ffbp', merge_factor=2, kernel='knab8', range_oversampling=1.8,
              angle_oversampling=1.8)


def wavenumber(case):
    return by(case, 'wavenumber')


def zero_padded(case):
    return by(case, 'zero-padding')


def by(case, method, **options):
    return plan_image(case.grid, case.block.radar, case.block.n_samples, method=method,
                      **options)(case.block).samples


def correlated(case):
    return correlate_profiles(case.block, case.points)[0]


def verified(case):
    return np.float64(measure_error(exact(case), case.grid, case.block, n_pixels=40,
                                    n_brightest=40).error_db)


def calibrated(case):
    return calibrate_at_reflector(case.block, case.points[0]).delay_s


@pytest.mark.parametrize('image_of', [exact, by_points, ffbp, wavenumber, zero_padded, correlated,
                                      verified])
def test_waves_of_any_speed_give_the_same_image(make_case, image_of):
    case = make_case(1e3, pulses=192, aperture_m=20.0, n_points=5)
    np.testing.assert_array_equal(image_of(shrunk(case)), image_of(case))


def test_afbp_of_waves_of_any_speed(make_case):
    case = make_case(1e3, pulses=192, aperture_m=20.0, n_points=5)
    image, slow = afbp(case), afbp(shrunk(case))
    # Beams are planned for a spread that is rounded in metres, hence not to the last bit; either
    # image may be 50 dB, the target, from the exact one.
    assert np.linalg.norm(slow - image) <= 2 * 10 ** (-50 / 20) * np.linalg.norm(image)


def test_live_afbp_of_a_sonar_goes_through_messages(make_case):
    case = shrunk(make_case(1e3, pulses=96, aperture_m=20.0, n_points=5))
    stage = LiveSubapertures(case.grid, pulses_per_aperture=96, target_db=-50.0)
    fusion = LiveFusion()
    sent = stage.add(case.block) + stage.flush()
    received = [subaperture_wire.from_array(*subaperture_wire.to_array(s)) for s in sent]
    assert {s.fusion.wavelength_m for s in received} == {case.block.radar.wavelength_m}
    images = [image for s in received for image in fusion.add(s)] + fusion.flush()
    exactly = exact(case)
    assert np.linalg.norm(images[-1].image - exactly) <= 2 * 10 ** (-50 / 20) * np.linalg.norm(
        exactly)


def test_channels_are_calibrated_at_any_speed(make_case):
    case = make_case(1e3, channels=3, n_points=1)
    np.testing.assert_array_equal(calibrated(shrunk(case)), calibrated(case))


@pytest.mark.parametrize('waveform', [Waveform.STEPPED_FREQUENCY, Waveform.LFM])
def test_echoes_and_compression_know_the_speed(waveform):
    def profiles(scale):
        radar = RadarParameters(10e9, 300e6, 400e6, 2e-6, 1e-6, 3e14, waveform,
                                scale * SPEED_OF_LIGHT)
        centre = scale * np.array([[[0.0, 0.0, 0.0]]])
        point = scale * np.array([[330.0, 10.0, 5.0]])
        samples = EchoSimulator(radar, 1024, compressed=False, points_m=point,
                                amplitudes=[1.0])(centre, centre)
        raw = PulseBlock(radar, False, [0], [0], samples, centre, centre)
        if waveform == Waveform.STEPPED_FREQUENCY:
            raw = dataclasses.replace(raw, radar=dataclasses.replace(radar, sample_rate_hz=300e6))
        return RangeCompressor.for_block(
            raw, range_window_m=(scale * 310.0, scale * 350.0))(raw)
    light, slow = profiles(1.0), profiles(SHRINK)
    np.testing.assert_array_equal(slow.samples, light.samples)
    assert slow.radar.range_start_m == SHRINK * light.radar.range_start_m
    place = slow.radar.range_start_m + slow.radar.sample_spacing_m * np.arange(slow.n_samples)
    truth = SHRINK * np.linalg.norm([330.0, 10.0, 5.0])
    found = place[np.abs(slow.samples[0, 0]).argmax()]
    assert abs(found - truth) <= slow.radar.sample_spacing_m  # half a sample, and rounding


def _block(radar, track_m, points_m, n_samples):
    """Range profiles of reflectors along a track, (P, 3), of one antenna."""
    track = np.ascontiguousarray(track_m)[:, None]
    samples = EchoSimulator(radar, n_samples, compressed=True, points_m=points_m,
                            amplitudes=np.ones(len(points_m)))(track, track)
    number = np.arange(len(track))
    return PulseBlock(radar, True, number, number, samples, track, track)


def _delays_s(block, points, speed):
    path = np.linalg.norm(block.tx_m[:, 0, None] - points, axis=-1)
    return 2 * path / speed


def _correlation(block, points, speed):
    """Time-domain correlation in float64, written out: the reference of these tests."""
    image = np.zeros(len(points), complex)
    frequencies, spectra = band_spectrum(block)
    for spectrum, delay in zip(spectra[:, 0], _delays_s(block, points, speed), strict=True):
        image += np.exp(2j * np.pi * np.outer(delay, frequencies)) @ spectrum
    return image


def _check_image(image, block, points, speed):
    """Error against correlation as predicted, and every reflector at its place."""
    flat, samples = points.reshape(-1, 3), image.samples.ravel()
    chosen = np.argsort(np.abs(samples))[-300:]
    reference = _correlation(block, flat[chosen], speed)
    difference = samples[chosen] - reference
    error_db = 10 * np.log10(np.sum(np.abs(difference) ** 2) / np.sum(np.abs(reference) ** 2))
    assert error_db <= image.report.predicted_error_db + 3.0
    assert error_db <= -60.0
    library = correlate(*band_spectrum(block), block.tx_m, block.rx_m, flat[chosen],
                        propagation_speed_m_per_s=speed)
    np.testing.assert_allclose(library, reference, atol=1e-8 * np.abs(reference).max())


def _peak(image, points, truth, reach_m):
    """Place of the brightest pixel near the truth, metres."""
    near = np.linalg.norm(points - truth, axis=-1) < reach_m
    return points[near][np.abs(image[near]).argmax()]


def test_ground_penetrating_radar():
    """Pipes below a cart with a 1 GHz antenna: a vertical section of soil where eps_r is 9."""
    speed = SPEED_OF_LIGHT / 3
    radar = RadarParameters(1e9, 800e6, 1.6e9, 0.0, propagation_speed_m_per_s=speed)
    pipes = np.array([[0.0, 0.0, -0.8], [0.35, 0.0, -0.5], [-0.5, 0.0, -1.2]])
    track = np.linspace(-1.0, 1.0, 81)[:, None] * [1.0, 0.0, 0.0]
    block = _block(radar, track, pipes, 128)
    x, z = np.meshgrid(np.linspace(-0.8, 0.8, 161), -np.linspace(0.3, 1.5, 121))
    points = np.stack([x, 0 * x, z], axis=-1)
    image = plan_image(points, radar, block.n_samples, method='exact', target_db=-60.0)(block)
    _check_image(image, block, points, speed)
    for pipe in pipes:  # to a pixel of 1 cm; a resolution cell has 6 cm
        assert np.abs(_peak(image.samples, points, pipe, 0.1) - pipe).max() <= 0.0101
    # Taken for waves in air, the pipes lie deeper, where the profiles say they are thrice as far.
    with pytest.raises(ValueError, match='profiles cover'):
        air = dataclasses.replace(radar, propagation_speed_m_per_s=SPEED_OF_LIGHT,
                                  first_sample_delay_s=20e-9)
        exact_image(points, dataclasses.replace(block, radar=air))


@pytest.mark.parametrize('carrier_hz, band_hz, range_m', [(40e3, 20e3, 30.0), (1e6, 200e3, 3.0)])
def test_sonar(carrier_hz, band_hz, range_m):
    """Synthetic aperture sonar in fresh water, on a map of the bottom."""
    speed = 1480.0
    cell = speed / 2 / band_hz
    start = range_m - 40 * cell
    radar = RadarParameters(carrier_hz, band_hz, 1.5 * band_hz, 2 * start / speed,
                            propagation_speed_m_per_s=speed)
    length = range_m * radar.wavelength_m / 2 / cell  # as fine along the track as in range
    track = np.linspace(-0.5, 0.5, 128)[:, None] * [0.0, length, 0.0] + [0, 0, 0.3 * range_m]
    ground = np.sqrt(1 - 0.3 ** 2) * range_m
    grid = MapGrid((ground, 0.0, 0.0), 96, 96, cell / 4)
    mines = np.array(grid.centre_m) + cell * np.array([[0, 0, 0], [5.0, -6.0, 0], [-4.5, 7.25, 0]])
    block = _block(radar, track, mines, 160)
    image = plan_image(grid, radar, block.n_samples, method='exact', target_db=-60.0)(block)
    _check_image(image, block, grid.points(), speed)
    for mine in mines:  # to half a pixel and what neighbours shift: a quarter of a cell
        assert np.abs(_peak(image.samples, grid.points(), mine, 2 * cell) - mine).max() <= cell / 4
