# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Positions from odometry on its own clock: late, missing, jumping; through real processes."""

import dataclasses
import importlib.util

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Float32MultiArray

from msg_conversions.images import complex_from_message, map_metadata_from_message
from msg_conversions.pulse_block import from_message
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters
from sar_imaging.tools.node_processes import NODES, PIPELINE

OFFSET_NS = 1_000_003_700_000  # the poses' clock is ahead
TF = importlib.util.find_spec('tf2_ros') is not None
QUARTER_LEFT = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))  # body x is the frame's y


def without_positions(block):
    return dataclasses.replace(block, tx_m=None, rx_m=None)


class Platform:
    """Publishes poses."""

    def __init__(self, observer, message_type=Odometry, topic='odometry'):
        self._type = message_type
        self._publisher = observer.node.create_publisher(message_type, topic, 1000)
        observer.wait(self._publisher.get_subscription_count, f'a subscriber of {topic}')

    def send(self, stamp_ns, position, quaternion=(0.0, 0.0, 0.0, 1.0), frame='odom'):
        message = self._type()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(stamp_ns), 10**9)
        pose = message.pose.pose if self._type is Odometry else message.pose
        p, q = pose.position, pose.orientation
        p.x, p.y, p.z = map(float, position)
        q.x, q.y, q.z, q.w = map(float, quaternion)
        self._publisher.publish(message)


def test_odometry_that_comes_late_or_not_at_all_for_five_seconds(make_chains, psf):
    pulses = psf.pulses
    # The recording flies straight on: 0 to 0.3 s, reference point in the middle channel.
    seconds = (pulses.stamp_ns - pulses.stamp_ns[0]) * 1e-9
    track = np.polynomial.polynomial.polyfit(seconds, pulses.tx_m[:, 0], 1)
    arms = (pulses.rx_m - pulses.tx_m[:, :1])[0][:, [1, 0, 2]] * [1, -1, 1]  # into the body
    # The platform begins its track anew with every aperture, one a second.
    chains = make_chains(*({
        'truth': psf.truth, 'names': names, 'namespace': f'radar{number}', 'pulse_buffer': {
            'pose.source': 'odometry', 'pose.time_offset_s': OFFSET_NS * 1e-9,
            'pose.wait_s': 3.0, 'pose.jump_m': 1e4, 'antenna.rx': arms.ravel().tolist()}}
        for number, names in enumerate((NODES, PIPELINE))))
    observers = [chain.observer for chain in chains]
    platforms = [Platform(observer) for observer in observers]
    buffers = [('radar0/pulse_buffer', 'stage'), ('radar1/sar_pipeline', 'pulse_buffer')]

    def send_pulses(first, stop):
        for observer in observers:
            observer.send([without_positions(b) for n in range(first, stop)
                           for b in psf.later(psf.blocks(25), n)])

    def send_poses(aperture):
        for platform in platforms:
            for t in np.arange(-0.05, 0.36, 0.01):
                platform.send(pulses.stamp_ns[0] + OFFSET_NS + round((aperture + t) * 1e9),
                              track[0] + t * track[1], QUARTER_LEFT, frame='map')

    def wait_for_counters(**expected):
        for observer, buffer in zip(observers, buffers, strict=True):
            observer.wait_for_counters(*buffer, **expected)

    def check_image(number):
        for observer in observers:
            image = observer.wait_for('image_complex', number)[-1]
            grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
            # The recorded track is rounded to 2^-20 m, 0.3 um from the line: -76 dB at this
            # wavelength.
            assert psf.error_db(complex_from_message(image), grid, np.arange(200)) < -70.0

    send_pulses(0, 1)
    wait_for_counters(pulses_waiting_for_poses=200, pulses_emitted=0)
    send_poses(0)
    check_image(1)
    wait_for_counters(pulses_waiting_for_poses=0, pulses_emitted=200, pulses_without_pose=0,
                      pose_gaps=0, pose_jumps=0, poses_received=41)
    send_pulses(1, 6)
    wait_for_counters(pulses_without_pose=1000, pulses_emitted=200)
    for observer, buffer in zip(observers, buffers, strict=True):
        assert observer.status(*buffer).level > DiagnosticStatus.OK
    send_pulses(6, 7)
    send_poses(6)
    check_image(2)
    wait_for_counters(pulses_emitted=400, pulses_without_pose=1000, pose_gaps=1, pose_jumps=0)
    for chain in chains:
        assert 'no pose came in time' in chain.log(chain.names[0])


RADAR = RadarParameters(10e9, 600e6, 720e6, 1e-6)


def pulses_of(first, stop):
    """Pulses every 10 ms, between the poses."""
    counter = np.arange(first, stop)
    samples = np.zeros((counter.size, 1, 16), np.complex64)
    return PulseBlock(RADAR, True, 5_000_000 + counter * 10_000_000, counter, samples)


class Buffer:
    """A pulse_buffer with poses, and what it publishes."""

    def __init__(self, start_node, observer, message_type=Odometry, topic='odometry',
                 **parameters):
        self.node = start_node('pulse_buffer', {
            'pulses_per_aperture': 100, 'reorder_window_pulses': 0, 'pose.source': topic,
            'frame_id': 'odom',
            'pose.time_offset_s': OFFSET_NS * 1e-9} | parameters)
        self.observer = observer
        self.blocks = []
        observer.node.create_subscription(
            Float32MultiArray, 'pulse_blocks', lambda m: self.blocks.append(from_message(m)), 100)
        self.node.wait_for_log('pulse_buffer', 'subscriber on /pulse_blocks joined')
        observer.wait(lambda: observer.joined, 'the subscription')
        self.platform = Platform(observer, message_type, topic)
        self.n_poses = 0

    def send_poses(self, first_ms, stop_ms, shift_m=0.0):
        """Poses every 20 ms; returns when they came, since pulses wait for them but shortly."""
        for ms in range(first_ms, stop_ms, 20):
            self.platform.send(OFFSET_NS + ms * 1_000_000, (0.005 * ms, shift_m, 2.0))
            self.n_poses += 1
        self.observer.wait_for_counters('pulse_buffer', poses_received=self.n_poses)

    def send_pulses(self, first, stop):
        self.observer.send([pulses_of(i, i + 50) for i in range(first, stop, 50)])

    def wait_for_pulses(self, expected):
        def received():
            return [int(c) for b in self.blocks for c in b.counter]

        self.observer.wait(lambda: len(received()) >= len(expected), f'{len(expected)} pulses')
        assert received() == list(expected)


def test_missing_odometry_and_a_frame_that_jumps(start_node, make_observer):
    observer = make_observer()
    buffer = Buffer(start_node, observer, **{'pose.wait_s': 0.3})
    buffer.send_poses(0, 1001)
    buffer.send_pulses(0, 600)  # and then nothing for five seconds
    observer.wait_for_counters('pulse_buffer', pulses_without_pose=500, pulses_emitted=100)
    assert observer.status('pulse_buffer').level > DiagnosticStatus.OK
    buffer.platform.send(OFFSET_NS + 6 * 10**9, (30, 0, 2), frame='map')  # another frame
    buffer.platform.send(OFFSET_NS + 6 * 10**9, (np.nan, 0, 2))
    buffer.n_poses += 1
    buffer.send_poses(900, 901)
    buffer.send_poses(6000, 6500)
    buffer.send_poses(6500, 8100, shift_m=1.0)
    buffer.send_pulses(600, 800)
    # 648 and 649 lie in the jump; the rest of their aperture is of the new frame.
    buffer.wait_for_pulses([*range(100), *range(600, 648), *range(700, 800)])
    position = buffer.blocks[-1].tx_m[:, 0]
    t_ms = buffer.blocks[-1].stamp_ns * 1e-6
    np.testing.assert_allclose(position, np.stack([
        0.005 * t_ms, np.ones_like(t_ms), np.full_like(t_ms, 2.0)], axis=1), atol=1e-9)
    observer.wait_for_counters(
        'pulse_buffer', pulses_received=800, pulses_emitted=248, pulses_without_pose=502,
        pulses_of_another_frame=50, pulses_waiting_for_poses=0, pose_gaps=1, pose_jumps=1,
        poses_rejected=2, poses_late=1, pose_restarts=0, blocks_rejected=0, errors=0)
    log = buffer.node.log('pulse_buffer')
    for text in ('poses in frame odom', 'no pose came in time', 'no pose for 5 s of their clock',
                 'the frame of the poses jumped', 'nothing checks pose.time_offset_s=1000',
                 'dropped poses of /odometry in frame map: grid and images are in frame_id=odom',
                 'dropped pulses 696..699 (4): the frame of the poses jumped within'):
        assert text in log


def test_without_any_pose_nothing_stalls(start_node, make_observer):
    observer = make_observer()
    buffer = Buffer(start_node, observer, PoseStamped, 'pose',
                    **{'pose.wait_s': 0.1, 'stall_timeout_s': 0.5})
    buffer.send_pulses(0, 200)
    observer.wait_for_counters('pulse_buffer', pulses_without_pose=200, blocks_waiting=0)
    buffer.node.wait_for_log('pulse_buffer', 'no poses on /pose for')
    buffer.send_poses(1900, 3100)
    buffer.send_pulses(200, 300)
    buffer.wait_for_pulses(range(200, 300))
    buffer.node.wait_for_log('pulse_buffer', 'poses go on')
    assert observer.trigger('pulse_buffer/reset')[0]
    assert observer.change_state('pulse_buffer', 'deactivate')
    assert observer.change_state('pulse_buffer', 'activate')
    buffer.observer.wait(lambda: observer.joined > 1, 'the subscription of the pulses')
    buffer.platform = Platform(observer, PoseStamped, 'pose')
    buffer.send_poses(2900, 4100)
    buffer.send_pulses(300, 400)
    buffer.wait_for_pulses(range(200, 400))
    assert 'Traceback' not in buffer.node.log('pulse_buffer')


IMPOSSIBLE = [
    ({'pose.source': 'gps'}, "parameter pose.source: 'gps' is unknown; use one of block, "
     'odometry, pose, tf'),
    ({'antenna.tx': [0.0, 1.0]}, 'parameter antenna.tx: 2 numbers; expected x, y, z of one'),
    ({'antenna.rx': 'left'}, "parameter antenna.rx='left'; expected a list of numbers (m)"),
    ({'pose.source': 'tf', 'frame_id': ''}, 'parameter frame_id is empty; expected the frame of '
     'positions and images'),
    ({'pose.source': 'odometry', 'pose.frame_id': 'map', 'frame_id': 'odom'},
     'parameter pose.frame_id=map, but grid and images are in frame_id=odom'),
    *([] if TF else [({'pose.source': 'tf'}, 'tf2_ros is not installed: it comes with a ROS '
                      'installation')]),
]


def test_an_impossible_source_ends_the_node_with_one_clear_line(start_node):
    nodes = [start_node('pulse_buffer', parameters) for parameters, _ in IMPOSSIBLE]
    for node, (_, message) in zip(nodes, IMPOSSIBLE, strict=True):
        assert node.exit_code('pulse_buffer') == 1
        [line] = node.log('pulse_buffer').splitlines()
        assert message in line


def test_lever_arms_that_do_not_fit_reject_blocks_with_the_reason(start_node, make_observer):
    observer = make_observer()
    buffer = Buffer(start_node, observer, **{'antenna.rx': [0.0] * 6})
    buffer.send_pulses(0, 50)
    buffer.node.wait_for_log('pulse_buffer', '2 lever arms rx_m for 1 channels; give one for all')
    observer.wait_for_counters('pulse_buffer', blocks_rejected=1)
