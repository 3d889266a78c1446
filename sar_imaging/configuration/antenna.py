# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The antenna of a configuration: its pattern and its pointing, by parameters of the nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..geometry.antenna import (
    MEASURED,
    MOUNTS as MOUNTS,
    PATTERNS as PATTERNS,
    POINT,
    ROTATION,
    TRACK,
    Antenna,
    Mount,
)
from .constraints import Finding, refusal

NONE, BLOCK = 'none', 'block'
PATTERN_CHOICES = (NONE, *PATTERNS)
POINTING_CHOICES = (BLOCK, *MOUNTS)
# Parameters of pulse_buffer and the fields of `Mount`, by kind.
_FIELDS = {'antenna.boresight': 'boresight', 'antenna.up': 'up', 'antenna.side': 'side',
           'antenna.squint': 'squint_deg', 'antenna.depression': 'depression_deg',
           'antenna.target': 'target_m', 'antenna.rotation_rate': 'rate_deg_per_s',
           'antenna.rotation_start': 'start_deg', 'antenna.rotation_start_s': 'start_s'}
_USED = {TRACK: ('antenna.side', 'antenna.squint', 'antenna.depression'),
         POINT: ('antenna.target',),
         ROTATION: ('antenna.depression', 'antenna.rotation_rate', 'antenna.rotation_start',
                    'antenna.rotation_start_s')}
_WITHOUT_ATTITUDE = {BLOCK: 'pulses have positions only', 'fix': 'fixes have no attitude'}


def antenna_of(parameters: Mapping[str, Any]) -> Antenna | None:
    """Antenna that parameters of backprojection describe; None where all pixels are lit alike.

    Raises
    ------
    ValueError
        They describe none; the text names the parameter.
    """
    kind, file = parameters['antenna.pattern'], parameters['antenna.pattern_file']
    if kind not in PATTERN_CHOICES:
        raise ValueError(f'antenna.pattern={kind!r}; expected one of {", ".join(PATTERN_CHOICES)}')
    if bool(file) != (kind == MEASURED):
        raise ValueError(f'antenna.pattern={kind} and antenna.pattern_file={file!r}; expected '
                         f'antenna.pattern: {MEASURED} with the file of a table, and no file '
                         'otherwise')
    if kind == NONE:
        return None
    try:
        if file:
            return Antenna.load(file)
        return Antenna(kind, parameters['antenna.azimuth_width'],
                       parameters['antenna.elevation_width'], parameters['antenna.cutoff'])
    except ValueError as error:
        raise ValueError(f'antenna.pattern={kind}: {error}') from error


def mount_of(parameters: Mapping[str, Any]) -> Mount | None:
    """Mount that parameters of pulse_buffer describe; None where pulses tell the pointing.

    Raises
    ------
    ValueError
        They describe none; the text names the parameter.
    """
    kind = parameters['antenna.pointing']
    if kind not in POINTING_CHOICES:
        raise ValueError(f'antenna.pointing={kind!r}; expected one of '
                         f'{", ".join(POINTING_CHOICES)}')
    if kind == BLOCK:
        return None
    try:
        mount = Mount(kind, **{field: parameters[name] for name, field in _FIELDS.items()})
    except ValueError as error:
        raise ValueError(f'antenna.pointing={kind}: {error}') from error
    source = parameters['pose.source']
    if mount.needs_attitude and source in _WITHOUT_ATTITUDE:
        raise ValueError(f'antenna.pointing={kind} needs the attitude of the platform, and with '
                         f'pose.source={source} {_WITHOUT_ATTITUDE[source]}; expected pose.source '
                         'odometry, pose, tf or fix_imu, or antenna.pointing track')
    return mount


def antenna_parameters(antenna: Antenna | None, mount: Mount | None,
                       pattern_file: str = '') -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of pulse_buffer and of backprojection for an antenna and its mount.

    Parameters
    ----------
    antenna : Antenna or None
        The antenna.
    mount : Mount or None
        Its mount; None where pulses tell the pointing.
    pattern_file : str
        Where the table of a measured antenna is, for backprojection to read.
    """
    buffer: dict[str, Any] = {}
    imager: dict[str, Any] = {}
    if mount is not None:
        names = _USED.get(mount.kind, ('antenna.boresight', 'antenna.up'))
        values = {name: getattr(mount, _FIELDS[name]) for name in names}
        buffer = {'antenna.pointing': mount.kind} | {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()}
    if antenna is not None:
        imager = {'antenna.pattern': antenna.pattern} | (
            {'antenna.pattern_file': pattern_file} if antenna.pattern == MEASURED else
            {'antenna.azimuth_width': antenna.azimuth_width_deg,
             'antenna.elevation_width': antenna.elevation_width_deg,
             'antenna.cutoff': antenna.cutoff_widths})
    return buffer, imager


def check_antenna(nodes: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """What is wrong with the antenna of a configuration.

    Parameters
    ----------
    nodes : mapping
        Parameters of the nodes by name, see `parameters.Configuration`.
    """
    imager, buffer = nodes['backprojection'], nodes['pulse_buffer']
    errors = refusal(antenna_of, imager) or refusal(mount_of, buffer)
    yield from errors
    if not errors and imager['antenna.pattern'] == NONE and buffer['antenna.pointing'] != BLOCK:
        yield Finding('warning', f'antenna.pointing={buffer["antenna.pointing"]}, but '
                      'antenna.pattern=none: pulses tell where the antenna looks, and images make '
                      'no use of it; set antenna.pattern of backprojection')
