# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""radar_driver: messages of a radar's driver over DDS become pulses."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float32MultiArray, MultiArrayLayout

from msg_conversions import pulse_block
from sar_imaging.nodes import radar_driver
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

SCANS = RadarParameters(3.95e9, 1.5e9, 16e9, 2 * 3.5 / SPEED_OF_LIGHT, waveform=Waveform.PASSBAND)
RX_M = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]])
POINT = [0.4, 5.0, 0.0]
P440 = {'samples': {'topic': 'radar_frames', 'sizes': {'channel': 2, 'sample': 512}},
        'radar': {'waveform': 'passband', 'carrier_hz': 3.95e9, 'bandwidth_hz': 1.5e9,
                  'sample_rate_hz': 16e9, 'range_start_m': 3.5},
        'array': {'rx_m': RX_M.tolist()}}
N_SCANS = 20


def scans():
    """(P, 2, 512) samples, and their phase centres."""
    position = np.stack([0.01 * np.arange(N_SCANS), 0 * np.arange(N_SCANS),
                         1 + 0 * np.arange(N_SCANS)], axis=-1)
    tx_m = np.repeat(position[:, None], 2, axis=1)
    rx_m = position[:, None] + RX_M
    return EchoSimulator(SCANS, 512, compressed=False, points_m=[POINT],
                         amplitudes=[1000.0])(tx_m, rx_m), tx_m, rx_m


def description(folder, tree=P440):
    path = folder / 'radar.yaml'
    path.write_text(yaml.safe_dump(tree))
    return str(path)


@pytest.fixture
def driver(start_node, make_observer, tmp_path):
    """The node, and an observer that publishes what the radar's driver would."""
    node = start_node('radar_driver', {'description_file': description(tmp_path)})
    observer = make_observer('radar_frames')
    observer.subscribe(Float32MultiArray, 'pulses')
    observer.wait(lambda: observer.joined, 'the subscription')
    node.wait_for_log('radar_driver', 'subscriber on .*/pulses joined')
    return node, observer


@pytest.mark.usefixtures('whole_end')
def test_scans_without_header_become_pulses_that_focus(driver):
    node, observer = driver
    samples, tx_m, rx_m = scans()
    before_ns = observer.node.get_clock().now().nanoseconds
    observer.send_messages(Float32MultiArray(data=scan.real.ravel().tolist()) for scan in samples)
    blocks = [pulse_block.from_message(m) for m in observer.wait_for('pulses', N_SCANS)]
    after_ns = observer.node.get_clock().now().nanoseconds
    block = concatenate(blocks)
    np.testing.assert_array_equal(block.counter, np.arange(N_SCANS))
    assert before_ns <= block.stamp_ns[0] <= block.stamp_ns[-1] <= after_ns
    assert not block.has_positions and block.radar.waveform == Waveform.PASSBAND
    np.testing.assert_allclose(block.samples, samples, atol=1e-4)  # float32 of 1000
    placed = PulseBlock(block.radar, False, block.stamp_ns, block.counter, block.samples, tx_m,
                        rx_m)
    profiles = RangeCompressor.for_block(placed)(placed)
    path_m = 0.5 * (np.linalg.norm(tx_m - POINT, axis=-1) + np.linalg.norm(rx_m - POINT, axis=-1))
    away_m = (profiles.radar.range_start_m + np.abs(profiles.samples).argmax(axis=-1)
              * profiles.radar.sample_spacing_m - path_m)
    assert np.abs(away_m).max() <= profiles.radar.sample_spacing_m
    log = node.log('radar_driver')
    assert '2 channels of 512 samples; pulse_buffer needs antenna.tx: [0.0, 0.0, 0.0, 0' in log
    assert 'antenna.rx: [0.0, 0.0, 0.0, 0.03, 0.0, 0.0], antenna.offset_s: [0.0, 0.0]' in log


def test_broken_scans_are_counted_and_the_node_lives_on(driver):
    node, observer = driver
    good = Float32MultiArray(data=scans()[0][0].real.ravel().tolist())
    observer.send_messages([Float32MultiArray(data=[1.0, 2.0]), good,
                            Float32MultiArray(layout=MultiArrayLayout(data_offset=9)), good])
    observer.wait_for('pulses', 2)
    observer.wait_for_counters('radar_driver', frames_received=4, frames_rejected=2,
                               frames_converted=2, pulses_published=2)
    node.wait_for_log('radar_driver', 'rejected a frame: data holds 2 numbers; expected 1 x 2 x '
                      '512')


def test_a_topic_on_which_nothing_comes_is_told_with_what_may_be_meant(
        start_node, make_observer, tmp_path):
    node = start_node('radar_driver', {'description_file': description(tmp_path)})
    node.wait_for_log('radar_driver', 'nothing came on .*/radar_frames for more than 5 s: '
                      'nobody publishes std_msgs/msg/Float32MultiArray; is the driver')
    observer = make_observer('uwb/scan')
    node.wait_for_log('radar_driver', 'nobody publishes there, std_msgs/msg/Float32MultiArray is '
                      'on .*/uwb/scan; remap radar_frames, or correct the parameter message_type')
    other = observer.node.create_publisher(MultiArrayLayout, 'radar_frames', 10)
    node.wait_for_log('radar_driver', 'it carries std_msgs/msg/MultiArrayLayout, expected std_')
    observer.node.destroy_publisher(other)


def test_a_driver_of_another_reliability_is_told_with_the_parameter_that_helps(
        start_node, make_observer, tmp_path):
    parameters = {'description_file': description(tmp_path)}
    node = start_node('radar_driver', parameters)
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    observer = make_observer()
    observer.subscribe(Float32MultiArray, 'pulses')
    scan = Float32MultiArray(data=scans()[0][0].real.ravel().tolist())
    publisher = observer.node.create_publisher(Float32MultiArray, 'radar_frames', best_effort)
    node.wait_for_log('radar_driver', 'qos_overrides./radar_frames.subscription.reliability')
    observer.wait_for_counters('radar_driver', qos_incompatible=1)
    node.stop('radar_driver')
    node = start_node('radar_driver', {
        **parameters, 'qos_overrides./radar_frames.subscription.reliability': 'best_effort'})
    node.wait_for_log('radar_driver', 'subscriber on .*/pulses joined')
    observer.wait(publisher.get_subscription_count, 'the subscription')
    publisher.publish(scan)
    observer.wait_for('pulses', 1)


def test_it_may_be_deactivated_and_activated(driver):
    node, observer = driver
    assert observer.change_state('radar_driver', 'deactivate')
    assert observer.state('radar_driver') == 'inactive'
    left = observer.joined
    assert observer.change_state('radar_driver', 'activate')
    observer.wait(lambda: observer.joined > left, 'the new subscription')
    observer.send_messages([Float32MultiArray(data=scans()[0][0].real.ravel().tolist())])
    observer.wait_for('pulses', 1)


def test_a_reset_counts_from_zero_again(driver):
    _, observer = driver
    scan = Float32MultiArray(data=scans()[0][0].real.ravel().tolist())
    observer.send_messages([scan, scan])
    observer.wait_for('pulses', 2)
    assert observer.trigger('radar_driver/reset')[0]
    observer.send_messages([scan])
    counters = [pulse_block.from_message(m).counter[0] for m in observer.wait_for('pulses', 3)]
    assert counters == [0, 1, 0]


@pytest.mark.parametrize(('parameters', 'message'), [
    ({}, 'parameter description_file is empty; name the description of the radar'),
    ({'message_type': 'nav_msgs/msg/Odometry'}, "message_type='nav_msgs/msg/Odometry'; expected "
     'the full name of a type such as package/msg/IQ'),
    ({'message_type': 'no_such_msgs/msg/IQ'}, 'this Python has no such messages'),
    ({'description_file': 'nowhere.yaml'}, 'description_file: description nowhere.yaml cannot be '
     'read')])
def test_what_cannot_work_is_told_at_the_start(start_node, parameters, message):
    node = start_node('radar_driver', parameters)
    assert node.exit_code('radar_driver') == 1
    assert message in node.log('radar_driver')


def test_a_description_with_a_mistake_is_told(start_node, tmp_path):
    tree = P440 | {'frames': {'stamp': 'now'}}
    node = start_node('radar_driver', {'description_file': description(tmp_path, tree)})
    assert node.exit_code('radar_driver') == 1
    assert 'frames.stamp: expected one of start, end, receipt' in node.log('radar_driver')


def test_the_configuration_file_lists_every_parameter_with_its_default(pytestconfig):
    tree = yaml.safe_load((pytestconfig.rootpath / 'sar_imaging' / 'config' / 'sar_imaging.yaml'
                           ).read_text())['/**/radar_driver']['ros__parameters']
    assert tree == {p.name: p.default for p in radar_driver.PARAMETERS if p.name != 'queue_depth'}
    page = (pytestconfig.rootpath / 'docs' / 'nodes' / 'radar_driver.md').read_text()
    for p in radar_driver.PARAMETERS:
        assert f'| `{p.name}` |' in page
