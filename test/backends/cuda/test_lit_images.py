# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images with illumination against the formula with weights, and against the processor's."""

import dataclasses
import math

import numpy as np
import pytest

from sar_imaging.backends import backend
from sar_imaging.geometry import MapGrid, PointGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.memory import granting
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.illumination import PointAmplitudes
from sar_imaging.planning.exact.points import ImagePoints
from sar_imaging.planning.exact.polar_image import DEGREE, TAPS, AzimuthParts, plan_polar
from sar_imaging.planning.interpolators import design_interpolator

TARGET_DB = -60.0
AGREE_DB = -100.0  # float32 sums in another order, of the same polynomials
NARROW = AntennaPattern(PatternCut.sinc(0.006), PatternCut.cosine(0.6))
WIDE = AntennaPattern(PatternCut.gaussian(0.3))


def looking(block, squint_rad):
    """The pulses of an antenna that looks along x and down but for its squints, by pulse."""
    down = math.atan2(block.tx_m[0, 0, 2], 900.0)
    squint = np.resize(squint_rad, block.n_pulses)
    return dataclasses.replace(block, pointing=Pointing(np.stack(
        [np.cos(squint) * math.cos(down), np.sin(squint), 0 * squint - math.sin(down)], axis=-1)))


def planned(scene, grid, squint_rad, route=None, pattern=NARROW):
    """A plan with illumination; by a polar image, or by parts of one, where `way` says so."""
    block, echoes = looking(scene.block, squint_rad), scene.echoes
    light = Illumination.of_pulses(pattern, block.pointing, block.tx_m, block.rx_m)
    plan = plan_backprojection(grid, block.radar, block.n_samples, *echoes[1:], TARGET_DB, light)
    if route is not None:
        polar = plan_polar(grid, *echoes[1:], block.radar, block.n_samples, TARGET_DB, light)
        if route == 'parts':  # which pay for larger images alone
            parts = AzimuthParts(
                (slice(0, 2), slice(2, 4)), np.array([-90.0, 200.0]), polar.polar, polar.polar,
                design_interpolator(1.5, taps=TAPS, degree=DEGREE), -60.0, 0.0)
            polar = dataclasses.replace(polar, parts=parts)
        plan = dataclasses.replace(plan, route=polar)
    return plan


def added(name, plan, echoes):
    image = np.zeros(plan.grid.shape, np.complex64)
    backend(name).Backprojection(plan).add(*echoes, image)
    return image


SQUINTS = [0.0, 0.004, 0.1, -0.005]  # the third pulse lights nothing


def check(plan, echoes, error_db, memory=None, agree_db=AGREE_DB):
    """Agrees with the processor, also in tiles where there is that much memory."""
    image = added('cuda', plan, echoes)
    assert error_db(image, added('cpu', plan, echoes)) < agree_db
    if memory is not None:
        with granting(memory):
            sums = backend('cuda').Backprojection(plan)
        assert len(sums.tiles) > 1
        parts = np.zeros(plan.grid.shape, np.complex64)
        sums.add(*echoes, parts)
        np.testing.assert_array_equal(parts, image)
    return image


@pytest.fixture(scope='module')
def scene(make_scene):
    return make_scene(1000.0, n=12, pulses=4, aperture_m=4.0, height_m=300.0)


def test_lines(scene, error_db):
    """Two groups of lines, of which tiles cut one; echoes light lines in part, or none."""
    x, y, z = scene.grid.centre_m
    plan = planned(scene, MapGrid((x, y, z), 8, 40, 0.25), SQUINTS)
    assert plan.method == 'lines' and 0.5 < plan.route.amplitudes.share < 1.0
    image = check(plan, scene.echoes, error_db, memory=60_000)
    wanted = added('reference', plan, scene.echoes)
    assert error_db(image, wanted) < plan.predicted_error_db


@pytest.mark.parametrize('route', ['polar', 'parts'])
def test_polar_images(make_scene, error_db, route):
    scene = make_scene(1000.0, n=16, pulses=4)
    plan = planned(scene, scene.grid, SQUINTS, route, WIDE)
    assert plan.method == 'polar' and plan.route.amplitudes.apart == 16
    check(plan, scene.echoes, error_db)


@pytest.mark.parametrize(('tile', 'each'), [
    ((4, 4), False), ((8, 8), False), ((1, 16), False), ((4, 4), True)])
def test_points(scene, error_db, tile, each):
    """Parabolas over tiles, and amplitudes of each point where a node is missing."""
    points = scene.grid.points()
    points[..., 2] += 3.0 * np.exp(-points[..., 1] ** 2)
    points[4, 4, 2] = np.nan  # a node of tiles of 4 x 4
    if tile[0] == 1:
        points = points[4:5]
    grid = ImagePoints.of_grid(PointGrid(points))
    plan = planned(scene, grid, SQUINTS)
    assert plan.method == 'points'
    route = dataclasses.replace(plan.route, tile=tile,
                                amplitudes=PointAmplitudes(each, 0.7, 1.0, -70.0))
    plan = dataclasses.replace(plan, route=route)
    # float32 paths over the larger tiles are good to 1e-7 m, 5e-5 rad
    image = check(plan, scene.echoes, error_db, memory=9_000 if tile == (4, 4) else None,
                  agree_db=AGREE_DB if tile == (4, 4) else -90.0)
    assert image[-8, 4] == 0.0 if len(image) > 1 else image[0, 4] == 0.0
    if each:
        wanted = added('reference', plan, scene.echoes)
        assert error_db(image, wanted) < plan.predicted_error_db
