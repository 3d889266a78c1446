"""What the nodes have in common: take pulse blocks, work on them in one thread, tell about it."""

from __future__ import annotations

import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription
from std_msgs.msg import Float32MultiArray, UInt32

from msg_conversions import WireFormatError
from msg_conversions.pulse_block import from_message
from msg_conversions.wire import DEFAULT_MAX_ELEMENTS
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.sequence import StreamEvent, describe_range

from .health import Health
from .parameters import ConfigurationError, Parameter, ParameterValues
from .worker import Worker

DIAGNOSTICS_PERIOD_S = 1.0

COMMON_PARAMETERS = (
    Parameter('queue_depth', 50, 'Depth of the reliable queues of the middleware for pulse '
              'blocks, in and out; covers the largest burst.', 'messages', 1, 10_000),
    Parameter('worker_queue_size', 50, 'Blocks that may wait for the worker thread; more are '
              'dropped, counted and logged.', 'blocks', 1, 10_000),
    Parameter('max_message_elements', DEFAULT_MAX_ELEMENTS, 'Largest block to accept.', 'floats',
              2, 2**31 - 1, read_only=False),
    Parameter('stall_timeout_s', 5.0, 'Input that pauses for longer is reported as stalled.', 's',
              0.1, 3600.0, read_only=False),
)


class Stage(Node):
    """A node with pulse blocks as input.

    The subscription's callback validates and queues, one thread works, losses of any kind are
    counted, logged and published on /diagnostics, and `~/progress` tells the counter of the last
    pulse after every finished block.

    Subclasses create what they need in ``__init__``, implement `process`, and may override `idle`
    and `update_counters`. `run` starts them.

    Parameters
    ----------
    input_topic : str
        Relative topic of the blocks.
    parameters : iterable of Parameter
        Those of the subclass, beside the common ones.
    counters, faults : iterable of str
        Diagnostics keys of the subclass; `faults` are also `counters` and mean a warning.

    Attributes
    ----------
    NAME : str
        Name of the node, given by the subclass.
    parameters : ParameterValues
        Current values by name.
    health : Health
        Counters and log.

    Raises
    ------
    ConfigurationError
        A parameter is of the wrong type or out of range.
    """

    NAME: str

    def __init__(self, *, input_topic: str, parameters: Iterable[Parameter] = (),
                 counters: Iterable[str] = (), faults: Iterable[str] = ()):
        super().__init__(self.NAME)
        faults = (*faults, 'blocks_rejected', 'blocks_dropped', 'messages_lost',
                  'qos_incompatible')
        errors = ('errors',)
        self.health = Health(self, counters=(*counters, 'blocks_received', *faults, *errors,
                                             'blocks_waiting'), faults=faults, errors=errors)
        self.parameters = ParameterValues(self, (*parameters, *COMMON_PARAMETERS))
        self._input_topic = input_topic
        self._last_input: float | None = None
        self._stalled = False
        self._worker: Worker | None = None

    def process(self, block: PulseBlock) -> None:
        """Work on a block, in the worker's thread; ValueError means that the block is rejected."""
        raise NotImplementedError(f'{type(self).__name__} must implement process')

    def idle(self) -> None:
        """Work to be done when no block came for `idle_s` seconds, in the worker's thread."""

    def update_counters(self) -> None:
        """Bring the counters up to date before they are published."""

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return ''

    def start(self, *, idle_s: Callable[[], float] | None = None) -> None:
        """Begin to work.

        Parameters
        ----------
        idle_s : callable or None
            Returns the seconds without input after which `idle` is called, once; None for never.
        """
        self._worker = Worker(self._work, capacity=self.parameters['worker_queue_size'],
                              on_error=self._work_failed, on_idle=self.idle if idle_s else None,
                              idle_s=idle_s, name=self.get_name())
        self._progress = self.create_publisher(UInt32, '~/progress', self.stream_qos())
        try:
            self._subscription = self.create_subscription(
                Float32MultiArray, self._input_topic, self._receive, self.stream_qos(),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=self._incompatible_qos, message_lost=self._message_lost,
                    matched=lambda event: self._matched('publisher', self._subscription, event)))
        except _QOS_ERRORS as error:
            raise ConfigurationError(f'QoS override of {self._input_topic}: {error}') from error
        # Diagnostics follow the wall clock: a paused simulation is no reason to fall silent.
        self._timer = self.create_timer(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._worker.start()
        self.health.info(f'ready: {self._subscription.topic_name}{self.summary()}')

    def stream_qos(self) -> QoSProfile:
        """Reliable, keeping the last `queue_depth` messages."""
        return QoSProfile(depth=self.parameters['queue_depth'],
                          reliability=ReliabilityPolicy.RELIABLE)

    def create_output(self, message_type, topic: str, qos: QoSProfile) -> Publisher:
        """Publisher with QoS overrides that reports incompatible subscribers.

        Raises
        ------
        ConfigurationError
            A QoS override makes no sense.
        """
        def matched(event):
            self._matched('subscriber', publisher, event)

        try:
            publisher = self.create_publisher(
                message_type, topic, qos,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                event_callbacks=PublisherEventCallbacks(
                    incompatible_qos=self._incompatible_qos, matched=matched))
        except _QOS_ERRORS as error:
            raise ConfigurationError(f'QoS override of {topic}: {error}') from error
        return publisher

    def report(self, events: Iterable[StreamEvent]) -> None:
        """Log what a stage's plain class has to tell."""
        for event in events:
            if event.kind == 'start':
                self.health.info(event.text)
            else:
                self.health.warning(event.text)

    def destroy_node(self) -> None:
        """Stop the worker, then destroy the node."""
        if self._worker is not None:
            self._worker.stop()
        super().destroy_node()

    def _receive(self, message: Float32MultiArray) -> None:
        self._last_input = time.monotonic()
        self.health.count('blocks_received')
        try:
            block = from_message(message, max_elements=self.parameters['max_message_elements'])
        except WireFormatError as error:
            self._reject(error)
            return
        if not self._worker.put(block):
            self.health.count('blocks_dropped')
            self.health.warning(f'dropped {_pulses(block)}: {self._worker.waiting} blocks wait '
                                'already; the work is slower than the input')

    def _work(self, block: PulseBlock) -> None:
        try:
            self.process(block)
        except ValueError as error:
            self._reject(error, _pulses(block))
        self._progress.publish(UInt32(data=int(block.counter[-1])))

    def _reject(self, error: ValueError, which: str = 'a message') -> None:
        self.health.count('blocks_rejected')
        self.health.warning(f'rejected {which} of {self._subscription.topic_name}: {error}')

    def _work_failed(self, error: Exception) -> None:
        if not self.context.ok():
            return  # publishing fails once Ctrl-C has shut the context down
        self.health.count('errors')
        self.health.error('error while working, the node goes on:\n'
                          + ''.join(traceback.format_exception(error)))

    def _matched(self, who: str, endpoint: Publisher | Subscription, event) -> None:
        if event.current_count_change == 0:
            return  # told already: two changes may arrive as one event
        change = 'joined' if event.current_count_change > 0 else 'left'
        self.health.info(f'{who} on {endpoint.topic_name} {change} ({event.current_count} now)')

    def _incompatible_qos(self, event) -> None:
        self.health.count('qos_incompatible', event.total_count_change)
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        self.health.warning(f'a publisher or subscriber asks for another {policy}: no messages '
                            'flow between it and this node; see the QoS overrides')

    def _message_lost(self, event) -> None:
        self.health.count('messages_lost', event.total_count_change)
        self.health.warning(f'the middleware lost {event.total_count_change} messages of '
                            f'{self._subscription.topic_name}; raise queue_depth at both ends')

    def _publish_diagnostics(self) -> None:
        self.update_counters()
        self.health.set('blocks_waiting', self._worker.waiting)
        problem = ''
        if self._last_input is not None:
            pause = time.monotonic() - self._last_input
            stalled = pause > self.parameters['stall_timeout_s']
            if stalled:
                problem = f'no input for {pause:.0f} s'
            if stalled and not self._stalled:
                self.health.warning(f'input stalled: nothing on {self._subscription.topic_name} '
                                    f'for {pause:.0f} s')
            elif self._stalled and not stalled:
                self.health.info('input goes on')
            self._stalled = stalled
        self.health.publish(problem, 'working' if self._last_input else 'waiting for input')


_QOS_ERRORS = (ParameterException, InvalidQosOverridesError, RuntimeError)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)


def _pulses(block: PulseBlock) -> str:
    return f'pulses {describe_range(int(block.counter[0]), int(block.counter[-1]))}'


def run(node_class: type[Stage], args: list[str] | None = None) -> int:
    """Spin a node until Ctrl-C or shutdown.

    Returns
    -------
    int
        Exit code: 0 after an orderly end, 1 when the configuration is impossible.
    """
    # Without KeyboardInterrupt, which would strike anywhere, the clean-up included: rclpy's own
    # handler, installed by rclpy.init, shuts the context down and so ends the spinning.
    interrupted = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    node = None
    try:
        _init(args)
        if not interrupted.is_set():
            with SingleThreadedExecutor() as executor:
                node = node_class()
                node.start()
                executor.add_node(node)
                executor.spin()
    except ExternalShutdownException:
        pass
    except ConfigurationError as error:
        get_logger(node_class.NAME).fatal(str(error))
        return 1
    except Exception:
        if rclpy.ok():
            raise  # otherwise rclpy complains about the context that Ctrl-C has just shut down
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _init(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args)
    except RuntimeError as error:  # what rclpy makes of ROS arguments that it cannot parse
        raise ConfigurationError(f'ROS arguments: {error}') from error
