"""Raw radar messages from ROS bags, of ROS 1 or 2, by the definitions in the bag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tqdm import tqdm

from msg_conversions.radar_frames import (
    FRAME_TYPES,
    INFO_TYPES,
    read_frame,
    read_info,
    short_name,
)
from sar_imaging.loading import DescriptionError
from sar_imaging.loading.frames import FrameError
from sar_imaging.names import advice_on

from ..recordings.bag_files import checked
from .bag_poses import open_bag


def read_bag_frames(path: Path, topic: str, sizes: Mapping[str, int],
                    axes: Sequence[str] | None) -> Iterator[tuple[object, int]]:
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
