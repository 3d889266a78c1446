# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Mode volume: the reflectors of a raster scan as points where they are, by steps and over DDS."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sensor_msgs.msg import PointCloud2

from msg_conversions.point_cloud import CELL_FIELDS, GEOGRAPHIC_FIELDS, from_message
from sar_imaging.exploitation.bright_cells import bright_cells
from sar_imaging.geometry import Datum, VolumeGrid
from sar_imaging.nodes.backprojection import VOLUME, BackprojectionStep
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.tools.node_processes import parameters_from_truth, pipeline_parameters
from sar_imaging.tools.simulate import scenario_truth

from ..step_bench import Outputs, make

SCENARIO = SCENARIOS['raster_scan']()
PLACES = np.array([s.position_m for s in SCENARIO.scatterers])
N = SCENARIO.n_pulses
PARAMETERS = {'volume.height': SCENARIO.height_m, 'volume.threshold_db': 30.0}
# Half of the sides of a resolution cell, wavelength x 4 m / 2 / 0.35 m and c / 2B: 7 and 15 cm.
NEAR_M = (0.04, 0.08, 0.04)


@pytest.fixture(name='pulses', scope='module')
def pulses_fixture():
    return concatenate(list(SCENARIO.blocks()))


def volume_step(**parameters):
    grid = SCENARIO.grid
    return make(BackprojectionStep, **{
        'mode': VOLUME, 'pulses_per_aperture': N, 'frame_id': 'scanner', 'target_db': -60.0,
        **{f'grid.centre_{axis}': v for axis, v in zip('xyz', grid.centre_m, strict=True)},
        'grid.size_x': 1.2, 'grid.size_y': 1.2, 'grid.spacing': grid.spacing_m,
        **PARAMETERS} | parameters)


def check_places(rows):
    """The power of the points around each reflector has its middle there; nothing else is bright.

    Tolerance: 1 cm, a third of a cell and a seventh of the resolution.
    """
    for place in PLACES:
        near = (np.abs(rows[:, :3] - place) < NEAR_M).all(axis=1)
        power = 10 ** (rows[near, 3] / 10)
        np.testing.assert_allclose(power @ rows[near, :3] / power.sum(), place, atol=0.01)
    brightest = rows[rows[:, 3] > rows[0, 3] - 10]  # sidelobes are 13 dB below
    off = np.abs(brightest[:, None, :3] - PLACES)
    assert (off < 2 * np.array(NEAR_M)).all(axis=2).any(axis=1).all()
    assert (np.diff(rows[:, 3]) <= 0).all() and rows[-1, 3] >= 30.0 - 1e-4


def test_reflectors_of_a_raster_are_points_at_their_heights(start_node, make_observer, pulses):
    """Raw pulses to the cloud, over real DDS."""
    values = pipeline_parameters(parameters_from_truth(scenario_truth(SCENARIO), VOLUME))
    node = start_node('sar_pipeline', values['sar_pipeline'] | PARAMETERS | {
        'frame_id': 'scanner', 'target_db': -60.0})
    observer = make_observer()
    observer.subscribe(PointCloud2, 'volume')
    node.wait_for_log('sar_pipeline', 'subscriber on .*/volume joined')
    observer.wait(lambda: observer.joined, 'a subscriber of the pulses')
    observer.send([pulses.select(slice(n, n + 48)) for n in range(0, N, 48)])
    [cloud] = observer.wait_for('volume', 1)
    assert cloud.header.frame_id == 'scanner'
    stamp = cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec
    middle = (int(pulses.stamp_ns[0]) + int(pulses.stamp_ns[-1])) // 2
    assert abs(stamp - middle) <= 1
    check_places(from_message(cloud, CELL_FIELDS))
    assert '41 x 41 x 41 cells of 0.03 x 0.03 x 0.03 m around (0, 4, 0.6) m in frame scanner' in (
        node.log('sar_pipeline'))
    node.wait_for_log('sar_pipeline', 'image of aperture 0: 576 pulses, missing none')


@pytest.fixture(name='profiles', scope='module')
def profiles_fixture(pulses):
    return RangeCompressor.for_block(pulses)(pulses)


def test_the_volume_is_as_exact_as_predicted(profiles):
    step, _ = volume_step()
    [product] = step.process(profiles)
    volume = VolumeGrid.above(SCENARIO.grid, SCENARIO.height_m)
    assert product.grid == volume and product.image.shape == volume.shape == (41, 41, 41)
    measured = measure_error(product.image, volume, profiles, n_pixels=150)
    assert measured.error_db < product.predicted_error_db < -60.0


def test_clouds_follow_their_parameters_and_become_files(profiles, tmp_path):
    datum = Datum(47.3, 8.5, 430.0, 20.0)
    step, log = volume_step(**{
        'save.folder': str(tmp_path), 'datum.source': 'parameters',
        **{f'datum.{name}': value for name, value in vars(datum).items()}})
    outputs = Outputs('volume')
    step.create_outputs(outputs)
    assert list(outputs.sent) == ['volume']
    with pytest.raises(ValueError, match=r'no volume was formed since save\.folder was set'):
        step.saving()
    [product] = step.process(profiles)
    step.publish(product)
    [cloud] = outputs.sent['volume']
    expected = bright_cells(product.image, product.grid, threshold_db=30.0)
    rows = from_message(cloud, CELL_FIELDS)
    np.testing.assert_allclose(rows[:, :3], expected.points_m, atol=1e-6)
    np.testing.assert_allclose(rows[:, 3], expected.intensity_db, rtol=1e-6)
    places = from_message(cloud, GEOGRAPHIC_FIELDS)
    np.testing.assert_allclose(datum.from_geographic(*places.T), rows[:, :3], atol=1e-5)
    assert log['points_in_last_cloud'] == len(rows) > 100
    text = step.saving()()
    [path] = tmp_path.glob('volume_*.ply')
    assert str(path) in text and f'element vertex {len(rows)}'.encode() in path.read_bytes()

    step.parameters |= {'volume.max_points': 7, 'save.folder': ''}
    step.publish(product)
    np.testing.assert_array_equal(from_message(outputs.sent['volume'][1], CELL_FIELDS), rows[:7])
    assert any('the cloud has the brightest volume.max_points=7' in line for line in log.lines)
    with pytest.raises(ValueError, match=r'parameter save\.folder is empty'):
        step.saving()
    outputs.listened.clear()
    step.parameters['volume.max_points'] = 3
    step.publish(product)  # nothing is built for nobody
    assert len(outputs.sent['volume']) == 2 and log['points_in_last_cloud'] == 7


def test_points_have_their_cross_section(profiles, tmp_path):
    """The closed form of the test of `sar-imaging image --height`."""
    constant = tmp_path / 'radar.yaml'
    constant.write_text('gain_m: 16.0\nnoise_power: 0.01\n')
    step, log = volume_step(**{'radiometry.quantity': 'rcs', 'save.folder': str(tmp_path),
                               'radiometry.constant_file': str(constant)})
    outputs = Outputs('volume')
    step.create_outputs(outputs)
    [product] = step.process(profiles)
    step.publish(product)
    rows = from_message(outputs.sent['volume'][0], CELL_FIELDS)
    for thing in SCENARIO.scatterers:
        near = (np.abs(rows[:, :3] - thing.position_m) < NEAR_M).all(axis=1)
        distance = np.linalg.norm(profiles.tx_m[:, 0] - thing.position_m, axis=-1)
        expected = 20 * np.log10(abs(thing.amplitude) / 16.0 / (distance**-2.0).mean())
        assert rows[near, 3].max() == pytest.approx(expected, abs=0.6)
    assert log['responses_computed'] == 1 and log['images_not_calibrated'] == 0
    assert any('dB of rcs, noise-equivalent' in line and 'incidence' not in line
               for line in log.lines)
    assert step.saving()()
    assert b'radar cross section' in next(tmp_path.glob('volume_*.ply')).read_bytes()


@pytest.mark.parametrize(('parameters', 'message'), [
    ({'volume.height': 0.0}, r'volume\.height=0 in mode volume; expected the positive height'),
    ({'volume.spacing': 1e-4}, r'41 x 41 x 12001 cells, more than max_image_pixels=10000000; '
     r'raise grid\.spacing=0\.03 or volume\.spacing=0\.0001'),
    ({'method': 'afbp'}, 'method: afbp images maps, not volumes; set method: exact'),
    ({'autofocus.track_error': 0.1}, 'autofocus.track_error=0.1 .* mode: volume, which has no'),
    ({'radiometry.quantity': 'sigma0', 'radiometry.constant_file': 'radar.yaml'},
     'radiometry.quantity=sigma0 in mode volume, whose cells have no area of ground; expected'),
    ({'terrain.file': 'hill.npz'}, 'terrain.file: a volume has level layers; use mode image')])
def test_impossible_volumes_are_refused(parameters, message):
    with pytest.raises(ConfigurationError, match=message):
        volume_step(max_image_pixels=10_000_000, **parameters)


def test_a_volume_too_large_for_the_memory_is_refused_before_it_is_made(monkeypatch):
    from sar_imaging.configuration.settings import Machine

    machine = Machine(1e9, 'given', 1_000_000)  # of the 1.7 MB that 41^3 cells take
    monkeypatch.setattr(Machine, 'this_one', classmethod(lambda cls: machine))
    with pytest.raises(ConfigurationError, match='a volume of 41 x 41 x 41 cells and its message '
                       r'need 2 MB, 1 MB are available; raise grid\.spacing'):
        volume_step()
