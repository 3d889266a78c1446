# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Flow control of the replay, against a node in this process over real DDS."""

import time

import pytest

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float32MultiArray, UInt32

from msg_conversions import WireFormatError
from msg_conversions.pulse_block import from_message
from sar_imaging.recordings import bag_io
from sar_imaging.tools.evaluation.replay import MAX_MESSAGES, Replayer, ReplayError
from sar_imaging.tools.node_processes import free_domain

pytestmark = pytest.mark.nodes


class Consumer:
    """Takes pulses and tells progress as late as the replayer can bear."""

    def __init__(self, context, *, tells_progress=True, holds=MAX_MESSAGES):
        self.node = rclpy.create_node('backprojection', context=context)
        self.node.create_subscription(Float32MultiArray, 'pulses', self._receive, 200)
        self._progress = (self.node.create_publisher(UInt32, 'backprojection/progress', 200)
                          if tells_progress else None)
        self._holds = holds
        self.held = 0
        self.counters = []
        self.damaged = 0

    def wait_for_listener(self, spin):
        """Progress told before the topics match is lost; real nodes have minutes for that."""
        deadline = time.monotonic() + 10
        while self._progress and not self._progress.get_subscription_count():
            assert time.monotonic() < deadline
            spin()

    def _receive(self, message):
        try:
            block = from_message(message)
        except WireFormatError:
            self.damaged += 1
            return
        self.counters.append(int(block.counter[-1]))
        self.held += 1
        if self._progress and self.held >= self._holds:
            self._progress.publish(UInt32(data=self.counters[-1]))
            self.held = 0


@pytest.fixture
def ros(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--disable-external-lib-logs'],
               domain_id=free_domain())
    executor = SingleThreadedExecutor(context=context)
    node = rclpy.create_node('replay', context=context)
    executor.add_node(node)
    nodes = [node]

    def make(check=lambda: None, **consumer):
        made = Consumer(context, **consumer)
        nodes.append(made.node)
        executor.add_node(made.node)
        replayer = Replayer(node, executor, check=check)
        replayer.wait_for_subscriber(10.0)
        made.wait_for_listener(lambda: executor.spin_once(timeout_sec=0.1))
        return replayer, made, lambda: executor.spin_once(timeout_sec=0.1)

    make.replayer = lambda: Replayer(node, executor)
    yield make
    executor.shutdown()
    for each in nodes:
        each.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def messages(make_block):
    def make(n, pulses=2, n_samples=3):
        blocks = (make_block(pulses * i, pulses, n_samples=n_samples) for i in range(n))
        return [(int(b.stamp_ns[-1]), bag_io.serialise(b)) for b in blocks]

    return make


def receive_all(consumer, spin, n):
    deadline = time.monotonic() + 30
    while len(consumer.counters) + consumer.damaged < n and time.monotonic() < deadline:
        spin()


@pytest.mark.parametrize('pulses, n_samples, most', [
    (2, 3, 40),  # messages
    (500, 3, 2),  # pulses, at most 1024
    (2, 62_500, 7),  # bytes, a little more than 1 MB each
])
def test_everything_arrives_in_order_and_no_more_than_allowed_is_on_its_way(
        ros, messages, pulses, n_samples, most):
    replayer, consumer, spin = ros(holds=most)
    n, on_the_way = 4 * most, []

    def on_published(message):
        finished = -1 if replayer.progress is None else replayer.progress
        on_the_way.append((int(message.block.counter[-1]) - finished) // pulses)

    assert replayer.replay(messages(n, pulses, n_samples), on_published=on_published) == n
    receive_all(consumer, spin, n)
    assert consumer.counters == [pulses * i + pulses - 1 for i in range(n)]
    assert max(on_the_way) == most


def test_damaged_messages_go_out_unchanged_and_are_not_waited_for(ros, messages):
    replayer, consumer, spin = ros(holds=10)
    data = messages(60)
    for i in range(20, 60):  # as many as may be on their way
        # the end of the message is samples; zeros there and before reach back to the header
        raw = bytearray(data[i][1])
        raw[160:] = bytes(len(raw) - 160)
        data[i] = (data[i][0], bytes(raw))
    assert replayer.replay(data) == 60
    receive_all(consumer, spin, 60)
    assert (len(consumer.counters), consumer.damaged) == (20, 40)


def test_goes_on_when_nobody_tells_progress(ros, messages):
    replayer, consumer, spin = ros(tells_progress=False)
    n = MAX_MESSAGES + 3
    replayer.replay(messages(n))
    receive_all(consumer, spin, n)
    assert len(consumer.counters) == n


def test_real_time_is_never_faster_than_the_recording(ros, messages):
    replayer, consumer, spin = ros(holds=1)
    data = messages(30)  # 20 ms apart
    start = time.monotonic()
    replayer.replay(data, rate=2.0)
    assert time.monotonic() - start >= 29 * 0.020 / 2
    receive_all(consumer, spin, 30)
    assert len(consumer.counters) == 30


def test_check_ends_the_replay(ros, messages):
    class Stop(Exception):
        pass

    calls = []

    def check():
        calls.append(None)
        if len(calls) > 50:
            raise Stop

    replayer, _, _ = ros(holds=1)
    replayer.check = check
    with pytest.raises(Stop):
        replayer.replay(messages(1000))


def test_nobody_listens(ros):
    with pytest.raises(ReplayError, match='nobody subscribes to /pulses'):
        ros.replayer().wait_for_subscriber(0.1)
