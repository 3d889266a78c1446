# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node localization: where the robot is in a reference map, from its images and its odometry."""

from __future__ import annotations

import collections
import dataclasses
import math
import sys
import threading
import time
from concurrent.futures import Future as Call
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import MapMetaData
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image as ImageMessage
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from msg_conversions.errors import WireFormatError
from msg_conversions.images import (
    amplitude_from_message,
    complex_from_message,
    map_metadata_from_message,
)
from msg_conversions.planar_poses import pose_to_message, transform_to_message
from sar_imaging.configuration.positions import imaging_frame, plain_frame
from sar_imaging.exploitation.localization import (
    COMMON_PULSES,
    KINDS,
    NO_ODOMETRY,
    ODOMETRY_BROKEN,
    OTHER_IMAGE,
    Estimate,
    Guess,
    Localizer,
    OdometryTrack,
    Refusal,
)
from sar_imaging.exploitation.map_update import GrowingMap
from sar_imaging.formats.reference_map import (
    MAP_FILES,
    Pass,
    ReferenceMap,
    complex_file,
    read_reference_map,
    write_reference_map,
)
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image, Report

from .poses.pose_input import (
    ODOMETRY,
    PARAMETERS as POSE_PARAMETERS,
    POSE,
    TF,
    PoseInput,
    import_tf,
)
from .runtime.block_output import PRODUCT_QOS
from .runtime.health import REJECTION, Cause
from .runtime.input_watch import CAUSES, InputWatch
from .runtime.managed import ManagedNode, run
from .runtime.parameters import ConfigurationError, Parameter, one_of
from .runtime.stage import COMMON_PARAMETERS
from .runtime.worker import Worker

PARAMETERS = (
    Parameter('map.folder', '', 'Folder of the reference map, as sar-imaging map writes it; read '
              'anew when it changes.'),
    Parameter('map.frame_id', 'map', 'Name of the frame of that map.'),
    Parameter('map.update', False, 'Add images to the map in memory where they are found; the '
              'service save_map writes it.'),
    Parameter('carrier_hz', 0.0, 'Carrier frequency of the images, to be compared with that of '
              'the map; 0.0 where it is not known.', 'Hz', 0.0, 1e13),
    Parameter('aperture_s', 1.0, 'Longest time from the first pulse of an image to its last: '
              'images nearer to each other may have pulses in common.', 's', 1e-3, 3600.0),
    Parameter('search_m', 30.0, 'Farthest that an image is looked for from where it is expected, '
              'along x and y.', 'm', 0.1, 1e4),
    Parameter('search_deg', 5.0, 'Greatest rotation from the expected heading.', 'degrees', 0.1,
              30.0),
    Parameter('most_false', 5e-4, 'Greatest probability of a false match that is accepted.', '',
              1e-12, 0.1),
    Parameter('height_std_m', 2.0, 'Root mean square of the heights over the plane of the images, '
              'such as of walls and trees.', 'm', 0.0, 1e3),
    Parameter('drift', 0.02, 'Standard deviation of the odometry, as a share of the path.', '',
              0.0, 1.0),
    Parameter('drift_deg_per_m', 0.01, 'Standard deviation of its heading.', 'degrees/m', 0.0,
              10.0),
    Parameter('start.x', 0.0, 'Where the origin of frame_id lies in the map before any estimate, '
              'x.', 'm', -1e8, 1e8),
    Parameter('start.y', 0.0, 'The same, y.', 'm', -1e8, 1e8),
    Parameter('start.heading_deg', 0.0, 'Direction of the x axis of frame_id in the map, '
              'counter-clockwise from x.', 'degrees', -360.0, 360.0),
    Parameter('start.std_m', 0.0, 'Standard deviation of where the robot is by that; 0.0 where '
              'two images have to agree first.', 'm', 0.0, 1e4),
    Parameter('start.std_deg', 0.0, 'Standard deviation of its heading; 0.0 likewise.', 'degrees',
              0.0, 180.0),
    Parameter('publish_tf', False, 'Publish the transform from map.frame_id to frame_id; false '
              'where a filter does.'),
    Parameter('image_timeout_s', 60.0, 'Images that pause for longer are reported.', 's', 0.1,
              1e5),
    Parameter('pose.source', ODOMETRY, 'Where poses in frame_id come from: the topic odometry, '
              'the topic pose, or tf.', check=one_of(ODOMETRY, POSE, TF)),
    *(p for p in POSE_PARAMETERS if p.name in (
        'pose.time_offset_s', 'pose.max_gap_s', 'pose.wait_s', 'pose.jump_m', 'pose.frame_id',
        'pose.child_frame_id', 'pose.tf_rate_hz')),
    *(p for p in COMMON_PARAMETERS if p.name in ('frame_id', 'stall_timeout_s')),
)
NO_MAP = 'no_map'  # kind of refusal, beside those of the localizer
REFUSAL = 'last_refusal'
FAULTS = ('images_rejected', 'images_in_other_frame', 'images_dropped', 'poses_in_other_frame',
          'odometry_restarts', *(f'refused_{kind}' for kind in (
              NO_MAP, OTHER_IMAGE, NO_ODOMETRY, ODOMETRY_BROKEN)))
COUNTERS = ('images_received', 'images_waiting', 'poses_published', 'jumps_accepted',
            *(f'refused_{kind}' for kind in KINDS if f'refused_{kind}' not in FAULTS),
            'images_added', 'images_unsaved', 'last_std_m', 'last_std_deg',
            'last_search_seconds', 'poses_by_speckle', 'last_coherence')
_MOST_WAITING = 4  # images; more would be old when their turn comes
_GRIDS = 50  # that are remembered, of images that come late
_SETTLE_S = 0.1  # until what was sent before an image on another topic has come
_PERIOD_S = 0.02  # of looks for poses
_TF_PERIOD_S, _TF_AHEAD_S = 0.05, 0.1  # a transform serves until the next one
_METADATA_QOS = QoSProfile(depth=_GRIDS, reliability=ReliabilityPolicy.RELIABLE,
                           durability=DurabilityPolicy.TRANSIENT_LOCAL)


class MapFolder:
    """The reference map in a folder, read whenever its files change.

    Parameters
    ----------
    folder : path
        May be missing.

    Attributes
    ----------
    problem : str
        Why it could not be read the last time; empty where it could.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._seen: list[tuple[int, int, int] | None] | None = None
        self.problem = ''

    def look(self) -> ReferenceMap | None:
        """The map, if its files have changed and can be read."""
        seen = self._stamps()
        if seen == self._seen:
            return None
        self._seen, self.problem = seen, ''
        try:
            return read_reference_map(self._folder)
        except (OSError, ValueError, MemoryError) as error:
            self.problem = str(error)
            return None

    def write(self, reference: ReferenceMap) -> list[str]:
        """Write a map into the folder, which is not read for that; names of the files."""
        names = write_reference_map(self._folder, reference)
        self._seen = self._stamps()
        return names

    def _stamps(self) -> list[tuple[int, int, int] | None]:
        parts = sorted(path.name for path in self._folder.glob(complex_file('*')))
        return [self._stamp(name) for name in (*MAP_FILES, *parts)]

    def _stamp(self, name: str) -> tuple[int, int, int] | None:
        try:
            told = (self._folder / name).stat()
        except (OSError, ValueError):
            return None
        return told.st_mtime_ns, told.st_ino, told.st_size


class LocalizationNode(ManagedNode):
    """Publishes poses in the map from what comes on `image` and `odometry`."""

    NAME = 'localization'

    def __init__(self) -> None:
        super().__init__(parameters=PARAMETERS, counters=COUNTERS, faults=FAULTS)
        self._worker: Worker | None = None
        self._watch: InputWatch | None = None
        self._localizer: Localizer | None = None
        self._reference: ReferenceMap | None = None
        self._growing: GrowingMap | None = None
        self._added_ns = self._n_unsaved = 0  # latest image that was added, and how many
        self._shown = None  # place of the frame of the odometry that tf is told
        self._ending = threading.Event()
        self.create_service(Trigger, '~/reset', self._reset, callback_group=self.service_group)
        self.create_service(Trigger, '~/save_map', self._save_map,  # others do not wait for a disk
                            callback_group=MutuallyExclusiveCallbackGroup())

    # ------------------------------------------------------------------------- life cycle

    def configure(self) -> None:
        """Read the map, make the outputs; see `ManagedNode`."""
        p = self.parameters
        if not p['map.folder']:
            raise ConfigurationError('parameter map.folder is empty; name a folder that '
                                     'sar-imaging map wrote')
        self._frame = imaging_frame(p)
        if p['publish_tf'] and self._frame == p['map.frame_id']:
            raise ConfigurationError(f'publish_tf: map.frame_id and frame_id are both '
                                     f'{self._frame}; set frame_id to the frame of the odometry')
        self._poses = PoseInput(p, self.health, None, lost='images are refused meanwhile')
        self._output = self.create_output(PoseWithCovarianceStamped, 'map_pose', PRODUCT_QOS)
        self._broadcaster = None
        if p['publish_tf']:
            tf2_ros = import_tf('publish_tf is true', 'set it to false')
            self._broadcaster = tf2_ros.TransformBroadcaster(self)
            self.outputs.append(self._broadcaster.pub_tf)
        self._map = MapFolder(Path(p['map.folder']))
        self._look_for_map()

    def activate(self) -> None:
        """Subscribe and begin to work; see `ManagedNode`."""
        p = self.parameters
        self._track = OdometryTrack(max_gap_s=p['pose.max_gap_s'], jump_m=p['pose.jump_m'])
        self._odometry_frame, self._n_other_frame = 0, self._poses.n_other_frame
        self._grids: collections.deque[tuple[int, MapGrid]] = collections.deque(maxlen=_GRIDS)
        if self._localizer is not None:
            self._localizer.restart()  # who knows where the robot was brought meanwhile
        self._ending.clear()
        self._worker = Worker(self._work, capacity=_MOST_WAITING, on_error=self._work_failed,
                              name=self.get_name())
        self._worker.start()
        self.activity.callback(self._end_work)
        self._poses.activate(self)
        self.create_input(MapMetaData, 'map_metadata', self._take_metadata, _METADATA_QOS)
        images = self.create_input(ImageMessage, 'image', self._receive, PRODUCT_QOS)
        self._watch = InputWatch(
            self, images.topic_name, 'sensor_msgs/msg/Image', images.qos_profile,
            patience_s=lambda: p['image_timeout_s'], advice='remap image',
            sender='what forms the images')
        if self._broadcaster is not None:
            self.repeat(_TF_PERIOD_S, self._send_transform)
        self.health.info(f'ready: {images.topic_name} in frame {self._frame}, '
                         f'{self._poses.topic} -> {self._output.topic_name} in frame '
                         f'{p["map.frame_id"]}')

    def _end_work(self) -> None:
        """Finish the image in work and drop the rest."""
        self._ending.set()
        worker, self._worker = self._worker, None
        waiting = worker.stop()
        self._watch = self._shown = None
        self.health.forget_causes()
        if waiting:
            self.health.count('images_dropped', len(waiting))

    def cleanup(self) -> None:
        """Forget the map; see `ManagedNode`."""
        self._forget_map()
        self._localizer = None

    # ------------------------------------------------------------------------- callbacks

    def _take_metadata(self, message: MapMetaData) -> None:
        try:
            grid = map_metadata_from_message(message)
        except WireFormatError as error:
            self._reject(f'map metadata: {error}')
            return
        self._grids.append((_stamp_ns(message.map_load_time), grid))

    def _receive(self, message: ImageMessage) -> None:
        worker = self._worker
        if worker is None:
            return  # taken just before the node was deactivated
        self._watch.arrived()
        self.health.count('images_received')
        frame = plain_frame(message.header.frame_id)
        self.health.cause(Cause.IMAGES_IN_OTHER_FRAME, '' if frame == self._frame else (
            f'images are in frame {frame!r}; expected frame_id={self._frame}, that of the '
            'odometry that they are formed with'))
        if frame != self._frame:
            self.health.count('images_in_other_frame')
            return
        item = message, time.monotonic()
        if not worker.put(item):
            self.health.count('images_dropped', len(worker.clear()))
            worker.put(item)

    def _reset(self, request: Trigger.Request, response: Trigger.Response
               ) -> Trigger.Response:
        def forget() -> None:
            if self._localizer is not None:
                self._localizer.restart()
            self._shown = None

        if self._worker is None:
            response.success, response.message = False, f'the node is {self.state}'
        else:
            self._worker.call(forget)
            response.success, response.message = True, 'the estimates are forgotten'
        return response

    async def _save_map(self, request: Trigger.Request, response: Trigger.Response
                        ) -> Trigger.Response:
        if self._worker is None:
            response.success, response.message = False, f'the node is {self.state}'
            return response
        call = await self.ended(self._worker.call(self._saved))
        error = None if call.cancelled() else call.exception()
        response.success = not call.cancelled() and error is None
        if response.success:
            response.message = call.result()
            self.health.info(response.message)
        else:
            response.message = str(error or 'the node was deactivated meanwhile')
            self.health.warning(f'no map was saved: {response.message}')
            if not isinstance(error, ImportError | OSError | ValueError | None):
                self._work_failed(error)
        return response

    def _send_transform(self) -> None:
        place = self._shown
        if place is None:
            return
        stamp = self.get_clock().now() + Duration(seconds=_TF_AHEAD_S)
        self._broadcaster.sendTransform(transform_to_message(place, Header(
            stamp=stamp.to_msg(), frame_id=self.parameters['map.frame_id']), self._frame))

    # ------------------------------------------------------------------------- worker

    def _work(self, item: tuple[ImageMessage, float]) -> None:
        message, received_s = item
        stamp_ns = _stamp_ns(message.header.stamp) + round(
            1e9 * self.parameters['pose.time_offset_s'])
        guess = self._guess(stamp_ns, received_s)
        if guess is None:
            return  # the node is deactivated
        started_s = time.perf_counter()
        try:
            answer = guess if isinstance(guess, Refusal) else self._located(message, guess)
        except WireFormatError as error:
            self._reject(f'an image: {error}')
            return
        self.health.set('last_search_seconds', time.perf_counter() - started_s)
        if isinstance(answer, Refusal):
            self.health.count(f'refused_{answer.kind}')
            self.health.tell(REFUSAL, answer.text)
            if answer.kind != COMMON_PULSES:  # which may be most of them
                self.health.info(f'no pose of the image of {stamp_ns * 1e-9:.6f} s: '
                                 f'{answer.text}')
            return
        self._publish(answer, stamp_ns)

    def _guess(self, stamp_ns: int, received_s: float) -> Guess | Refusal | None:
        """What the odometry tells, as soon as it does; None where the node ends."""
        aperture_ns = round(1e9 * self.parameters['aperture_s'])
        while True:
            self._take_poses()
            waited_s = time.monotonic() - received_s
            guess = self._track.guess(stamp_ns, aperture_ns,
                                      final=waited_s > self.parameters['pose.wait_s'])
            if guess is not None and waited_s > _SETTLE_S:
                return guess
            if self._ending.wait(_PERIOD_S):
                return None

    def _take_poses(self) -> None:
        for pose in self._poses.take():
            self._track.add(*pose)
        other = self._poses.n_other_frame
        self.health.count('poses_in_other_frame', other - self._n_other_frame)
        self._n_other_frame = other
        if self._track.frame != self._odometry_frame:
            self._odometry_frame, self._shown = self._track.frame, None
            self.health.count('odometry_restarts')
            self.health.warning('the odometry jumped or began anew: two images have to agree '
                                'about the place')

    def _located(self, message: ImageMessage, guess: Guess) -> Estimate | Refusal:
        localizer = self._localizer
        if localizer is None:
            return Refusal(NO_MAP, f'no reference map: {self._map.problem}')
        read = complex_from_message if message.encoding == '32FC2' else amplitude_from_message
        samples = read(message)
        grid = self._grid_of(_stamp_ns(message.header.stamp))
        if grid is None or grid.shape != samples.shape:
            raise WireFormatError(
                f'it has {samples.shape[0]} x {samples.shape[1]} pixels, '
                + ('and no map_metadata tell where' if grid is None else
                   f'map_metadata tell of {grid.shape[0]} x {grid.shape[1]}')
                + '; remap map_metadata to that of the images')
        carrier_hz = self.parameters['carrier_hz'] or localizer.reference.carrier_hz
        image = Image(samples, grid, carrier_hz, Report('received', '', 0.0))
        answer = localizer.locate(image, guess)
        if self._growing is not None and isinstance(answer, Estimate):
            self._add(image, answer)
        return answer

    def _grid_of(self, stamp_ns: int) -> MapGrid | None:
        """The latest grid that was told for a time, or the latest at all."""
        grids = list(self._grids)
        told = [grid for since_ns, grid in grids if since_ns <= stamp_ns] or [g for _, g in grids]
        return told[-1] if told else None

    def _publish(self, estimate: Estimate, stamp_ns: int) -> None:
        header = Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9),
                        frame_id=self.parameters['map.frame_id'])
        self._output.publish(pose_to_message(
            estimate.position_m, estimate.attitude(self._track.attitude(stamp_ns)),
            estimate.covariance, header))
        self._shown = estimate.map_to_odometry
        self.health.count('poses_published')
        self.health.count('jumps_accepted', int(estimate.jumped))
        coherence = estimate.registration.coherence
        self.health.count('poses_by_speckle', int(coherence is not None))
        self.health.set('last_coherence', coherence or 0.0)
        self.health.set('last_std_m', estimate.std_m)
        self.health.set('last_std_deg', estimate.std_deg)
        self.health.info(str(estimate))

    def _add(self, image: Image, estimate: Estimate) -> None:
        """Add an image to the map, where it is sure enough."""
        reason = self._growing.add(image, estimate)
        if reason:
            self.health.info(f'the image is not added to the map: {reason}')
            return
        self._localizer.looks = tuple(self._growing.looks)
        self._added_ns = estimate.guess.last_ns
        self.health.count('images_added')
        self._set_unsaved(self._n_unsaved + 1)

    def _set_unsaved(self, n: int) -> None:
        self._n_unsaved = n
        self.health.set('images_unsaved', n)

    def _saved(self) -> str:
        """Write the map with what was added; says so."""
        if self._growing is None or self._reference is None:
            raise ValueError('map.update is false, or no map was read yet')
        known = self._reference.passes
        more = [Pass(self.NAME, look, self._added_ns)
                for look in self._growing.looks[len(known):]]
        names = self._map.write(dataclasses.replace(self._reference, passes=(*known, *more)))
        n = self._n_unsaved
        self._set_unsaved(0)
        return f'{n} images more: wrote {", ".join(names)} in {self.parameters["map.folder"]}'

    def _forget_map(self) -> None:
        """Let go of the map, and of what was added to it."""
        if self._n_unsaved:
            self.health.warning(f'{self._n_unsaved} images that were added to the map are lost: '
                                'save_map had not been called')
        self._growing = None
        self._set_unsaved(0)

    def _reject(self, text: str) -> None:
        self.health.count('images_rejected')
        self.health.tell(REJECTION, text)
        self.health.warning(f'rejected {text}')

    def _work_failed(self, error: BaseException) -> None:
        if self.context.ok():  # publishing fails once Ctrl-C has shut the context down
            self.report_error(error, 'error while working, the node continues')

    # ------------------------------------------------------------------------- map, diagnostics

    def _look_for_map(self) -> None:
        """Read the map where it has come or changed."""
        before, reference = self._map.problem, self._map.look()
        if reference is not None:
            self._forget_map()
            self._localizer, self._reference = self._of(reference), reference
            if self.parameters['map.update']:
                self._growing = GrowingMap(reference.image, reference.seen, reference.resolution_m,
                                           self._localizer.looks)
            grid, n_complex = reference.image.grid, len(reference.speckle)
            self.health.info(f'map of {grid.n_x} x {grid.n_y} pixels of {grid.spacing_m:g} m from '
                             f'{len(reference.passes)} passes' + (
                                 f', {n_complex} of them complex: complex images share their '
                                 'speckle, remap image to image_complex' if n_complex else ''))
        problem = self._map.problem
        self.health.cause(Cause.NO_MAP, '' if self._localizer is not None else
                          f'no reference map, images are refused: {problem}')
        if problem and problem != before and self._localizer is not None:
            self.health.warning(f'the map that was read serves on: {problem}')

    def _of(self, reference: ReferenceMap) -> Localizer:
        p = self.parameters
        start = (p['start.x'], p['start.y'], math.radians(p['start.heading_deg']))
        std = [p[name] or math.inf for name in ('start.std_m', 'start.std_deg')]
        if self._localizer is not None:  # of another map of the same frame
            start, std = self._localizer.map_to_odometry, [math.inf, math.inf]
        return Localizer(
            reference.image, [one.look for one in reference.passes], speckle=reference.speckle,
            resolution_m=reference.resolution_m, map_to_odometry=start, std_m=std[0],
            std_deg=std[1], **{name: p[name] for name in (
                'search_m', 'search_deg', 'height_std_m', 'drift', 'drift_deg_per_m',
                'most_false')})

    def _look_around(self) -> None:
        """What the worker looks at beside images."""
        self._take_poses()
        self._look_for_map()

    def publish_diagnostics(self) -> None:
        """Publish the counters, and why nothing comes; see `ManagedNode`."""
        state, worker, watch = self.state, self._worker, self._watch
        if worker is not None and watch is not None:
            self.health.set('images_waiting', worker.waiting)
            self.health.causes_of(CAUSES, watch.look())
            self._poses.look()
            worker.call(self._look_around).add_done_callback(self._called)
            state = watch.state
        self.health.publish(state)

    def _called(self, future: Call[Any]) -> None:
        if not future.cancelled() and future.exception() is not None:
            self._work_failed(future.exception())


def _stamp_ns(stamp: Time) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def main() -> int:
    """Run the node."""
    return run(LocalizationNode)


if __name__ == '__main__':
    sys.exit(main())
