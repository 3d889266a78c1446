# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A node in this process: what its transitions keep and forget."""

import platform
import resource
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.time import Time
from std_msgs.msg import Float32MultiArray

from msg_conversions import pulse_block
from sar_imaging.nodes.runtime.parameters import ConfigurationError, Parameter
from sar_imaging.nodes.runtime.stage import Stage
from sar_imaging.nodes.runtime.step import Step
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

from ..conftest import wait

SUCCESS, FAILURE, ERROR = (getattr(TransitionCallbackReturn, name)
                           for name in ('SUCCESS', 'FAILURE', 'ERROR'))
RADAR = RadarParameters(carrier_hz=1e10, bandwidth_hz=1e8, sample_rate_hz=2e8,
                        first_sample_delay_s=1e-6)


BUSY, GO_ON = threading.Event(), threading.Event()  # blocks of 5 samples wait to be let go on


class HoldStep(Step):
    """Holds the pulses that come; cannot be made for a size of 13, fails at 14."""

    NAME = 'hold'
    PARAMETERS = (Parameter('size', 1, 'Of anything.', '', 0, 100),)
    COUNTERS = ('pulses_held',)
    FAULTS = ('pulses_lost',)

    def __init__(self, parameters, health):
        super().__init__(parameters, health)
        if parameters['size'] == 13:
            raise ConfigurationError('size=13 brings bad luck')
        if parameters['size'] == 14:
            raise KeyError('14')
        self.held = 0

    def process(self, block):
        if block.n_samples == 4:
            raise ValueError('4 samples')
        if block.n_samples == 5:
            BUSY.set()
            GO_ON.wait(60.0)
        self.held += block.n_pulses
        self.health.count('pulses_held', block.n_pulses)
        return []

    def discard(self):
        held, self.held = self.held, 0
        return held


class HoldNode(Stage):
    """Stage with that step alone."""

    NAME = 'hold'
    INPUT = 'held_pulses'
    STEPS = (HoldStep,)


class Bench:
    """The node, a sender of pulses and a reader of its diagnostics, spun by the test."""

    def __init__(self):
        rclpy.init()
        self.node = HoldNode()
        self.other = rclpy.create_node('bench')
        self.reports = []
        self.other.create_subscription(DiagnosticArray, '/diagnostics', self._reported, 100)
        self.sender = self.other.create_publisher(Float32MultiArray, 'held_pulses', 100)
        self._executor = SingleThreadedExecutor()
        for node in (self.node, self.other):
            self._executor.add_node(node)
        self._sent = 0
        self.set('max_age_s', 3600.0)  # a busy machine is no matter here
        self.wait(lambda: self.other.count_publishers('/diagnostics') and self._diagnosed(),
                  'diagnostics')

    def _reported(self, array):
        self.reports += [(Time.from_msg(array.header.stamp), s) for s in array.status
                         if s.name == 'hold: stage']

    def _diagnosed(self):
        self.node.publish_diagnostics()
        return self.reports

    def wait(self, condition, what):
        return wait(condition, what, work=lambda: self._executor.spin_once(timeout_sec=0.02))

    def send(self, n_pulses, n_samples=3):
        counters = np.arange(self._sent, self._sent + n_pulses)
        self._sent += n_pulses
        block = PulseBlock(RADAR, True, counters, counters, np.ones((n_pulses, 1, n_samples)),
                           np.ones((n_pulses, 1, 3)), np.ones((n_pulses, 1, 3)))
        self.sender.publish(pulse_block.to_message(block))

    def status(self):
        """A fresh report: level, message and counters."""
        asked = self.node.get_clock().now()
        self.node.publish_diagnostics()
        self.wait(lambda: self.reports[-1][0] >= asked, 'a report')
        latest = self.reports[-1][1]
        return latest.level, latest.message, {
            v.key: float(v.value) for v in latest.values if v.key != 'last_rejection'}

    def wait_for(self, **counters):
        self.wait(lambda: counters.items() <= self.status()[2].items(), str(counters))

    def set(self, name, value):
        [result] = self.node.set_parameters([rclpy.Parameter(name, value=value)])
        return result.successful

    def close(self):
        self._executor.shutdown()
        for node in (self.node, self.other):
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def bench(ros_environment):
    bench = Bench()
    yield bench
    bench.close()


def start(bench):
    assert bench.node.start()
    bench.wait(lambda: bench.sender.get_subscription_count(), 'the subscription')


def test_a_stall_of_before_is_forgotten_when_the_node_is_activated_again(bench):
    assert bench.set('stall_timeout_s', 0.2)
    start(bench)
    assert bench.status()[:2] == (DiagnosticStatus.OK, 'waiting for input')
    bench.send(2)
    bench.wait_for(pulses_held=2)
    bench.wait(lambda: bench.status()[1].startswith('no input for'), 'the stall')
    assert bench.status()[0] == DiagnosticStatus.WARN

    assert bench.node.trigger_deactivate() == SUCCESS
    assert bench.status()[:2] == (DiagnosticStatus.OK, 'inactive')
    assert bench.node.trigger_activate() == SUCCESS
    bench.wait(lambda: bench.sender.get_subscription_count(), 'the subscription')
    ends = time.monotonic() + 0.4  # longer than the limit: nothing came since
    bench.wait(lambda: time.monotonic() > ends, 'twice the limit')
    level, message, _ = bench.status()  # it counts from the activation, and before a first block
    assert level > DiagnosticStatus.OK and message.startswith('no input for')
    bench.send(1)
    bench.wait_for(blocks_received=2)
    assert bench.status()[:2] == (DiagnosticStatus.OK, 'working')


def test_a_clean_up_counts_from_zero(bench):
    start(bench)
    bench.send(5)
    bench.send(1, n_samples=4)
    bench.wait_for(pulses_held=5, blocks_received=2, blocks_rejected=1)
    assert bench.status()[0] == DiagnosticStatus.WARN
    assert bench.node.trigger_deactivate() == SUCCESS
    bench.wait_for(pulses_discarded=5)
    assert bench.node.trigger_activate() == SUCCESS
    assert bench.status()[2]['pulses_held'] == 5  # the configuration is the same
    assert bench.node.trigger_deactivate() == SUCCESS
    assert bench.node.trigger_cleanup() == SUCCESS
    assert bench.node.trigger_configure() == SUCCESS
    level, message, counters = bench.status()
    assert (level, message) == (DiagnosticStatus.OK, 'inactive')
    assert {key for key, value in counters.items() if value} == {'memory_megabytes'}


def test_what_waits_and_what_is_underway_is_dropped_at_the_end(bench):
    BUSY.clear()
    GO_ON.clear()
    start(bench)
    bench.send(5, n_samples=5)
    bench.wait(BUSY.is_set, 'the first block in work')
    bench.send(3)
    bench.send(4)
    bench.wait_for(blocks_received=3, blocks_waiting=2)
    lines = []
    bench.node.health.info = lines.append
    threading.Timer(0.05, GO_ON.set).start()
    assert bench.node.trigger_deactivate() == SUCCESS  # finishes the block in work
    assert 'deactivated: dropped 7 pulses that waited and 5 underway' in lines
    counters = bench.status()[2]
    assert (counters['pulses_discarded'], counters['blocks_waiting']) == (12, 0)


def test_a_refused_configuration_can_be_repeated_and_a_failed_one_is_an_error(bench):
    node = bench.node
    lines = []
    node.health.error = lines.append
    assert bench.set('size', 13)
    assert node.trigger_configure() == FAILURE and node.state == 'unconfigured'
    assert lines == ['configuration refused: size=13 brings bad luck']
    assert bench.status()[2]['errors'] == 0
    assert not bench.set('size', 101)
    assert bench.set('size', 14)  # a refused configuration holds no parameter
    assert node.trigger_configure() == ERROR and node.state == 'unconfigured'
    level, _, counters = bench.status()
    assert level == DiagnosticStatus.ERROR and counters['errors'] == 1
    assert bench.set('size', 2)
    start(bench)
    assert not bench.set('size', 3)
    assert node.state == 'active' and bench.status()[0] == DiagnosticStatus.OK


def test_parts_are_cleaned_up_with_their_node(bench):
    part = bench.node.health.part('fusion', counters=('images',), faults=('lost',))
    part.count('images', 3)
    part.count('lost')
    assert part.status('').level == DiagnosticStatus.WARN
    bench.node.health.clear()
    status = part.status('working')
    assert (status.level, status.message) == (DiagnosticStatus.OK, 'working')
    assert {v.key: v.value for v in status.values} == {'images': '0', 'lost': '0'}


def test_a_failure_where_input_comes_is_counted_and_the_node_lives_on(bench, monkeypatch, capfd):
    start(bench)
    with monkeypatch.context() as broken:
        broken.setattr(bench.node._worker, 'offer', lambda *_: 1 // 0)
        bench.send(1)
        bench.wait_for(errors=1)
    assert 'ZeroDivisionError' in capfd.readouterr().err
    bench.send(1)
    bench.wait_for(errors=1, pulses_held=1)


def test_more_lines_than_anybody_reads_are_counted_instead(bench, capfd):
    capfd.readouterr()
    bench.node.publish_diagnostics()  # which begins another period
    for number in range(25):
        bench.node.health.warning(f'line {number}')
    bench.node.publish_diagnostics()
    bench.node.health.info('and on')
    lines = [line.split(']: ')[1] for line in capfd.readouterr().err.splitlines()]
    assert lines == [*(f'line {n}' for n in range(20)),
                     '5 more messages were not logged; see /diagnostics for the counts', 'and on']


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason='another C library frees otherwise')
def test_large_messages_take_the_memory_of_those_before():
    """Pages that the system has to find again cost more than copies."""
    code = ('import resource\n'
            'from sar_imaging.nodes.runtime.managed import keep_freed_memory\n'
            'keep_freed_memory()\n'
            'for _ in range(9):\n'
            '    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n'
            '    copies = [bytes([n]) * 2**23 for n in range(3)]\n'
            '    del copies\n'
            'print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)\n')
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    n_pages = 3 * 2**23 / resource.getpagesize()
    assert int(run.stdout) < 0.1 * n_pages  # all of them, as the system gives them by default
