# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Base of the nodes: receive messages, process them in one thread, report.

Steps run one after the other in that thread; each gets the products of the one before. While
a node prepares itself its executor waits, and pulses may come already: that is reported as well.
"""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future as Call, ThreadPoolExecutor
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import NotInitializedException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray, UInt32
from std_srvs.srv import Trigger

from msg_conversions import WireFormatError
from msg_conversions.layout import DEFAULT_MAX_ELEMENTS

from ...backends import DeviceError
from ...compilation import SLOWLY, MissingNumbaError, counted, interruptible
from ...configuration.datum import NONE, SOURCES, configured_datum
from ...signal.pulses.block import CORRUPT
from ...signal.pulses.sequence import describe_counters
from .health import ERRORS, REJECTION, Cause, Rates
from .inlet import Inlet
from .input_watch import CAUSES, InputWatch
from .managed import DIAGNOSTICS_PERIOD_S, ManagedNode, RCLError
from .overload import APERTURES, FAULTS, POLICIES, Load
from .parameters import ANY_TIME, BACKEND, Parameter, one_of, refused
from .step import Chain, Step, stream_qos

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
            self._node.health.count('pulses_before_ready', item.n_pulses)


PATIENCE_S = 3.0  # with a block in work, after Ctrl-C
INPUT_TYPE = 'std_msgs/msg/Float32MultiArray'
COMMON_PARAMETERS = (
    Parameter('pulses_per_aperture', 1024, 'Length of an aperture; the same in all nodes.',
              'pulses', 1, 2**31 - 1),
    Parameter('frame_id', 'map', 'Frame of the phase centres, the grid and the images; the same '
              'in all nodes.'),
    Parameter('datum.source', NONE, 'Where frame_id stands on the Earth: none (nobody knows), '
              'parameters (the following), or fix (pulse_buffer finds it from fixes and tells '
              'the others); this and the following the same in all nodes.',
              check=one_of(*SOURCES)),
    Parameter('datum.latitude_deg', 0.0, "Geodetic latitude of the frame's origin (WGS 84).",
              'degrees', -90.0, 90.0),
    Parameter('datum.longitude_deg', 0.0, 'Its longitude, east positive.', 'degrees', -180.0,
              360.0),
    Parameter('datum.height_m', 0.0, 'Its height above the WGS 84 ellipsoid, not above sea '
              'level.', 'm', -12_000.0, 1e7),
    Parameter('datum.heading_deg', 0.0, "Bearing of the frame's y axis, clockwise from true "
              'north; 0.0 where x is east.', 'degrees', -360.0, 360.0),
    Parameter('queue_depth', 50, 'Depth of the reliable queues of the middleware for pulse '
              'blocks, in and out; covers the largest burst.', 'messages', 1, 10_000),
    Parameter('worker_queue_size', 512, 'Blocks that may wait for the worker thread.', 'blocks',
              1, 10_000),
    Parameter('worker_queue_megabytes', 512.0, 'Memory that the waiting blocks may take.', 'MB',
              0.1, 1e6),
    Parameter('max_age_s', 0.0, 'Apertures whose images would be older are left out, the oldest '
              'first, and counted; 0.0: two apertures, at least 0.3 s.', 's', 0.0, 1e6,
              changes=ANY_TIME),
    Parameter('overload', APERTURES, 'What happens when too many blocks wait: '
              f'{" or ".join(POLICIES)}; counted and logged.', check=one_of(*POLICIES)),
    Parameter('max_message_elements', DEFAULT_MAX_ELEMENTS, 'Largest block to accept.', 'floats',
              2, 2**31 - 1, changes=ANY_TIME),
    Parameter('stall_timeout_s', 5.0, 'Input that pauses for longer is reported as stalled.', 's',
              0.1, 3600.0, changes=ANY_TIME),
)
_STRAYS = ('pulses_missing', 'pulses_late', 'restarts', 'configuration_changes',
           'pulses_conflicting', 'subapertures_late')  # what two publishers cause


class Stage(ManagedNode):
    """A node that takes messages and passes them through one step, or several in a row.

    While it is active, the subscription's callback validates and queues, and one thread works.
    Losses of any kind are counted, logged and published on /diagnostics, `~/progress` tells the
    counter of the last pulse after every finished message, `~/form_image` of nodes that
    form images finishes what is underway, and `~/reset` drops it; a service named by the last step
    writes its latest product to a file. `managed.run` starts a subclass.

    Attributes
    ----------
    NAME : str
        Name of the node.
    INPUT : str
        Relative topic of the input.
    INPUT_QOS : callable
        Quality of service of the input, from the parameters.
    STEPS : tuple of type
        Classes of the steps; their parameters are the node's. With several of them each has a
        part of its own in the diagnostics.
    """

    INPUT: str
    INPUT_QOS = staticmethod(stream_qos)
    STEPS: tuple[type[Step], ...]

    def __init__(self) -> None:
        alone = len(self.STEPS) == 1
        super().__init__(
            parameters=_joined(self.STEPS),
            counters=('blocks_received', 'pulses_discarded', 'blocks_waiting', 'queue_fill',
                      'oldest_seconds', *Rates.KEYS,
                      *(self.STEPS[0].COUNTERS if alone else ())),
            faults=('blocks_rejected', *FAULTS, 'pulses_before_ready', 'messages_lost',
                    *(self.STEPS[0].FAULTS if alone else ())))
        self._healths = {step: self.health if alone else self.health.part(
            step.NAME, counters=step.COUNTERS, faults=step.FAULTS) for step in self.STEPS}
        self._rates = Rates()
        self._watch: InputWatch | None = None
        self._chain: Chain | None = None
        self._worker: Load | None = None
        self.create_service(Trigger, '~/reset', self._reset, callback_group=self.service_group)
        if self.STEPS[-1].FORMS_IMAGES:
            self.create_service(Trigger, '~/form_image', self._form_image,
                                callback_group=self.service_group)
        self._files = ThreadPoolExecutor(1, 'files')  # neither callbacks nor the worker wait
        if self.STEPS[-1].SAVE_SERVICE:  # other services do not wait for a disk
            self.create_service(Trigger, f'~/{self.STEPS[-1].SAVE_SERVICE}', self._save,
                                callback_group=MutuallyExclusiveCallbackGroup())

    def steps(self) -> tuple[type[Step], ...]:
        """Those of `STEPS` that the parameters ask for."""
        return self.STEPS

    # ------------------------------------------------------------------------- life cycle

    def configure(self) -> None:
        """Make the steps and their outputs; see `ManagedNode.configure`."""
        with refused():
            configured_datum(self.parameters)
        if SLOWLY and BACKEND.name in self.parameters:
            self.health.warning(SLOWLY)
        self._progress = self.create_publisher(UInt32, '~/progress', stream_qos(self.parameters))
        self.outputs.append(self._progress)
        steps = self.steps()
        self._inlet = steps[0].INLET(self.parameters['pulses_per_aperture'])
        with (Preparation(self, self.INPUT, self._inlet), interruptible(self.context.ok),
              refused(errors=MissingNumbaError)):
            self._chain = Chain([step.create(self.parameters, self._healths[step])
                                 for step in steps], reject=self._reject)
            for step in self._chain.steps:
                step.create_outputs(self)

    def activate(self) -> None:
        """Subscribe and begin to work; see `ManagedNode.activate`."""
        p = self.parameters
        for step in self._chain.steps:
            step.activate(self)
        self._worker = Load(self._work, self._inlet, p, self.health, self._chain.skip,
                            on_error=self._work_failed, on_idle=self._chain.idle,
                            idle_s=self._chain.idle_s, name=self.get_name())
        self._worker.start()
        self.activity.callback(self._end_work)
        subscription = self.create_input(
            Float32MultiArray, self.INPUT, self._receive, self.INPUT_QOS(p),
            message_lost=self._message_lost,
            matched=functools.partial(self.report_match, 'publisher', self.INPUT))
        self._watch = InputWatch(
            self, subscription.topic_name, INPUT_TYPE, subscription.qos_profile,
            patience_s=lambda: p['stall_timeout_s'], advice='docs/wire_format.md',
            sender='its sender', strays=self._count_strays)
        settings = ''.join(step.summary() for step in self._chain.steps)
        self.health.info(f'ready: {subscription.topic_name}{settings}')

    def _end_work(self) -> None:
        """Finish the block in work and drop the rest."""
        worker, self._worker = self._worker, None
        # After Ctrl-C nobody receives what the work gives, and launch kills who takes 10 s.
        waiting = worker.stop(None if self.context.ok() else PATIENCE_S)
        if worker.working:
            self.works_on = True
            self.activity.pop_all()  # what the steps have begun serves them still
            return
        self._watch = None
        self.health.forget_causes()
        if self.state == 'active':  # else the activation was refused
            self._report_discarded('deactivated', waiting, self._chain.discard())

    def cleanup(self) -> None:
        """Finish the file in work and forget the steps; see `ManagedNode.cleanup`."""
        self._files.shutdown()
        self._files, self._chain = ThreadPoolExecutor(1, 'files'), None

    def in_worker(self, work: Callable[[], None]) -> None:
        """Have something done in the worker's thread, soon; for the steps' callbacks."""
        if self._worker is not None:
            self._worker.call(work).add_done_callback(self._called)

    def wake(self) -> None:
        """Have the steps' `collect` called soon; for their callbacks."""
        if self._chain is not None:
            self.in_worker(self._chain.collect)

    # ------------------------------------------------------------------------- input and work

    def _receive(self, message: Float32MultiArray) -> None:
        if self._worker is None:
            return  # taken just before the node was deactivated
        self._watch.arrived()
        self.health.count('blocks_received')
        try:
            item, corrupt = self._inlet.sound(self._inlet.read(
                message, max_elements=self.parameters['max_message_elements']))
        except WireFormatError as error:
            self._reject('a message', error)
            return
        if corrupt:
            self._healths[self.STEPS[0]].count('pulses_corrupt', len(corrupt))
            self.health.warning(f'{CORRUPT}: {describe_counters(corrupt)}')
            if not item.n_pulses:
                return
        self._rates.add(item.n_pulses, 4 * len(message.data))
        self._worker.offer(item, time.monotonic())
        if self._worker.look():  # not a second later
            self.publish_diagnostics()

    def _work(self, item: Any, kept: Any, received_s: float) -> None:
        if kept is not None:
            self._chain.steps[0].work(kept, received_s)
        self._progress.publish(UInt32(data=self._inlet.counters(item)[1]))

    def _reject(self, which: str, error: Exception) -> None:
        self.health.count('blocks_rejected')
        self.health.tell(REJECTION, str(error))
        self.health.warning(f'rejected {which} of {self.resolve_topic_name(self.INPUT)}: {error}')

    def _called(self, future: Call[Any]) -> None:
        if not future.cancelled() and future.exception() is not None:
            self._work_failed(future.exception())

    def _work_failed(self, error: BaseException) -> None:
        if not self.context.ok():  # publishing fails once Ctrl-C has shut the context down
            return
        if isinstance(error, DeviceError):
            self.health.count(ERRORS)
            self.health.error(f'{error}; the node continues')
        else:
            self.report_error(error, 'error while working, the node continues')

    # ------------------------------------------------------------------------- services

    async def _in_worker(self, work: Callable[[], tuple[bool, Any]]) -> tuple[bool, Any]:
        if self._worker is None:
            return False, f'the node is {self.state}; activate it first'
        call = await self.ended(self._worker.call(work))
        if call.cancelled():
            return False, 'the node was deactivated meanwhile'
        if call.exception() is not None:
            self._work_failed(call.exception())
            return False, f'{call.exception()}; see the log'
        return call.result()

    async def _save(self, request: Trigger.Request, response: Trigger.Response
                    ) -> Trigger.Response:
        def prepare() -> tuple[bool, Any]:
            try:
                return True, self._chain.steps[-1].saving()
            except ValueError as error:
                return False, str(error)

        response.success, found = await self._in_worker(prepare)
        if not response.success:
            response.message = found
            return response
        call = await self.ended(self._files.submit(found))
        error = call.exception()
        response.success = error is None
        response.message = call.result() if error is None else str(error)
        if error is None:
            self.health.info(response.message)
        elif isinstance(error, ImportError | MemoryError | OSError | ValueError):
            self.health.warning(f'nothing was saved: {error}')
        else:
            self._work_failed(error)
        return response

    async def _form_image(self, request: Trigger.Request, response: Trigger.Response
                          ) -> Trigger.Response:
        response.success, response.message = await self._in_worker(
            lambda: self._chain.form_image())
        return response

    async def _reset(self, request: Trigger.Request, response: Trigger.Response
                     ) -> Trigger.Response:
        waiting = self._worker.clear() if self._worker is not None else []
        response.success, response.message = await self._in_worker(
            lambda: (True, self._report_discarded('reset', waiting, self._chain.discard())))
        return response

    def _report_discarded(self, why: str, waiting: list[tuple[Any, float]],
                          n_underway: int) -> str:
        n_waiting = sum(item.n_pulses for item, _ in waiting)
        self.health.count('pulses_discarded', n_waiting + n_underway)
        text = (f'dropped {n_waiting} pulses that waited and {n_underway} underway'
                if n_waiting + n_underway else 'no pulses were underway')
        self.health.info(f'{why}: {text}')
        return text

    # ------------------------------------------------------------------------- events, diagnostics

    def _message_lost(self, event: Any) -> None:
        self.health.count('messages_lost', event.total_count_change)
        self.health.warning(f'the middleware lost {event.total_count_change} messages of '
                            f'{self.resolve_topic_name(self.INPUT)}; raise queue_depth at '
                            'both ends')

    def _count_strays(self) -> int:
        tally = self._healths[self.STEPS[0]]
        return sum(tally.get(key) for key in _STRAYS)

    def publish_diagnostics(self) -> None:
        """Publish the counters and whether the input stalls; see `ManagedNode`."""
        worker = self._worker
        self.health.set('blocks_waiting', worker.waiting if worker is not None else 0)
        self.health.set('queue_fill', worker.fill if worker is not None else 0.0)
        for key, value in self._rates.take().items():
            self.health.set(key, value)
        if self.state in ('inactive', 'active'):
            for step in self._chain.steps:
                step.update_counters()
        state = self.state
        if worker is not None and self._watch is not None:
            self.health.causes_of(CAUSES, self._watch.look())
            worker.look()
            state = self._watch.state
        self.health.publish(state)


def _joined(steps: tuple[type[Step], ...]) -> tuple[Parameter, ...]:
    """Parameters of the steps and those common to all nodes, each once."""
    table = {p.name: p for step in steps for p in step.PARAMETERS}
    return (*(table | {p.name: p for p in COMMON_PARAMETERS}).values(),)
