"""Parameters of the antenna's pattern: which pixels a pulse lights."""

from __future__ import annotations

from collections.abc import Mapping

from sar_imaging.configuration.antenna import NONE, PATTERN_CHOICES, antenna_of
from sar_imaging.geometry.illumination import AntennaPattern

from ..runtime.parameters import ConfigurationError, Parameter, one_of

PATTERN = Parameter(
    'antenna.pattern', NONE, 'Pattern of the antenna, with which pulses add to pixels: '
    f'{", ".join(PATTERN_CHOICES)}; {NONE} lights all alike. Pulses tell where it looks, see '
    'antenna.pointing of pulse_buffer.', check=one_of(*PATTERN_CHOICES))
PARAMETERS = (
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


def pattern_from(parameters: Mapping[str, object]) -> AntennaPattern | None:
    """Pattern that the parameters describe; None where all pixels are lit alike.

    Raises
    ------
    ConfigurationError
        They describe none.
    """
    try:
        antenna = antenna_of(parameters)
    except ValueError as error:
        raise ConfigurationError(f'parameter {error}') from error
    return None if antenna is None else antenna.amplitudes()
