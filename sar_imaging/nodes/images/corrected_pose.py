# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Publish where autofocus finds the robot, for a filter: one position of each focused aperture."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from msg_conversions.planar_poses import POSITION, pose_to_message
from sar_imaging.autofocus.models import OFFSET
from sar_imaging.streaming.aperture import ApertureImage

from ..poses.known_positions import KnownPositions
from ..runtime.block_output import PRODUCT_QOS, header_at
from ..runtime.health import Health, Part

if TYPE_CHECKING:
    from ..runtime.stage import Stage

COUNTERS = ('corrected_poses_published',)
_NOT_TOLD = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)


class CorrectedPose:
    """Publishes `corrected_pose` of one node, once the image is on its way.

    Parameters
    ----------
    node : Stage
        Node whose output it is.
    parameters : mapping
        Current values, with ``antenna.offset_s`` and ``frame_id``.
    health : Health or Part
        Counters, with `COUNTERS`, and log.
    positions : KnownPositions or None
        Poses of the body; without them the position is that of the antenna.
    """

    def __init__(self, node: Stage, parameters: Mapping[str, Any], health: Health | Part,
                 positions: KnownPositions | None):
        self._parameters, self._health, self._positions = parameters, health, positions
        self._output = node.create_output(PoseWithCovarianceStamped, 'corrected_pose', PRODUCT_QOS)

    def publish(self, product: ApertureImage) -> None:
        """Publish the middle of an aperture that is claimed to be focused, if somebody listens."""
        if product.focus.track is None or not self._output.get_subscription_count():
            return
        began = time.perf_counter()
        try:
            track = product.focus.track()
            middle = int(np.argmin(np.abs(track.stamp_ns - product.stamp_ns)))
            stamp_ns = int(track.stamp_ns[middle])
            quaternion, arm_m = self._body(stamp_ns, track.parameters.get(OFFSET, 0.0))
        except ValueError as error:
            self._health.info(f'no corrected pose of aperture {product.aperture}: {error}')
            return
        stamp_ns += round(1e9 * np.mean(self._parameters['antenna.offset_s']))
        covariance_m2 = track.covariance_m2[middle]
        self._output.publish(pose_to_message(
            track.position_m[middle] - arm_m, quaternion, covariance_m2,
            header_at(stamp_ns, self._parameters), POSITION))
        self._health.count('corrected_poses_published')
        std = ', '.join(f'{s:.2g}' for s in np.sqrt(np.linalg.eigvalsh(covariance_m2)))
        self._health.info(f'corrected pose of aperture {product.aperture}: known to {std} m along '
                          f'its axes; {time.perf_counter() - began:.2g} s of work')

    def _body(self, stamp_ns: int, offset_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Attitude (4,), and the antenna's place from the body (3,), as far as poses tell them."""
        told = None if self._positions is None else self._positions.body(stamp_ns, offset_s)
        return _NOT_TOLD if told is None else told
