# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Replay recorded pulse blocks into running nodes, without loss or in real time.

The serialised messages go out unchanged (`publisher.publish(bytes)`), so whatever a recording or
a test puts in them, intact or not, reaches the nodes as it is.
"""

from __future__ import annotations

import collections
import dataclasses
import heapq
import itertools
import time
from collections.abc import Callable, Iterable, Iterator

from nav_msgs.msg import Odometry
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float32MultiArray, UInt32

from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.pulses.sequence import counter_distance

from ...recordings.bag_io import deserialise

# What may be on its way through the nodes: below the depth of the middleware's queues (50
# messages of 32 pulses behind pulse_buffer) and of the shared memory segment.
MAX_MESSAGES = 40
MAX_PULSES = 1024
MAX_BYTES = 8_000_000
STALL_S = 0.25  # without progress for so long, one more message goes out
FIRST_PROGRESS_S = 30.0  # the same before the first progress: the imager may be compiling
PUBLISHER_DEPTH = 100
POSE_DEPTH = 10_000  # poses come in bursts between two messages of pulses
POSES_PER_S = 1000.0  # at most, since nobody tells which were taken
POSE_TIMEOUT_S = 10.0


class ReplayError(RuntimeError):
    """The recording cannot be replayed: nobody listens."""


@dataclasses.dataclass(frozen=True)
class Published:
    """A message that was sent.

    Parameters
    ----------
    index : int
        Place among the messages of the replay, from 0.
    block : PulseBlock or None
        What it holds, None when it cannot be read.
    n_bytes : int
        Length of the serialised message.
    time_s : float
        When `publish` was called, on `time.monotonic`.
    """

    index: int
    block: PulseBlock | None
    n_bytes: int
    time_s: float


class Replayer:
    """Publishes serialised pulse blocks on `pulses` and follows the imager's progress.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to publish from; topics are relative to its namespace.
    executor : rclpy.executors.Executor
        Executor of that node. It is spun here while waiting, so the node's other subscriptions
        keep working.
    check : callable, optional
        Called often while waiting; what it raises ends the replay.
    imager : str
        Node whose progress is followed.

    Attributes
    ----------
    progress : int or None
        Counter of the last pulse that the imager has finished.
    """

    def __init__(self, node: Node, executor: Executor, *, check: Callable[[], None] = lambda: None,
                 imager: str = 'backprojection') -> None:
        self._node = node
        self._executor = executor
        self.check = check
        self._publisher = node.create_publisher(
            Float32MultiArray, 'pulses',
            QoSProfile(depth=PUBLISHER_DEPTH, reliability=ReliabilityPolicy.RELIABLE))
        self._progress = node.create_subscription(
            UInt32, f'{imager}/progress', self._on_progress,
            QoSProfile(depth=PUBLISHER_DEPTH, reliability=ReliabilityPolicy.RELIABLE))
        self.progress: int | None = None
        self._flight: collections.deque[Published] = collections.deque()
        self._last_event_s = 0.0  # of publishing or progress
        self._last_progress_s = 0.0
        self._progress_interval_s = 0.0
        self._seen_progress = False

    def wait_for_subscriber(self, timeout_s: float) -> None:
        """Return when somebody subscribes to `pulses` and progress, if told, gets here.

        Raises
        ------
        ReplayError
            Nobody did in time.
        """
        deadline = time.monotonic() + timeout_s
        while not self._publisher.get_subscription_count():
            if time.monotonic() > deadline:
                raise ReplayError(
                    f'nobody subscribes to {self._publisher.topic_name} after {timeout_s:g} s; '
                    'start the nodes with the same ROS_DOMAIN_ID and namespace, or add '
                    '--launch-nodes')
            self._spin(0.05)
        while (self._node.count_publishers(self._progress.topic_name)
               and not self._progress.get_publisher_count() and time.monotonic() < deadline):
            self._spin(0.05)  # progress told before the topics match would be lost

    def replay(self, messages: Iterable[tuple[int, bytes]], *,
               poses: Iterable[tuple[int, bytes]] = (), rate: float | None = None,
               on_published: Callable[[Published], None] = lambda published: None) -> int:
        """Publish messages in their order.

        Parameters
        ----------
        messages : iterable of (time_ns, cdr)
            Recording times in nanoseconds and serialised messages, as `bag_io.raw_messages`
            gives them; a test may drop, repeat, swap or damage some on the way.
        poses : iterable of (time_ns, cdr)
            Serialised nav_msgs/Odometry, as `bag_io.pose_messages` gives them; published on
            `odometry` among the others, by their times.
        rate : float, optional
            Follow the recording times, so many times as fast. By default messages go as fast as
            the nodes finish them.
        on_published : callable
            Called after every message of pulses.

        Returns
        -------
        int
            Number of messages of pulses published.

        Raises
        ------
        ReplayError
            There are poses, and nobody subscribes to them.
        """
        self._flight.clear()
        self._seen_progress = False
        start_ns, count = None, 0
        stream = self._with_poses(messages, poses)
        start_s = due_s = time.monotonic()
        for time_ns, cdr, publisher in stream:
            start_ns = time_ns if start_ns is None else start_ns
            if publisher is not self._publisher:
                self._wait_until(due_s if rate is None
                                 else start_s + (time_ns - start_ns) / 1e9 / rate)
                due_s = time.monotonic() + 1 / POSES_PER_S
                publisher.publish(cdr)
                continue
            message = Published(count, _read(cdr), len(cdr), 0.0)
            if rate is None:
                self._wait_for_room(message)
            else:
                self._wait_until(start_s + (time_ns - start_ns) / 1e9 / rate)
            self.check()
            message = dataclasses.replace(message, time_s=time.monotonic())
            self._publisher.publish(cdr)
            self._last_event_s = message.time_s
            if message.block is not None:  # a damaged message never makes progress
                self._flight.append(message)
            on_published(message)
            count += 1
            self._spin(0.0)
        return count

    def _with_poses(self, messages: Iterable[tuple[int, bytes]],
                    poses: Iterable[tuple[int, bytes]]
                    ) -> Iterator[tuple[int, bytes, Publisher]]:
        """Both streams by time, with the publisher of each message."""
        pulses = ((time_ns, cdr, self._publisher) for time_ns, cdr in messages)
        poses = iter(poses)
        first = next(poses, None)
        if first is None:
            return pulses
        odometry = self._node.create_publisher(Odometry, 'odometry', POSE_DEPTH)
        deadline = time.monotonic() + POSE_TIMEOUT_S
        while not odometry.get_subscription_count():
            if time.monotonic() > deadline:
                raise ReplayError(f'nobody subscribes to {odometry.topic_name}; start '
                                  'pulse_buffer with pose.source:=odometry')
            self._spin(0.05)
        located = ((time_ns, cdr, odometry) for time_ns, cdr in itertools.chain([first], poses))
        return heapq.merge(located, pulses, key=lambda message: message[0])

    def _wait_until(self, moment_s: float) -> None:
        while (remaining := moment_s - time.monotonic()) > 0:
            self._spin(min(remaining, 0.05))

    def _wait_for_room(self, message: Published) -> None:
        while (self._flight and not self._fits(message)
               and time.monotonic() - self._last_event_s < self._patience_s()):
            self._spin(0.02)

    def _fits(self, message: Published) -> bool:
        flying = [*self._flight, message]
        return (len(flying) <= MAX_MESSAGES
                and sum(m.n_bytes for m in flying) <= MAX_BYTES
                and sum(m.block.n_pulses for m in flying if m.block) <= MAX_PULSES)

    def _patience_s(self) -> float:
        """Seconds without any event after which to go on: blocks may have been lost."""
        if not self._node.count_publishers(self._progress.topic_name):
            return STALL_S
        if not self._seen_progress:
            return FIRST_PROGRESS_S
        return max(STALL_S, 4 * self._progress_interval_s)

    def _on_progress(self, message: UInt32) -> None:
        now = time.monotonic()
        if self._seen_progress:
            self._progress_interval_s += 0.3 * (now - self._last_progress_s
                                                - self._progress_interval_s)
        self._seen_progress = True
        self._last_event_s = self._last_progress_s = now
        self.progress = message.data
        # blocks are finished in the order sent: everything before a finished one is done or lost
        finished = [i for i, m in enumerate(self._flight)
                    if m.block is not None
                    and counter_distance(m.block.counter[-1], message.data) <= 0]
        for _ in range(finished[-1] + 1 if finished else 0):
            self._flight.popleft()

    def _spin(self, timeout_s: float) -> None:
        self.check()
        self._executor.spin_once(timeout_sec=timeout_s)


def _read(cdr: bytes) -> PulseBlock | None:
    """Block in a message; None when it holds none."""
    try:
        return deserialise(cdr)
    except Exception:  # damaged bytes fail in many ways, and sending them on is the point here
        return None
