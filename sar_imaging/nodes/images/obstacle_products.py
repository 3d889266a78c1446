# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Publish obstacles as a map and a cloud, built only while they have a subscriber.

Maps are made in a thread of their own with a low priority: images do not wait for them. Where
images come faster than maps are made, the latest one that waits takes the place of the one before,
which is counted.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from msg_conversions.images import occupancy_to_message
from msg_conversions.point_cloud import OBSTACLE_FIELDS, to_message
from sar_imaging.compilation import MISSING, MissingNumbaError
from sar_imaging.exploitation.obstacles import Obstacle, ObstacleDetector, spacing_advice
from sar_imaging.exploitation.obstacles.aperture_view import ApertureView
from sar_imaging.exploitation.obstacles.obstacle_map import (
    FREE,
    UNKNOWN,
    ObstacleMap,
    compile_kernels,
)
from sar_imaging.geometry.grids import MapGrid

from ..poses.frame_datum import FrameDatum
from ..runtime.block_output import PRODUCT_QOS, header_at
from ..runtime.health import Health, Part
from ..runtime.parameters import ANY_TIME, Parameter
from ..runtime.worker import Worker

if TYPE_CHECKING:
    from ..runtime.stage import Stage

PARAMETERS = (
    Parameter('obstacles.false_alarms', 0.1, 'Obstacles per image that clutter may make up in '
              'obstacle_map, on average.', '', 1e-6, 10.0, changes=ANY_TIME),
    Parameter('obstacles.memory_s', 60.0, 'Evidence for and against an obstacle fades to 1 / e in '
              'this time; a cell not looked at for so long is unknown.', 's', 0.01, 1e9,
              changes=ANY_TIME),
    Parameter('obstacles.beamwidth', 0.0, 'Beam along the track of an antenna fixed to the '
              'platform; cells outside of it are unknown. 0.0 where it covers the image or '
              'follows it; antenna.pattern takes its place.', 'degrees', 0.0, 180.0,
              changes=ANY_TIME),
    Parameter('obstacles.squint', 0.0, 'Axis of that beam from broadside, positive ahead.',
              'degrees', -90.0, 90.0, changes=ANY_TIME),
)
COUNTERS = ('obstacle_maps_published', 'obstacles_in_last_map', 'last_obstacle_map_seconds')
FAULTS = ('obstacle_maps_refused', 'obstacle_maps_skipped')
# Who keeps the latched map may ask to be told within this time that its sender died.
MAP_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL,
                     liveliness=LivelinessPolicy.AUTOMATIC,
                     liveliness_lease_duration=Duration(seconds=2))
_FADING_S = 0.5  # between maps that no image renews
_PATIENCE_S = 3.0  # for the map in work, once Ctrl-C was pressed


@dataclasses.dataclass(frozen=True)
class _Look:
    """An image, and what its map needs to know of it; see `ObstacleProducts.publish`."""

    image: np.ndarray
    grid: MapGrid
    stamp_ns: int
    view: Callable[[], ApertureView]
    illuminated: Callable[[], np.ndarray] | None


class ObstacleProducts:
    """Publishes `obstacle_map` and `obstacles` of one node.

    Parameters
    ----------
    node : Stage
        Node whose outputs they are.
    parameters : mapping
        Current values of `PARAMETERS`.
    health : Health or Part
        Where maps are counted, and told why there is none.
    datum : FrameDatum
        Tells latitudes and longitudes of obstacles.
    """

    def __init__(self, node: Stage, parameters: Mapping[str, Any], health: Health | Part,
                 datum: FrameDatum):
        self._parameters, self._health, self._datum = parameters, health, datum
        self._map = ObstacleMap()
        self._latest: _Look | None = None  # that nobody has asked for yet
        self._worker: Worker | None = None  # of the maps; without it they are made at once
        self._refusal, self._advised = '', False
        # Time and stamp of the last map while some of it is known, on time.monotonic and in ns.
        self._sent: tuple[float, int] | None = None
        if not MISSING:
            compile_kernels()  # who asks for the first map must not wait for it
        joined = {'joined': lambda: node.in_worker(self._publish)}
        self._grid_output = node.create_output(OccupancyGrid, 'obstacle_map', MAP_QOS, **joined)
        self._cloud_output = node.create_output(PointCloud2, 'obstacles', PRODUCT_QOS, **joined)

    def activate(self, node: Stage) -> None:
        """Make maps in a thread of their own, and let the map fade, images or not."""
        worker = self._worker = Worker(
            lambda work: work(), capacity=1, name='obstacle_map', background=True,
            on_error=lambda error: node.in_worker(lambda: _raise(error)))
        worker.start()
        # Where an image waits the map need not fade.
        node.activity.callback(self._end, node)
        node.repeat(_FADING_S, lambda: worker.put(self.fade))

    def _end(self, node: Stage) -> None:
        """Finish the map in work; the latched one is unknown, since nobody looks any more."""
        worker, self._worker = self._worker, None
        worker.stop(None if node.context.ok() else _PATIENCE_S)
        if node.context.ok():
            self.fade(math.inf)

    def fade(self, later_s: float | None = None) -> None:
        """Publish what is left of the map where no image came for a while.

        Parameters
        ----------
        later_s : float, optional
            Seconds since the last image's map; by default those that passed.
        """
        if self._sent is None:
            return
        sent_s, stamp_ns = self._sent
        passed_s = time.monotonic() - sent_s
        if later_s is None and passed_s < _FADING_S:
            return
        states = self._map.states(passed_s if later_s is None else later_s)
        self._grid_output.publish(occupancy_to_message(
            states, self._map.grid,
            header_at(stamp_ns + round(1e9 * passed_s), self._parameters)))
        if (states == UNKNOWN).all():
            self._sent = None

    def publish(self, image: np.ndarray, grid: MapGrid, stamp_ns: int,
                view: Callable[[], ApertureView],
                illuminated: Callable[[], np.ndarray] | None = None) -> None:
        """Add the evidence of an image and publish, if somebody listens.

        Parameters
        ----------
        image : (n_y, n_x) complex64
            The array is kept until the next image comes.
        grid : MapGrid
            Where its pixels are.
        stamp_ns : int
            Middle of the aperture, nanoseconds.
        view : callable
            Returns the aperture, or raises ValueError where it cannot be told.
        illuminated : callable, optional
            Returns the pixels (n_y, n_x) bool that the antenna illuminated: they take the place of
            `obstacles.beamwidth`.
        """
        self._latest = _Look(image, grid, stamp_ns, view, illuminated)
        self._publish()

    def _listened(self) -> list[Any]:
        return [p for p in (self._grid_output, self._cloud_output) if p.get_subscription_count()]

    def _publish(self) -> None:
        """Have the map of the latest image made, if somebody listens."""
        if self._latest is None or not self._listened():
            return
        look, self._latest = self._latest, None
        try:
            view = look.view()
        except ValueError as error:
            self._refuse(str(error))
            return
        worker, make = self._worker, functools.partial(self._make, look, view)
        if worker is None:
            make()
        elif not worker.put(make):
            self._health.count('obstacle_maps_skipped',
                               sum(work != self.fade for work in worker.clear()))
            worker.put(make)

    def _make(self, look: _Look, view: ApertureView) -> None:
        """Add the evidence of an image, and publish what the map is now."""
        started, p = time.monotonic(), self._parameters
        try:
            detector = ObstacleDetector(
                look.grid, view, false_alarms=p['obstacles.false_alarms'],
                beamwidth_rad=math.radians(p['obstacles.beamwidth']),
                squint_rad=math.radians(p['obstacles.squint']),
                lit=None if look.illuminated is None else look.illuminated())
            self._map.memory_s = p['obstacles.memory_s']
            self._map.add(detector(look.image), look.stamp_ns)
        except (ValueError, MemoryError, MissingNumbaError) as error:
            self._refuse(str(error))
            return
        self._refusal = ''
        self._advise(spacing_advice(look.grid, view))
        states, obstacles = self._map.states(), self._map.obstacles()
        self._send(look, states, obstacles)
        seconds = time.monotonic() - started
        self._health.count('obstacle_maps_published')
        self._health.set('obstacles_in_last_map', len(obstacles))
        self._health.set('last_obstacle_map_seconds', seconds)
        self._health.info(f'obstacle map: {len(obstacles)} obstacles, '
                          f'{np.mean(states == FREE):.0%} free, '
                          f'{np.mean(states == UNKNOWN):.0%} unknown; {seconds:.3g} s of work')

    def _send(self, look: _Look, states: np.ndarray, obstacles: list[Obstacle]) -> None:
        header, outputs = header_at(look.stamp_ns, self._parameters), self._listened()
        if self._grid_output in outputs:
            self._grid_output.publish(occupancy_to_message(states, look.grid, header))
            self._sent = time.monotonic(), look.stamp_ns
        if self._cloud_output in outputs:
            rows = [(*o.position_m, o.intensity_db, o.width_m) for o in obstacles]
            points = np.array(rows, float).reshape(-1, len(OBSTACLE_FIELDS))
            self._cloud_output.publish(to_message(points, header, OBSTACLE_FIELDS,
                                                  self._datum.geographic(points[:, :3])))

    def _advise(self, advice: str) -> None:
        if advice and not self._advised:
            self._health.warning(f'obstacle map: {advice}')
        self._advised = bool(advice)

    def _refuse(self, why: str) -> None:
        self._health.count('obstacle_maps_refused')
        if why != self._refusal:
            self._health.warning(f'no obstacle map of this image: {why}')
        self._refusal = why


def _raise(error: Exception) -> None:
    raise error
