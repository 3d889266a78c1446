# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of pulse blocks: rosbag2 folders (mcap) with the truth in their metadata.

Needs `rosbags` and no ROS. Topic `/pulses` of type std_msgs/msg/Float32MultiArray; the time of a
message is the transmission time of its block's last pulse. Where the pulses have no positions,
topic `/odometry` of type nav_msgs/msg/Odometry has the poses of the platform on their own clock.
The same blocks always give the same bytes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import heapq
import json
import operator
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from msg_conversions.wire import from_array, to_array

from .. import files
from ..files import naming
from ..geometry.poses import PoseTable
from ..signal.pulses import PulseBlock
from .bag_files import add_checksums, check_bag, checked
from .truth import TRUTH_VERSION, check_truth

TOPIC, ODOMETRY_TOPIC = '/pulses', '/odometry'
MESSAGE_TYPE, ODOMETRY_TYPE = 'std_msgs/msg/Float32MultiArray', 'nav_msgs/msg/Odometry'
TRUTH_KEY = 'sar_imaging.truth'
_BAG_ENDINGS = ('.mcap', '.mcap.zstd', '.db3', '.db3.zstd', '.db3-shm', '.db3-wal')
POSE_TYPES = {  # place of position and orientation in a message
    ODOMETRY_TYPE: 'pose.pose',
    'geometry_msgs/msg/PoseStamped': 'pose',
    'geometry_msgs/msg/PoseWithCovarianceStamped': 'pose.pose',
    'geometry_msgs/msg/TransformStamped': 'transform'}


def odometry_messages(poses: PoseTable) -> Iterator[tuple[int, bytes]]:
    """Time and CDR bytes of each message."""
    types = message_types().types
    odometry, header = types[ODOMETRY_TYPE], types['std_msgs/msg/Header']
    time, point = types['builtin_interfaces/msg/Time'], types['geometry_msgs/msg/Point']
    quaternion = types['geometry_msgs/msg/Quaternion']
    pose = types['geometry_msgs/msg/Pose']
    vector = types['geometry_msgs/msg/Vector3']
    still = types['geometry_msgs/msg/Twist'](linear=vector(x=0.0, y=0.0, z=0.0),
                                             angular=vector(x=0.0, y=0.0, z=0.0))
    unknown = np.zeros(36)
    twist = types['geometry_msgs/msg/TwistWithCovariance'](twist=still, covariance=unknown)
    for stamp, place, rotation in zip(poses.stamp_ns.tolist(), poses.position_m.tolist(),
                                      poses.quaternion.tolist(), strict=True):
        message = odometry(
            header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9),
                          frame_id=poses.frame_id),
            child_frame_id=poses.child_frame_id,
            pose=types['geometry_msgs/msg/PoseWithCovariance'](
                pose=pose(position=point(**dict(zip('xyz', place, strict=True))),
                          orientation=quaternion(**dict(zip('xyzw', rotation, strict=True)))),
                covariance=unknown),
            twist=twist)
        yield stamp, bytes(message_types().serialize_cdr(message, ODOMETRY_TYPE))


def pose_table(messages: Iterable[tuple[Any, str]]) -> PoseTable:
    """Poses of messages and their types, one of `POSE_TYPES`, in their order."""
    stamp, position, quaternion = [], [], []
    for message, kind in messages:
        pose = operator.attrgetter(POSE_TYPES[kind])(message)
        place = getattr(pose, 'position', None) or pose.translation
        rotation = getattr(pose, 'orientation', None) or pose.rotation
        at = message.header.stamp
        stamp.append(at.sec * 10**9 + at.nanosec)
        position.append([place.x, place.y, place.z])
        quaternion.append([rotation.x, rotation.y, rotation.z, rotation.w])
    return PoseTable(np.array(stamp, np.int64), np.array(position, float).reshape(-1, 3),
                     np.array(quaternion, float).reshape(-1, 4))


class BagError(RuntimeError):
    """A recording is missing, exists already, or is not one of ours.

    Examples
    --------
    >>> from sar_imaging.recordings import BagError, read_blocks
    >>> try:
    ...     next(read_blocks('bags'))
    ... except BagError as error:
    ...     print(error)
    bags is not a rosbag2 recording: it has no metadata.yaml
    """


def _rosbag2() -> Any:
    """Module rosbags.rosbag2; a robot may do without it."""
    try:
        from rosbags import rosbag2
    except ModuleNotFoundError as error:
        raise BagError('recordings need the Python package rosbags, which is not installed: `pip '
                       'install "rosbags>=0.11.7,<0.12"` in a virtual environment, see '
                       'docs/install.md') from error
    return rosbag2


@functools.cache
def message_types() -> Any:
    """Message types of ROS 2 Jazzy, a type store of rosbags."""
    _rosbag2()  # tells where it is missing
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def serialise(block: PulseBlock) -> bytes:
    """CDR bytes of the message that carries `block`, as a publisher would send them."""
    data, dims, offset = to_array(block)
    types = message_types().types
    layout = types['std_msgs/msg/MultiArrayLayout'](
        dim=[types['std_msgs/msg/MultiArrayDimension'](label=label, size=size, stride=stride)
             for label, size, stride in dims],
        data_offset=offset)
    return bytes(message_types().serialize_cdr(types[MESSAGE_TYPE](layout=layout, data=data),
                                      MESSAGE_TYPE))


def deserialise(cdr: bytes) -> PulseBlock:
    """Pulse block of a message's CDR bytes; raises `WireFormatError` when it holds none."""
    message = message_types().deserialize_cdr(cdr, MESSAGE_TYPE)
    dims = [(d.label, d.size, d.stride) for d in message.layout.dim]
    return from_array(message.data, dims, message.layout.data_offset)


def write_bag(path: Path | str, blocks: Iterable[PulseBlock], truth: dict[str, Any], *,
              overwrite: bool = False, poses: PoseTable | None = None) -> int:
    """Write a recording (rosbag2), all of it or nothing.

    The bag is written beside its place and moved there when complete, so an interruption leaves
    neither half a bag nor a damaged older one.

    Parameters
    ----------
    path : path
        Folder to make; its name becomes the name of the mcap file.
    blocks : iterable of PulseBlock
        In the order of their pulses.
    truth : dict
        What evaluation compares with; stored as JSON, see docs/preparing_radar_data.md.
    overwrite : bool
        Replace an existing bag. A folder without metadata.yaml is never removed.
    poses : PoseTable, optional
        Poses of the platform; the truth's `alignment` says how the radar's clock lies to theirs.
        Messages of both topics are then recorded at the times of the poses' clock.

    Returns
    -------
    int
        Number of messages with pulses.

    Raises
    ------
    BagError
        `path` exists and may not be replaced, or there is no block.

    Examples
    --------
    >>> from sar_imaging.recordings import read_blocks, read_truth, write_bag
    >>> blocks = list(read_blocks('bags/psf'))
    >>> write_bag('half_of_it', blocks[:4], read_truth('bags/psf'))
    4
    """
    path = Path(path)
    check_target(path, overwrite=overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    with files.replacing(path, folder=True) as partial:
        count = _write(partial, blocks, truth, poses)
        if not count:
            raise BagError(f'no pulse block to write to {path}')
        add_checksums(partial / f'{path.name}.mcap')
    return count


def check_target(path: Path, *, overwrite: bool) -> None:
    """Raise `BagError` when a bag may not be written to `path`."""
    if not os.path.lexists(path):
        return
    if not (path / 'metadata.yaml').is_file():
        raise BagError(f'{path} exists and is not a bag; choose another path')
    if not overwrite:
        raise BagError(f'{path} exists already; choose another path or add --force')
    others = [f.name for f in path.iterdir()
              if f.name != 'metadata.yaml' and not f.name.endswith(_BAG_ENDINGS)]
    if others and not path.is_symlink():  # of which the link alone goes
        raise BagError(f'{path} holds other files besides a bag ({", ".join(others[:3])}); choose '
                       'another path, or move them')
    files.check_target(path, folder=True)


def _write(path: Path, blocks: Iterable[PulseBlock], truth: dict[str, Any],
           poses: PoseTable | None) -> int:
    rosbag2 = _rosbag2()
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        writer.set_custom_data(TRUTH_KEY, json.dumps(truth, sort_keys=True))
        pulses = writer.add_connection(TOPIC, MESSAGE_TYPE, typestore=message_types())
        late_ns = round(truth.get('alignment', {}).get('time_offset_s', 0.0) * 1e9)
        streams = [((int(b.stamp_ns[-1]) + late_ns, pulses, serialise(b)) for b in blocks)]
        if poses is not None:
            odometry = writer.add_connection(ODOMETRY_TOPIC, ODOMETRY_TYPE,
                                             typestore=message_types())
            streams.append((time_ns, odometry, cdr)
                           for time_ns, cdr in odometry_messages(poses))
        count = 0
        for time_ns, connection, cdr in heapq.merge(*streams, key=lambda message: message[0]):
            writer.write(connection, time_ns, cdr)
            count += connection is pulses
    return count


@contextlib.contextmanager
def reading_bag(path: Path, trouble: str,
                reader: Callable[[Path], contextlib.AbstractContextManager[Any]]) -> Iterator[Any]:
    """Reader of a bag that was looked through before, opened; what fails is a `BagError`."""
    with naming(path, trouble, BagError):
        check_bag(path)
        with reader(path) as opened:
            yield opened


@contextlib.contextmanager
def _opened(path: Path | str) -> Iterator[Any]:
    path, rosbag2 = Path(path), _rosbag2()
    if not (path / 'metadata.yaml').is_file():
        raise BagError(f'{path} is not a rosbag2 recording: it has no metadata.yaml')
    with reading_bag(path, 'cannot be read', rosbag2.Reader) as reader:
        yield reader


def raw_messages(path: Path | str, start_ns: int | None = None, stop_ns: int | None = None
                 ) -> Iterator[tuple[int, bytes]]:
    """Messages of `/pulses` as they were recorded, for a publisher to send on.

    Parameters
    ----------
    path : path
        Bag folder.
    start_ns, stop_ns : int, optional
        Only those recorded at the first time or later, and before the second, nanoseconds: the
        rest of the file is not read.

    Yields
    ------
    time_ns : int
        When the message was recorded, nanoseconds.
    cdr : bytes
        The serialised message.

    Raises
    ------
    BagError
        The folder is no bag or has no topic `/pulses` of the right type.
    """
    yield from _messages(path, TOPIC, MESSAGE_TYPE, start_ns, stop_ns)


def pose_messages(path: Path | str) -> Iterator[tuple[int, bytes]]:
    """Messages of `/odometry` as `raw_messages` gives those of the pulses; none without it."""
    with _opened(path) as reader:
        recorded = any(c.topic == ODOMETRY_TOPIC for c in reader.connections)
    if recorded:
        yield from _messages(path, ODOMETRY_TOPIC, ODOMETRY_TYPE)


def read_poses(path: Path | str) -> PoseTable | None:
    """Read the poses of a recording; None when it has no `/odometry`.

    Parameters
    ----------
    path : path
        Bag folder.

    Returns
    -------
    PoseTable or None
        Nanoseconds, metres and quaternions.

    Examples
    --------
    >>> from sar_imaging.recordings import read_poses
    >>> read_poses('bags/psf') is None  # its pulses have phase centres
    True
    """
    read = [message_types().deserialize_cdr(cdr, ODOMETRY_TYPE) for _, cdr in pose_messages(path)]
    return dataclasses.replace(
        pose_table((message, ODOMETRY_TYPE) for message in read),
        frame_id=read[0].header.frame_id, child_frame_id=read[0].child_frame_id) if read else None


def _messages(path: Path | str, topic: str, message_type: str, start_ns: int | None = None,
              stop_ns: int | None = None) -> Iterator[tuple[int, bytes]]:
    with _opened(path) as reader:
        connections = [c for c in reader.connections
                       if c.topic == topic and c.msgtype == message_type]
        if not connections:
            present = ', '.join(f'{c.topic} ({c.msgtype})' for c in reader.connections) or 'none'
            raise BagError(f'{path} has no topic {topic} of type {message_type}; topics in it: '
                           f'{present}. sar-imaging load makes a recording of the raw messages '
                           'of a radar driver, see docs/drivers.md')
        for _, time_ns, cdr in checked(reader.messages(connections, start_ns, stop_ns)):
            yield time_ns, bytes(cdr)


def read_blocks(path: Path | str) -> Iterator[PulseBlock]:
    """Read the pulse blocks of a recording one by one; raises as `raw_messages` does.

    Parameters
    ----------
    path : path
        Bag folder.

    Yields
    ------
    PulseBlock
        Of one message each.

    Examples
    --------
    >>> from sar_imaging.recordings import read_blocks
    >>> for block in read_blocks('bags/psf'):
    ...     print(block.samples.shape, block.compressed)
    ...     break
    (25, 5, 126) True
    """
    for number, (_, cdr) in enumerate(raw_messages(path)):
        with naming(path, f'has no pulse block in message {number}', BagError):
            block = deserialise(cdr)
        yield block


def read_truth(path: Path | str) -> dict[str, Any] | None:
    """Read the truth stored with a recording; None when it has none.

    Parameters
    ----------
    path : path
        Bag folder.

    Returns
    -------
    dict or None
        As `make_truth` makes it.

    Raises
    ------
    BagError
        The folder is no bag, or its truth is of a version this program does not know.

    Examples
    --------
    >>> from sar_imaging.recordings import read_truth
    >>> truth = read_truth('bags/psf')
    >>> [(s['name'], s['position_m']) for s in truth['scatterers']]
    [('centre', [10000.0, 0.0, 0.0])]
    """
    with _opened(path) as reader:
        text = (reader.storage.metadata.custom or {}).get(TRUTH_KEY)
    if text is None:
        return None
    with naming(path, 'has a truth that cannot be read', BagError):
        truth = json.loads(text)
        if not isinstance(truth, dict) or truth.get('version') != TRUTH_VERSION:
            raise BagError(f'{path}: truth of version {dict(truth).get("version")}; this program '
                           f'reads version {TRUTH_VERSION}')
        check_truth(truth)
        return truth


PULSES_PER_MESSAGE = 32


def split(block: PulseBlock, pulses_per_message: int = PULSES_PER_MESSAGE) -> Iterator[PulseBlock]:
    """Cut a block into blocks for one message each."""
    for first in range(0, block.n_pulses, pulses_per_message):
        yield block.select(slice(first, first + pulses_per_message))


def with_progress(blocks: Iterator[PulseBlock], n_pulses: int) -> Iterator[PulseBlock]:
    """Pass blocks on and show on a terminal how many of `n_pulses` have passed."""
    with tqdm(total=n_pulses, unit='pulse', disable=None) as bar:
        for block in blocks:
            yield block
            bar.update(block.n_pulses)
