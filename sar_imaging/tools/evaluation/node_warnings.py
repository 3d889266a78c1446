"""Collect the warnings of nodes from /rosout, and progress, for programs that watch them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from rcl_interfaces.msg import Log
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

_DEPTH = 1000  # lines: that of the publishers
MOST_TOLD = 20
_PROGRESS = 'autofocus of aperture'  # lines that tell how far a long search is


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
                 past: bool):
        prefix = node.get_namespace().strip('/').replace('/', '.')
        self._names = {f'{prefix}.{name}'.lstrip('.'): name for name in names}
        self._tell = tell
        self.texts: list[tuple[str, str]] = []
        self._kinds: set[tuple[str, str]] = set()
        durability = DurabilityPolicy.TRANSIENT_LOCAL if past else DurabilityPolicy.VOLATILE
        node.create_subscription(Log, '/rosout', self._take, QoSProfile(
            depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=durability))

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
