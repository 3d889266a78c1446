# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps and clouds of obstacles as the steps publish them, read by the rules of Nav2's costmaps."""

import ast
import pathlib
import re
import threading
import time

import numpy as np
import pytest
import yaml

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from benchmarks.support.obstacle_scenes import Platform
from msg_conversions.images import occupancy_from_message
from msg_conversions.point_cloud import OBSTACLE_FIELDS, from_message
from sar_imaging.nodes.afbp_fusion import FusionStep
from sar_imaging.nodes.backprojection import IMAGE, BackprojectionStep
from sar_imaging.nodes.images import obstacle_products
from sar_imaging.nodes.poses import pose_input
from sar_imaging.signal.pulses import concatenate
from sar_imaging.streaming.subapertures import LiveSubapertures

from ..step_bench import Outputs, make

PAGE = (pathlib.Path(__file__).parents[3] / 'docs' / 'nav2.md').read_text()
PLACES = ((0.0, 0.0, 0.0), (0.55, 0.4, 0.0), (-0.5, -0.62, 0.0))
NO_INFORMATION, LETHAL, INSCRIBED, FREE = 255, 254, 253, 0


def costs(cells, *, track_unknown_space, lethal_cost_threshold=100, unknown_cost_value=255,
          inscribed_obstacle_cost_value=99, trinary_costmap=True):
    """Costs of occupancy values by the documented rules of nav2_costmap_2d's static layer.

    Values are read as bytes, so that -1 is 255. In this order: the unknown value is no
    information, or free where unknown space is not tracked; the inscribed value is inscribed
    (releases after Jazzy); from the threshold on a value is lethal; below it is free in a trinary
    costmap and scaled otherwise.
    """
    values = cells.astype(np.int8).view(np.uint8).astype(int)
    scaled = (values / lethal_cost_threshold * LETHAL).astype(int)
    out = np.where(values >= lethal_cost_threshold, LETHAL, FREE if trinary_costmap else scaled)
    out = np.where(values == inscribed_obstacle_cost_value, INSCRIBED, out)
    return np.where(values == unknown_cost_value, NO_INFORMATION if track_unknown_space else FREE,
                    out)


@pytest.fixture(name='car', scope='module')
def car_fixture():
    return Platform('automotive_77ghz', 2.0, 2)


@pytest.fixture(name='profiles', scope='module')
def profiles_fixture(car):
    rng = np.random.default_rng(3)
    return concatenate([
        car.profiles(i, car.spectra(i, PLACES, [3.0, 1.0, 0.5]) + car.noise(rng, -25.0))
        for i in range(2)])


def image_step(car, **parameters):
    g = car.grid
    return make(BackprojectionStep, **{
        'mode': IMAGE, 'pulses_per_aperture': 256, 'frame_id': 'odom', 'target_db': -60.0,
        **{f'grid.centre_{axis}': v for axis, v in zip('xyz', g.centre_m, strict=True)},
        'grid.size_x': 2.0, 'grid.size_y': 2.0, 'grid.spacing': g.spacing_m} | parameters)


def published(step, items, *topics):
    outputs = Outputs(*topics)
    step.create_outputs(outputs)
    for item in items:
        for product in step.process(item):
            step.publish(product)
    return outputs


def near_truth(grid, radius_m=0.12):
    """Pixels within two resolution cells, of some 5 cm, of a reflector."""
    points = grid.points()
    return np.min([np.linalg.norm(points - p, axis=-1) for p in PLACES], axis=0) <= radius_m


def check_map(message, grid):
    cells, where = occupancy_from_message(message)
    assert where == grid
    near = near_truth(grid)
    for place in PLACES:
        here = np.linalg.norm(grid.points() - place, axis=-1) <= 0.12
        assert (cells[here] == 100).any()
    assert not (cells[~near] == 100).any() and np.mean(cells == 0) > 0.7
    return cells


def costmap_with(word):
    """Parameters of the page's one example of a costmap that has a word in it."""
    [text] = [t for t in re.findall(r'^```yaml\n(.*?)^```', PAGE, re.DOTALL | re.MULTILINE)
              if word in t]
    return yaml.safe_load(text)['local_costmap']['local_costmap']['ros__parameters']


def test_costmaps_read_obstacles_free_space_and_the_unknown(car, profiles):
    """With the parameters that the page shows, with Nav2's defaults and on a scaled costmap."""
    step, _ = image_step(car, **{'obstacles.beamwidth': 12.0})
    outputs = published(step, [profiles], 'obstacle_map')
    assert len(outputs.sent['obstacle_map']) == 2
    cells, grid = occupancy_from_message(outputs.sent['obstacle_map'][-1])
    assert {-1, 0, 100} == set(np.unique(cells))
    parameters = costmap_with('StaticLayer')
    # A static layer resizes a costmap that is not rolling, and overwrites layers before it.
    assert parameters['rolling_window'] and parameters['plugins'][0] == 'radar_layer'
    assert parameters['radar_layer']['map_topic'] == '/obstacle_map'
    assert parameters['radar_layer']['map_subscribe_transient_local'] is True
    rules = {key: parameters[key] for key in ('track_unknown_space', 'lethal_cost_threshold',
                                              'trinary_costmap')}
    for options in (rules, {'track_unknown_space': True},
                    {'track_unknown_space': True, 'trinary_costmap': False},
                    {'track_unknown_space': True, 'lethal_cost_threshold': 65}):
        cost = costs(cells, **options)
        assert (cost[cells == 100] == LETHAL).all()
        assert (cost[cells == 0] == FREE).all()
        assert (cost[cells == -1] == NO_INFORMATION).all()
    # Where unknown space is not tracked it is free, as the page warns.
    assert (costs(cells, track_unknown_space=False)[cells == -1] == FREE).all()


def test_obstacles_are_points_for_obstacle_layers(car, profiles):
    step, log = image_step(car)
    outputs = published(step, [profiles], 'obstacles')
    assert outputs.sent['obstacle_map'] == []
    cloud = outputs.sent['obstacles'][-1]
    assert cloud.header.frame_id == 'odom'
    points = from_message(cloud, OBSTACLE_FIELDS)
    assert len(points) == len(PLACES) == log['obstacles_in_last_map']
    for place, (x, y, z, intensity, width) in zip(PLACES, points, strict=True):  # by strength
        assert np.hypot(x - place[0], y - place[1]) < 0.025 and z == 0.0  # half a cell
        assert 15 < intensity < 50 and 0.02 < width < 0.15
    # An obstacle layer drops points outside of the heights that the page gives it.
    radar = costmap_with('PointCloud2')['obstacle_layer']['radar']
    assert radar['data_type'] == 'PointCloud2' and radar['topic'] == '/obstacles'
    assert radar['marking'] is True and radar['clearing'] is False
    assert radar['min_obstacle_height'] <= points[:, 2].min()
    assert points[:, 2].max() <= radar['max_obstacle_height']


def test_the_launch_example_remaps_an_input_of_the_nodes():
    """Jazzy's launch was tried with it; here it is absent, and what can be read is checked."""
    code, _ = re.findall(r'^```python\n(.*?)^```', PAGE, re.DOTALL | re.MULTILINE)
    [remap] = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)
               and getattr(node.func, 'id', '') == 'SetRemap']
    source, target = (argument.value for argument in remap.args)
    assert source == pose_input.ODOMETRY  # the name of the topic, too
    assert target == '/odometry/filtered'


def test_the_watchdog_asks_for_the_liveliness_that_the_map_has():
    """A killed node was noticed within it over Fast DDS; here the two are compared."""
    _, code = re.findall(r'^```python\n(.*?)^```', PAGE, re.DOTALL | re.MULTILINE)
    names = {'__name__': 'page'}
    exec(code, names)
    for key in ('depth', 'reliability', 'durability', 'liveliness', 'liveliness_lease_duration'):
        assert getattr(names['MAP'], key) == getattr(obstacle_products.MAP_QOS, key)


def test_nothing_is_built_for_nobody(car, profiles, monkeypatch):
    made = []
    detector = obstacle_products.ObstacleDetector

    def counting(*arguments, **options):
        made.append(arguments)
        return detector(*arguments, **options)

    monkeypatch.setattr(obstacle_products, 'ObstacleDetector', counting)
    step, log = image_step(car)
    outputs = published(step, [profiles], 'image')
    assert made == [] and log['obstacle_maps_published'] == 0
    for _ in range(2):
        outputs.join('obstacle_map')  # the latest image, once
    assert len(made) == log['obstacle_maps_published'] == 1
    check_map(outputs.sent['obstacle_map'][0], car.grid)


def test_images_do_not_wait_for_maps_and_the_newest_that_waits_replaces_the_one_before(
        car, profiles, monkeypatch):
    begun, goes_on, started = threading.Event(), threading.Event(), []
    detector = obstacle_products.ObstacleDetector

    def slow(*arguments, **options):
        started.append(arguments)
        begun.set()
        assert goes_on.wait(60.0)
        return detector(*arguments, **options)

    monkeypatch.setattr(obstacle_products, 'ObstacleDetector', slow)
    step, log = image_step(car)
    outputs = Outputs('obstacle_map')
    step.create_outputs(outputs)
    [first, second] = step.process(profiles)
    step._obstacles.activate(outputs)
    step.publish(first)
    assert begun.wait(60.0)
    for image in (first, second):  # while the first map is in work
        step.publish(image)
    assert log['images_published'] == 3 and outputs.sent['obstacle_map'] == []
    assert log['obstacle_maps_skipped'] == 1
    goes_on.set()
    step._obstacles._worker.call(lambda: None).result(60.0)  # after what waits
    assert len(started) == len(outputs.sent['obstacle_map']) == log['obstacle_maps_published'] == 2
    stamps = [_ns(m.header.stamp) for m in outputs.sent['obstacle_map']]
    assert stamps == [first.stamp_ns, second.stamp_ns]
    assert log['last_obstacle_map_seconds'] > 0
    outputs.activity.close()
    cells, _ = occupancy_from_message(outputs.sent['obstacle_map'][-1])
    assert (cells == -1).all()


def test_pixels_that_are_too_far_apart_are_told_once(car, profiles):
    step, log = image_step(car, **{'grid.spacing': 2 * car.grid.spacing_m})
    published(step, [profiles], 'obstacle_map')
    [told] = [line for line in log.lines if line.startswith('obstacle map: pixels')]
    assert 'more than half of the null spacing' in told and 'set grid.spacing to 0.0' in told


def test_fused_images_have_the_same_obstacles(car, profiles):
    stage = LiveSubapertures(car.grid, pulses_per_aperture=256, pulses_per_subaperture=32)
    step, _ = make(FusionStep, pulses_per_aperture=256, images_every=2)
    outputs = published(step, stage.add(profiles), 'obstacle_map')
    # Images of an aperture underway are no evidence of their own.
    assert len(outputs.sent['obstacle_map']) == 2
    for message in outputs.sent['obstacle_map']:
        check_map(message, car.grid)


def test_evidence_of_apertures_adds_up(car):
    """A reflector 13 dB above noise, which a single image does not tell from it."""
    rng = np.random.default_rng(8)
    blocks = [car.profiles(i % 2, car.spectra(i % 2, PLACES[:1], [10**-0.6])
                           + car.noise(rng, -25.0)) for i in range(2)]
    step, _ = image_step(car, **{'obstacles.false_alarms': 1e-6})
    outputs = published(step, blocks, 'obstacle_map')
    [first, second] = [occupancy_from_message(m)[0] for m in outputs.sent['obstacle_map']]
    assert not (first == 100).any()
    assert (second[near_truth(car.grid)] == 100).any()


def test_images_without_a_track_are_counted_and_told_once(car, profiles):
    step, log = image_step(car)
    outputs = Outputs('obstacle_map')
    step.create_outputs(outputs)
    for image in step.process(profiles):
        step._pulses.view = lambda counters, near_ns: _raise('the track bends by 3 m')
        step.publish(image)
    assert log['obstacle_maps_refused'] == 2 and log['images_published'] == 2
    told = [line for line in log.lines if 'no obstacle map' in line]
    assert told == ['no obstacle map of this image: the track bends by 3 m']
    assert outputs.sent['obstacle_map'] == []


def _raise(text):
    raise ValueError(text)


def test_images_on_terrain_have_no_obstacle_map(car, tmp_path):
    from sar_imaging.geometry.terrain import Terrain

    path = tmp_path / 'hill.npz'
    Terrain(np.linspace(-3, 3, 5), np.linspace(-3, 3, 5), np.zeros((5, 5))).save(str(path))
    step, _ = image_step(car, **{'terrain.file': str(path)})
    outputs = Outputs()
    step.create_outputs(outputs)
    assert 'image' in outputs.sent and 'obstacle_map' not in outputs.sent


def test_a_node_that_stops_leaves_an_unknown_map(car, profiles):
    step, _ = image_step(car)
    outputs = published(step, [profiles], 'obstacle_map')
    assert (occupancy_from_message(outputs.sent['obstacle_map'][-1])[0] == 0).any()
    step._obstacles.activate(outputs)
    outputs.activity.close()
    assert (occupancy_from_message(outputs.sent['obstacle_map'][-1])[0] == -1).all()


def test_a_map_that_no_image_renews_fades_until_all_is_unknown(car, profiles, monkeypatch):
    step, _ = image_step(car, **{'obstacles.memory_s': 2.0})
    outputs = published(step, [profiles], 'obstacle_map')
    maps, n = outputs.sent['obstacle_map'], len(outputs.sent['obstacle_map'])
    now = time.monotonic()
    step._obstacles.fade()  # too early for another
    assert len(maps) == n
    for passed, known in ((1.0, True), (2.5, False)):
        monkeypatch.setattr(time, 'monotonic', lambda s=passed: now + s)
        step._obstacles.fade()
        cells, _ = occupancy_from_message(maps[-1])
        assert (cells == 0).any() == known and (known or (cells == -1).all())
    step._obstacles.fade()  # all is told
    assert len(maps) == n + 2
    later_ns = _ns(maps[-1].header.stamp) - _ns(maps[n - 1].header.stamp)
    assert later_ns == pytest.approx(2.5e9, rel=0.1)


def _ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec
