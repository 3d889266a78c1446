# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Receive what the nodes publish during an evaluation: image, grid, diagnostics, warnings."""

from __future__ import annotations

import dataclasses
import math
import re
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import MapMetaData
from rcl_interfaces.msg import Log
from rclpy.executors import Executor
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.geometry.grids import MapGrid

from ..node_processes import AFBP_NODES, PIPELINE

AUTOFOCUS_FIGURES = ('time_offset_s', 'largest_move_m', 'contrast_before', 'contrast_after')
_ALL_REJECTED = 4  # blocks or poses from which on it is no accident
INPUTS = ('pulses', 'pulse_blocks', 'range_profiles', 'subaperture_images')  # of AFBP_NODES
_LOG_DEPTH = 1000  # lines: that of the publishers
MOST_TOLD = 20
_PROGRESS = 'autofocus of aperture', 'compiling kernels'  # lines that tell why it takes long


class ObserverError(RuntimeError):
    """The nodes do not answer or do not fit together."""


@dataclasses.dataclass(frozen=True)
class ReceivedImage:
    """A complex image and when it came.

    Parameters
    ----------
    image : (n_y, n_x) complex64
        Image; row 0 is the largest y.
    stamp_ns : int
        Middle of its aperture, nanoseconds.
    received_s : float
        Time of reception, on `time.monotonic`.
    """

    image: np.ndarray
    stamp_ns: int
    received_s: float


class NodeWarnings:
    """Warnings and errors in the logs of nodes; texts that differ in numbers alone are told once.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to listen with; the nodes are in its namespace.
    names : sequence of str
        Nodes to listen to.
    tell : callable
        Called with a line for people, at most `MOST_TOLD` times, and with how far autofocus is.
    past : bool
        Also what was logged before, as far as the nodes keep it.

    Attributes
    ----------
    texts : list of (str, str)
        Node and text of all different warnings so far.
    """

    def __init__(self, node: Node, names: Sequence[str], tell: Callable[[str], object], *,
                 past: bool) -> None:
        prefix = node.get_namespace().strip('/').replace('/', '.')
        self._names = {f'{prefix}.{name}'.lstrip('.'): name for name in names}
        self._tell = tell
        self.texts: list[tuple[str, str]] = []
        self._kinds: set[tuple[str, str]] = set()
        durability = DurabilityPolicy.TRANSIENT_LOCAL if past else DurabilityPolicy.VOLATILE
        node.create_subscription(Log, '/rosout', self._take, QoSProfile(
            depth=_LOG_DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=durability))

    def of(self, name: str, words: str) -> str:
        """Latest warning of a node that has some words in it; empty without."""
        found = [text for node, text in self.texts if node == name and words in text]
        return found[-1] if found else ''

    def _take(self, message: Log) -> None:
        name = self._names.get(message.name)
        if name is None or message.level < LoggingSeverity.WARN:
            if name is not None and message.msg.startswith(_PROGRESS):
                self._tell(f'{name}: {message.msg}')
            return
        if (name, message.msg) in self.texts:
            return
        self.texts.append((name, message.msg))
        kind = name, re.sub(r'\d+', '#', message.msg)
        if kind in self._kinds:
            return
        self._kinds.add(kind)
        if len(self._kinds) <= MOST_TOLD:
            self._tell(f'{name} warns: {message.msg}')
        elif len(self._kinds) == MOST_TOLD + 1:
            self._tell('further warnings of the nodes are in their logs')


class Observer:
    """Subscriptions to the products of the nodes.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to subscribe from; the observed nodes are in its namespace.
    executor : rclpy.executors.Executor
        Executor of that node, spun here while waiting.
    nodes : sequence of str
        The observed nodes, in the order of the work.
    tell : callable
        Called with what the nodes warn of, a line each.
    past : bool
        Also what they warned of before.

    Attributes
    ----------
    image : ReceivedImage or None
        Image of the aperture asked for by `expect`.
    n_images : int
        All images that came.
    autofocus : dict of int to dict
        What the nodes told of autofocus, by the number of the aperture: `verdict`, `reason` and
        the figures `AUTOFOCUS_FIGURES`.
    """

    def __init__(self, node: Node, executor: Executor, nodes: Sequence[str], *,
                 tell: Callable[[str], object] = lambda line: None, past: bool = False) -> None:
        self._node = node
        self._nodes = tuple(nodes)
        self._executor = executor
        self._warnings = NodeWarnings(node, nodes, tell, past=past)
        self._window_ns = (0, 0)
        self._map_metadata: MapMetaData | None = None
        self._status: dict[str, tuple[float, DiagnosticStatus]] = {}
        self._before: dict[str, dict[str, int]] = {}
        prefix = node.get_namespace().strip('/')
        self._statuses = {f'{prefix}/{name}: {part}'.lstrip('/'): key
                          for name in nodes for part, key in _parts(name).items()}
        self.image: ReceivedImage | None = None
        self.n_images = 0
        self.autofocus: dict[int, dict[str, Any]] = {}
        reliable = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
        latched = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                             durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._image_subscription = node.create_subscription(
            Image, 'image_complex', self._on_image, reliable)
        node.create_subscription(MapMetaData, 'map_metadata', self._on_map_metadata, latched)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 50)

    def expect(self, first_ns: int, last_ns: int) -> None:
        """Keep the image whose stamp lies between these times, nanoseconds."""
        self._window_ns = (first_ns, last_ns)
        self.image = None
        self._before = {name: self.counters(name) for name in self.stages}

    def wait_for_nodes(self, timeout_s: float, check: Callable[[], None]) -> None:
        """Return when all nodes are there and their topics are connected.

        A fresh report of every node, published after its neighbours were seen, means that they
        have had the time to see each other.

        Raises
        ------
        ObserverError
            Something is missing after the timeout.
        """
        deadline = time.monotonic() + timeout_s
        while missing := self._missing():
            if time.monotonic() > deadline:
                raise ObserverError(
                    f'after {timeout_s:g} s there is no {", no ".join(missing)}; start the nodes '
                    'with the same ROS_DOMAIN_ID and namespace, or add --launch-nodes')
            self.spin(check)
        if (n := self._node.count_publishers('image_complex')) > 1:
            raise ObserverError(f'{n} nodes publish image_complex; stop all but one, or choose '
                                'another ROS_DOMAIN_ID')
        complete_s = time.monotonic()
        for name in self._nodes:
            if self.status_after(name, complete_s, deadline, check) is None:
                raise ObserverError(f'{name} publishes no /diagnostics; check its log')

    def _missing(self) -> list[str]:
        """What the evaluation needs and cannot see yet, in words."""
        missing = []
        for topic, reader in zip(INPUTS, self._nodes, strict=False):
            # By name: what counts pulses while kernels are compiled subscribes, too.
            readers = self._node.get_subscriptions_info_by_topic(topic)
            if (reader not in {info.node_name for info in readers}
                    or (topic != INPUTS[0] and not self._node.count_publishers(topic))):
                missing.append(f'{reader} on topic {topic}')
        if not self._node.count_publishers('image_complex'):
            missing.append('publisher of image_complex')
        return missing

    def pulses_per_aperture(self, timeout_s: float, check: Callable[[], None]) -> int:
        """Parameter of the running nodes.

        Raises
        ------
        ObserverError
            The node does not answer.
        """
        name = 'pulses_per_aperture'
        client = AsyncParameterClient(self._node, self._nodes[0])
        deadline = time.monotonic() + timeout_s
        while not client.services_are_ready() and time.monotonic() < deadline:
            self.spin(check)
        future = client.get_parameters([name]) if client.services_are_ready() else None
        while future and not future.done() and time.monotonic() < deadline:
            self.spin(check)
        values = future.result().values if future and future.done() else []
        if not values or values[0].integer_value < 1:
            raise ObserverError(f'node {self._nodes[0]} does not give its parameter {name}')
        return values[0].integer_value

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of all that reports: the nodes, or a pipeline and its stages."""
        return tuple(self._statuses.values())

    @property
    def grid(self) -> MapGrid | None:
        """Grid of the images, None before it came."""
        return self._map_metadata and map_metadata_from_message(self._map_metadata)

    def counters(self, name: str) -> dict[str, int]:
        """Integer counters in the last report of a node."""
        if name not in self._status:
            return {}
        out = {}
        for pair in self._status[name][1].values:
            try:
                out[pair.key] = int(pair.value)
            except ValueError:
                continue  # a measured figure, not a counter
        return out

    def counted(self) -> dict[str, dict[str, int]]:
        """What each node has counted since `expect`."""
        return {name: counter_increase(self._before[name], self.counters(name))
                for name in self.stages}

    def refusal(self, *, sent_all: bool = False) -> str:
        """Which node has refused everything since `expect`, and why; empty when none has.

        Parameters
        ----------
        sent_all : bool
            Nothing more will be sent: a single block that was refused is enough.
        """
        def increase(name: str, key: str) -> int:
            return self.counters(name).get(key, 0) - self._before.get(name, {}).get(key, 0)

        least = 1 if sent_all else _ALL_REJECTED
        for name in self.stages:
            rejected = increase(name, 'blocks_rejected')
            all_of_them = (rejected >= increase(name, 'blocks_received') if (name,) != PIPELINE
                           else not increase('backprojection', 'pulses_imaged'))
            if rejected >= least and all_of_them:
                return (f'{name} rejected all of {rejected} blocks so far: '
                        f'{self._text(name, "last_rejection") or "see its log"}')
        poses = increase('pulse_buffer', 'poses_rejected')
        if poses >= _ALL_REJECTED and poses >= increase('pulse_buffer', 'poses_received'):
            why = self._warnings.of(self._nodes[0], 'dropped poses') or 'see its log'
            return f'{self._nodes[0]} rejected all of {poses} poses so far: {why}'
        return ''

    def refused(self, aperture: int) -> str:
        """Which node has given up the image of an aperture, and why; empty when none has."""
        for name in self._nodes:
            for words in ('dropped', 'cannot be imaged', 'is left out'):
                if why := self._warnings.of(name, f'aperture {aperture} {words}'):
                    return f'{name} forms no image: {why}'
        return ''

    def figure(self, name: str, key: str) -> float | None:
        """A measured figure in the last report of a node; None where it has none."""
        text = self._text(name, key) if name in self._status else ''
        return float(text) if text and math.isfinite(float(text)) else None

    @property
    def diagnosing(self) -> bool:
        """Whether a node still looks for what is wrong with an aperture."""
        return any(self._text(name, 'diagnosis_seconds') == 'nan' for name in self._status)

    def _text(self, name: str, key: str) -> str:
        return next((pair.value for pair in self._status[name][1].values if pair.key == key), '')

    def status_after(self, name: str, moment_s: float, deadline_s: float,
                     check: Callable[[], None]) -> DiagnosticStatus | None:
        """First report of a node after a moment, None when none comes before the deadline."""
        while name not in self._status or self._status[name][0] <= moment_s:
            if time.monotonic() > deadline_s:
                return None
            self.spin(check)
        return self._status[name][1]

    def report(self) -> str:
        """Last reports of the nodes, for error messages."""
        lines = []
        for name in self.stages:
            if name not in self._status:
                lines.append(f'  {name}: no report')
                continue
            status = self._status[name][1]
            counts = ', '.join(f'{k}={v}' for k, v in self.counters(name).items() if v)
            lines.append(f'  {name}: {status.message}; {counts or "all counters are zero"}')
            lines += [f'    {text}' for key in ('last_rejection', 'mistake')
                      if (text := self._text(name, key))]
        return '\n'.join(lines)

    def spin(self, check: Callable[[], None], timeout_s: float = 0.05) -> None:
        """Handle what came, or wait a moment for something to come."""
        check()
        self._executor.spin_once(timeout_sec=timeout_s)

    def _on_image(self, message: Image) -> None:
        received_s = time.monotonic()
        self.n_images += 1
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if self._window_ns[0] <= stamp_ns <= self._window_ns[1]:
            self.image = ReceivedImage(complex_from_message(message).copy(), stamp_ns, received_s)

    def _on_map_metadata(self, message: MapMetaData) -> None:
        self._map_metadata = message

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            name = self._statuses.get(status.name)
            if name is not None:  # else of another radar, or of something else
                self._status[name] = (time.monotonic(), status)
                if verdict := self._text(name, 'autofocus_verdict'):
                    self.autofocus[int(self._text(name, 'autofocus_aperture'))] = {
                        'verdict': verdict, 'reason': self._text(name, 'autofocus_reason'),
                        **{key: self.figure(name, f'autofocus_{key}') for key in
                           AUTOFOCUS_FIGURES}}


def counter_increase(before: dict[str, int], after: dict[str, int]) -> dict[str, int]:
    """Increase of a node's counters; of a node that started anew, their values.

    Parameters
    ----------
    before, after : dict of str to int
        Counters by name, as `Observer.counters` gives them, before and after.
    """
    restarted = any(after.get(k, 0) < v for k, v in before.items() if k.endswith('_received'))
    return {k: v if restarted else v - before.get(k, 0) for k, v in after.items()}


def _parts(node: str) -> dict[str, str]:
    """Parts of a node's diagnostics and the names that they are kept by."""
    parts = {'stage': node}
    return parts if (node,) != PIPELINE else parts | {name: name for name in AFBP_NODES}
