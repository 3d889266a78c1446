# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Raw radar messages and poses from ROS bags, of ROS 1 or 2, by the definitions in the bag."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from msg_conversions.radar_frames import FRAME_TYPES, INFO_TYPES, read_frame, read_info, short_name

from ..geometry.poses import PoseTable
from ..names import advice_on
from .bag_files import checked
from .bag_io import POSE_TYPES, BagError, message_types, pose_table, reading_bag
from .description import DescriptionError
from .frames import FrameError, Received


@contextlib.contextmanager
def open_bag(path: Path) -> Iterator[Any]:
    """Reader of a bag, ROS 1 or 2, opened.

    Raises
    ------
    BagError
        It cannot be read, or rosbags is not installed.
    """
    # Definitions in the recording go before; old ones have none, and then Jazzy's count.
    default = message_types()  # tells where rosbags is missing
    from rosbags.highlevel import AnyReader

    path = Path(path)
    if not path.exists():
        raise BagError(f'{path} does not exist; expected a ROS 1 bag or the folder of a ROS 2 bag')
    with reading_bag(path, 'cannot be read as a whole ROS 1 bag, .mcap file or folder of a ROS 2 '
                     'bag (`ros2 bag reindex` and `mcap recover` mend one whose recorder was '
                     'killed)', lambda path: AnyReader([path], default_typestore=default)) as bag:
        yield bag


def read_bag_poses(path: Path, topic: str | None = None) -> PoseTable:
    """Poses of a bag.

    Parameters
    ----------
    path : Path
        ROS 1 file, or folder of a ROS 2 bag.
    topic : str, optional
        Topic of type Odometry, PoseStamped, PoseWithCovarianceStamped or TransformStamped; needed
        where the bag has several of these.

    Raises
    ------
    DescriptionError
        The bag has no such topic, or several.
    BagError
        It cannot be read.
    """
    with open_bag(path) as bag:
        fit = [c for c in bag.connections
               if c.msgtype in POSE_TYPES and (topic is None or c.topic == topic)]
        if len({c.topic for c in fit}) != 1:
            present = ', '.join(sorted(f'{c.topic} ({c.msgtype})' for c in bag.connections))
            raise DescriptionError(
                f'{Path(path).name}: expected {"one topic" if topic is None else topic} with '
                f'poses ({", ".join(POSE_TYPES)}); it has {present or "no topic"}: name one in '
                'poses.topic')
        return pose_table((bag.deserialize(raw, connection.msgtype), connection.msgtype)
                          for connection, _, raw in checked(bag.messages(connections=fit)))


def read_bag_frames(path: Path, topic: str, sizes: Mapping[str, int],
                    axes: Sequence[str] | None) -> Iterator[tuple[Received, int]]:
    """Frames of a topic, after the numbers of all messages that describe a radar.

    Parameters
    ----------
    path : Path
        ROS 1 file, or folder of a ROS 2 bag.
    topic : str
        With raw messages.
    sizes, axes
        See `msg_conversions.radar_frames.read_frame`.

    Yields
    ------
    item : RawFrame, mapping or FrameError
        Frame, numbers of the radar, or why a message holds no frame.
    received_ns : int
        When it was recorded, nanoseconds.

    Raises
    ------
    DescriptionError
        The bag has no such topic of a known type.
    BagError
        It cannot be read.
    """
    with open_bag(path) as bag:
        frames = [c for c in bag.connections
                  if c.topic == topic and short_name(c.msgtype) in FRAME_TYPES]
        if not frames:
            present = ', '.join(sorted(f'{c.topic} ({c.msgtype})' for c in bag.connections))
            raw = [c.topic for c in bag.connections if short_name(c.msgtype) in FRAME_TYPES]
            raise DescriptionError(
                f'samples.topic: {Path(path).name} has no topic {topic} of a type '
                f'{", ".join(FRAME_TYPES)}; it has {present or "no topic"}'
                + (f': {advice_on(topic, raw)}' if raw else ''))
        infos = [c for c in bag.connections if short_name(c.msgtype) in INFO_TYPES]
        told = bag.messages(connections=infos) if infos else ()
        for connection, time_ns, raw in checked(told):
            yield read_info(bag.deserialize(raw, connection.msgtype), connection.msgtype), time_ns
        with tqdm(total=sum(c.msgcount for c in frames), unit='frame', disable=None) as bar:
            for connection, time_ns, raw in checked(bag.messages(connections=frames)):
                try:
                    message = bag.deserialize(raw, connection.msgtype)
                    yield read_frame(message, connection.msgtype, sizes, axes), time_ns
                except FrameError as error:
                    yield error, time_ns
                bar.update(1)
