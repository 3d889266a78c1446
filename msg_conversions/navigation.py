# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Satellite navigation and attitudes from sensor_msgs, the datum of a frame as a transform.

The datum of a frame travels as geometry_msgs/TransformStamped from the frame ``earth`` (REP 105:
Earth-centred, Earth-fixed, WGS 84) to the imaging frame: exact, heading included, and what tf
would hold. geographic_msgs/GeoPose is not part of common_interfaces.
"""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus
from std_msgs.msg import Header

from sar_imaging.geometry.earth import Datum, ecef_to_geographic
from sar_imaging.geometry.navigation import Fix

from .errors import WireFormatError

EARTH_FRAME = 'earth'
_UPRIGHT = 1e-6  # of z of the frame from the normal of the ellipsoid, radians
_NORM_TOLERANCE = 0.01  # of quaternions


def fix_from_message(message: NavSatFix, *, max_std_m: float = math.inf) -> Fix:
    """Read a fix of satellite navigation.

    Parameters
    ----------
    message : sensor_msgs.msg.NavSatFix
        Its altitude is above the WGS 84 ellipsoid, as the message demands.
    max_std_m : float
        Largest horizontal standard deviation, metres; of fixes that tell one.

    Returns
    -------
    Fix
        Nanoseconds, degrees and metres.

    Raises
    ------
    WireFormatError
        It is no fix, no place on the Earth, or not good enough; the text says which.

    Examples
    --------
    >>> from sensor_msgs.msg import NavSatFix, NavSatStatus
    >>> from msg_conversions.navigation import fix_from_message
    >>> fix = fix_from_message(NavSatFix(
    ...     status=NavSatStatus(status=NavSatStatus.STATUS_FIX), latitude=47.0, longitude=8.0,
    ...     altitude=450.0))
    >>> fix.latitude_deg, fix.longitude_deg, fix.height_m
    (47.0, 8.0, 450.0)
    """
    if message.status.status < NavSatStatus.STATUS_FIX:
        raise WireFormatError(f'status {message.status.status}: no fix')
    place = message.latitude, message.longitude, message.altitude
    if not all(map(math.isfinite, place)):
        raise WireFormatError(f'latitude, longitude, altitude = {place[0]:g}, {place[1]:g}, '
                              f'{place[2]:g}; expected three finite numbers')
    try:
        Datum(*place)
    except ValueError as error:
        raise WireFormatError(str(error)) from error
    std_m = _std_m(message)
    if std_m > max_std_m:
        raise WireFormatError(f'standard deviation {std_m:.3g} m, more than {max_std_m:g} m')
    return Fix(_stamp_ns(message.header), *place, std_m)


def _std_m(message: NavSatFix) -> float:
    """Horizontal standard deviation along the worse of east and north, metres; NaN if unknown."""
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return math.nan
    variance = max(message.position_covariance[0], message.position_covariance[4])
    return math.sqrt(variance) if variance >= 0 else math.nan


def attitude_from_message(message: Imu) -> tuple[int, tuple[float, float, float, float]]:
    """Read time and attitude: from the body into east, north, up (REP 145).

    Parameters
    ----------
    message : sensor_msgs.msg.Imu
        With an orientation.

    Returns
    -------
    stamp_ns : int
        Nanoseconds.
    quaternion : (4,) floats
        x, y, z, w.

    Raises
    ------
    WireFormatError
        The message tells no orientation.

    Examples
    --------
    >>> from geometry_msgs.msg import Quaternion
    >>> from sensor_msgs.msg import Imu
    >>> from msg_conversions.navigation import attitude_from_message
    >>> stamp_ns, quaternion = attitude_from_message(Imu(orientation=Quaternion(z=1.0, w=0.0)))
    >>> stamp_ns, [float(v) for v in quaternion]
    (0, [0.0, 0.0, 1.0, 0.0])
    """
    q = message.orientation
    turn = q.x, q.y, q.z, q.w
    if message.orientation_covariance[0] == -1:
        raise WireFormatError('orientation_covariance[0] is -1: no orientation')
    if not abs(math.hypot(*turn) - 1) <= _NORM_TOLERANCE:
        raise WireFormatError(f'orientation has the norm {math.hypot(*turn):.3g}; expected 1')
    return _stamp_ns(message.header), turn


def datum_to_message(datum: Datum, frame_id: str, stamp: Time) -> TransformStamped:
    """Write the datum of a frame as the transform from `EARTH_FRAME` to it.

    Parameters
    ----------
    datum : Datum
        Place and heading of the frame.
    frame_id : str
        Name of the frame.
    stamp : builtin_interfaces.msg.Time
        From when on it holds.

    Returns
    -------
    geometry_msgs.msg.TransformStamped
        From `EARTH_FRAME`, metres.

    Examples
    --------
    >>> from builtin_interfaces.msg import Time
    >>> from msg_conversions.navigation import datum_to_message
    >>> from sar_imaging.geometry import Datum
    >>> message = datum_to_message(Datum(47.0, 8.0, 450.0), 'map', Time(sec=12))
    >>> message.header.frame_id, message.child_frame_id
    ('earth', 'map')
    >>> print(f'{message.transform.translation.x / 1000:.1f} km along the x axis of the Earth')
    4315.6 km along the x axis of the Earth
    """
    turn = Rotation.from_matrix(datum.axes_ecef.T).as_quat()
    x, y, z = datum.origin_ecef_m.tolist()
    return TransformStamped(
        header=Header(stamp=stamp, frame_id=EARTH_FRAME), child_frame_id=frame_id,
        transform=Transform(translation=Vector3(x=x, y=y, z=z),
                            rotation=Quaternion(**dict(zip('xyzw', turn.tolist(), strict=True)))))


def datum_from_message(message: TransformStamped) -> Datum:
    """Read the datum of the frame that a transform from `EARTH_FRAME` leads to.

    Parameters
    ----------
    message : geometry_msgs.msg.TransformStamped
        As `datum_to_message` writes it; its z axis points up where it leads.

    Returns
    -------
    Datum
        Degrees and metres, WGS 84.

    Raises
    ------
    WireFormatError
        It begins in another frame, or the z axis does not point up where it leads.

    Examples
    --------
    >>> from builtin_interfaces.msg import Time
    >>> from msg_conversions.navigation import datum_from_message, datum_to_message
    >>> from sar_imaging.geometry import Datum
    >>> message = datum_to_message(Datum(47.0, 8.0, 450.0, heading_deg=30.0), 'map', Time())
    >>> datum = datum_from_message(message)
    >>> print(f'{datum.latitude_deg:.6f}, {datum.longitude_deg:.6f}, {datum.heading_deg:.3f}')
    47.000000, 8.000000, 30.000
    """
    if message.header.frame_id != EARTH_FRAME:
        raise WireFormatError(f'transform from frame {message.header.frame_id!r}; expected '
                              f'{EARTH_FRAME}')
    t, q = message.transform.translation, message.transform.rotation
    numbers = (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
    if not all(map(math.isfinite, numbers)) or not (
            abs(math.hypot(*numbers[3:]) - 1) <= _NORM_TOLERANCE):
        raise WireFormatError(f'transform of {numbers}; expected finite numbers and a quaternion '
                              'of norm 1')
    latitude, longitude, height = (float(v) for v in ecef_to_geographic((t.x, t.y, t.z)))
    try:
        local = Datum(latitude, longitude, height)
    except ValueError as error:
        raise WireFormatError(str(error)) from error
    axes = Rotation.from_quat((q.x, q.y, q.z, q.w)).as_matrix().T  # of the frame, one to a row
    east, north, up = local.axes_ecef
    tilt = float(np.linalg.norm(np.cross(axes[2], up)))
    if tilt > _UPRIGHT or axes[2] @ up < 0:
        raise WireFormatError(f'z of {message.child_frame_id} is {math.degrees(tilt):.3g} degrees '
                              'off the normal of the ellipsoid; expected none')
    heading = math.degrees(math.atan2(axes[1] @ east, axes[1] @ north))
    return Datum(latitude, longitude, height, heading)


def _stamp_ns(header: Header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec
