"""What the nodes have in common: take pulse blocks, work on them in one thread, tell about it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.task import Future
from std_msgs.msg import Float32MultiArray, UInt32
from std_srvs.srv import Trigger

from msg_conversions import WireFormatError
from msg_conversions.pulse_block import from_message
from msg_conversions.wire import DEFAULT_MAX_ELEMENTS
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.sequence import StreamEvent, describe_range

from .health import Rates
from .managed import QOS_ERRORS, ManagedNode
from .parameters import ANY_TIME, ConfigurationError, Parameter
from .worker import Worker

COMMON_PARAMETERS = (
    Parameter('queue_depth', 50, 'Depth of the reliable queues of the middleware for pulse '
              'blocks, in and out; covers the largest burst.', 'messages', 1, 10_000),
    Parameter('worker_queue_size', 50, 'Blocks that may wait for the worker thread; more are '
              'dropped, counted and logged.', 'blocks', 1, 10_000),
    Parameter('max_message_elements', DEFAULT_MAX_ELEMENTS, 'Largest block to accept.', 'floats',
              2, 2**31 - 1, changes=ANY_TIME),
    Parameter('stall_timeout_s', 5.0, 'Input that pauses for longer is reported as stalled.', 's',
              0.1, 3600.0, changes=ANY_TIME),
)


class Stage(ManagedNode):
    """A node with pulse blocks as input.

    While it is active, the subscription's callback validates and queues, and one thread works.
    Losses of any kind are counted, logged and published on /diagnostics, `~/progress` tells the
    counter of the last pulse after every finished block, and `~/reset` drops what is underway.

    Subclasses create what they need in `configure`, implement `process`, and may override `idle`,
    `discard` and `update_counters`. `managed.run` starts them.

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
    IDLE_PARAMETER : str or None
        Parameter with the seconds without input after which `idle` is called, once.
    received_s : float
        When the block in work came, on `time.monotonic`.
    """

    IDLE_PARAMETER: str | None = None

    def __init__(self, *, input_topic: str, parameters: Iterable[Parameter] = (),
                 counters: Iterable[str] = (), faults: Iterable[str] = ()):
        super().__init__(
            parameters=(*parameters, *COMMON_PARAMETERS),
            counters=(*counters, 'blocks_received', 'pulses_discarded', 'blocks_waiting',
                      'queue_fill', *Rates.KEYS),
            faults=(*faults, 'blocks_rejected', 'blocks_dropped', 'messages_lost'))
        self._input_topic = input_topic
        self._rates = Rates()
        self._last_input: float | None = None
        self._stalled = False
        self._worker: Worker | None = None
        self._subscription: Subscription | None = None
        self.received_s = 0.0
        self.create_service(Trigger, '~/reset', self._reset, callback_group=self.service_group)

    # ------------------------------------------------------------------------- for subclasses

    def process(self, block: PulseBlock) -> None:
        """Work on a block, in the worker's thread; ValueError means that the block is rejected."""
        raise NotImplementedError(f'{type(self).__name__} must implement process')

    def idle(self) -> None:
        """Work to be done when no block came for a while, in the worker's thread."""

    def discard(self) -> int:
        """Forget the pulses underway and return their number; the worker is not working."""
        return 0

    def update_counters(self) -> None:
        """Bring the counters up to date before they are published."""

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return ''

    def stream_qos(self) -> QoSProfile:
        """Reliable, keeping the last `queue_depth` messages."""
        return QoSProfile(depth=self.parameters['queue_depth'],
                          reliability=ReliabilityPolicy.RELIABLE)

    def report(self, events: Iterable[StreamEvent]) -> None:
        """Log what a stage's plain class has to tell."""
        for event in events:
            if event.kind == 'start':
                self.health.info(event.text)
            else:
                self.health.warning(event.text)

    def create_trigger(self, name: str, work: Callable[[], tuple[bool, str]]) -> None:
        """Service whose work is done in the worker's thread, after the blocks that wait.

        Parameters
        ----------
        name : str
            Name of the service, of type std_srvs/Trigger.
        work : callable
            Returns success and message of the answer.
        """
        async def answer(request, response):
            response.success, response.message = await self._in_worker(work)
            return response

        self.create_service(Trigger, name, answer, callback_group=self.service_group)

    # ------------------------------------------------------------------------- life cycle

    def configure(self) -> None:
        """Create the outputs; see `ManagedNode.configure`."""
        self._progress = self.create_publisher(UInt32, '~/progress', self.stream_qos())
        self.outputs.append(self._progress)

    def activate(self) -> None:
        """Subscribe and begin to work; see `ManagedNode.activate`."""
        self._last_input, self._stalled = None, False
        idle = self.IDLE_PARAMETER
        self._worker = Worker(
            self._work, capacity=self.parameters['worker_queue_size'],
            on_error=self._work_failed, on_idle=self.idle if idle else None,
            idle_s=(lambda: self.parameters[idle]) if idle else None, name=self.get_name())
        self._worker.start()
        try:
            self._subscription = self.create_subscription(
                Float32MultiArray, self._input_topic, self._receive, self.stream_qos(),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=self.report_incompatible_qos,
                    message_lost=self._message_lost, matched=self._input_matched))
        except QOS_ERRORS as error:
            raise ConfigurationError(f'QoS override of {self._input_topic}: {error}') from error
        self.health.info(f'ready: {self._subscription.topic_name}{self.summary()}')

    def deactivate(self) -> None:
        """Unsubscribe, finish the block in work and drop the rest; see `ManagedNode`."""
        subscription, self._subscription = self._subscription, None
        if subscription is not None:
            self.destroy_subscription(subscription)
        worker, self._worker = self._worker, None
        waiting = worker.stop() if worker is not None else []
        if subscription is not None:  # else the activation was refused
            self._report_discarded('deactivated', waiting, self.discard())

    # ------------------------------------------------------------------------- input and work

    def _receive(self, message: Float32MultiArray) -> None:
        if self._worker is None:
            return  # taken just before the node was deactivated
        now = self._last_input = time.monotonic()
        self.health.count('blocks_received')
        try:
            block = from_message(message, max_elements=self.parameters['max_message_elements'])
        except WireFormatError as error:
            self._reject(error)
            return
        self._rates.add(block.n_pulses, 4 * len(message.data))
        if not self._worker.put((block, now)):
            self.health.count('blocks_dropped')
            self.health.warning(f'dropped {_pulses(block)}: {self._worker.waiting} blocks wait '
                                'already; the work is slower than the input')

    def _work(self, item: tuple[PulseBlock, float]) -> None:
        block, self.received_s = item
        try:
            self.process(block)
        except ValueError as error:
            self._reject(error, _pulses(block))
        self._progress.publish(UInt32(data=int(block.counter[-1])))

    def _reject(self, error: ValueError, which: str = 'a message') -> None:
        self.health.count('blocks_rejected')
        self.health.warning(f'rejected {which} of {self.resolve_topic_name(self._input_topic)}: '
                            f'{error}')

    def _work_failed(self, error: BaseException) -> None:
        if self.context.ok():  # publishing fails once Ctrl-C has shut the context down
            self.report_error(error, 'error while working, the node goes on')

    async def _in_worker(self, work: Callable[[], tuple[bool, str]]) -> tuple[bool, str]:
        if self._worker is None:
            return False, f'the node is {self.state}; activate it first'
        done = Future()

        def finish(call):
            done.set_result(call)
            if self.executor is not None:
                self.executor.wake()

        self._worker.call(work).add_done_callback(finish)
        call = await done
        if call.cancelled():
            return False, 'the node was deactivated meanwhile'
        if call.exception() is not None:
            self._work_failed(call.exception())
            return False, f'{call.exception()}; see the log'
        return call.result()

    async def _reset(self, request, response):
        waiting = self._worker.clear() if self._worker is not None else []
        response.success, response.message = await self._in_worker(
            lambda: (True, self._report_discarded('reset', waiting, self.discard())))
        return response

    def _report_discarded(self, why: str, waiting: list[tuple[PulseBlock, float]],
                          n_underway: int) -> str:
        n_waiting = sum(block.n_pulses for block, _ in waiting)
        self.health.count('pulses_discarded', n_waiting + n_underway)
        text = (f'dropped {n_waiting} pulses that waited and {n_underway} underway'
                if n_waiting + n_underway else 'no pulses were underway')
        self.health.info(f'{why}: {text}')
        return text

    # ------------------------------------------------------------------------- events, diagnostics

    def _input_matched(self, event) -> None:
        if self._subscription is not None:
            self.report_match('publisher', self._subscription, event)

    def _message_lost(self, event) -> None:
        self.health.count('messages_lost', event.total_count_change)
        self.health.warning(f'the middleware lost {event.total_count_change} messages of '
                            f'{self.resolve_topic_name(self._input_topic)}; raise queue_depth at '
                            'both ends')

    def publish_diagnostics(self) -> None:
        """Publish the counters and whether the input stalls; see `ManagedNode`."""
        waiting = self._worker.waiting if self._worker is not None else 0
        self.health.set('blocks_waiting', waiting)
        self.health.set('queue_fill', waiting / self.parameters['worker_queue_size'])
        for key, value in self._rates.take().items():
            self.health.set(key, value)
        if self.state in ('inactive', 'active'):
            self.update_counters()
        if self.state == 'active':
            state = 'working' if self._last_input else 'waiting for input'
            self.health.publish(self._stall(), state)
        else:
            self.health.publish('', self.state)

    def _stall(self) -> str:
        """Text about input that has stalled, empty when it flows or has not begun."""
        if self._last_input is None:
            return ''
        pause = time.monotonic() - self._last_input
        stalled = pause > self.parameters['stall_timeout_s']
        if stalled and not self._stalled:
            self.health.warning('input stalled: nothing on '
                                f'{self.resolve_topic_name(self._input_topic)} for {pause:.0f} s')
        elif self._stalled and not stalled:
            self.health.info('input goes on')
        self._stalled = stalled
        return f'no input for {pause:.0f} s' if stalled else ''


def _pulses(block: PulseBlock) -> str:
    return f'pulses {describe_range(int(block.counter[0]), int(block.counter[-1]))}'
