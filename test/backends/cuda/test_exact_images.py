# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Whole small images against the processor's backend, by the same plans."""

import dataclasses
import math

import numpy as np
import pytest

from sar_imaging.backends import DeviceError, backend
from sar_imaging.geometry import PlaneGrid, PointGrid, VolumeGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.memory import granting
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.points import ImagePoints
from sar_imaging.planning.exact.polar_image import DEGREE, TAPS, AzimuthParts, plan_polar
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.profiles import PhaseHistory

AGREE_DB = -100.0  # float32 sums in another order, of the same polynomials


def planned(scene, grid, route=None, target_db=-80.0):
    block, rows = scene.block, scene.echoes
    band = None if block.compressed else PhaseHistory(block.radar, block.n_samples)
    radar = (band or block).radar
    plan = plan_backprojection(grid, radar, block.n_samples, *rows[1:], target_db, band=band)
    if route is not None:
        polar = plan_polar(grid, *rows[1:], radar, block.n_samples, target_db, band=band)
        if route == 'parts':  # which pay for larger images alone
            parts = AzimuthParts(
                (slice(0, 1), slice(1, 2)), np.array([-90.0, 200.0]), polar.polar, polar.polar,
                design_interpolator(1.5, taps=TAPS, degree=DEGREE), -60.0, 0.0)
            polar = dataclasses.replace(polar, parts=parts)
        plan = dataclasses.replace(plan, route=polar)
    return plan


def images(plan, rows):
    """What the device adds to an image, and what the processor adds."""
    made = [backend(name).Backprojection(plan) for name in ('cuda', 'cpu')]
    return [added(sums, rows) for sums in made]


def added(sums, rows):
    image = np.full(sums.plan.grid.shape, 1 + 2j, np.complex64)  # images are added to
    sums.add(*rows, image)
    return image - np.complex64(1 + 2j)


def in_tiles(plan, rows, pixel_bytes):
    """The same with memory for all but a twentieth of it: half of all is for a tile."""
    with granting(2 * 0.95 * (plan.n_bytes + pixel_bytes * math.prod(plan.grid.shape))):
        sums = backend('cuda').Backprojection(plan)
    assert len(sums.tiles) > 1
    return added(sums, rows)


@pytest.mark.parametrize(('route', 'options'), [
    ('lines', {'range_m': 1000.0, 'height_m': 300.0, 'history': True}),
    ('bistatic', {'range_m': 1000.0, 'apart_m': 40.0, 'channels': 2, 'pulses': 1}),
    ('points', {'range_m': 30.0, 'aperture_m': 3.0, 'n': 20}),
    ('hills', {'range_m': 500.0, 'height_m': 100.0, 'history': True}),
    ('volume', {'range_m': 1000.0, 'height_m': 300.0}),
    ('wall', {'range_m': 300.0, 'height_m': 20.0}),
    ('polar', {'range_m': 1000.0, 'bend_m': 3.0, 'n': 16}),
    pytest.param('parts', {'range_m': 1000.0, 'n': 16}, marks=pytest.mark.campaign)])
def test_images_are_those_of_the_processor(make_scene, error_db, route, options):
    scene = make_scene(**{'n': 12, 'pulses': 2, **options})
    grid = scene.grid
    x, y, z = grid.centre_m
    if route == 'volume':
        grid = VolumeGrid((x, y, z), (0.25, 0.0, 0.0), (0.0, 0.25, 0.01), (0.0, 0.0, 0.5), 8, 6, 2)
    elif route == 'wall':
        grid = PlaneGrid((x, y - 1.0, z), (0.02, 0.25, 0.0), (0.1, 0.0, 0.3), 12, 8)
    elif route == 'hills':
        points = grid.points()
        points[..., 2] += 3.0 * np.exp(-points[..., 1] ** 2)
        points[5, 7, 2] = np.nan
        grid = ImagePoints.of_grid(PointGrid(points))
    plan = planned(scene, grid, route if route in ('polar', 'parts') else None)
    if route == 'hills':  # as of a larger image
        plan = dataclasses.replace(plan, route=dataclasses.replace(plan.route, tile=(4, 4)))
    image, wanted = images(plan, scene.echoes)
    assert error_db(image, wanted) < AGREE_DB
    if route == 'parts':  # directions are told from another line
        assert error_db(in_tiles(plan, scene.echoes, 8), image) < AGREE_DB - 10.0
    elif route != 'polar':
        np.testing.assert_array_equal(in_tiles(plan, scene.echoes, 32 if route == 'hills' else 8),
                                      image)
    if route == 'hills':
        assert image[5, 7] == 0.0


def test_one_imager_for_processor_and_device(make_scene, error_db):
    scene = make_scene(1000.0, n=12, pulses=4)
    options = {'method': 'exact', 'target_db': -80.0}
    found, wanted = (plan_image(scene.grid, scene.block.radar, scene.block.n_samples, backend=name,
                                **options)(scene.block) for name in ('cuda', 'cpu'))
    assert found.report.predicted_error_db == wanted.report.predicted_error_db
    assert error_db(found.samples, wanted.samples) < AGREE_DB


def test_what_plans_say_besides_is_refused(make_scene):
    scene = make_scene(1000.0, n=12, pulses=4)
    plan = planned(scene, scene.grid)

    @dataclasses.dataclass(frozen=True, eq=False)
    class Windowed(type(plan)):
        window: object = 'hann'

    with pytest.raises(ValueError, match='does not compute window of Windowed yet; use'):
        backend('cuda').Backprojection(Windowed(**vars(plan)))


def test_what_does_not_fit_is_refused_with_numbers(make_scene):
    scene = make_scene(1000.0, n=12, pulses=4)
    plan = planned(scene, scene.grid)
    with granting(300), pytest.raises(DeviceError, match=(
            r'the smallest tile of an image of 12 x 12 pixels needs 0.000 MB of device memory, '
            r'0.000 MB are free; use backend=')):
        backend('cuda').Backprojection(plan)
    with granting(10_000), pytest.raises(DeviceError, match=(
            r'one pass of 32 range profiles needs 0.\d+ MB of device memory, 0.010 MB are free')):
        backend('cuda').Backprojection(plan).add(*scene.echoes, np.zeros((12, 12), np.complex64))
