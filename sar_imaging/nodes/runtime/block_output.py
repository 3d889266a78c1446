# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Outputs of nodes: blocks for the next one, headers and queues of products."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float32MultiArray, Header

from msg_conversions import pulse_block

from .health import Cause, Part, Tally
from .managed import ManagedNode
from .step import stream_qos

UNTAKEN = 'pulses_untaken'
PRODUCT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)


def header_at(stamp_ns: int, parameters: Mapping[str, Any]) -> Header:
    """Header of a product of a time in nanoseconds, in the imaging frame."""
    return Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9),
                  frame_id=parameters['frame_id'])


class BlockOutput:
    """Publishes pulse blocks when somebody subscribes, and counts the pulses that nobody takes.

    Parameters
    ----------
    node : ManagedNode
        Node whose output it is.
    topic : str
        Relative name.
    parameters : mapping
        Current values, with `queue_depth`.
    health : Tally
        Counters, with `UNTAKEN`. A `Part` hands its products on to the next one: nobody has to
        subscribe.
    to_message : callable
        Makes a message of a product that has `n_pulses`.
    qos : callable
        Quality of service, from the parameters.
    """

    def __init__(self, node: ManagedNode, topic: str, parameters: Mapping[str, Any],
                 health: Tally,
                 to_message: Callable[..., Float32MultiArray] = pulse_block.to_message,
                 qos: Callable[[Mapping[str, Any]], QoSProfile] = stream_qos):
        self._health, self._to_message = health, to_message
        self._publisher = node.create_output(Float32MultiArray, topic, qos(parameters))

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return self._publisher.topic_name

    def publish(self, product: Any) -> None:
        """Publish a product; without a subscriber no message is made."""
        taken = self._publisher.get_subscription_count() > 0
        if taken:
            self._publisher.publish(self._to_message(product))
        if isinstance(self._health, Part):
            return
        self._health.count(UNTAKEN, 0 if taken else product.n_pulses)
        self._health.cause(Cause.NO_SUBSCRIBER, '' if taken else (
            f'pulses are lost: nobody subscribes to {self.topic}; the next node is not ready or '
            'does not run'))
