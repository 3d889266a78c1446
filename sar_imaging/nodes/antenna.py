# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the antenna: which pixels a pulse lights, and where it looks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sar_imaging.configuration.antenna import (
    BLOCK,
    NONE,
    PATTERN_CHOICES,
    POINTING_CHOICES,
    antenna_of,
)
from sar_imaging.geometry.illumination import AntennaPattern

from .runtime.parameters import Parameter, check_vector, one_of, refused

PATTERN = Parameter(
    'antenna.pattern', NONE, 'Pattern of the antenna, with which pulses add to pixels: '
    f'{", ".join(PATTERN_CHOICES)}; {NONE} lights all alike. Pulses tell where it looks, see '
    'antenna.pointing of pulse_buffer.', check=one_of(*PATTERN_CHOICES))
PATTERN_PARAMETERS = (
    PATTERN,
    Parameter('antenna.azimuth_width', 0.0, 'Full width of the pattern between its half-power '
              'points, of one way, in azimuth.', 'degrees', 0.0, 180.0),
    Parameter('antenna.elevation_width', 0.0, 'The same in elevation; 0.0: all elevations are lit '
              'alike.', 'degrees', 0.0, 180.0),
    Parameter('antenna.cutoff', 0.0, 'Where the pattern ends off boresight; pixels beyond take no '
              'part. 0.0: where the kind of pattern does.', 'widths', 0.0, 100.0),
    Parameter('antenna.pattern_file', '', 'YAML file with the measured gain over azimuth and '
              'elevation, for antenna.pattern measured.'),
)


def pattern_from(parameters: Mapping[str, Any]) -> AntennaPattern | None:
    """Pattern that the parameters describe; None where all pixels are lit alike.

    Raises
    ------
    ConfigurationError
        They describe none.
    """
    with refused('parameter '):
        antenna = antenna_of(parameters)
    return None if antenna is None else antenna.amplitudes()


POINTING_PARAMETERS = (
    Parameter('antenna.pointing', BLOCK, 'Where the antenna looks: as the pulse blocks tell, if '
              'they do, fixed to the platform, beside the track, to one point, or in rotation.',
              check=one_of(*POINTING_CHOICES)),
    Parameter('antenna.boresight', [0.0, 1.0, 0.0], 'For platform: boresight in the body frame of '
              'the poses, x, y, z.', check=check_vector),
    Parameter('antenna.up', [0.0, 0.0, 1.0], 'For platform: upward direction of the antenna '
              'there.', check=check_vector),
    Parameter('antenna.side', 'left', 'For track: side of the direction of flight, left or right.',
              check=one_of('left', 'right')),
    Parameter('antenna.squint', 0.0, 'For track: boresight from broadside, positive ahead.',
              'degrees', -90.0, 90.0),
    Parameter('antenna.depression', 0.0, 'For track and rotation: boresight below the horizon.',
              'degrees', -90.0, 90.0),
    Parameter('antenna.target', [0.0, 0.0, 0.0], 'For point: what the antenna looks at, x, y, z '
              'in the imaging frame.', 'm', check=check_vector),
    Parameter('antenna.rotation_rate', 0.0, 'For rotation: counterclockwise seen from above.',
              'degrees per second', -1e5, 1e5),
    Parameter('antenna.rotation_start', 0.0, 'For rotation: boresight at the start, '
              'counterclockwise from the x axis.', 'degrees', -360.0, 360.0),
    Parameter('antenna.rotation_start_s', 0.0, 'For rotation: time of the start on the clock of '
              'the pulses.', 's', -1e10, 1e10),
)
