"""Watch an input of a node: tell of a topic on which nothing comes, and what may be meant."""

from __future__ import annotations

import time

from rclpy.node import Node

from .health import Health

PATIENCE_S = 5.0


class InputWatch:
    """Whether messages come on a topic; to be asked once per second.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that subscribes.
    health : Health
        Where to log.
    topic : str
        Resolved name of the topic.
    message_type : str
        That is expected there, such as ``'xwr_msgs/msg/IQ'``.
    advice : str
        How to name another topic or type.
    """

    def __init__(self, node: Node, health: Health, topic: str, message_type: str, advice: str):
        self._node, self._health = node, health
        self._topic, self._type, self._advice = topic, message_type, advice
        self._last_s = time.monotonic()
        self._told = ''

    def arrived(self) -> None:
        """A message came."""
        self._last_s = time.monotonic()

    def problem(self) -> str:
        """Why nothing comes, logged when it begins; empty while messages come."""
        pause_s = time.monotonic() - self._last_s
        if pause_s < PATIENCE_S:
            if self._told:
                self._health.info(f'messages come on {self._topic}')
                self._told = ''
            return ''
        text = self._reason()
        if text != self._told:
            self._health.warning(f'nothing came on {self._topic} for more than {PATIENCE_S:g} s: '
                                 f'{text}')
            self._told = text
        return f'no input for {pause_s:.0f} s: {text}'

    def _reason(self) -> str:
        types = {e.topic_type for e in self._node.get_publishers_info_by_topic(self._topic)}
        if self._type in types:
            return 'its publisher is silent'
        if types:
            return (f'it carries {", ".join(sorted(types))}, expected {self._type}; '
                    f'{self._advice}')
        others = sorted(name for name, kinds in self._node.get_topic_names_and_types()
                        if self._type in kinds and self._of_others(name))
        if not others:
            return f'nobody publishes {self._type}; is the driver of the radar running?'
        return f'nobody publishes there, {self._type} is on {", ".join(others)}; {self._advice}'

    def _of_others(self, topic: str) -> bool:
        me = self._node.get_name(), self._node.get_namespace()
        return any((e.node_name, e.node_namespace) != me
                   for e in self._node.get_publishers_info_by_topic(topic))
