# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps that poses and parameters change while they work, without processes."""

import dataclasses
import types

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from sar_imaging.nodes.backprojection import BackprojectionStep
from sar_imaging.nodes.moving_targets import MovingTargetsStep
from sar_imaging.nodes.poses import pose_input
from sar_imaging.nodes.pulse_buffer import PulseBufferStep
from sar_imaging.nodes.range_compression import RangeCompressionStep
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

from ..step_bench import Outputs, make

RADAR = RadarParameters(10e9, 100e6, 250e6, 1e-6)
MS = 1_000_000


class Node(Outputs):
    """What poses need of a node besides: subscriptions, a timer, and to be woken."""

    def __init__(self):
        super().__init__()
        self.callbacks, self.timers, self.wakes = {}, [], 0

    def create_input(self, message_type, topic, callback, qos, **events):
        self.callbacks[topic] = callback
        self.activity.callback(self.callbacks.pop, topic)
        return types.SimpleNamespace(topic_name=f'/{topic}', qos_profile=qos)

    def repeat(self, period_s, call):
        self.timers.append(call)
        self.activity.callback(self.timers.remove, call)

    def get_publishers_info_by_topic(self, topic):
        return []

    def get_topic_names_and_types(self):
        return []

    def wake(self):
        self.wakes += 1


def pulses(first_ms, stop_ms, n_channels=1):
    number = np.arange(first_ms, stop_ms)
    return PulseBlock(RADAR, False, number * MS, number,
                      np.ones((number.size, n_channels, 16)))


def pose(kind, time_ms, frame='odom'):
    """At 2 m/s along x, turned to the left by a quarter."""
    message = kind()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ms * MS, 10**9)
    inner = message.pose.pose if kind is Odometry else message.pose
    inner.position.x = 2e-3 * time_ms
    inner.orientation.z = inner.orientation.w = np.sqrt(0.5)
    return message


@pytest.fixture(params=['odometry', 'pose'])
def flight(request):
    """Step that takes positions from a topic, its log, its node, and how to send it poses."""
    step, log = make(PulseBufferStep, **{
        'pose.source': request.param, 'antenna.tx': [1.0, 0.0, 0.0], 'antenna.rx': [0.0] * 3,
        'pulses_per_block': 10, 'reorder_window_pulses': 0, 'stall_timeout_s': 5.0,
        'frame_id': 'odom'})
    node = Node()
    step.create_outputs(node)
    step.activate(node)
    kind = {'odometry': Odometry, 'pose': PoseStamped}[request.param]

    def send(times_ms, **options):
        for time_ms in times_ms:
            node.callbacks[request.param](pose(kind, time_ms, **options))

    return types.SimpleNamespace(step=step, log=log, node=node, send=send)


def numbers(blocks):
    return [int(c) for block in blocks for c in block.counter]


def test_pulses_wait_for_their_poses_and_get_their_places(flight):
    step, node = flight.step, flight.node
    assert step.process(pulses(10, 30)) == []
    assert node.wakes == 0
    flight.send(range(0, 40, 10))
    assert node.wakes == 1  # one call takes all that came until then
    blocks = step.collect()
    assert numbers(blocks) == []  # 19 ms needs the pose at 40 ms, too
    flight.send([40, 50, 60])
    assert node.wakes == 2
    [first, second] = step.collect()
    assert numbers([first, second]) == list(range(10, 30))
    x = 2e-3 * np.arange(10, 20)
    # A metre ahead of a platform that looks to +y.
    np.testing.assert_allclose(first.tx_m[:, 0], np.stack([x, 1 + 0 * x, 0 * x], 1), atol=1e-7)
    np.testing.assert_allclose(first.rx_m[:, 0], np.stack([x, 0 * x, 0 * x], 1), atol=1e-7)
    step.update_counters()
    assert (flight.log['pulses_emitted'], flight.log['poses_received']) == (20, 7)
    assert flight.log['pulses_waiting_for_poses'] == 0


def test_poses_of_another_frame_are_counted_and_told_of_once(flight):
    flight.send([0, 10])
    flight.send([15, 16, 17], frame='map')
    flight.send([20, 30, 40])
    assert numbers(flight.step.process(pulses(0, 10))) == list(range(10))
    flight.step.update_counters()
    assert (flight.log['poses_rejected'], flight.log['poses_received']) == (3, 5)
    assert flight.log.lines.count('poses in frame odom, as are grid and images') == 1
    [line] = [line for line in flight.log.lines if 'dropped poses' in line]
    assert line.endswith(' in frame map: grid and images are in frame_id=odom; set frame_id: map '
                         'in all nodes, with the grid in that frame, or send poses in odom')


def test_poses_without_a_frame_are_told_of_and_a_leading_slash_is_none(flight):
    flight.send([0], frame='')
    flight.send([10], frame='/odom')
    flight.step.collect()
    flight.step.update_counters()
    assert (flight.log['poses_rejected'], flight.log['poses_received']) == (1, 1)
    assert any('without header.frame_id: grid and images are in frame_id=odom; send poses in odom'
               in line for line in flight.log.lines)


def test_blocks_say_in_which_frame_their_positions_are(flight):
    flight.step.process(pulses(10, 30))
    flight.send(range(0, 70, 10))
    assert {block.frame for block in flight.step.collect()} == {'odom'}


@pytest.mark.parametrize(('autofocus', 'told'), [({}, 1), ({'autofocus.time_offset': 0.0}, 1),
                                                 ({'autofocus.time_offset': 2.0}, 0)])
def test_that_nothing_checks_the_clocks_is_told(autofocus, told):
    step, log = make(PulseBufferStep, **{'pose.source': 'odometry', 'pose.time_offset_s': 0.5},
                     **autofocus)  # parameters of the pipeline
    node = Node()
    step.create_outputs(node)
    step.activate(node)
    found = [line for line in log.lines if 'nothing checks pose.time_offset_s=0.5' in line]
    assert len(found) == told
    assert all('autofocus.time_offset of backprojection estimates it' in line for line in found)


def test_the_timer_looks_for_ends_only_where_something_waits(flight):
    [look] = flight.node.timers
    look()
    assert flight.node.wakes == 0
    flight.step.process(pulses(10, 20))
    look()
    look()
    assert flight.node.wakes == 1
    assert flight.step.discard() == 10
    flight.node.activity.close()
    assert (flight.node.timers, flight.node.callbacks) == ([], {})


def test_poses_that_stop_are_told_of_once_and_so_is_that_they_go_on(flight, monkeypatch):
    clock = types.SimpleNamespace(now_s=100.0)
    monkeypatch.setattr(pose_input, 'time', types.SimpleNamespace(
        monotonic=lambda: clock.now_s))

    def told(what):
        flight.step.update_counters()
        return len([line for line in flight.log.lines if what in line])

    flight.send([0])
    clock.now_s += 5.0
    assert told('no poses on') == 0
    clock.now_s += 0.001
    assert told('no poses on') == told('no poses on') == 1
    flight.send([10, 20])
    assert told('poses go on') == 1
    # Activated again, the wait begins anew.
    clock.now_s += 5.001
    assert told('no poses on') == 2
    flight.node.activity.close()
    flight.step.activate(flight.node)
    flight.send([30])
    assert told('poses go on') == 1 and told('no poses on') == 2


def test_pulses_with_positions_need_no_poses():
    step, log = make(PulseBufferStep, pulses_per_block=10, reorder_window_pulses=0)
    node = Node()
    step.create_outputs(node)
    step.activate(node)
    assert (node.callbacks, node.timers) == ({}, [])
    with pytest.raises(ValueError, match='no phase centres'):
        step.process(pulses(0, 10))
    centres = np.ones((10, 1, 3))
    assert numbers(step.process(dataclasses.replace(pulses(0, 10), tx_m=centres,
                                                    rx_m=centres))) == list(range(10))
    step.update_counters()
    assert log['pulses_emitted'] == 10


def test_tf_needs_a_frame_or_is_missing():
    with pytest.raises(ConfigurationError, match='frame_id is empty'):
        make(PulseBufferStep, **{'pose.source': 'tf', 'frame_id': ''})


def test_poses_in_another_frame_than_the_images_are_no_configuration():
    with pytest.raises(ConfigurationError, match='pose.frame_id=map, but grid and images are in '
                       'frame_id=odom: poses are not transformed'):
        make(PulseBufferStep, **{'pose.source': 'pose', 'pose.frame_id': 'map',
                                 'frame_id': 'odom'})


def test_positions_that_pulses_bring_are_in_the_frame_of_the_images():
    centres = np.ones((10, 1, 3))
    block = dataclasses.replace(pulses(0, 10), tx_m=centres, rx_m=centres, frame='odom')
    for step, options in ((PulseBufferStep, {'reorder_window_pulses': 0}),
                          (RangeCompressionStep, {}), (BackprojectionStep, {}),
                          (MovingTargetsStep, {})):
        with pytest.raises(ValueError, match="in frame 'odom', the image grid is in frame_id"):
            make(step, **options)[0].process(block)


# ------------------------------------------------------------------------------- compression

def profile_block(first=0, n=20, radar=RADAR):
    number = np.arange(first, first + n)
    return PulseBlock(radar, True, number * MS, number,
                      np.full((n, 1, 64), 7.0) + (number % 2)[:, None, None])


def test_a_plan_is_made_once_and_anew_when_something_changed():
    step, log = make(RangeCompressionStep)

    def plans():
        step.process(profile_block())
        return log['plans_made']

    assert [plans(), plans()] == [1, 1]
    step.parameters['window'] = 'hamming'
    assert [plans(), plans()] == [2, 2]
    step.parameters['background_s'] = 0.5  # is no part of the plan
    assert plans() == 2
    step.process(profile_block(radar=dataclasses.replace(RADAR, carrier_hz=9e9)))
    assert (log['plans_made'], log['blocks_compressed']) == (3, 6)
    assert len([line for line in log.lines if line.startswith('planned for profiles')]) == 3


@pytest.mark.parametrize(('near', 'far', 'kept'), [
    (0.0, 0.0, (0, 64)), (160.0, 0.0, (0, 64)), (170.0, 0.0, (17, 64)), (0.0, 155.0, (0, 26)),
    (170.0, 172.0, (17, 54))])
def test_near_and_far_range_cut_the_profiles(near, far, kept):
    """64 samples of 0.6 m from 149.9 m on; sixteen more at each end are kept."""
    step, _ = make(RangeCompressionStep, near_range=near, far_range=far)
    [profiles] = step.process(profile_block())
    start = (profiles.radar.range_start_m - RADAR.range_start_m) / RADAR.sample_spacing_m
    assert (round(start), round(start) + profiles.n_samples) == kept


def test_background_is_forgotten_when_it_should_be():
    step, _ = make(RangeCompressionStep, background_s=0.5)

    def first_is_zero(first):
        [profiles] = step.process(profile_block(first))
        return not np.abs(profiles.samples[0]).max() > 1e-6

    assert first_is_zero(0)  # which is its own average
    assert not first_is_zero(20)
    assert step.discard() == 0
    assert first_is_zero(40)
    step.parameters['background_s'] = 0.25
    assert first_is_zero(60)
    step.parameters['background_s'] = 0.0
    assert not first_is_zero(80)
    step.parameters['background_s'] = 0.25
    assert first_is_zero(100)
