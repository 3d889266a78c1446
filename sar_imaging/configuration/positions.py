# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Check the source of positions, and what images are weighed and calibrated by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from .antenna import check_antenna
from .constraints import Finding, refusal
from .datum import check_datum, datum_rows
from .radiometry import check_radiometry
from .settings import Acquisition

BLOCK = 'block'
_BUFFER = 'pulse_buffer'
_ARMS = ('antenna.tx', 'antenna.rx')


def check_positions(nodes: Mapping[str, Mapping[str, Any]],
                    acquisition: Acquisition | None) -> list[Finding]:
    """What is wrong with frames, lever arms, the antenna and calibrated brightness.

    Parameters
    ----------
    nodes : mapping
        Parameters of the nodes by name, see `parameters.Configuration`.
    acquisition : Acquisition or None
        Radar and platform; None where the file does not describe them.

    Returns
    -------
    list of Finding
    """
    found = [*_check_frames(nodes), *check_datum(nodes), *check_antenna(nodes),
             *check_radiometry(nodes)]
    buffer = nodes[_BUFFER]
    if buffer['pose.source'] != BLOCK:
        found += refusal(imaging_frame, buffer)
        found += _check_counts(buffer, acquisition)
        if acquisition is not None and not found:
            found += _check_places(buffer, acquisition)
    return found


def position_rows(nodes: Mapping[str, Mapping[str, Any]],
                  acquisition: Acquisition) -> list[tuple[str, str, str]]:
    """Where positions come from, in words: name, value, explanation."""
    buffer, imager = nodes[_BUFFER], nodes['backprojection']
    source, frame = buffer['pose.source'], buffer['frame_id']
    datum = datum_rows(buffer)
    if source == BLOCK:
        return [('positions', 'pulses', f'every pulse states those of its antennas, in {frame}'),
                *datum]
    searched = imager['autofocus.time_offset']
    moved = f'{0.1 * acquisition.speed_m_per_s:.3g} m'
    return [('positions', source, f'of the platform, in frame {frame} as grid and images'),
            ('clock of the poses', f'{buffer["pose.time_offset_s"]:g} s',
             f'ahead of the radar; autofocus looks for up to {searched:g} s' if searched else
             f'ahead of the radar; nothing checks it: 0.1 s would move images by {moved}; '
             'autofocus.time_offset estimates it'), *datum]


def _check_frames(nodes: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    frames: dict[str, list[str]] = {}
    for name, values in nodes.items():
        if 'frame_id' in values:
            frames.setdefault(plain_frame(values['frame_id']), []).append(name)
    if len(frames) > 1:
        words = '; '.join(f'{frame or "empty"} in {", ".join(names)}'
                          for frame, names in frames.items())
        yield Finding('error', f'frame_id is not the same in all nodes: {words}; set it once, in '
                      'the section /**')


def plain_frame(name: str) -> str:
    """Name of a frame without the leading slash that tf took before ROS 2."""
    return name.lstrip('/')


def imaging_frame(values: Mapping[str, Any]) -> str:
    """Frame of poses, grid and images alike.

    Parameters
    ----------
    values : mapping
        Parameters of a node that takes poses, by name.

    Raises
    ------
    ValueError
        Poses are to be in another frame than the images, or nobody names that of these.
    """
    poses, images = (plain_frame(values[name]) for name in ('pose.frame_id', 'frame_id'))
    if not images:
        raise ValueError('frame_id is empty; expected the frame of positions and images, such as '
                         'odom')
    if poses and poses != images:
        raise ValueError(f'pose.frame_id={poses}, but grid and images are in frame_id={images}: '
                         f'poses are not transformed; set frame_id: {poses}, with the grid in '
                         'that frame, and leave pose.frame_id empty')
    return images


def lever_arms(values: Mapping[str, Any], name: str) -> list[str] | list[tuple[float, ...]]:
    """Places of phase centres on the platform, each a frame of tf or x, y, z in metres.

    Parameters
    ----------
    values : mapping
        Parameters of a node that takes poses, by name.
    name : str
        ``antenna.tx`` or ``antenna.rx``.
    """
    names, numbers = values[f'{name}_frames'], values[name]
    if names.strip():
        return [part.strip() for part in names.split(',')]
    return [tuple(numbers[i:i + 3]) for i in range(0, len(numbers), 3)]


def _check_counts(buffer: Mapping[str, Any], acquisition: Acquisition | None) -> Iterator[Finding]:
    """As many lever arms as channels, or one for all: else the nodes reject every block."""
    counts = {name: len(lever_arms(buffer, name)) for name in _ARMS}
    counts['antenna.offset_s'] = len(buffer['antenna.offset_s'])
    broken = [name for name in _ARMS if len(buffer[name]) % 3]
    for name in broken:
        yield Finding('error', f'{name} has {len(buffer[name])} numbers; expected x, y, z of one '
                      'phase centre for all channels, or of one for each')
    channels = acquisition.n_channels if acquisition else max(counts.values())
    for name, count in counts.items():
        if count not in (1, channels) and name not in broken:
            what = 'times' if name == 'antenna.offset_s' else 'phase centres'
            yield Finding('error', f'{name} has {count} {what} for {channels} channels: the nodes '
                          'would reject every block of pulses; give one for all or one for each')


def _check_places(buffer: Mapping[str, Any], acquisition: Acquisition) -> Iterator[Finding]:
    """Several channels at one place, which nobody said or which contradicts the radar."""
    channels, spacing = acquisition.n_channels, acquisition.channel_spacing_m
    places = [lever_arms(buffer, name) for name in _ARMS]
    if channels == 1 or any(len(set(some)) > 1 for some in places):
        return
    said = any(len(some) == channels for some in places)
    if said and not spacing:
        return  # such as two polarisations of one antenna
    first = -0.5 * (channels - 1) * spacing
    arms = ', '.join(f'{v:g}' if v else '0.0' for n in range(channels)
                     for v in (round(first + n * spacing, 9), 0.0, 0.0))
    example = (f'such as antenna.rx: [{arms}] for receivers {spacing:g} m apart along the flight '
               '(x of the body is forward)' if spacing else
               'x, y, z of each channel in antenna.rx, also where they are the same')
    yield Finding('error', f'positions come from {buffer["pose.source"]} and {channels} channels '
                  f'have no lever arms of their own: all would be imaged as if they were at one '
                  f'place; give the place of each antenna on the platform, {example}')
