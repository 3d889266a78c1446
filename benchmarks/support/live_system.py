# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Run the nodes as processes, feed them in real time, and take note of what comes when."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pathlib
import time
from collections.abc import Callable, Iterable

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray

from sar_imaging.nodes.runtime.managed import keep_freed_memory
from sar_imaging.simulation.scenarios.scenario import START_NS
from sar_imaging.tools.node_processes import NO_LOG_FILES, NodeProcesses

from .live_flight import PRF_HZ, PULSES_PER_APERTURE, PULSES_PER_MESSAGE, Message

PATIENCE_S = 60.0
TICKS_PER_S = os.sysconf('SC_CLK_TCK')
# What means that pulses were lost, in the diagnostics of any node.
LOSSES = ('pulses_missing', 'pulses_late', 'pulses_corrupt', 'blocks_dropped', 'blocks_rejected',
          'apertures_dropped', 'apertures_skipped', 'messages_lost', 'errors')


@dataclasses.dataclass
class Received:
    """An image that came."""

    middle: float  # of its pulses: counter
    time_s: float  # on time.monotonic
    data: bytes  # empty where images are not kept

    @property
    def aperture(self) -> int:
        """Number of the aperture that the middle belongs to."""
        return int(self.middle) // PULSES_PER_APERTURE

    @property
    def last_so_far(self) -> int:
        """Last pulse of an image of its aperture so far."""
        first = self.aperture * PULSES_PER_APERTURE
        return round(2 * self.middle - first)

    @property
    def last_of_window(self) -> int:
        """Last pulse of an image as long as an aperture, wherever it begins."""
        return round(self.middle + (PULSES_PER_APERTURE - 1) / 2)


@dataclasses.dataclass(frozen=True)
class Fed:
    """What was sent."""

    seconds: float
    n_pulses: int
    n_bytes: int


class System:
    """The nodes, fed and observed; use it in a ``with`` statement.

    Parameters
    ----------
    names : tuple of str
        Nodes to start.
    parameters : dict
        Their parameters.
    folder : Path
        For their logs.
    keep : bool
        Keep the pixels of the images.
    topic : str
        Which images to receive.
    """

    def __init__(self, names: tuple[str, ...], parameters: dict, folder: pathlib.Path, *,
                 keep: bool = False, topic: str = 'image_complex'):
        self.names, self._topic = names, topic
        self._parameters = parameters
        self._folder = folder
        self._keep = keep
        self._stack = contextlib.ExitStack()
        self.images: list[Received] = []
        self.status: dict[str, dict[str, float]] = {}
        self._sent_s: dict[int, float] = {}  # when each message was sent, by its number

    def __enter__(self) -> System:
        self.started_s = time.monotonic()
        self.nodes = NodeProcesses(self._parameters, self._folder, os.environ, nodes=self.names)
        self._stack.enter_context(self.nodes)
        context = rclpy.Context()
        rclpy.init(args=list(NO_LOG_FILES), context=context)
        keep_freed_memory()  # as a subscriber of large images does well to
        self._stack.callback(rclpy.try_shutdown, context=context)
        node = rclpy.create_node('live_benchmark', context=context)
        self._stack.callback(node.destroy_node)
        self._executor = SingleThreadedExecutor(context=context)
        self._stack.callback(self._executor.shutdown)
        self._executor.add_node(node)
        self._publisher = node.create_publisher(
            Float32MultiArray, 'pulses',
            QoSProfile(depth=200, reliability=ReliabilityPolicy.RELIABLE))
        node.create_subscription(Image, self._topic, self._on_image, 50)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 50)
        try:
            self.wait(self._connected, 'the nodes to be connected')
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *exception) -> None:
        self._stack.close()

    def _connected(self) -> bool:
        logs = [self.nodes.log_file(name).read_text() for name in self.names]
        return (self._publisher.get_subscription_count() > 0
                and all('subscriber on ' in log for log in logs[:-1])
                and f'subscriber on /{self._topic} joined' in logs[-1])

    def wait(self, condition: Callable[[], object], what: str, patience_s=PATIENCE_S) -> bool:
        """Spin until a condition holds; raises TimeoutError."""
        deadline = time.monotonic() + patience_s
        while not condition():
            self.nodes.check()
            if time.monotonic() > deadline:
                raise TimeoutError(f'waited {patience_s:g} s for {what}')
            self._executor.spin_once(timeout_sec=0.02)
        return True

    def _on_image(self, message: Image) -> None:
        stamp = message.header.stamp
        seconds = (stamp.sec * 10**9 + stamp.nanosec - START_NS) / 1e9
        self.images.append(Received(seconds * PRF_HZ, time.monotonic(),
                                    bytes(message.data) if self._keep else b''))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.status[status.name] = numbers = {}
            for pair in status.values:
                with contextlib.suppress(ValueError):  # texts
                    numbers[pair.key] = float(pair.value)

    def publish(self, cdr: bytes) -> None:
        """Send a serialised message now."""
        self._publisher.publish(cdr)

    def feed(self, messages: Iterable[Message], rate: float,
             every_message: Callable[[], object] = lambda: None) -> Fed:
        """Send messages at `rate` times real time; what was sent before is forgotten."""
        self._sent_s.clear()
        self.images.clear()
        begun, first_s, n_pulses, n_bytes = time.monotonic(), None, 0, 0
        for message in messages:
            first_s = message.time_s if first_s is None else first_s
            due = begun + (message.time_s - first_s) / rate
            while (remaining := due - time.monotonic()) > 0:
                self._executor.spin_once(timeout_sec=remaining)
            self._executor.spin_once(timeout_sec=0)
            self.publish(message.cdr)
            self._sent_s[message.first // PULSES_PER_MESSAGE] = time.monotonic()
            n_pulses, n_bytes = n_pulses + message.n_pulses, n_bytes + len(message.cdr)
            every_message()
        self.nodes.check()
        return Fed(time.monotonic() - begun, n_pulses, n_bytes)

    def delay_s(self, image: Received, last: int) -> float | None:
        """Seconds from sending a pulse to an image; None where it was not sent."""
        sent_s = self._sent_s.get(last // PULSES_PER_MESSAGE)
        return None if sent_s is None else image.time_s - sent_s

    @property
    def last_sent_s(self) -> float:
        """When the last message was sent."""
        return max(self._sent_s.values())

    def losses(self) -> dict[str, int]:
        """What the nodes report as lost, after a fresh report of each."""
        self.status.clear()
        self.wait(lambda: len({n.split(':')[0] for n in self.status}) >= len(self.names),
                  'diagnostics')
        now = time.monotonic()
        self.wait(lambda: time.monotonic() > now + 1.5, 'the other parts')
        found = {key: int(sum(s.get(key, 0) for s in self.status.values())) for key in LOSSES}
        return {key: n for key, n in found.items() if n}

    def cpu_s(self) -> dict[str, dict[str, float]]:
        """Seconds of processor time so far: of each node, in its transport and its work.

        Transport is the main thread, which takes messages and checks them, and the threads of
        Fast DDS; the rest is the worker with the threads of Numba.
        """
        return {name: _thread_seconds(self.nodes.pid(name)) for name in self.names}

    def memory_mb(self) -> dict[str, float]:
        """Resident memory of each node, MB."""
        return {name: _resident_mb(self.nodes.pid(name)) for name in self.names}


def _resident_mb(pid: int) -> float:
    pages = int(pathlib.Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def _thread_seconds(pid: int) -> dict[str, float]:
    seconds = {'transport': 0.0, 'work': 0.0}
    for task in pathlib.Path(f'/proc/{pid}/task').iterdir():
        name, _, fields = (task / 'stat').read_text().partition('(')[2].rpartition(')')
        user, system = fields.split()[11:13]
        transport = task.name == str(pid) or name.startswith('dds.')
        seconds['transport' if transport else 'work'] += (int(user) + int(system)) / TICKS_PER_S
    return seconds


def difference_db(received: Received, reference: np.ndarray) -> float:
    """Difference of a complex image message from an image, dB."""
    image = np.frombuffer(received.data, np.complex64).reshape(reference.shape)
    return float(20 * np.log10(np.linalg.norm(image - reference) / np.linalg.norm(reference)
                               + 1e-12))
