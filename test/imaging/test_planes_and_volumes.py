# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection onto planes of any orientation and volumes, against time-domain correlation.

Points are focused where they are, as wide as theory says: 0.886 of the null spacings ``c / 2B`` in
range and ``lambda / (4 sin(theta / 2))`` across it, theta being the angle under which a point sees
the aperture. Tolerances of widths are 4 %: range and direction are not quite separable.
"""

from __future__ import annotations

import dataclasses
import functools
import pickle

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging import memory
from sar_imaging.geometry import MapGrid, PlaneGrid, PointGrid, TerrainGrid, VolumeGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.points import ImagePoints
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.simulation.echoes import EchoSimulator

WIDTH = 0.886  # of a sinc at -3 dB, in null spacings


@dataclasses.dataclass(frozen=True)
class Scene:
    """A radar's band, its track and a grid."""

    carrier_hz: float
    bandwidth_hz: float
    track_m: np.ndarray
    grid: PlaneGrid | VolumeGrid

    @functools.cached_property
    def ranges_m(self) -> tuple[float, float]:
        """From the track to the nearest and the farthest pixel."""
        pixels = self.grid.points().reshape(-1, 3)
        ranges = np.linalg.norm(pixels[:, None] - self.track_m[::7], axis=-1)
        return ranges.min(), ranges.max()

    def block(self, points_m) -> PulseBlock:
        """Range profiles of reflectors of amplitude 1 at the points, (S, 3)."""
        nearest, farthest = self.ranges_m
        rate = 1.5 * self.bandwidth_hz
        spacing = SPEED_OF_LIGHT / 2 / rate
        start = nearest - 40 * spacing
        n = int((farthest - start) / spacing) + 40
        radar = RadarParameters(self.carrier_hz, self.bandwidth_hz, rate,
                                2 * start / SPEED_OF_LIGHT)
        track = np.ascontiguousarray(self.track_m)[:, None]
        samples = EchoSimulator(radar, n, compressed=True, points_m=points_m,
                                amplitudes=np.ones(len(points_m)))(track, track)
        number = np.arange(len(track))
        return PulseBlock(radar, True, number, number, samples, track, track)

    def random_points(self, n=40):
        """Points all over the grid and between its pixels."""
        rng = np.random.default_rng(5)
        shape = np.array(self.grid.shape) - 1
        return self.grid.origin_m + (rng.random((n, len(shape))) * shape) @ self.grid.steps_m


def track(start, stop, n):
    return np.linspace(start, stop, n)


def raster(side_m, n, y=0.0):
    """Phase centres on a square in the x-z plane, as two rails scan it."""
    u = np.linspace(-0.5, 0.5, n) * side_m
    x, z = np.meshgrid(u, u)
    return np.stack([x.ravel(), np.full(x.size, y), z.ravel()], axis=-1)


MAST = Scene(  # antennas up a mast of 6 m and a section from 25 m to 45 m before it
    10e9, 300e6, track([0, 0, 1], [0, 0, 7], 96),
    PlaneGrid.vertical_section((25.0, 0.0), (1.0, 0.0), 20.0, -1.0, 9.0, 0.1))
TURNED = dataclasses.replace(MAST, grid=PlaneGrid.vertical_section(
    (15.0, 20.0), (0.6, 0.8), 20.0, -1.0, 9.0, 0.1))
AIRCRAFT_TRACK = track([-800, -60, 600], [-800, 60, 606], 160)
AIRCRAFT = Scene(10e9, 300e6, AIRCRAFT_TRACK, PlaneGrid.slant_plane(
    AIRCRAFT_TRACK, (0.0, 5.0, 0.0), 40.0, 30.0, 0.25))
RAIL = Scene(24e9, 1.5e9, raster(0.3, 24), PlaneGrid.wall(
    (0.1, 3.0, 0.0), (0.0, -1.0), 1.6, 1.2, 0.02))
ROOM = dataclasses.replace(RAIL, grid=VolumeGrid(
    (-0.5, 2.5, -0.4), (0.02, 0, 0), (0, 0.03, 0), (0, 0, 0.025), 41, 24, 23))
OBLIQUE = dataclasses.replace(RAIL, grid=VolumeGrid(
    (-0.5, 2.4, -0.4), (0.02, 0.004, 0.002), (-0.01, 0.02, 0.002), (0, 0.003, 0.02), 30, 24, 23))
TOMOGRAPHY = Scene(  # seven tracks at different heights over houses
    10e9, 150e6, np.concatenate([track([-800, -30, 600 + h], [-800, 30, 600 + h], 64)
                                 for h in np.linspace(0, 36, 7)]),
    VolumeGrid.above(MapGrid((0.0, 0.0, 0.0), 48, 40, 0.5), 15.0, 0.75))
AHEAD = dataclasses.replace(TOMOGRAPHY, grid=VolumeGrid(  # the first axis follows range
    (-10.0, -8.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.5, 0.0), (0.5, 0.0, 0.0), 20, 33, 41))
BESIDE = dataclasses.replace(TOMOGRAPHY, grid=VolumeGrid(  # the middle axis does
    (-10.0, -8.0, 0.0), (0.0, 0.5, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 0.5), 33, 41, 20))
SCENES = {'vertical section': (MAST, 'lines'), 'turned section': (TURNED, 'lines'),
          'slant plane': (AIRCRAFT, 'lines'), 'wall': (RAIL, 'points'),
          'room': (ROOM, 'points'), 'oblique volume': (OBLIQUE, 'points'),
          'tomography': (TOMOGRAPHY, 'lines'), 'range first': (AHEAD, 'lines'),
          'range in the middle': (BESIDE, 'lines')}


def against_correlation_db(image, grid, block):
    """Error over the brightest and as many random pixels, dB."""
    flat, points = image.ravel(), grid.points().reshape(-1, 3)
    chosen = np.r_[np.argsort(np.abs(flat))[-200:],
                   np.random.default_rng(0).integers(0, flat.size, 200)]
    reference = correlate(*band_spectrum(block), block.tx_m, block.rx_m, points[chosen])
    return 10 * np.log10(np.sum(np.abs(flat[chosen] - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


@pytest.mark.parametrize('target_db', [-50.0, -80.0])
@pytest.mark.parametrize('name', SCENES)
def test_images_are_as_exact_as_predicted(name, target_db):
    scene, route = SCENES[name]
    block = scene.block(scene.random_points())
    image = plan_image(scene.grid, block.radar, block.n_samples, method='exact',
                       target_db=target_db)(block)
    report = image.report
    assert image.shape == scene.grid.shape
    # 6.3 cm up the mast repeat directions each 0.24, and the section is 0.4 wide, for instance
    assert all('ambiguous' in warning for warning in report.warnings)
    assert image.planned.predicted_error_db <= target_db  # as if evenly bright
    assert (against_correlation_db(image.samples, scene.grid, block)
            <= report.predicted_error_db + 3.0)
    if target_db == -50.0:  # more exact lines need segments so short that points are quicker
        assert report.plan.method == route


@pytest.mark.parametrize('name', ['vertical section', 'slant plane', 'oblique volume',
                                  'tomography', 'range in the middle'])
def test_what_is_planned_is_what_is_quicker(name):
    scene, _ = SCENES[name]
    block = scene.block(scene.random_points())
    rows = block.tx_m.reshape(-1, 3)
    arguments = block.radar, block.n_samples, rows, rows, -50.0
    plan = plan_backprojection(scene.grid, *arguments)
    other = exact_image(scene.grid.points(), block, target_db=-50.0)
    image = exact_image(scene.grid, block, target_db=-50.0)
    assert pickle.loads(pickle.dumps(plan)) == plan
    # Either may be as far from the exact image as is asked for.
    assert np.linalg.norm(image - other) <= 2 * 10 ** (-50 / 20) * np.linalg.norm(other)
    anywhere = plan_backprojection(
        ImagePoints.of_grid(PointGrid(scene.grid.points())), *arguments)
    assert plan.route.cost <= anywhere.route.cost * (1 + 1e-9)


def width_m(image, axis, spacing_m):
    """Width at -3 dB of the response through the brightest pixel along an axis, metres."""
    peak = np.unravel_index(np.abs(image).argmax(), image.shape)
    index = list(peak)
    index[axis] = slice(None)
    cut = np.abs(image[tuple(index)]) / np.abs(image[peak])
    ends = []
    for side in (cut[peak[axis]::-1], cut[peak[axis]:]):
        first = int(np.argmax(side < np.sqrt(0.5)))
        ends.append(first - (np.sqrt(0.5) - side[first]) / (side[first - 1] - side[first]))
    return sum(ends) * spacing_m


def across_m(scene, length_m, range_m):
    """Width across the line of sight that theory says, metres."""
    sine = np.sin(np.arctan(length_m / 2 / range_m))
    return WIDTH * SPEED_OF_LIGHT / scene.carrier_hz / (4 * sine)


def along_m(scene):
    """Width in range that theory says, metres."""
    return WIDTH * SPEED_OF_LIGHT / 2 / scene.bandwidth_hz


def check_focus(scene, grid, point, widths):
    """A reflector is imaged at its place, to a pixel, and so wide along each axis."""
    block = scene.block(np.array([point]))
    image = exact_image(grid, block, target_db=-60.0)
    assert np.abs(image).max() == pytest.approx(block.n_pulses, rel=0.01)
    found = grid.points()[np.unravel_index(np.abs(image).argmax(), image.shape)]
    steps = np.linalg.norm(grid.steps_m, axis=1)
    assert np.linalg.norm(found - point) <= 0.51 * np.linalg.norm(steps)
    for axis, wanted in enumerate(widths):
        assert width_m(image, axis, steps[axis]) == pytest.approx(wanted, rel=0.04)


def test_focus_in_a_vertical_section():
    grid = PlaneGrid.vertical_section((33.0, 0.0), (2.0, 0.0), 4.0, 3.0, 5.0, 0.02)
    check_focus(MAST, grid, [35.01, 0.0, 4.005],
                [across_m(MAST, 6.0 * 96 / 95, 35.0), along_m(MAST)])


def test_focus_on_a_slant_plane():
    grid = PlaneGrid.slant_plane(AIRCRAFT_TRACK, (0.0, 5.0, 0.0), 6.0, 6.0, 0.03)
    point = grid.points()[101, 104] + 0.2 * grid.steps_m[0]
    length = np.linalg.norm(AIRCRAFT_TRACK[-1] - AIRCRAFT_TRACK[0]) * 160 / 159
    check_focus(AIRCRAFT, grid, point,
                [across_m(AIRCRAFT, length, np.linalg.norm(point - AIRCRAFT_TRACK.mean(axis=0))),
                 along_m(AIRCRAFT)])


def test_focus_on_a_wall_before_a_rail():
    grid = PlaneGrid.wall((0.0, 3.0, 0.0), (0.0, -1.0), 0.3, 0.3, 0.003)
    width = across_m(RAIL, 0.3 * 24 / 23, 3.0)
    check_focus(RAIL, grid, [0.0, 3.0, 0.001], [width, width])


def test_focus_in_a_volume():
    grid = VolumeGrid((-0.12, 2.85, -0.12), (0.006, 0, 0), (0, 0.006, 0), (0, 0, 0.006), 41, 51,
                      41)
    width = across_m(RAIL, 0.3 * 24 / 23, 3.0)
    check_focus(RAIL, grid, [0.002, 3.0, 0.0], [width, along_m(RAIL), width])


def test_measure_error_knows_every_grid():
    for scene in (AIRCRAFT, BESIDE):
        block = scene.block(scene.random_points())
        image = exact_image(scene.grid, block, target_db=-60.0)
        told = measure_error(image, scene.grid, block, n_pixels=60, n_brightest=60)
        assert -100.0 < told.error_db <= -60.0


def test_terrain_and_points_are_grids_too(make_case):
    case = make_case(300.0, height_m=100.0)
    radar, n = case.block.radar, case.block.n_samples
    heights = 2.0 * np.sin(case.grid.x_m / 7) + 0 * case.grid.y_m[:, None]
    heights[3, 4] = np.nan
    by_map = exact_image(case.grid, case.block, height_m=heights)
    terrain = TerrainGrid(case.grid, heights)
    np.testing.assert_array_equal(exact_image(terrain, case.block), by_map)
    points = terrain.points()
    by_array = plan_image(points, radar, n, method='exact', target_db=-80.0)(case.block)
    np.testing.assert_array_equal(exact_image(PointGrid(points), case.block), by_array)
    assert isinstance(by_array.grid, PointGrid)
    assert by_map[3, 4] == 0
    with pytest.raises(ValueError, match='height_m goes with a MapGrid, not with PlaneGrid'):
        plan_image(AIRCRAFT.grid, radar, n, height_m=heights)


class OwnGrid:
    """What a user may write of a grid with equal steps."""

    def __init__(self, grid):
        self.origin_m, self.steps_m, self.shape = grid.origin_m, grid.steps_m, grid.shape
        self._grid = grid

    def positions(self, *index):
        return self._grid.positions(*index)

    def points(self):
        return self._grid.points()


@pytest.mark.parametrize('scene', [MAST, RAIL, ROOM, BESIDE])
def test_an_own_grid_with_equal_steps_is_the_plane_or_volume_that_it_is(scene):
    """Where points are the quickest it was asked for what PlaneGrid alone has, and failed."""
    block, own = scene.block(scene.random_points(3)), OwnGrid(scene.grid)
    image = exact_image(own, block)
    np.testing.assert_array_equal(image, exact_image(scene.grid, block))


def test_an_own_line_of_pixels_is_imaged_point_by_point():
    block, grid = RAIL.block(RAIL.random_points(3)), OwnGrid(RAIL.grid)
    grid.steps_m, grid.shape = grid.steps_m[1:], grid.shape[1:]
    grid.positions = lambda column: RAIL.grid.positions(0, column)
    grid.points = lambda: RAIL.grid.points()[0]
    np.testing.assert_array_equal(exact_image(grid, block),
                                  exact_image(PointGrid(RAIL.grid.points()[0]), block))


def test_positions_of_oblique_grids_are_part_of_the_memory():
    for scene, bytes_per_pixel in ((RAIL, 0), (ROOM, 0), (OBLIQUE, 24)):
        block, shape = scene.block(scene.random_points(3)), scene.grid.shape
        plan = plan_image(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                          method='exact', target_db=-80.0).report.plan
        assert plan.method == 'points'
        assert plan.n_bytes == bytes_per_pixel * np.prod(shape)
    with memory.granting(16 * np.prod(shape)), pytest.raises(
            MemoryError, match="30 x 24 x 23 pixels by method 'exact' needs"):
        exact_image(scene.grid, block)


def test_what_does_not_fit_into_memory_is_refused(make_case):
    case = make_case(300.0)
    huge = dataclasses.replace(ROOM.grid, n_x=10 ** 5, n_y=10 ** 5, n_z=10 ** 3)
    with pytest.raises(MemoryError, match='an image of 100000 x 100000 x 1000 pixels needs 8'):
        plan_image(huge, case.block.radar, case.block.n_samples)


@pytest.mark.parametrize('scene', [AIRCRAFT, TOMOGRAPHY], ids=['slant plane', 'tomography'])
def test_imagers_of_maps_refuse_other_grids_and_name_the_one_that_does_not(scene):
    grid, block = scene.grid, scene.block(scene.random_points(3))
    aperture = block.radar, block.n_samples, block.tx_m, block.rx_m
    for method in ('afbp', 'ffbp', 'wavenumber'):
        with pytest.raises(ValueError, match=f'grid is a {type(grid).__name__}; .* exact back'):
            plan_image(grid, *aperture, method=method, target_db=-50.0)


@pytest.mark.parametrize(('method', 'backend'), [
    ('auto', 'cpu'), ('auto', 'reference'), ('zero-padding', 'cpu'), ('correlation', 'cpu')])
def test_one_entry_images_any_grid(method, backend):
    grid = dataclasses.replace(AIRCRAFT.grid, n_u=20, n_v=15)
    block = AIRCRAFT.block(AIRCRAFT.random_points())
    image = plan_image(grid, block.radar, block.n_samples, method=method, target_db=-50.0,
                       backend=backend)(block)
    assert image.grid == grid and image.report.target_db == -50.0
    assert against_correlation_db(image.samples, grid, block) <= -45.0  # some cells of the scene
