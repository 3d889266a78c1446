"""Poses of a platform in recordings: nav_msgs/msg/Odometry messages, without ROS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sar_imaging.geometry.poses import PoseTable

ODOMETRY_TOPIC = '/odometry'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'


def odometry_messages(poses: PoseTable, store) -> Iterator[tuple[int, bytes]]:
    """Time and CDR bytes of each message; `store` is a type store of rosbags."""
    types = store.types
    odometry, header = types[ODOMETRY_TYPE], types['std_msgs/msg/Header']
    time, point = types['builtin_interfaces/msg/Time'], types['geometry_msgs/msg/Point']
    rotation = types['geometry_msgs/msg/Quaternion']
    pose = types['geometry_msgs/msg/Pose']
    vector = types['geometry_msgs/msg/Vector3']
    still = types['geometry_msgs/msg/Twist'](linear=vector(x=0.0, y=0.0, z=0.0),
                                             angular=vector(x=0.0, y=0.0, z=0.0))
    unknown = np.zeros(36)
    twist = types['geometry_msgs/msg/TwistWithCovariance'](twist=still, covariance=unknown)
    for stamp, place, turn in zip(poses.stamp_ns.tolist(), poses.position_m.tolist(),
                                  poses.quaternion.tolist(), strict=True):
        message = odometry(
            header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9),
                          frame_id=poses.frame_id),
            child_frame_id=poses.child_frame_id,
            pose=types['geometry_msgs/msg/PoseWithCovariance'](
                pose=pose(position=point(**dict(zip('xyz', place, strict=True))),
                          orientation=rotation(**dict(zip('xyzw', turn, strict=True)))),
                covariance=unknown),
            twist=twist)
        yield stamp, bytes(store.serialize_cdr(message, ODOMETRY_TYPE))


def poses_of_messages(store, messages: Sequence[bytes]) -> PoseTable | None:
    """Poses of serialised messages, in their order; None of none."""
    if not messages:
        return None
    read = [store.deserialize_cdr(cdr, ODOMETRY_TYPE) for cdr in messages]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in read]
    poses = [m.pose.pose for m in read]
    return PoseTable(np.array(stamps, np.int64),
                     np.array([[getattr(p.position, a) for a in 'xyz'] for p in poses]),
                     np.array([[getattr(p.orientation, a) for a in 'xyzw'] for p in poses]),
                     read[0].header.frame_id, read[0].child_frame_id)
