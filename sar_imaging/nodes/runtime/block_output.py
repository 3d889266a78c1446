"""Publish pulse blocks for the next node, while it subscribes."""

from __future__ import annotations

from collections.abc import Mapping

from std_msgs.msg import Float32MultiArray

from msg_conversions.pulse_block import to_message
from sar_imaging.signal.pulses import PulseBlock

from .managed import ManagedNode
from .step import stream_qos


class BlockOutput:
    """Publishes pulse blocks when somebody subscribes.

    Parameters
    ----------
    node : ManagedNode
        Node whose output it is.
    topic : str
        Relative name.
    parameters : mapping
        Current values, with `queue_depth`.
    """

    def __init__(self, node: ManagedNode, topic: str, parameters: Mapping[str, object]):
        self._publisher = node.create_output(Float32MultiArray, topic, stream_qos(parameters))

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return self._publisher.topic_name

    def publish(self, block: PulseBlock) -> None:
        """Publish a block; without a subscriber no message is made."""
        if self._publisher.get_subscription_count():
            self._publisher.publish(to_message(block))
