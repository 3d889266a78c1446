# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Planes and volumes: where their pixels are, and what is refused."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry import Grid, MapGrid, PlaneGrid, PointGrid, TerrainGrid, VolumeGrid
from sar_imaging.geometry.grids import EvenGrid, even_positions
from sar_imaging.geometry.polar import PolarGrid

MAP = MapGrid((10.0, -3.0, 2.0), 7, 5, 0.5)
PLANE = PlaneGrid((1.0, 2.0, 3.0), (0.1, 0.2, 0.0), (0.0, 0.1, -0.3), 6, 4)
VOLUME = VolumeGrid((1.0, 2.0, 3.0), (0.1, 0.0, 0.02), (0.0, 0.2, 0.0), (0.03, 0.0, 0.3), 6, 4, 3)
POLAR = PolarGrid((0, 0, 5), (1, 0), 1, 0, 100, 1, 5, 0, 0.01, 4)
GRIDS = [MAP, PLANE, VOLUME, POLAR, TerrainGrid(MAP, np.arange(35.0).reshape(5, 7)),
         PointGrid(np.random.default_rng(0).random((4, 2, 3)))]


@pytest.mark.parametrize('grid', GRIDS, ids=lambda grid: type(grid).__name__)
def test_some_positions_are_those_of_all(grid):
    assert isinstance(grid, Grid)
    points = grid.points()
    assert points.shape == (*grid.shape, 3) and points.dtype == np.float64
    rng = np.random.default_rng(1)
    index = tuple(rng.integers(0, n, 20) for n in grid.shape)
    np.testing.assert_array_equal(grid.positions(*index), points[index])


@pytest.mark.parametrize('grid', [MAP, PLANE, VOLUME], ids=lambda grid: type(grid).__name__)
def test_pixels_lie_at_equal_steps(grid):
    assert isinstance(grid, EvenGrid)
    points = grid.points()
    np.testing.assert_allclose(points[(0,) * len(grid.shape)], grid.origin_m, atol=1e-12)
    for axis, step in enumerate(grid.steps_m):
        steps = np.diff(points, axis=axis).reshape(-1, 3)
        np.testing.assert_allclose(steps, np.broadcast_to(step, steps.shape), atol=1e-12)
    np.testing.assert_allclose(even_positions(grid, *np.ogrid[tuple(map(slice, grid.shape))]),
                               points, atol=1e-12)


def test_slices_of_a_volume():
    for number in range(VOLUME.n_z):
        np.testing.assert_allclose(VOLUME.slice(number).points(), VOLUME.points()[number])


def test_a_volume_above_a_map_has_maps_for_slices():
    volume = VolumeGrid.above(MAP, 3.0, 0.75)
    assert volume.shape == (5, *MAP.shape)
    for number, height in enumerate([2.0, 2.75, 3.5, 4.25, 5.0]):
        raised = dataclasses.replace(MAP, centre_m=(*MAP.centre_m[:2], height))
        np.testing.assert_allclose(volume.points()[number], raised.points(), atol=1e-12)
    assert VolumeGrid.above(MAP, 3.0).n_z == 7  # cubes unless told


@given(st.floats(0, 6.3), st.floats(0.1, 9.0))
def test_vertical_section(angle, length):
    direction = np.array([np.cos(angle), np.sin(angle)])
    grid = PlaneGrid.vertical_section((4.0, 5.0), length * direction, 12.0, -1.0, 3.0, 0.25)
    assert grid.shape == (17, 49)
    points = grid.points()
    np.testing.assert_allclose(points[0, 0], [4.0, 5.0, 3.0])  # nearest and highest
    np.testing.assert_allclose(points[-1, -1], [*(4.0 + 12 * direction[:1]),
                                                *(5.0 + 12 * direction[1:]), -1.0])


@given(st.floats(0, 6.3))
def test_wall_as_its_observer_sees_it(angle):
    towards = np.array([np.cos(angle), np.sin(angle), 0.0])
    grid = PlaneGrid.wall((1.0, 2.0, 3.0), 7.0 * towards[:2], 4.0, 2.0, 0.5)
    points = grid.points()
    assert grid.shape == (5, 9)
    np.testing.assert_allclose(points.mean(axis=(0, 1)), [1.0, 2.0, 3.0], atol=1e-12)
    assert points[0, 0, 2] == pytest.approx(4.0)  # row 0 is at the top
    right = np.cross(-towards, [0, 0, 1])  # of who looks at it
    np.testing.assert_allclose(points[0, -1] - points[0, 0], 4.0 * right, atol=1e-12)


def test_slant_plane_holds_the_track_and_the_scene():
    track = np.linspace([-500.0, -40.0, 300.0], [-520.0, 60.0, 310.0], 50)
    centre = np.array([10.0, 30.0, 2.0])
    grid = PlaneGrid.slant_plane(track[:, None], centre, 20.0, 10.0, 0.5)
    assert grid.shape == (21, 41)
    points = grid.points()
    np.testing.assert_allclose(points[10, 20], centre, atol=1e-9)
    u, v = np.array(grid.step_u_m), np.array(grid.step_v_m)
    normal = np.cross(u, v)
    np.testing.assert_allclose((track - centre) @ normal / np.linalg.norm(normal), 0, atol=1e-9)
    along = (track[-1] - track[0]) / np.linalg.norm(track[-1] - track[0])
    np.testing.assert_allclose(-v / 0.5, along, atol=1e-12)  # row 0 is where the flight ends
    assert u @ along == pytest.approx(0, abs=1e-12)
    away = np.linalg.norm(points[10] - track.mean(axis=0), axis=-1)
    assert (np.diff(away) > 0).all()


P, V = (0.0, 0.0, 0.0), ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))


@pytest.mark.parametrize(('make', 'text'), [
    (lambda: PlaneGrid((0, 0), *V[:2], 1, 1), 'origin_m=.*expected three finite numbers'),
    (lambda: PlaneGrid(P, (np.nan, 0, 0), V[1], 1, 1), 'step_u_m=.*three finite numbers'),
    (lambda: PlaneGrid(P, *V[:2], 0, 1), 'n_u=0, n_v=1; expected at least one pixel'),
    (lambda: PlaneGrid(P, V[0], (2.0, 0, 0), 1, 1), 'step_u_m=.*step_v_m=.*span a plane'),
    (lambda: PlaneGrid(P, V[0], P, 1, 1), 'not 0 and span a plane'),
    (lambda: VolumeGrid(P, *V, 1, 0, 1), 'n_x=1, n_y=0, n_z=1; expected at least one'),
    (lambda: VolumeGrid(P, V[0], V[1], (1.0, 1.0, 0), 1, 1, 1), 'span a volume'),
    (lambda: VolumeGrid.above(MAP, -1.0), 'height_m=-1.0; expected a finite length'),
    (lambda: PlaneGrid.wall(P, (0.0, 0.0), 1, 1, 0.1), 'normal=.*not all 0'),
    (lambda: PlaneGrid.wall(P, (1.0, 0.0, 0.0), 1, 1, 0.1), 'normal=.*expected 2 finite'),
    (lambda: PlaneGrid.wall(P, (1.0, 0.0), np.inf, 1, 0.1), 'width_m=inf; expected a finite'),
    (lambda: PlaneGrid.vertical_section((0, 0), (1, 0), 5, 3, 1, 0.1), r'high_m - low_m=-2'),
    (lambda: PlaneGrid.vertical_section((0, 0), (1, 0), 5, 0, 1, 0.0), 'spacing_m=0.0 must be'),
    (lambda: PlaneGrid.slant_plane([P] * 4, V[0], 1, 1, 0.1), 'one place only'),
    (lambda: PlaneGrid.slant_plane([P, V[0]], (5.0, 0, 0), 1, 1, 0.1), 'on the line of the track'),
    (lambda: TerrainGrid(MAP, np.zeros((5, 6))), r'height_m.shape=\(5, 6\).*expected \(5, 7\)'),
    (lambda: TerrainGrid(MAP, np.full((5, 7), np.inf)), 'z of 35 points is infinite'),
    (lambda: PointGrid(np.zeros((4, 2))), r'points.shape=\(4, 2\); expected \(..., 3\)')])
def test_impossible_grids_are_refused(make, text):
    with pytest.raises(ValueError, match=text):
        make()
