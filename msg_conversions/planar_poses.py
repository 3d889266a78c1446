# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert poses of which a part is known, with its covariance, to geometry_msgs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from std_msgs.msg import Header

UNKNOWN_VARIANCE = 1e6  # of what a pose does not tell, square metres and square radians
PLANAR, POSITION = (0, 1, 5), (0, 1, 2)  # among x, y, z, roll, pitch, yaw


def pose_to_message(position_m: Sequence[float], quaternion: Sequence[float],
                    covariance: np.ndarray, header: Header,
                    known: tuple[int, int, int] = PLANAR) -> PoseWithCovarianceStamped:
    """Write a pose of which x, y and heading are known, or the position.

    Parameters
    ----------
    position_m : (3,) floats
        Metres.
    quaternion : (4,) floats
        x, y, z, w, from the body into the frame of the header.
    covariance : (3, 3) float64
        Of x, y and heading, or of x, y, z: square metres, metres, square radians.
    header : std_msgs.msg.Header
        Time and frame.
    known : (3,) ints
        `PLANAR` or `POSITION`.

    Returns
    -------
    geometry_msgs.msg.PoseWithCovarianceStamped
        What is not known has the variance `UNKNOWN_VARIANCE`.

    Raises
    ------
    ValueError
        A number is not finite, or a variance is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import planar_poses
    >>> message = planar_poses.pose_to_message((3.0, 4.0, 1.0), (0.0, 0.0, 0.0, 1.0),
    ...                                        np.diag([0.01, 0.04, 1e-4]), Header(frame_id='map'))
    >>> message.pose.pose.position.y, float(message.pose.covariance[35])  # of the yaw
    (4.0, 0.0001)
    """
    covariance = np.asarray(covariance, float)
    if not (np.isfinite([*position_m, *quaternion]).all() and np.isfinite(covariance).all()
            and (np.diag(covariance) > 0).all()):
        raise ValueError(f'position {position_m}, quaternion {quaternion}, covariance '
                         f'{covariance.tolist()}; expected finite numbers and positive variances')
    whole = np.diag(np.full(6, UNKNOWN_VARIANCE))
    whole[np.ix_(known, known)] = covariance
    return PoseWithCovarianceStamped(header=header, pose=PoseWithCovariance(
        pose=Pose(position=Point(**_named('xyz', position_m)),
                  orientation=Quaternion(**_named('xyzw', quaternion))),
        covariance=whole.reshape(-1)))


def transform_to_message(place: Sequence[float], header: Header, child_frame_id: str
                         ) -> TransformStamped:
    """Write where a frame lies in another one, in the plane.

    Parameters
    ----------
    place : (3,) floats
        x and y, metres, and heading, radians.
    header : std_msgs.msg.Header
        Time, and the frame in which it lies.
    child_frame_id : str
        Its name.

    Returns
    -------
    geometry_msgs.msg.TransformStamped

    Examples
    --------
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import planar_poses
    >>> message = planar_poses.transform_to_message((3.0, 4.0, 0.0), Header(frame_id='map'),
    ...                                             'odom')
    >>> message.child_frame_id, message.transform.translation.x
    ('odom', 3.0)
    """
    x, y, heading = (float(v) for v in place)
    return TransformStamped(header=header, child_frame_id=child_frame_id, transform=Transform(
        translation=Vector3(x=x, y=y, z=0.0),
        rotation=Quaternion(z=math.sin(heading / 2), w=math.cos(heading / 2))))


def _named(names: str, values: Sequence[float]) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}
