# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Causes in the diagnostics: each is injected into real processes, named, and ends.

With CAUSES_RESULTS the parameters are those by default, and the seconds until each cause is named,
its level and its text are written to that file; `make fault-campaign` does so.
"""

import json
import os
import pathlib
import re
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float32MultiArray, String

from sar_imaging.recordings import bag_io
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters
from sar_imaging.tools.node_processes import NODES

from ..conftest import Nodes

RESULTS = os.environ.get('CAUSES_RESULTS', '')
STALL_S = 5.0 if RESULTS else 0.5
RADAR = RadarParameters(10e9, 100e6, 250e6, 1e-6)
START_NS = 1_700_000_000 * 10**9
PRF_HZ = 200.0
LEVELS = {DiagnosticStatus.WARN: 'WARN', DiagnosticStatus.ERROR: 'ERROR'}
ROUGH = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class Pulses:
    """Publishes pulses as time passes, or poses of their platform."""

    def __init__(self, observer, topic='pulses', *, clock_s=0.0, positions=True, n_samples=16):
        self.node, self.clock_s, self.n_samples = observer.node, clock_s, n_samples
        self.positions = positions
        self._publisher = self.node.create_publisher(Float32MultiArray, topic, 100)
        self._began, self._next = time.monotonic(), 0
        observer.wait(self._publisher.get_subscription_count, f'a subscriber of {topic}')

    def __call__(self):
        """Send what has become due."""
        due = int((time.monotonic() - self._began) * PRF_HZ)
        if due - self._next < 4:
            return
        number = np.arange(max(self._next, due - 64), due)  # no flood after a pause
        places = np.zeros((number.size, 1, 3)) if self.positions else None
        self._next = due
        self._publisher.publish(bag_io.serialise(PulseBlock(
            RADAR, True, START_NS + np.rint((number / PRF_HZ + self.clock_s) * 1e9).astype(int),
            number, np.ones((number.size, 1, self.n_samples)), places, places)))

    def end(self):
        """No more; the publisher goes."""
        self.node.destroy_publisher(self._publisher)


class Poses(Pulses):
    """Odometry of a platform at rest."""

    def __init__(self, observer, *, clock_s=0.0, frame='odom', began):
        self.node, self.clock_s, self._frame = observer.node, clock_s, frame
        self._publisher = self.node.create_publisher(Odometry, 'odometry', 100)
        self._began, self._sent_s = began, 0.0

    def __call__(self):
        now = time.monotonic()
        if now < self._sent_s + 0.02:
            return
        self._sent_s, message = now, Odometry()
        message.header.frame_id = self._frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            START_NS + round((now - self._began + self.clock_s) * 1e9), 10**9)
        message.pose.pose.orientation.w = 1.0
        self._publisher.publish(message)


class Watch:
    """The diagnostics of a node while causes come and go; `feed` has what is sent meanwhile."""

    def __init__(self, observer, node):
        self.observer, self.node, self.feed, self._ended = observer, node, [], ''

    def _until(self, condition, what, **options):
        def step():
            for send in self.feed:
                send()
            status = self.observer.status(self.node)
            return status is not None and condition(status) and status

        return self.observer.wait(step, what, **options)

    def named(self, cause, pattern, *, last=DiagnosticStatus.WARN):
        """Wait until the cause is the state of the node, and in a campaign for its last level."""
        began = time.monotonic()
        status = self._until(lambda s: re.search(pattern, s.message), cause)
        seconds, level = time.monotonic() - began, LEVELS[status.level]
        assert status.level > DiagnosticStatus.OK
        self._ended = pattern
        if RESULTS:
            text = status.message
            self._until(lambda s: s.level == last, f'the level of {cause}')
            record({'cause': cause, 'node': self.node, 'named_after_s': round(seconds, 1),
                    'level': level, 'lasting_level': LEVELS[last], 'text': text})

    def ends(self, pattern='', **options):
        """Wait until the cause named last is no more, or what else matches a pattern."""
        began = time.monotonic()
        pattern, again = pattern or self._ended, not pattern
        self._until(lambda s: not re.search(pattern, s.message), f'the end of {pattern}',
                    **options)
        if RESULTS and again:
            record({'ended_after_s': round(time.monotonic() - began, 1)}, again=True)


def record(values, *, again=False):
    """Add a row to the results, or to its last one."""
    path = pathlib.Path(RESULTS)
    rows = json.loads(path.read_text()) if path.exists() else []
    if again:
        rows[-1] |= values
    else:
        rows = [r for r in rows if (r['cause'], r['node']) != (values['cause'], values['node'])]
        rows.append(values)
    path.write_text(json.dumps(rows, indent=1) + '\n')


@pytest.fixture
def watch(make_observer):
    """Watch a node, whose output has a subscriber."""
    def make(node, output=''):
        observer = make_observer('elsewhere')
        if output:
            observer.subscribe(Float32MultiArray, output)
        return Watch(observer, node)
    return make


def test_why_no_pulses_come_or_cannot_be_used(start_node, watch):
    start_node('pulse_buffer', {'stall_timeout_s': STALL_S})
    w = watch('pulse_buffer', 'pulse_blocks')
    observer, severe = w.observer, DiagnosticStatus.ERROR
    w.named('no publisher', 'nobody publishes there, std_msgs/msg/Float32MultiArray is on '
            '/elsewhere;', last=severe)
    other = observer.node.create_publisher(String, 'pulses', 1)
    w.named('another type', '/pulses carries std_msgs/msg/String|it carries std_msgs/msg/String',
            last=severe)
    observer.node.destroy_publisher(other)
    w.ends()
    other = observer.node.create_publisher(Float32MultiArray, 'pulses', ROUGH)
    w.named('best-effort driver', 'a publisher of /pulses, observer, cannot be heard: .*reliab',
            last=severe)
    observer.node.destroy_publisher(other)
    w.ends()
    pulses = Pulses(observer)
    w.feed = [pulses]
    w.ends('no input')
    w.feed = []
    w.named('stalled', 'no input for .* the publisher of /pulses is silent', last=severe)
    w.feed = [pulses]
    w.ends()
    pulses.n_samples = 20
    w.named('samples change', 'the pulses have changed: samples from 16 to 20')
    if RESULTS:  # which lasts ten seconds
        w.ends()
    other = Pulses(observer, clock_s=7.0, n_samples=20)
    w.feed = [pulses, other]
    w.named('two publishers that send different pulses',
            'two publishers send different pulses on /pulses: .*; stop all but one', last=severe)
    other.end()
    w.feed = [pulses]
    w.ends()


def test_why_poses_are_of_no_use(start_node, watch):
    start_node('pulse_buffer', {'stall_timeout_s': STALL_S, 'pose.source': 'odometry',
                                'frame_id': 'odom'})
    w = watch('pulse_buffer', 'pulse_blocks')
    observer, severe = w.observer, DiagnosticStatus.ERROR
    pulses = Pulses(observer, positions=False)
    w.feed, began = [pulses], pulses._began
    w.named('no poses', 'no poses on /odometry for .*: nobody publishes nav_msgs/msg/Odometry',
            last=severe)
    other = observer.node.create_publisher(String, 'odometry', 1)
    w.named('poses of another type', 'odometry carries std_msgs/msg/String|it carries std_msgs',
            last=severe)
    observer.node.destroy_publisher(other)
    w.ends()
    other = observer.node.create_publisher(Odometry, 'odometry', ROUGH)
    w.named('best-effort poses', 'a publisher of /odometry, observer, cannot be heard',
            last=severe)
    observer.node.destroy_publisher(other)
    w.ends()
    for cause, pattern, options in (
            ('poses in another frame', 'in frame map: grid and images are in frame_id=odom',
             {'frame': 'map'}),
            ('clocks apart', r'poses are (50\.\d|49\.9) s ahead of the pulses: synchronise the '
             'clocks, or set pose.time_offset_s to ', {'clock_s': 50.0}),
            ('clocks apart, the other way', r'poses are (50\.\d|49\.9) s behind the pulses',
             {'clock_s': -50.0})):
        wrong = Poses(observer, began=began, **options)
        w.feed = [pulses, wrong]
        w.named(cause, pattern, last=severe)
        wrong.end()
        right = Poses(observer, began=began)
        w.feed = [pulses, right]
        w.ends()
        right.end()


def test_what_stops_a_chain(ros_environment, tmp_path, make_observer):
    names = NODES[:2]
    nodes = Nodes(tmp_path, ros_environment, dict.fromkeys(names, {'stall_timeout_s': STALL_S}),
                  names=names)
    try:
        for name in names:
            nodes.start(name)
        observer = make_observer('elsewhere')
        w, w_first = Watch(observer, 'range_compression'), Watch(observer, 'pulse_buffer')
        pulses = Pulses(observer)
        w.feed = w_first.feed = [pulses]
        w.named('no subscriber', 'pulses are lost: nobody subscribes to /range_profiles')
        observer.subscribe(Float32MultiArray, 'range_profiles')
        w.ends()
        # Of a process that is killed the middleware hears no more after some 20 s.
        end = nodes.kill if RESULTS else nodes.stop
        end('pulse_buffer')
        w.named('upstream gone', 'no input for .*: (nobody publishes|.* is silent)',
                last=DiagnosticStatus.ERROR)
        nodes.start('pulse_buffer')
        w.ends()
        end('range_compression')
        w_first.named('downstream gone', 'pulses are lost: nobody subscribes to /pulse_blocks')
        nodes.start('range_compression')
        w_first.ends()
    finally:
        nodes.stop_all()


def test_work_that_falls_behind(start_node, make_observer, psf):
    start_node('backprojection', {'grid.size_x': 60.0, 'grid.size_y': 60.0, 'grid.spacing': 0.1,
                                  'grid.centre_x': 10_000.0, 'max_age_s': 0.5,
                                  'pulses_per_aperture': psf.truth['pulses_per_aperture']})
    observer = make_observer('range_profiles')
    observer.wait(lambda: observer.joined, 'the subscription')
    w = Watch(observer, 'backprojection')
    observer.send(b for n in range(20) for b in psf.later(psf.blocks(25), n))
    w.named('falling behind', 'falling behind: blocks wait for .* s, the work is slower than the '
            'input; images older than max_age_s=0.5 are left out')
    w.ends()
    assert observer.counters('backprojection')['apertures_too_old'] > 0


@pytest.mark.campaign
def test_kernels_that_are_compiled(ros_environment, tmp_path, make_observer):
    environment = ros_environment | {'NUMBA_CACHE_DIR': str(tmp_path / 'cache')}
    nodes = Nodes(tmp_path, environment, {}, names=NODES[2:])
    try:
        nodes.start('backprojection')
        w = Watch(make_observer('range_profiles'), 'backprojection')
        w.feed = [Pulses(w.observer, 'range_profiles')]
        w.named('compiling', r'compiling kernels for \d+ s so far; pulses are not taken, \d+ came')
        w.ends(progress=lambda: w.observer.status('backprojection').message)  # which counts on
        assert w.observer.counters('backprojection')['pulses_before_ready'] > 0
    finally:
        nodes.stop_all()
