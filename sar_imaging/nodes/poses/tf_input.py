"""Sample poses and lever arms from tf, where a ROS installation provides it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.time import Time

from ..runtime.parameters import ConfigurationError

if TYPE_CHECKING:
    from ..runtime.managed import ManagedNode

_PERIOD_S = 0.02
_MOST_STEPS = 1000  # at once; after a longer pause the rest is a gap
_STATIC_WAIT_S = 10.0  # for the publisher of a robot's description, which may start later


def import_tf(why: str, instead: str):
    """Module tf2_ros.

    Parameters
    ----------
    why, instead : str
        What asks for tf, and what to set where there is none, for the error.

    Raises
    ------
    ConfigurationError
        It is not installed.
    """
    try:
        import tf2_ros
    except ImportError as error:
        raise ConfigurationError(
            f'{why}, but tf2_ros is not installed: it comes with a ROS installation (package '
            f'tf2_ros_py) and not from PyPI; install it there, or {instead}') from error
    return tf2_ros


def split_frames(names: str) -> list[str]:
    """Names of frames with commas between; none of an empty text.

    Raises
    ------
    ValueError
        A name is empty.
    """
    frames = [name.strip() for name in names.split(',')] if names.strip() else []
    if not all(frames):
        raise ValueError(f'{names!r} has an empty name; expected frames such as '
                         'antenna_1,antenna_2')
    return frames


def read_lever_arms(node: ManagedNode, body: str, frames: Sequence[str]) -> np.ndarray:
    """Origins of antenna frames in the body frame, read once.

    Returns when all are known; antennas that move on the body are taken where they are then.

    Parameters
    ----------
    node : ManagedNode
        Whose context and namespace to listen in. It is being configured: a node of its own
        listens meanwhile.
    body : str
        Frame of the lever arms.
    frames : sequence of str
        One for each phase centre.

    Returns
    -------
    (len(frames), 3) float64
        Metres.

    Raises
    ------
    ConfigurationError
        tf2_ros is not installed, or a transform did not come within ten seconds.
    """
    tf2_ros = import_tf(f'antenna frames {", ".join(frames)} are named',
                        'give the lever arms by antenna.tx and antenna.rx')
    listening = Node(f'{node.get_name()}_tf', namespace=node.get_namespace(),
                     context=node.context, enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(listening)
    try:
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, listening)
        arms: dict[str, tuple] = {}
        end_s = time.monotonic() + _STATIC_WAIT_S
        while missing := [frame for frame in frames if frame not in arms]:
            if time.monotonic() > end_s:
                raise ConfigurationError(
                    f'tf knows no transform from {", ".join(missing)} to {body} after '
                    f'{_STATIC_WAIT_S:g} s; start what publishes it, such as '
                    'robot_state_publisher, or give the lever arms by antenna.tx and antenna.rx')
            executor.spin_once(timeout_sec=_PERIOD_S)
            for frame in missing:
                with contextlib.suppress(tf2_ros.TransformException):
                    p = buffer.lookup_transform(body, frame, Time()).transform.translation
                    arms[frame] = (p.x, p.y, p.z)
        listener.unregister()
    finally:
        executor.shutdown()
        listening.destroy_node()
    return np.array([arms[frame] for frame in frames], float)


class TfSampler:
    """Transforms of tf, sampled evenly up to the latest time at which the whole chain is known.

    Parameters
    ----------
    node : ManagedNode
        Node to listen with.
    frame : str
        Frame of the positions.
    parameters : mapping
        Current values of `PARAMETERS`.
    take : callable
        Called with time in ns, translation and rotation.
    """

    def __init__(self, node: ManagedNode, frame: str, parameters: Mapping[str, object], take):
        tf2_ros = import_tf('pose.source is tf', 'set pose.source to odometry or pose')
        self._frame, self._body = frame, parameters['pose.child_frame_id']
        self._step_ns = round(1e9 / parameters['pose.tf_rate_hz'])
        self._take, self._error = take, tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer(cache_time=Duration(seconds=30))
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._node, self._last_ns = node, None
        self._timer = node.create_timer(_PERIOD_S, self._sample,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self) -> None:
        """Listen no more."""
        self._node.destroy_timer(self._timer)
        self._listener.unregister()

    def _sample(self) -> None:
        try:
            newest = self._lookup(Time())
        except self._error:
            return  # not yet known
        newest_ns = Time.from_msg(newest.header.stamp).nanoseconds
        last_ns, self._last_ns = self._last_ns, newest_ns
        if last_ns is not None and last_ns < newest_ns:
            first_ns = max(last_ns + self._step_ns,
                           newest_ns - _MOST_STEPS * self._step_ns)
            for stamp_ns in range(first_ns, newest_ns, self._step_ns):
                try:
                    self._pass_on(stamp_ns, self._lookup(Time(nanoseconds=stamp_ns)))
                except self._error:
                    continue  # forgotten already
        if last_ns != newest_ns:
            self._pass_on(newest_ns, newest)

    def _lookup(self, moment: Time):
        return self._buffer.lookup_transform(self._frame, self._body, moment)

    def _pass_on(self, stamp_ns: int, found) -> None:
        self._take(stamp_ns, found.transform.translation, found.transform.rotation)
