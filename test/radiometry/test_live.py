# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Brightness of images as they come: one response for many images, with and without an antenna."""

import dataclasses

import numpy as np
import pytest

from benchmarks.support.radiometry_scenes import GAIN, Flight
from sar_imaging.geometry import MapGrid, TerrainGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.image import Image, Report
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.impulse_response import measure_scatterer
from sar_imaging.radiometry import LiveCalibration, RadarConstant, calibrated, image_response


def antenna(flight):
    """Pattern that falls over the map, and its pointing."""
    width = 25 * flight.grid.spacing_m / flight.tx_m[0, 0, 2]
    return (AntennaPattern(PatternCut.gaussian(width)),
            Pointing.steered(flight.tx_m[:, 0], flight.grid.centre_m))


@pytest.mark.parametrize('window', ['none', 'hamming'])
def test_a_reflector_has_its_cross_section_where_the_antenna_dims_it(window):
    """Simulated by the radar equation, weighed by the pattern, measured in the scaled image."""
    flight = Flight(1e3, n=64, weighting=window)
    pattern, pointing = antenna(flight)
    lit = Illumination.of_pulses(pattern, pointing, flight.tx_m, flight.rx_m)
    place, size = np.array(flight.grid.centre_m) + [4.2, -6.1, 0.0], 37.7
    block = dataclasses.replace(flight.block(place[None], np.sqrt([size]), lit),
                                pointing=pointing)
    image = plan_image(flight.grid, flight.radar, flight.n_samples, illumination=pattern)(block)
    weight = lit.amplitude(place[None])
    assert 20 * np.log10(weight.mean()) < -3  # it is dimmed, or this would test nothing
    scaled = LiveCalibration(RadarConstant(GAIN, 1e-3), 'rcs', pattern=pattern,
                             weighting=window)(image, block)
    peak = measure_scatterer(
        scaled.samples, flight.grid, place, aperture_centre_m=flight.tx_m.mean(axis=(0, 1)),
        wavenumber_rad_per_m=flight.radar.wavenumber_rad_per_m, cut_half_width_range_m=4.0,
        cut_half_width_azimuth_m=4.0).peak_amplitude
    # 0.02 dB measured: the scale differs over the cell, and the peak lies between pixels
    assert 20 * np.log10(peak) == pytest.approx(10 * np.log10(size), abs=0.1)


@pytest.mark.parametrize('quantity', ['rcs', 'beta0', 'sigma0', 'gamma0'])
@pytest.mark.parametrize('terrain', [False, True])
def test_some_pulses_and_knots_stand_for_all(quantity, terrain):
    flight = Flight(1e3, n=90, pulses=400, channels=2)
    pattern, pointing = antenna(flight)
    grid = flight.grid
    if terrain:
        slope = np.add.outer(np.zeros(grid.n_y), 0.1 * (grid.x_m - grid.centre_m[0]))
        grid = TerrainGrid(grid, slope)
    image = Image(np.ones(grid.shape, np.complex64), grid, 10e9, Report('exact', '', -60.0))
    block = flight.pulses(np.zeros((400, 2, 8), np.complex64))
    block = dataclasses.replace(block, pointing=pointing)
    constant = RadarConstant(GAIN, 0.2)
    live = LiveCalibration(constant, quantity, pattern=pattern)
    found = live(image, block)
    response = image_response(
        grid, flight.radar, flight.tx_m, flight.rx_m, weighted=True,
        illumination=Illumination.of_pulses(pattern, pointing, flight.tx_m, flight.rx_m))
    wanted = calibrated(image, response, constant, quantity)
    bright = response.amplitude > 0.1 * np.nanmax(response.amplitude)
    assert 0.3 < bright.mean() < 0.95
    difference_db = 20 * np.log10(np.abs(found.samples[bright] / wanted.samples[bright]))
    # 0.003 dB measured: 128 of 400 pulses, each of which stands for 3 or 4
    assert np.abs(difference_db).max() < 0.01
    # 0.16 dB and 0.02 degrees measured: medians over knots, more of which are on the edges
    for name in ('noise_equivalent_db', 'incidence_deg'):
        assert getattr(found.radiometry, name) == pytest.approx(
            getattr(wanted.radiometry, name), abs=0.3)
    assert found.radiometry.quantity == wanted.radiometry.quantity == quantity


def test_the_response_is_computed_anew_where_the_geometry_is_another_one():
    flight = Flight(1e3, n=16)
    image = Image(np.ones(flight.grid.shape, np.complex64), flight.grid, 10e9,
                  Report('exact', '', -60.0))
    block = flight.pulses(np.zeros((96, 1, 8), np.complex64))
    live = LiveCalibration(RadarConstant(GAIN))
    first = live(image, block)
    near = dataclasses.replace(block, tx_m=block.tx_m + 0.5, rx_m=block.rx_m + 0.5)
    assert np.array_equal(live(image, near).samples, first.samples)
    moved = MapGrid((flight.grid.centre_m[0], 100.0, 0.0), 16, 16, flight.grid.spacing_m)
    along = dataclasses.replace(block, tx_m=block.tx_m + [0, 100, 0],
                                rx_m=block.rx_m + [0, 100, 0])
    # a map that follows the radar is seen as before
    follows = live(dataclasses.replace(image, grid=moved), along)
    assert np.array_equal(follows.samples, first.samples)
    assert live.computed == 1
    live(image, along)
    assert live.computed == 2
    fewer = live(image, block.select(slice(0, 90)))
    assert live.computed == 3
    # six of 96 pulses less: amplitude of targets by 6 %, area of a cell by 6 % more
    assert np.abs(fewer.samples).mean() == pytest.approx(np.abs(first.samples).mean()
                                                         * np.sqrt(96 / 90), rel=2e-3)


def test_what_cannot_be_told_is_refused():
    flight = Flight(1e3, n=16)
    image = Image(np.ones(flight.grid.shape, np.complex64), flight.grid, 10e9,
                  Report('exact', '', -60.0))
    block = flight.pulses(np.zeros((96, 1, 8), np.complex64))
    with pytest.raises(ValueError, match='expected one of rcs, beta0'):
        LiveCalibration(RadarConstant(GAIN), 'brightness')
    with pytest.raises(ValueError, match='where the antenna looked'):
        LiveCalibration(RadarConstant(GAIN), pattern=antenna(flight)[0])(image, block)
    with pytest.raises(ValueError, match='stood still'):
        live = LiveCalibration(RadarConstant(GAIN))
        live(image, dataclasses.replace(block, tx_m=np.full((96, 1, 3), 50.0),
                                        rx_m=np.full((96, 1, 3), 50.0)))
    assert live.computed == 0
