# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Managed life cycle of a node: configure, activate, deactivate, clean up; and its main loop."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import Future as Call
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.signals import uninstall_signal_handlers
from rclpy.subscription import Subscription
from rclpy.task import Future

from sar_imaging.configuration.parameters import foreign

from .health import ERRORS, Health
from .parameters import (
    START,
    ConfigurationError,
    Parameter,
    ParameterValues,
    command_line_parameters,
    refused,
)
from .worker import works_aside

RCLError = rclpy_implementation.RCLError
DIAGNOSTICS_PERIOD_S = 1.0
SWITCH_S = 0.0005  # for which the worker waits for Python's lock at most, behind every kernel
KEPT_BYTES = 2**28  # of freed memory, at most
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
QOS_ERRORS = (ParameterException, InvalidQosOverridesError, RuntimeError)

AUTOSTART = Parameter('autostart', True, 'Configure and activate at the start; without it the '
                      'node waits for a life cycle manager.', changes=START)


class ManagedNode(LifecycleNode):
    """A life cycle node whose transitions tell why they are refused.

    Subclasses override `configure`, `activate` and `cleanup`; a `ConfigurationError` in one of the
    first two refuses the transition, with its text in the log, and undoes it. Diagnostics are
    published in every state.

    Parameters
    ----------
    parameters : iterable of Parameter
        What to declare, beside `AUTOSTART`.
    counters, faults : iterable of str
        Diagnostics keys; `faults` are also counters and mean a warning.

    Attributes
    ----------
    NAME : str
        Name of the node, given by the subclass.
    parameters : ParameterValues
        Current values by name.
    health : Health
        Counters and log.
    state : str
        ``unconfigured``, ``inactive``, ``active`` or ``finalized``.
    outputs : list of Publisher
        Publishers to be destroyed when the node is cleaned up.
    activity : contextlib.ExitStack
        How to undo what was begun since the node is active, the latest first; it is closed when
        the node is deactivated, and when its activation fails halfway.
    works_on : bool
        A thread of the node was still at work when the node ended.
    """

    NAME: str

    def __init__(self, *, parameters: Iterable[Parameter], counters: Iterable[str],
                 faults: Iterable[str]):
        super().__init__(self.NAME, parameter_overrides=command_line_parameters(sys.argv))
        faults = (*faults, 'qos_incompatible')
        self.health = Health(self, counters=(*counters, *faults, ERRORS), faults=faults)
        self.parameters = ParameterValues(self, (*parameters, AUTOSTART))
        if misspelt := foreign(self._parameter_overrides.keys() - self.parameters.keys()):
            self.health.warning(self.parameters.unknown(misspelt))
        self.state = 'unconfigured'
        self.outputs: list[Publisher] = []
        self.activity = contextlib.ExitStack()
        self.works_on = False
        # Of their own: a service that waits for the worker must not hold up the input.
        self.service_group = MutuallyExclusiveCallbackGroup()
        # Diagnostics follow the wall clock: a paused simulation is no reason to fall silent.
        self._timer = self.create_timer(
            DIAGNOSTICS_PERIOD_S, self._outlived(self.publish_diagnostics, 'diagnostics'),
            clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._jump = self.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                          on_clock_change=False), post_callback=self._time_jumped)

    # ------------------------------------------------------------------------- for subclasses

    def configure(self) -> None:
        """Make what the parameters describe, outputs included."""

    def activate(self) -> None:
        """Begin to work, and tell `activity` how each thing that was begun is undone."""

    def cleanup(self) -> None:
        """Forget what `configure` made; outputs are destroyed afterwards."""

    def publish_diagnostics(self) -> None:
        """Publish the diagnostics; called once per second in every state."""
        self.health.publish(self.state)

    def create_output(self, message_type: type, topic: str, qos: QoSProfile,
                      joined: Callable[[], None] = lambda: None) -> Publisher:
        """Publisher with QoS overrides that reports incompatible subscribers.

        It is destroyed when the node is cleaned up; `joined` is called when somebody subscribes.

        Raises
        ------
        ConfigurationError
            A QoS override makes no sense.
        """
        def matched(event: Any) -> None:
            self.report_match('subscriber', topic, event)
            if event.current_count_change > 0:
                joined()

        with refused(f'QoS override of {topic}: ', QOS_ERRORS):
            publisher = self.create_publisher(
                message_type, topic, qos,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                event_callbacks=PublisherEventCallbacks(
                    incompatible_qos=functools.partial(self.report_incompatible_qos, topic,
                                                       'publisher'),
                    matched=matched))
        self.outputs.append(publisher)
        return publisher

    def create_input(self, message_type: type, topic: str, callback: Callable[[Any], None],
                     qos: QoSProfile, **events: Callable[[Any], None]) -> Subscription:
        """Subscription with QoS overrides that reports incompatible publishers.

        It is destroyed when the node is deactivated.

        Raises
        ------
        ConfigurationError
            A QoS override makes no sense.
        """
        with refused(f'QoS override of {topic}: ', QOS_ERRORS):
            subscription = self.create_subscription(
                message_type, topic, self._outlived(callback, f'what takes {topic}'), qos,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=functools.partial(self.report_incompatible_qos, topic,
                                                       'subscription'), **events))
        self.activity.callback(self.destroy_subscription, subscription)
        return subscription

    def repeat(self, period_s: float, call: Callable[[], None]) -> None:
        """Call something periodically by the wall clock until the node is deactivated."""
        timer = self.create_timer(period_s, self._outlived(call, 'what the node repeats'),
                                  clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.activity.callback(self.destroy_timer, timer)

    def report_match(self, who: str, topic: str, event: Any) -> None:
        """Log that a publisher or subscriber joined or left."""
        if event.current_count_change == 0:
            return  # told already: two changes may arrive as one event
        change = 'joined' if event.current_count_change > 0 else 'left'
        self.health.info(f'{who} on {self.resolve_topic_name(topic)} {change} '
                         f'({event.current_count} now)')

    def report_incompatible_qos(self, topic: str, side: str, event: Any) -> None:
        """Count and log a publisher or subscriber that cannot be connected.

        Parameters
        ----------
        topic : str
            Topic of this node, as it was created.
        side : str
            ``publisher`` or ``subscription``: what this node is on it.
        event
            What the middleware tells.
        """
        self.health.count('qos_incompatible', event.total_count_change)
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
        name = self.resolve_topic_name(topic)
        other = 'subscriber asks for' if side == 'publisher' else 'publisher offers'
        parameter = f'qos_overrides.{name}.{side}.{policy}'
        self.health.warning(
            f'no messages flow on {name}: a {other} another {policy} than the {side} of this '
            f'node; make both the same, here by the parameter {parameter}')

    async def ended(self, call: Call[Any]) -> Call[Any]:
        """A call in another thread, once it has ended."""
        done = Future()

        def finish(call: Call[Any]) -> None:
            done.set_result(call)
            if self.executor is not None:
                self.executor.wake()

        call.add_done_callback(finish)
        return await done

    def report_error(self, error: BaseException, what: str) -> None:
        """Count and log what should never happen."""
        self.health.count(ERRORS)
        self.health.error(f'{what}:\n' + ''.join(traceback.format_exception(error)))

    def set_parameters_atomically(self, parameter_list: list[RosParameter]
                                  ) -> SetParametersResult:
        """As of every node; the reason says which name the node does not know."""
        if unknown := [p.name for p in parameter_list if not self.has_parameter(p.name)]:
            return SetParametersResult(successful=False, reason=self.parameters.unknown(unknown))
        return super().set_parameters_atomically(parameter_list)

    # ------------------------------------------------------------------------- transitions

    def start(self) -> bool:
        """Configure and activate; False when that was refused, with the reason in the log."""
        success = TransitionCallbackReturn.SUCCESS
        return self.trigger_configure() == success and self.trigger_activate() == success

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Check the parameters and make what they describe."""
        def work() -> None:
            self.health.clear()
            self.parameters.load()
            self.configure()

        return self._transition('configuration', 'inactive', work, undo=self._release)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work."""
        return self._transition('activation', 'active', self.activate, undo=self.activity.close)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the work; what was made at configuration stays."""
        return self._transition('deactivation', 'inactive', self.activity.close)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the configuration."""
        return self._transition('clean-up', 'unconfigured', self._release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the work for good, from any state."""
        return self._transition('shutdown', 'finalized', self._end)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to the state before the configuration after an unexpected failure."""
        return self._transition('recovery', 'unconfigured', self._end)

    def destroy_node(self) -> None:
        """End the work, then destroy the node."""
        self._end()
        # rclpy forgets it. With it the participant of DDS would live on, and leave a name in the
        # graph and 64 MB of shared memory behind where the process does not wait for its threads.
        self._state_machine.destroy_when_not_in_use()
        super().destroy_node()

    def _transition(self, name: str, goal: str, work: Callable[[], None],
                    undo: Callable[[], None] = lambda: None) -> TransitionCallbackReturn:
        try:
            try:
                work()
            except BaseException:
                undo()
                raise
        except ConfigurationError as error:
            self.health.error(f'{name} refused: {error}')
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            if not self.context.ok():
                raise  # Ctrl-C
            self.report_error(error, f'{name} failed')
            return TransitionCallbackReturn.ERROR
        self.state = goal
        self.health.info(f'{name} done: the node is {goal}')
        return TransitionCallbackReturn.SUCCESS

    def _end(self) -> None:
        if self.state == 'active':
            self.activity.close()
            self.state = 'inactive'
        self._release()

    def _release(self) -> None:
        self.cleanup()
        outputs, self.outputs = self.outputs, []
        for publisher in outputs:
            self.destroy_publisher(publisher)
        self.parameters.release()

    def _outlived(self, call: Callable[..., None], what: str) -> Callable[..., None]:
        """A call of the executor whose failure is counted and told; the node lives on."""
        @functools.wraps(call)
        def outlived(*arguments: object) -> None:
            try:
                call(*arguments)
            except Exception as error:
                if not self.context.ok():
                    raise  # Ctrl-C
                self.report_error(error, f'{what} failed')

        return outlived

    def _time_jumped(self, jump: TimeJump) -> None:
        self.health.info(f'time jumped back by {-jump.delta.nanoseconds / 1e9:.3g} s; apertures '
                         'follow the counters and times of the pulses')


def run(node_class: type[ManagedNode], args: list[str] | None = None) -> int:
    """Spin a node until Ctrl-C or shutdown.

    Returns
    -------
    int
        Exit code: 0 after an orderly end, 1 when the configuration is impossible and the node
        was to start by itself.
    """
    # Without KeyboardInterrupt, which would strike anywhere, the clean-up included: rclpy's own
    # handler, installed by rclpy.init, shuts the context down and so ends the spinning.
    sys.setswitchinterval(SWITCH_S)
    keep_freed_memory()
    interrupted = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    node = executor = None
    try:
        with refused('ROS arguments: ', RuntimeError):  # which rclpy cannot parse
            rclpy.init(args=args)
        if not interrupted.is_set():
            executor = SingleThreadedExecutor()  # later, Ctrl-C may have shut its context down
            node = _created(node_class)
            executor.add_node(node)
            if not node.parameters['autostart']:
                node.health.info('autostart is false: the node waits for a life cycle manager, or '
                                 f'for `ros2 lifecycle set {node.get_fully_qualified_name()} '
                                 'configure`')
            elif not node.start():
                return 1 if rclpy.ok() else 0  # Ctrl-C is no failure
            while rclpy.ok() and not interrupted.is_set():
                # Of a signal that comes while rclpy installs its handler Python's alone may know,
                # which is called when this ends: each second, for the diagnostics.
                executor.spin_once()
    except ExternalShutdownException:
        pass
    except ConfigurationError as error:
        return fail(node_class.NAME, error)
    except Exception:
        if rclpy.ok():
            raise  # otherwise rclpy complains about the context that Ctrl-C has just shut down
    finally:
        # It waits for the thread in which rclpy wakes executors at a signal: that thread would
        # touch what is destroyed here, and the process end as a crash does. Another signal would
        # look like one, too.
        uninstall_signal_handlers()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        if executor is not None:
            executor.shutdown(timeout_sec=0.0)  # a service may wait for the worker, in vain
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    if node is not None and (node.works_on or works_aside()):
        os._exit(0)  # the interpreter would wait for that thread
    return 0


def keep_freed_memory() -> None:
    """Keep memory that this process frees for what it needs next, `KEPT_BYTES` at most.

    By default glibc gives what is larger than a few megabytes back to the system, and each page
    costs 0.3 to 3 µs to get again: a subscriber of images of 8 MB, which copies them three times,
    spends more time on pages than on images. Other C libraries are left as they are.
    """
    trim_threshold, mmap_threshold = -1, -3  # numbers of mallopt
    with contextlib.suppress(AttributeError, OSError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(trim_threshold, KEPT_BYTES)
        mallopt(mmap_threshold, 2**25)  # the largest that glibc takes


def _created(node_class: type[ManagedNode]) -> ManagedNode:
    try:
        return node_class()
    except RCLError as error:
        if not rclpy.ok():
            raise  # Ctrl-C has just shut the context down
        raise ConfigurationError(f'the middleware cannot create the node: {error}') from error


def fail(name: str, error: ConfigurationError) -> int:
    """Log why a node cannot start; returns the exit code."""
    get_logger(name).fatal(str(error))
    return 1
