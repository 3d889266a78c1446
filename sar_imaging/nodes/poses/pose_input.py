# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Receive poses of the platform and lever arms, from topics or tf, for the worker thread."""

from __future__ import annotations

import collections
import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time

from ...configuration.positions import imaging_frame, lever_arms, plain_frame
from ...geometry.alignment import Alignment
from ...geometry.poses import PoseTrack
from ...geometry.poses.track import CAPACITY
from ..runtime.health import Cause, Health, Part
from ..runtime.input_watch import InputWatch
from ..runtime.managed import ManagedNode
from ..runtime.parameters import ConfigurationError, Parameter, one_of, refused
from .fix_input import PARAMETERS as FIX_PARAMETERS, FixPoseSource
from .frame_datum import FrameDatum

_PERIOD_S = 0.02
_Pose = tuple[int, tuple[float, ...], tuple[float, ...]]  # time, position, quaternion
_MOST_STEPS = 1000  # at once; after a longer pause the rest is a gap
_STATIC_WAIT_S = 10.0  # for the publisher of a robot's description, which may start later


def import_tf(why: str, instead: str) -> ModuleType:
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


def check_frames(names: str) -> None:
    """Refuse, by ValueError, a list of frames with commas between that has an empty name."""
    if names.strip() and not all(name.strip() for name in names.split(',')):
        raise ValueError(f'{names!r} has an empty name; expected frames such as '
                         'antenna_1,antenna_2')


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
        arms: dict[str, tuple[float, float, float]] = {}
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

    def __init__(self, node: ManagedNode, frame: str, parameters: Mapping[str, Any],
                 take: Callable[[int, Any, Any], None]) -> None:
        tf2_ros = import_tf('pose.source is tf', 'set pose.source to odometry or pose')
        self._frame, self._body = frame, parameters['pose.child_frame_id']
        self._step_ns = round(1e9 / parameters['pose.tf_rate_hz'])
        self._take, self._error = take, tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer(cache_time=Duration(seconds=30))
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._last_ns = None
        node.activity.callback(self._listener.unregister)
        node.repeat(_PERIOD_S, self._sample)

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

    def _lookup(self, moment: Time) -> TransformStamped:
        return self._buffer.lookup_transform(self._frame, self._body, moment)

    def _pass_on(self, stamp_ns: int, found: TransformStamped) -> None:
        self._take(stamp_ns, found.transform.translation, found.transform.rotation)


BLOCK, ODOMETRY, POSE, TF, FIX, FIX_IMU = SOURCES = ('block', 'odometry', 'pose', 'tf', 'fix',
                                                     'fix_imu')
_QUEUE_DEPTH = 10_000  # poses come in bursts where a machine is busy; each takes 0.7 kB
_CLOCKS_APART_S = 1.0  # more than messages are on their way
_CLOCK_LOOKS = 3  # in a row: who sends a recording's poses all at once is no wrong clock


def _check_arms(values: list[float]) -> None:
    if len(values) % 3:
        raise ValueError(f'{len(values)} numbers; expected x, y, z of one phase centre for all '
                         'channels, or of one for each')


PARAMETERS = (
    Parameter('pose.source', BLOCK, 'Where phase centres come from: the pulse blocks, the topic '
              'odometry, the topic pose, tf, the topic fix (satellite navigation), or the topics '
              'fix and imu.', check=one_of(*SOURCES)),
    Parameter('pose.time_offset_s', 0.0, "Clock of the poses minus the radar's.", 's', -1e10,
              1e10),
    Parameter('pose.range_bias_m', 0.0, 'Measured half path minus geometric one, such as half '
              'the delay of the cables.', 'm', -1e6, 1e6),
    Parameter('pose.max_gap_s', 0.2, 'Longest time between two poses that is interpolated.', 's',
              0.001, 60.0),
    Parameter('pose.wait_s', 1.0, 'Longest wait of pulses for their poses, by the wall clock.',
              's', 0.0, 60.0),
    Parameter('pose.max_waiting_pulses', 16_384, 'Pulses that may wait for their poses.',
              'pulses', 1, 10_000_000),
    Parameter('pose.jump_m', 0.05, 'Departure from the motion so far that no acceleration below '
              '20 m/s^2 explains and that means a jump of the frame.', 'm', 1e-4, 1e4),
    Parameter('pose.frame_id', '', 'Frame of the poses, which must be that of the images; empty '
              'takes frame_id.'),
    Parameter('pose.child_frame_id', 'base_link', 'Body frame to look up in tf.'),
    Parameter('pose.tf_rate_hz', 100.0, 'Rate at which tf is sampled.', 'Hz', 1.0, 10_000.0),
    Parameter('antenna.tx', [0.0, 0.0, 0.0], 'Lever arms: transmit phase centres in the body '
              'frame of the poses, x, y, z for each channel or once for all.', 'm',
              check=_check_arms),
    Parameter('antenna.rx', [0.0, 0.0, 0.0], 'The same of the receive phase centres.', 'm',
              check=_check_arms),
    Parameter('antenna.tx_frames', '', 'Frames of tf whose origins are the transmit phase '
              'centres, with commas between, one for all channels or one for each; they replace '
              'antenna.tx.', check=check_frames),
    Parameter('antenna.rx_frames', '', 'The same of the receive phase centres.',
              check=check_frames),
    Parameter('antenna.offset_s', [0.0], 'When each channel is sent after the stamp of its '
              'pulse, for transmitters that take turns; one stands for all.', 's'),
    *FIX_PARAMETERS,
)

# Those that tell where the platform was, for steps that let no pulses wait.
TRACK_PARAMETERS = tuple(p for p in PARAMETERS if p.name not in (
    'pose.wait_s', 'pose.max_waiting_pulses'))


def alignment_from(parameters: Mapping[str, Any], node: ManagedNode) -> Alignment:
    """Alignment between poses and pulses that the parameters describe.

    Parameters
    ----------
    parameters : mapping
        Current values of `PARAMETERS`.
    node : ManagedNode
        To listen to tf with, where frames of tf are named.

    Raises
    ------
    ConfigurationError
        Frames are named, and tf is not installed or does not know them.
    """
    def arms(name: str) -> ArrayLike:
        places = lever_arms(parameters, name)
        if not isinstance(places[0], str):
            return places
        return read_lever_arms(node, parameters['pose.child_frame_id'], places)

    return Alignment(tx_m=arms('antenna.tx'), rx_m=arms('antenna.rx'),
                     time_offset_s=parameters['pose.time_offset_s'],
                     range_bias_m=parameters['pose.range_bias_m'])


def clock_notice(parameters: Mapping[str, Any]) -> str:
    """That nothing checks the clocks of poses and pulses; empty where autofocus does."""
    with contextlib.suppress(KeyError):  # pulse_buffer alone has no autofocus
        if parameters['autofocus.time_offset']:
            return ''
    return (f'nothing checks pose.time_offset_s={parameters["pose.time_offset_s"]:g}: poses '
            'stamped 0.1 s late displace an image at 2 m/s by 0.2 m, as sharp as before; '
            'autofocus.time_offset of backprojection estimates it')


def track_from(parameters: Mapping[str, Any]) -> PoseTrack:
    """Empty track with the limits of the parameters."""
    return PoseTrack(max_gap_s=parameters['pose.max_gap_s'], jump_m=parameters['pose.jump_m'])


class PoseInput:
    """Subscription to poses; what came waits here until the worker takes it.

    Parameters
    ----------
    parameters : mapping
        Current values of `PARAMETERS`, `pose.source` not being `block`.
    health : Health or Part
        Log.
    datum : FrameDatum or None
        Datum of the imaging frame, for poses from fixes alone.
    on_pose : callable
        Called after every pose, in the thread of the callbacks; without it they wait for `take`.
    lost : str
        What no poses mean.

    Attributes
    ----------
    topic : str
        Where the poses come from, in words.
    n_other_frame : int
        Poses dropped because they were in another frame.
    of_fixes : FixPoseSource or None
        What makes poses of fixes; None where they come otherwise.

    Raises
    ------
    ConfigurationError
        The source is tf, and it is not installed, or the poses are to be in another frame than
        the images.
    """

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part,
                 datum: FrameDatum | None, on_pose: Callable[[], None] = lambda: None,
                 lost: str = 'pulses are dropped meanwhile'):
        self._parameters, self._health, self._on_pose = parameters, health, on_pose
        self._lost = lost
        self._source = parameters['pose.source']
        self._poses: collections.deque[_Pose] = collections.deque(maxlen=CAPACITY)
        with refused('parameter '):
            self._frame = imaging_frame(parameters)
        self._missed = False
        self._told = False  # the frame of the poses
        self._last_s: float | None = None
        self._watch: InputWatch | None = None  # of a topic of poses
        # Stamp of the latest pose and pulse in ns, when it came, and when it was noted.
        self._newest: dict[str, tuple[int, float, float]] = {}
        self._looks_apart = 0
        self._other_frame: str | None = None  # of the latest pose, where it is another one
        self.topic = self._source
        self.n_other_frame = 0
        self.of_fixes = (FixPoseSource(parameters, health, datum, self._source == FIX_IMU,
                                       self._take)
                         if self._source in (FIX, FIX_IMU) else None)
        if self._source == TF:
            import_tf('pose.source is tf', 'set pose.source to odometry or pose')
            self.topic = f'tf {self._frame} <- {parameters["pose.child_frame_id"]}'

    def activate(self, node: ManagedNode) -> None:
        """Subscribe."""
        self._last_s, self._other_frame = time.monotonic(), None
        self._newest.clear()
        node.activity.callback(self._end)
        if self._source == TF:
            TfSampler(node, self._frame, self._parameters, self._take_parts)
            return
        if self.of_fixes is not None:
            self.of_fixes.activate(node)
            self.topic = self.of_fixes.topics
            return
        message_type = {ODOMETRY: Odometry, POSE: PoseStamped}[self._source]
        subscription = node.create_input(
            message_type, self._source, self._receive,
            QoSProfile(depth=_QUEUE_DEPTH, reliability=ReliabilityPolicy.RELIABLE))
        self.topic = subscription.topic_name
        self._watch = InputWatch(
            node, self.topic, f'{message_type.__module__.split(".")[0]}/msg/'
            f'{message_type.__name__}', subscription.qos_profile,
            patience_s=lambda: self._parameters['stall_timeout_s'],
            advice=f'remap {self._source}, or set pose.source', sender='what tells the poses')

    def _end(self) -> None:
        """Forget the poses that wait."""
        self._watch, self._last_s = None, None
        self._poses.clear()
        self._health.forget_causes()

    def take(self) -> list[_Pose]:
        """Time in ns, position in m and quaternion of the poses that came, oldest first."""
        return [self._poses.popleft() for _ in range(len(self._poses))]

    @property
    def waiting(self) -> int:
        """Poses that wait to be taken."""
        return len(self._poses)

    def compare(self, stamp_ns: int, received_s: float) -> None:
        """Note when the latest pulse was sent by its clock, and when it came."""
        self._newest['pulse'] = stamp_ns, received_s, time.monotonic()

    def look(self) -> None:
        """State why no pose is of use: none comes, or their frame or clock is another."""
        if self._last_s is None:
            return
        pause_s, text = time.monotonic() - self._last_s, ''
        found = self._watch.look() if self._watch is not None else None
        if self._other_frame is not None:
            pass  # they do come
        elif found is not None and found[0] is not Cause.STALLED:
            text = found[1].replace('no input', f'no poses on {self.topic}')
        elif pause_s > self._parameters['stall_timeout_s']:
            text = f'no poses on {self.topic} for {pause_s:.0f} s; {self._lost}'
        self._missed = bool(text)
        self._health.cause(Cause.NO_POSES, text)
        self._health.cause(Cause.POSES_IN_OTHER_FRAME, self._explain(self._other_frame))
        self._health.cause(Cause.CLOCKS_APART, self._explain_clocks(self._ahead_s()))

    def _ahead_s(self) -> float:
        """How far the poses are ahead of the pulses, while both come; 0 where that is little."""
        newest, ahead_s = dict(self._newest), 0.0
        now = time.monotonic()
        if len(newest) == 2 and all(now - noted_s < 2.0 for *_, noted_s in newest.values()):
            (pose_ns, pose_s, _), (pulse_ns, pulse_s, _) = newest['pose'], newest['pulse']
            offset_ns = round(1e9 * self._parameters['pose.time_offset_s'])
            ahead_s = 1e-9 * (pose_ns - pulse_ns - offset_ns) - (pose_s - pulse_s)
        behind_s = max(_CLOCKS_APART_S, self._parameters['pose.wait_s'])
        apart = ahead_s > _CLOCKS_APART_S or ahead_s < -behind_s
        self._looks_apart = self._looks_apart + 1 if apart else 0
        return ahead_s if self._looks_apart >= _CLOCK_LOOKS else 0.0

    def _explain_clocks(self, ahead_s: float) -> str:
        """What clocks that differ mean."""
        if not ahead_s:
            return ''
        right_s = self._parameters['pose.time_offset_s'] + ahead_s
        return (f'poses are {abs(ahead_s):.1f} s {"ahead of" if ahead_s > 0 else "behind"} the '
                f'pulses: synchronise the clocks, or set pose.time_offset_s to {right_s:.1f}')

    def _receive(self, message: Odometry | PoseStamped) -> None:
        pose = message.pose.pose if self._source == ODOMETRY else message.pose
        frame = plain_frame(message.header.frame_id)
        if self._watch is not None:
            self._watch.arrived()
        if self._frame != frame:
            self.n_other_frame += 1
            self._other_frame = frame
            if self.n_other_frame == 1:
                self.look()
            return
        if not self._told:
            self._told = True
            self._health.info(f'poses in frame {frame}, as are grid and images')
        stamp = message.header.stamp
        self._take_parts(stamp.sec * 10**9 + stamp.nanosec, pose.position, pose.orientation)

    def _explain(self, frame: str | None) -> str:
        """Why poses of another frame are of no use."""
        if frame is None:
            return ''
        what, advice = ((f'in frame {frame}', f'set frame_id: {frame} in all nodes, with the grid '
                         'in that frame, or ') if frame else ('without header.frame_id', ''))
        return (f'dropped poses of {self.topic} {what}: grid and images are in frame_id='
                f'{self._frame}; {advice}send poses in {self._frame}')

    def _take_parts(self, stamp_ns: int, p: Any, q: Any) -> None:
        self._take(stamp_ns, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w))

    def _take(self, stamp_ns: int, position: tuple[float, ...], quaternion: tuple[float, ...]
              ) -> None:
        self._last_s = now = time.monotonic()
        self._newest['pose'], self._other_frame = (stamp_ns, now, now), None
        if self._missed:
            self._missed = False  # at once: poses may come seldom
            self._health.cause(Cause.NO_POSES, '')
        self._poses.append((stamp_ns, position, quaternion))
        self._on_pose()
