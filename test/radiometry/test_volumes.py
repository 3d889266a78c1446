# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Cross section of points in volumes, by the radar equation."""

import dataclasses

import numpy as np
import pytest

from benchmarks.support.radiometry_scenes import GAIN, Flight
from sar_imaging.geometry import VolumeGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.image import Image, Report
from sar_imaging.imaging.imager import plan_image
from sar_imaging.radiometry import LiveCalibration, RadarConstant, volume_scale

SIDE, STEP_M = 14, 0.07


def raster():
    """Phase centres in a square upright plane, 30 m from the scene."""
    flight = Flight(30.0, pulses=SIDE**2, n=16)
    places = (np.arange(SIDE) - (SIDE - 1) / 2) * STEP_M
    height = flight.tx_m[0, 0, 2]
    flight.tx_m = np.stack(np.meshgrid([0.0], places, height + places, indexing='ij'),
                           axis=-1).reshape(-1, 1, 3)
    flight.rx_m = flight.tx_m.copy()
    return flight


@pytest.mark.parametrize('lit', [False, True])
def test_a_reflector_has_its_cross_section_anywhere(lit):
    """0.0005 dB measured: a cell lies at the reflector, and profiles are read to -60 dB."""
    flight = raster()
    grid = VolumeGrid.above(flight.grid, 1.5, 0.15)
    pattern = pointing = illumination = None
    if lit:
        pattern = AntennaPattern(PatternCut.gaussian(0.12), PatternCut.gaussian(0.2))
        pointing = Pointing.steered(flight.tx_m[:, 0], flight.grid.centre_m)
        illumination = Illumination.of_pulses(pattern, pointing, flight.tx_m, flight.rx_m)
    for index, size in (((0, 8, 8), 0.3), ((9, 3, 12), 37.7), ((4, 13, 2), 1200.0)):
        place = grid.positions(*index)
        block = flight.block(place[None], np.sqrt([size]), illumination)
        block = dataclasses.replace(block, pointing=pointing)
        image = plan_image(grid, flight.radar, flight.n_samples, illumination=pattern)(block)
        scaled = LiveCalibration(RadarConstant(GAIN), 'rcs', pattern=pattern)(image, block)
        assert 20 * np.log10(np.abs(scaled.samples[index])) == pytest.approx(
            10 * np.log10(size), abs=0.02)
        assert scaled.radiometry.quantity == 'rcs'
    if lit:  # it dims the two that are off the middle, or this would test nothing
        assert 20 * np.log10(illumination.amplitude(place[None]).mean()) < -1


def test_knots_and_some_pulses_stand_for_all():
    """Beside the sums over all pulses at all cells, and their level of noise."""
    flight = raster()
    double = [np.concatenate([c, c]) for c in (flight.tx_m, flight.rx_m)]  # 392 pulses
    grid = VolumeGrid.above(dataclasses.replace(flight.grid, n_x=40, n_y=33), 1.5, 0.05)
    pattern = AntennaPattern(PatternCut.gaussian(0.25))
    pointing = Pointing.steered(double[0][:, 0], flight.grid.centre_m)
    scale = volume_scale(grid, *double, RadarConstant(GAIN, 1e-3), pattern=pattern,
                         pointing=pointing)
    some = (slice(None, None, 4), slice(None, None, 3), slice(None, None, 3))
    points = grid.points()[some]
    lit = Illumination.of_pulses(pattern, pointing, *double).amplitude(points)
    far = np.linalg.norm(double[0][:, 0] - points[..., None, :], axis=-1)
    lit = np.moveaxis(lit.reshape(len(lit), *points.shape[:3]), 0, -1)
    amplitude = (lit**2 / far**2).sum(axis=-1)
    # 3e-4 measured: the 256 pulses that stand for 392 do not lie evenly
    np.testing.assert_allclose(scale.factors()[some] * GAIN * amplitude, 1.0, rtol=1e-3)
    part = (slice(3, 7), slice(1, 30), slice(None))
    assert np.array_equal(scale.factors(*part), scale.factors()[part])
    noise = np.median(1e-3 * (lit**2).sum(axis=-1) / (GAIN * amplitude) ** 2)
    assert scale.radiometry.noise_equivalent_db == pytest.approx(10 * np.log10(noise), abs=0.1)


@pytest.mark.parametrize('quantity', ['beta0', 'sigma0', 'gamma0'])
def test_brightness_of_an_area_is_refused(quantity):
    flight = raster()
    grid = VolumeGrid.above(flight.grid, 1.5, 0.5)
    image = Image(np.ones(grid.shape, np.complex64), grid, 10e9, Report('exact', '', -60.0))
    with pytest.raises(ValueError, match='whose cells have no area of ground; expected .rcs.'):
        LiveCalibration(RadarConstant(GAIN), quantity)(
            image, flight.pulses(np.zeros((SIDE**2, 1, 8), np.complex64)))
