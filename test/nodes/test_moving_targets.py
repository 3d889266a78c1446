# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The node moving_targets: from a recording of cars on clutter to point clouds."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from nav_msgs.msg import MapMetaData
from sensor_msgs.msg import Image, PointCloud2

from msg_conversions.images import complex_from_message
from msg_conversions.point_cloud import GEOGRAPHIC_FIELDS, from_message
from sar_imaging.exploitation.movers.moving_targets import LiveMovingTargets, MovingTargetFinder
from sar_imaging.geometry import Datum, MapGrid
from sar_imaging.nodes.runtime.managed import LATCHED
from sar_imaging.recordings import bag_io
from sar_imaging.simulation.scenarios import moving_targets
from sar_imaging.tools.simulate import scenario_truth

GRID = MapGrid.from_size((0.0, 0.0, 0.0), 40.0, 40.0, 0.5)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Scenario of two apertures and a recording of it, with clutter in the middle only."""
    scenario = moving_targets()
    clutter = tuple(s for s in scenario.scatterers if np.abs(s.position_m[:2]).max() < 16.0)
    scenario = dataclasses.replace(scenario, scatterers=clutter, grid=GRID)
    path = tmp_path_factory.mktemp('bags') / 'moving_targets'
    bag_io.write_bag(path, scenario.blocks(40), scenario_truth(scenario))
    assert [m['velocity_m_per_s'] for m in bag_io.read_truth(path)['movers']] == [
        list(m.velocity_m_per_s) for m in scenario.movers]
    return scenario, path


def test_cars_of_a_recording_become_points(start_node, make_observer, bag):
    scenario, path = bag
    node = start_node('moving_targets', {
        'grid.size_x': 40.0, 'grid.size_y': 40.0, 'grid.spacing': 0.5, 'frame_id': 'odom',
        'pulses_per_aperture': 120})
    observer = make_observer('range_profiles')
    received = {name: [] for name in ('clouds', 'products', 'metadata')}
    observer.node.create_subscription(PointCloud2, 'moving_targets',
                                      received['clouds'].append, 10)
    observer.node.create_subscription(Image, 'interferogram', received['products'].append, 10)
    observer.node.create_subscription(MapMetaData, 'interferogram_metadata',
                                      received['metadata'].append, LATCHED)
    node.wait_for_log('moving_targets', 'subscriber on .*/interferogram joined')
    node.wait_for_log('moving_targets', 'subscriber on .*/moving_targets joined')
    observer.wait(lambda: observer.joined, 'a subscriber of the profiles')
    observer.send(cdr for _, cdr in bag_io.raw_messages(path))
    observer.wait(lambda: all(len(received[k]) >= n for k, n in
                              (('clouds', 2), ('products', 2), ('metadata', 1))), 'two apertures')

    # The node adds nothing to its plain class, and loses nothing but what float32 does.
    live = LiveMovingTargets(MovingTargetFinder(GRID), pulses_per_aperture=120)
    expected = [result for block in bag_io.read_blocks(path) for result in live.add(block)]
    assert sum(len(result.detections) for result in expected) >= 3
    for cloud, product, result in zip(received['clouds'], received['products'], expected,
                                      strict=True):
        rows = from_message(cloud)
        assert cloud.header.frame_id == 'odom' and cloud.header == product.header
        stamp = cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec
        assert stamp == result.stamp_ns
        np.testing.assert_allclose(rows[:, :3], [d.position_m for d in result.detections],
                                   rtol=1e-6)
        np.testing.assert_allclose(
            rows[:, 3:], [(d.radial_velocity_m_per_s, d.snr_db, d.radial_velocity_std_m_per_s)
                          for d in result.detections], rtol=1e-6)
        np.testing.assert_array_equal(complex_from_message(product), result.interferogram)
        # Nothing but the cars of the scenario, at range rates within 4 standard deviations.
        centre = scenario.phase_centres()[0][result.counters, 2].mean(axis=0)
        for row in rows:
            assert any(abs(row[0] - m.position_m[0]) < 2.0 and
                       abs(row[3] - m.radial_velocity_m_per_s(centre)) < 4 * row[5]
                       for m in scenario.movers), row
    assert received['metadata'][0].width == GRID.n_x

    observer.wait(lambda: any(v.key == 'apertures_searched' and v.value == '2'
                              for a in observer.messages['/diagnostics'] for s in a.status
                              if s.name == 'moving_targets: stage' for v in s.values),
                  'the diagnostics')
    assert observer.trigger('moving_targets/form_image') == (
        False, 'no aperture is being filled, or it was dropped; see the log')
    assert node.stop('moving_targets') == 0
    assert 'Traceback' not in node.log('moving_targets')
    assert 'aperture 1: ' in node.log('moving_targets')


def test_impossible_clutter_is_refused_with_the_choices(start_node):
    node = start_node('moving_targets', {'clutter': 'weibull'})
    assert node.exit_code('moving_targets') == 1
    assert "clutter: 'weibull' is unknown; use one of k, exponential" in node.log('moving_targets')


def test_targets_have_places_on_the_earth_and_become_files(start_node, make_observer, bag,
                                                           tmp_path):
    datum = Datum(-12.25, 45.5, 1300.0, heading_deg=77.0)
    start_node('moving_targets', {
        'grid.size_x': 40.0, 'grid.size_y': 40.0, 'grid.spacing': 0.5, 'pulses_per_aperture': 120,
        'datum.source': 'parameters', 'save.folder': str(tmp_path / 'out')} | {
            f'datum.{name}': value for name, value in vars(datum).items()})
    observer = make_observer('range_profiles')
    observer.subscribe(PointCloud2, 'moving_targets')
    observer.wait(lambda: observer.joined, 'a subscriber of the profiles')
    assert observer.trigger('moving_targets/save_targets') == (False,
                                                               'no aperture was searched yet')
    observer.send(cdr for _, cdr in bag_io.raw_messages(bag[1]))
    cloud = observer.wait_for('moving_targets', 2)[-1]
    places, rows = from_message(cloud, GEOGRAPHIC_FIELDS), from_message(cloud)
    assert len(rows)
    # float32 places of the cloud, 1e-7 of 20 m
    np.testing.assert_allclose(datum.from_geographic(*places.T), rows[:, :3], atol=1e-5)
    for kind in ('geojson', 'csv'):
        assert observer.set_parameter('moving_targets', 'save.points_format', kind)[0]
        success, text = observer.trigger('moving_targets/save_targets')
        assert success and text.endswith(f'.{kind}, {len(rows)} targets')
    [path] = (tmp_path / 'out').glob('targets_*.geojson')
    features = json.loads(path.read_text())['features']
    np.testing.assert_allclose([f['geometry']['coordinates'] for f in features],
                               places[:, [1, 0, 2]], rtol=0, atol=1e-4)
    np.testing.assert_allclose([f['properties']['radial_velocity'] for f in features], rows[:, 3],
                               rtol=1e-6)
