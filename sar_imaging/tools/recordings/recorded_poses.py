"""Poses of a platform in recordings: nav_msgs/msg/Odometry messages, without ROS."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from sar_imaging.geometry.poses import PoseTrack

ODOMETRY_TOPIC = '/odometry'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'


@dataclasses.dataclass(frozen=True)
class RecordedPoses:
    """Poses of the platform as a recording holds them.

    Parameters
    ----------
    stamp_ns : (N,) int64
        Times on the poses' clock, nanoseconds.
    position_m : (N, 3) float64
        Metres, in the frame `frame_id`.
    quaternion : (N, 4) float64
        x, y, z, w.
    frame_id, child_frame_id : str
        Frame of the positions and name of the body.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.tools.recordings import RecordedPoses
    >>> second = 1_000_000_000
    >>> poses = RecordedPoses(np.arange(20) * (second // 20), np.zeros((20, 3)),
    ...                       np.tile([0.0, 0.0, 0.0, 1.0], (20, 1)))
    >>> track = poses.track(max_gap_s=0.1)
    >>> poses.frame_id, poses.child_frame_id
    ('map', 'base_link')
    """

    stamp_ns: np.ndarray
    position_m: np.ndarray
    quaternion: np.ndarray
    frame_id: str = 'map'
    child_frame_id: str = 'base_link'

    def messages(self, store) -> Iterator[tuple[int, bytes]]:
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
        for stamp, place, turn in zip(self.stamp_ns.tolist(), self.position_m.tolist(),
                                      self.quaternion.tolist(), strict=True):
            message = odometry(
                header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9),
                              frame_id=self.frame_id),
                child_frame_id=self.child_frame_id,
                pose=types['geometry_msgs/msg/PoseWithCovariance'](
                    pose=pose(position=point(**dict(zip('xyz', place, strict=True))),
                              orientation=rotation(**dict(zip('xyzw', turn, strict=True)))),
                    covariance=unknown),
                twist=twist)
            yield stamp, bytes(store.serialize_cdr(message, ODOMETRY_TYPE))

    @classmethod
    def from_messages(cls, store, messages: Sequence[bytes]) -> RecordedPoses | None:
        """Poses of serialised messages, in their order; None of none."""
        if not messages:
            return None
        read = [store.deserialize_cdr(cdr, ODOMETRY_TYPE) for cdr in messages]
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in read]
        poses = [m.pose.pose for m in read]
        return cls(np.array(stamps, np.int64),
                   np.array([[getattr(p.position, a) for a in 'xyz'] for p in poses]),
                   np.array([[getattr(p.orientation, a) for a in 'xyzw'] for p in poses]),
                   read[0].header.frame_id, read[0].child_frame_id)

    def track(self, **limits) -> PoseTrack:
        """The track of all these poses; limits as of `PoseTrack`."""
        track = PoseTrack(**limits, capacity=max(len(self.stamp_ns), 1))
        for pose in zip(self.stamp_ns.tolist(), self.position_m, self.quaternion, strict=True):
            track.add(*pose)
        return track
