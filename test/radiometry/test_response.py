# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Responses of images against closed forms and against integrals of images of one target."""

import numpy as np
import pytest

from benchmarks.support.radiometry_scenes import GAIN, Flight
from sar_imaging.geometry import MapGrid, TerrainGrid
from sar_imaging.geometry.grids import PlaneGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.radiometry import image_response
from sar_imaging.signal import SPEED_OF_LIGHT


@pytest.mark.parametrize(('range_m', 'grazing_deg'), [(1e3, 30.0), (2e4, 10.0), (5e5, 60.0)])
def test_area_of_a_straight_track_is_that_of_the_textbook(range_m, grazing_deg):
    """``c lambda / (4 B sin(incidence) angle)`` on the slant plane, a sine less on the ground."""
    flight = Flight(range_m, grazing_deg)
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m)
    middle = flight.grid.n_y // 2, flight.grid.n_x // 2
    sine = np.cos(np.radians(grazing_deg))  # of the incidence angle
    wavelength = SPEED_OF_LIGHT / flight.radar.carrier_hz
    count = len(flight.tx_m)
    angle = flight.angle_rad * count / (count - 1)  # half a spacing more on both sides
    area = SPEED_OF_LIGHT * wavelength / (4 * flight.bandwidth_hz * sine ** 2 * angle)
    # 3e-4 measured: the angle is that of small angles, the pixel half a spacing off the middle
    assert response.area_m2[middle] == pytest.approx(area, rel=2e-3)
    assert response.slant_area_m2[middle] == pytest.approx(area * sine, rel=2e-3)
    assert np.degrees(response.incidence_rad[middle]) == pytest.approx(90 - grazing_deg, abs=0.1)
    spreading = count * (np.linalg.norm(flight.tx_m[count // 2, 0] - flight.grid.centre_m)) ** -2
    assert response.amplitude[middle] == pytest.approx(spreading, rel=2e-3)
    assert response.noise_gain[middle] == pytest.approx(count)


@pytest.mark.parametrize('options', [
    {'range_m': 100.0}, {'range_m': 1e3, 'channels': 3}, {'range_m': 1e3, 'squint_rad': 0.3},
    {'range_m': 5e5, 'grazing_deg': 50.0}])
@pytest.mark.parametrize('sloping', [False, True])
def test_area_is_the_integral_over_the_image_of_one_target(options, sloping):
    """Power of its image summed over the surface, over that of its peak."""
    flight = Flight(weighting='hamming', **options)
    n, step = 96, 0.3 * flight.cell_m
    grid = MapGrid(flight.grid.centre_m, n, n, step)
    if sloping:
        steps = step * np.array([[1.0, 0.0, 0.2], [0.0, -1.0, 0.1]])
        origin = np.array(flight.grid.centre_m) - n // 2 * steps.sum(axis=0)
        grid = PlaneGrid(tuple(origin), *map(tuple, steps), n, n)
    taper = np.hamming(2 * len(flight.tx_m) + 1)[1::2]
    target = grid.positions(n // 2, n // 2)
    block = flight.block(target[None], np.ones(1))
    image = plan_image(grid, flight.radar, flight.n_samples, target_db=-60, pulse_weights=taper)(
        block)
    response = image_response(grid, flight.radar, flight.tx_m, flight.rx_m, weighting='hamming',
                              pulse_weights=taper)
    there = n // 2, n // 2
    assert abs(image.samples[there]) == pytest.approx(GAIN * response.amplitude[there], rel=2e-3)
    pixel_m2 = np.linalg.norm(np.cross(*grid.steps_m))
    energy = (np.abs(image.samples) ** 2).sum() * pixel_m2 / abs(image.samples[there]) ** 2
    # sidelobes beyond the image hold less than 1e-3; the channels of an array spread the band
    assert energy == pytest.approx(response.area_m2[there], rel=5e-3)


def test_terrain_that_is_a_plane_has_the_area_of_the_plane():
    flight = Flight(1e3)
    n, spacing, slopes = 24, flight.grid.spacing_m, (0.2, -0.1)
    level = MapGrid(flight.grid.centre_m, n, n, spacing)
    x, y = np.meshgrid(level.x_m - level.centre_m[0], level.y_m)
    terrain = TerrainGrid(level, slopes[0] * x + slopes[1] * y)
    plane = PlaneGrid(tuple(terrain.positions(0, 0)), (spacing, 0.0, slopes[0] * spacing),
                      (0.0, -spacing, -slopes[1] * spacing), n, n)
    on_terrain, on_plane = (image_response(grid, flight.radar, flight.tx_m, flight.rx_m)
                            for grid in (terrain, plane))
    middle = n // 2, n // 2
    for name in ('area_m2', 'slant_area_m2', 'incidence_rad'):
        # the mean of directions over the aperture stands for each: 2e-5 measured
        assert getattr(on_terrain, name)[middle] == pytest.approx(
            getattr(on_plane, name)[middle], rel=1e-3)


def test_pattern_dims_targets_and_what_is_not_lit_is_nan():
    flight = Flight(1e3, n=96)
    width = 60 * flight.grid.spacing_m / 1e3
    pattern = Illumination.of_pulses(
        AntennaPattern(PatternCut.cosine(width)),
        Pointing.steered(0.5 * (flight.tx_m + flight.rx_m)[:, 0], flight.grid.centre_m),
        flight.tx_m, flight.rx_m)
    plain = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m)
    dimmed = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m,
                            illumination=pattern)
    weighed = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m,
                             illumination=pattern, weighted=True)
    points = flight.grid.points()[::7, 48]
    gain = pattern.amplitude(points)
    spread = 1 / np.linalg.norm(flight.tx_m[:, 0, None] - points, axis=-1) ** 2
    for response, sums in ((plain, spread), (dimmed, gain * spread),
                           (weighed, gain ** 2 * spread)):
        expected = sums.sum(axis=0)
        lit = expected > 1e-3 * expected.max()
        # splines over 49 x 49 pixels: below 1e-3 measured
        assert response.amplitude[::7, 48][lit] == pytest.approx(expected[lit], rel=3e-3)
    assert np.isfinite(plain.area_m2).all()
    edge = (abs(flight.grid.y_m) > 1.05 * width * 1e3)
    assert not edge.any() or np.isnan(dimmed.area_m2[edge, 48]).all()


@pytest.mark.parametrize(('change', 'message'), [
    ({'tx_m': np.zeros((4, 1, 3)), 'rx_m': np.zeros((4, 1, 3))}, '8 pulses or more'),
    ({'tx_m': np.zeros((9, 3)), 'rx_m': np.zeros((9, 3))}, r'expected \(P, C, 3\)'),
    ({'tx_m': np.full((9, 1, 3), 50.0), 'rx_m': np.full((9, 1, 3), 50.0)}, 'stood still'),
    ({'weighting': 'boxcar'}, 'unknown'),
])
def test_wrong_input_is_refused(change, message):
    flight = Flight(1e3)
    arguments = {'grid': flight.grid, 'radar': flight.radar, 'tx_m': flight.tx_m,
                 'rx_m': flight.rx_m} | change
    with pytest.raises(ValueError, match=message):
        image_response(**arguments)
