# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Watch an input of a node: why nothing, or nothing of use, comes on its topic."""

from __future__ import annotations

import collections
import itertools
import time
from collections.abc import Callable

from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from .health import Cause

CAUSES = (Cause.OTHER_TYPE, Cause.INCOMPATIBLE_QOS, Cause.NO_PUBLISHER, Cause.TWO_PUBLISHERS,
          Cause.STALLED)
_NUMBERS = {2: 'two', 3: 'three'}
_LOOKS = 3  # of which two see more strays


class InputWatch:
    """Whether messages come on a topic, and why not; to be asked once per second.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that subscribes.
    topic : str
        Resolved name of the topic.
    message_type : str
        That is expected there, such as ``'xwr_msgs/msg/IQ'``.
    qos : QoSProfile
        Quality of service of the subscription.
    patience_s : callable
        Returns how long the input may pause.
    advice : str
        Where the type is explained, or how to name another topic or type.
    sender : str
        Who publishes such messages.
    strays : callable
        Returns how much came so far that a single publisher would hardly send.
    """

    def __init__(self, node: Node, topic: str, message_type: str, qos: QoSProfile, *,
                 patience_s: Callable[[], float], advice: str, sender: str,
                 strays: Callable[[], int] = lambda: 0):
        self._node, self._topic, self._type, self._qos = node, topic, message_type, qos
        self._patience_s, self._advice, self._sender = patience_s, advice, sender
        self._count_strays = strays
        self._strays: collections.deque[int] = collections.deque(maxlen=_LOOKS + 1)
        self._last_s = time.monotonic()
        self.heard = False  # since the beginning

    def arrived(self) -> None:
        """A message came."""
        self._last_s, self.heard = time.monotonic(), True

    @property
    def pause_s(self) -> float:
        """Since the last message, or since the beginning."""
        return time.monotonic() - self._last_s

    @property
    def state(self) -> str:
        """What the node does when nothing is wrong."""
        return 'working' if self.heard else 'waiting for input'

    def look(self) -> tuple[Cause, str, str] | None:
        """What is wrong, text for the diagnostics and for the log; None when nothing is."""
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        same_type = [e for e in publishers if e.topic_type == self._type]
        unheard = [e for e in same_type if self._incompatible(e.qos_profile)]
        heard = [e.node_name for e in same_type if e not in unheard]
        pause_s, patience_s = self.pause_s, self._patience_s()
        silent = pause_s > patience_s
        self._strays.append(self._count_strays())
        pause = f'no input for {pause_s:.0f} s: '
        log = f'nothing came on {self._topic} for more than {patience_s:g} s: '
        if unheard and (silent or not heard):
            text = (f'a publisher of {self._topic}, {unheard[0].node_name}, cannot be heard: '
                    f'{self._incompatible(unheard[0].qos_profile)}')
            return Cause.INCOMPATIBLE_QOS, text, text
        if publishers and not same_type:
            types = ', '.join(sorted({e.topic_type for e in publishers}))
            if silent:
                text = f'it carries {types}, expected {self._type}; {self._advice}'
                return Cause.OTHER_TYPE, pause + text, log + text
            text = (f'{self._topic} carries {types}; expected {self._type} ({self._advice}): no '
                    'messages arrive')
            return Cause.OTHER_TYPE, text, text
        if not silent:
            return self._judge_strays(heard)
        if same_type:
            return (Cause.STALLED, f'{pause}the publisher of {self._topic} is silent',
                    f'input stalled: nothing on {self._topic} for {pause_s:.0f} s, its publisher '
                    'is silent')
        text = self._who_else()
        return Cause.NO_PUBLISHER, pause + text, log + text

    def _judge_strays(self, senders: list[str]) -> tuple[Cause, str, str] | None:
        """That several publishers send what does not fit together."""
        n, rises = len(senders), sum(b > a for a, b in itertools.pairwise(self._strays))
        if n < 2 or rises < 2:
            return None
        text = (f'{_NUMBERS.get(n, n)} publishers send different pulses on {self._topic}: '
                f'{", ".join(senders)}; stop all but one, or remap')
        return Cause.TWO_PUBLISHERS, text, text

    def _incompatible(self, offered: QoSProfile) -> str:
        compatible, reason = qos_check_compatible(offered, self._qos)
        if compatible != QoSCompatibility.ERROR:
            return ''
        return (f'{reason.removeprefix("ERROR: ").rstrip(";").lower()}; make both the same, here '
                f'by the parameters qos_overrides.{self._topic}.subscription')

    def _who_else(self) -> str:
        others = sorted(name for name, kinds in self._node.get_topic_names_and_types()
                        if self._type in kinds and self._has_source(name))
        if not others:
            return f'nobody publishes {self._type}; is {self._sender} running?'
        return f'nobody publishes there, {self._type} is on {", ".join(others)}; {self._advice}'

    def _has_source(self, topic: str) -> bool:
        """Whether another node publishes there that is no stage: those tell their progress."""
        me = self._node.get_name(), self._node.get_namespace()
        senders = {(end.node_name, end.node_namespace)
                   for end in self._node.get_publishers_info_by_topic(topic)} - {me}
        return any(not any(name.endswith(f'/{sender[0]}/progress')
                           for name, _ in self._outputs(*sender)) for sender in senders)

    def _outputs(self, name: str, namespace: str) -> list[tuple[str, list[str]]]:
        if not namespace.startswith('/'):  # DDS does not know the node yet, or it is none of ROS
            return []
        try:
            return self._node.get_publisher_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:  # it has just ended
            return []
