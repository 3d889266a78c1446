# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixes of satellite navigation, and attitudes, on their way to poses and to the datum."""

from __future__ import annotations

import collections
import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, NavSatFix

from msg_conversions.errors import WireFormatError
from msg_conversions.navigation import attitude_from_message, fix_from_message
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.navigation import DatumSearch, Fix, FixPoses, FoundDatum, FramePose
from sar_imaging.geometry.poses import PoseStatus, PoseTrack

from ..runtime.health import Health, Part
from ..runtime.managed import ManagedNode
from ..runtime.parameters import Parameter, check_vector
from .frame_datum import DatumOutput, FrameDatum

FIX_TOPIC, IMU_TOPIC = 'fix', 'imu'
_QUEUE_DEPTH = 10_000
_Numbers = tuple[float, ...]
_MOST_WAITING = 1000  # fixes that wait for poses at their times


PARAMETERS = (
    Parameter('gnss.antenna', [0.0, 0.0, 0.0], "Place of the satellite navigation's antenna in "
              'the body frame of the poses: x, y, z.', 'm', check=check_vector),
    Parameter('gnss.max_std_m', 10.0, 'Fixes that tell a larger horizontal standard deviation '
              'are not used.', 'm', 1e-3, 1e6),
)
HEADING_BASELINE = Parameter(
    'datum.heading_baseline_m', 0.0, "With datum.source fix: the frame's heading is found from "
    'fixes at places at least so far apart; 0.0: it is datum.heading_deg.', 'm', 0.0, 1e5)


class Listener:
    """Subscription to one topic of a sensor; what is not good enough is counted and told of.

    Sensors publish best effort or reliably; best effort hears both.

    Parameters
    ----------
    message_type : type
        Message type of the topic.
    topic : str
        Relative name.
    read : callable
        Content of a message, or raises WireFormatError.
    take : callable
        Called with the content, in the thread of the callbacks.
    health : Health or Part
        Log.

    Attributes
    ----------
    topic : str
        Its full name, once subscribed to.
    n_received, n_rejected : int
        Messages that came, and those of them that were not good.
    """

    def __init__(self, message_type: type, topic: str, read: Callable[[Any], Any],
                 take: Callable[[Any], None], health: Health | Part):
        self._type, self._read, self._take = message_type, read, take
        self._name = self.topic = topic
        self._health, self._refusal = health, ''
        self.n_received = self.n_rejected = 0

    def activate(self, node: ManagedNode) -> None:
        """Subscribe."""
        self.topic = node.create_input(
            self._type, self._name, self._receive,
            QoSProfile(depth=_QUEUE_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)).topic_name

    def _receive(self, message: Any) -> None:
        self.n_received += 1
        try:
            content = self._read(message)
        except WireFormatError as error:
            self.n_rejected += 1
            if str(error) != self._refusal:  # one line for a run of them
                self._refusal = str(error)
                self._health.warning(f'dropped messages of {self.topic}: {error}')
            return
        if self._refusal:
            self._refusal = ''
            self._health.info(f'messages of {self.topic} are good again')
        self._take(content)


def fix_listener(parameters: Mapping[str, Any], take: Callable[[Fix], None],
                 health: Health | Part) -> Listener:
    """Listener to fixes that are good enough."""
    read = functools.partial(fix_from_message, max_std_m=parameters['gnss.max_std_m'])
    return Listener(NavSatFix, FIX_TOPIC, read, take, health)


class FixPoseSource:
    """Poses from fixes, with the attitudes of an inertial sensor or without.

    Parameters
    ----------
    parameters : mapping
        Current values of `pose_input.PARAMETERS`.
    health : Health or Part
        Log.
    datum : FrameDatum
        Datum of the frame. An output that does not know it yet has it put where the first fix is.
    with_attitude : bool
        Whether the topic `imu` tells attitudes.
    take : callable
        Called with time in ns, position and quaternion of each pose.

    Attributes
    ----------
    fixes : Listener
        To the fixes.
    """

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part,
                 datum: FrameDatum, with_attitude: bool,
                 take: Callable[[int, _Numbers, _Numbers], None]):
        self._datum, self._take, self._heading_deg = datum, take, parameters['datum.heading_deg']
        self._poses = FixPoses(
            antenna_m=parameters['gnss.antenna'], with_attitude=with_attitude,
            max_gap_s=parameters['pose.max_gap_s'], jump_m=parameters['pose.jump_m'])
        self.fixes = fix_listener(parameters, self._take_fix, health)
        self._attitudes = (Listener(Imu, IMU_TOPIC, attitude_from_message,
                                    self._take_attitude, health)
                           if with_attitude else None)

    @property
    def topics(self) -> str:
        """Full names of the topics."""
        return ' and '.join(listener.topic for listener in (self.fixes, self._attitudes)
                            if listener is not None)

    @property
    def n_attitudes_unused(self) -> int:
        """Attitudes that were none, or without fixes around them."""
        rejected = 0 if self._attitudes is None else self._attitudes.n_rejected
        return rejected + self._poses.n_unused

    def activate(self, node: ManagedNode) -> None:
        """Subscribe."""
        self.fixes.activate(node)
        if self._attitudes is not None:
            self._attitudes.activate(node)

    def _take_fix(self, fix: Fix) -> None:
        if self._datum.value is None and isinstance(self._datum, DatumOutput):
            self._datum.set(Datum(fix.latitude_deg, fix.longitude_deg, fix.height_m,
                                  self._heading_deg), 'where the first good fix is')
        self._poses.datum = self._datum.value
        self._pass_on(self._poses.add_fix(fix))

    def _take_attitude(self, attitude: tuple[int, _Numbers]) -> None:
        self._pass_on(self._poses.add_attitude(*attitude))

    def _pass_on(self, poses: list[FramePose]) -> None:
        for pose in poses:
            self._take(*pose)


class DatumFinder:
    """Find the datum of the poses' frame from fixes, and again when that frame begins anew.

    Parameters
    ----------
    parameters : mapping
        Current values of `PARAMETERS` and `HEADING_BASELINE`.
    health : Health or Part
        Log.
    output : DatumOutput
        Told of the datum.

    Attributes
    ----------
    n_without_pose : int
        Good fixes at whose times no pose is known.
    """

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part,
                 output: DatumOutput):
        self._health, self._output = health, output
        self._arm_m = np.array(parameters['gnss.antenna'])
        self._search = functools.partial(DatumSearch, parameters['datum.heading_deg'],
                                         parameters[HEADING_BASELINE.name])
        self._current: DatumSearch | None = self._search()
        self._frame: int | None = None
        self._waiting: collections.deque[Fix] = collections.deque(maxlen=_MOST_WAITING)
        self.fixes = fix_listener(parameters, self._waiting.append, health)
        self.n_without_pose = 0

    @property
    def waiting(self) -> int:
        """Fixes that wait to be compared."""
        return len(self._waiting)

    def look(self, track: PoseTrack) -> None:
        """Compare the fixes that came with the poses at their times; in the worker's thread."""
        if len(track) and track.frame != self._frame:
            self._begin(track.frame)
        fixes = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if not fixes:
            return
        poses = track.sample(np.array([fix.stamp_ns for fix in fixes], np.int64))
        places_m = poses.position_m + poses.attitude.apply(self._arm_m)
        for fix, place_m, status, frame in zip(fixes, places_m, poses.status, poses.frame,
                                               strict=True):
            if status == PoseStatus.WAIT:
                self._waiting.append(fix)
            elif status != PoseStatus.READY:
                self.n_without_pose += 1
            elif self._current is not None and frame == self._frame:
                self._compare(fix, place_m)

    def _begin(self, frame: int) -> None:
        known = self._frame is not None and self._current is None
        self._frame, self._current = frame, self._search()
        if known:
            self._health.warning('the frame of the poses began anew: its datum is looked for '
                                 'again, and that of before stays until then')

    def _compare(self, fix: Fix, place_m: np.ndarray) -> None:
        try:
            found = self._current.add(fix.ecef_m, place_m, fix.std_m)
        except ValueError as error:
            self._health.warning(f'no datum: {error}')
            found = None
        if found is None:
            self._output.wait_for(self._current.reason)
            return
        self._current = None
        self._output.set(found.datum, _describe(found))


def _describe(found: FoundDatum) -> str:
    if found.n_fixes == 1:
        return 'from a fix and the pose at its time'
    return (f'from {found.n_fixes} fixes that differ from the poses by {found.residual_m:.3g} m; '
            f'the heading is good to about {found.heading_std_deg:.2g} degrees')
