"""Report while a node prepares itself: its executor waits, and pulses may come already."""

from __future__ import annotations

import contextlib
import threading
import time

from rclpy.exceptions import NotInitializedException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray

from msg_conversions import WireFormatError
from sar_imaging.compilation import counted

from .health import Cause
from .inlet import Inlet
from .managed import DIAGNOSTICS_PERIOD_S, ManagedNode, RCLError
from .step import stream_qos

CONTEXT_ENDED = RCLError, NotInitializedException, ExternalShutdownException


class Preparation(contextlib.ExitStack):
    """Publishes diagnostics, and counts the pulses that nobody takes, while kernels compile.

    Kernels are compiled at the first start on a machine, which takes up to some minutes; use it
    in a ``with`` statement around what may compile some.

    Parameters
    ----------
    node : ManagedNode
        With the counter ``pulses_before_ready``.
    topic : str
        Relative name of its input.
    inlet : Inlet
        How to read the input.
    """

    def __init__(self, node: ManagedNode, topic: str, inlet: Inlet):
        super().__init__()
        self._node, self._topic, self._inlet = node, topic, inlet
        self._ended = threading.Event()

    def __enter__(self) -> Preparation:
        self.enter_context(counted(self._begin))
        return self

    def _begin(self) -> None:
        """The first kernel is being compiled."""
        # First: an executor that Ctrl-C keeps from being made complains when it is collected.
        executor = SingleThreadedExecutor(context=self._node.context)
        self.callback(executor.shutdown)
        self._node.health.info(
            'compiling kernels: at the first start on a machine this takes up to a minute or two, '
            'later starts load them; `ros2 run sar_imaging compile_kernels` does it beforehand')
        thread = threading.Thread(target=self._report, args=[executor], name='preparation')
        thread.start()
        self.callback(thread.join)
        self.callback(self._ended.set)

    def _report(self, executor: SingleThreadedExecutor) -> None:
        node, context = self._node, self._node.context
        # Ctrl-C ends the context at any moment.
        with contextlib.suppress(*CONTEXT_ENDED), contextlib.ExitStack() as made:
            listening = Node(f'{node.get_name()}_preparing', namespace=node.get_namespace(),
                             context=context, enable_rosout=False, start_parameter_services=False)
            made.callback(listening.destroy_node)
            listening.create_subscription(
                Float32MultiArray, node.resolve_topic_name(self._topic), self._count,
                stream_qos(node.parameters))
            executor.add_node(listening)
            self._tell(executor)

    def _tell(self, executor: SingleThreadedExecutor) -> None:
        """Publish diagnostics in their period, and take pulses meanwhile."""
        node, began_s = self._node, time.monotonic()
        due_s = began_s
        while not self._ended.is_set() and node.context.ok():
            if time.monotonic() >= due_s:
                due_s += DIAGNOSTICS_PERIOD_S
                node.health.cause(Cause.COMPILING, (
                    f'compiling kernels for {time.monotonic() - began_s:.0f} s so far; pulses '
                    f'are not taken, {node.health.get("pulses_before_ready")} came'))
                node.health.publish(node.state)
            executor.spin_once(timeout_sec=0.05)
        if node.context.ok():
            node.health.cause(Cause.COMPILING, '')

    def _count(self, message: Float32MultiArray) -> None:
        with contextlib.suppress(WireFormatError):
            item = self._inlet.read(message, max_elements=2**31)
            self._node.health.count('pulses_before_ready', self._inlet.n_pulses(item))
