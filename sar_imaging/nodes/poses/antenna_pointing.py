"""Parameters of the antenna's mount, and the pointing of pulses by them."""

from __future__ import annotations

from collections.abc import Mapping

from sar_imaging.configuration.antenna import BLOCK, POINTING_CHOICES, mount_of
from sar_imaging.geometry.illumination import Mount

from ..runtime.parameters import ConfigurationError, Parameter, one_of


def _check_vector(values) -> None:
    if len(values) != 3:
        raise ValueError(f'{len(values)} numbers; expected x, y, z')


PARAMETERS = (
    Parameter('antenna.pointing', BLOCK, 'Where the antenna looks: as the pulse blocks tell, if '
              'they do, fixed to the platform, beside the track, to one point, or in rotation.',
              check=one_of(*POINTING_CHOICES)),
    Parameter('antenna.boresight', [0.0, 1.0, 0.0], 'For platform: boresight in the body frame of '
              'the poses, x, y, z.', check=_check_vector),
    Parameter('antenna.up', [0.0, 0.0, 1.0], 'For platform: upward direction of the antenna '
              'there.', check=_check_vector),
    Parameter('antenna.side', 'left', 'For track: side of the direction of flight, left or right.',
              check=one_of('left', 'right')),
    Parameter('antenna.squint', 0.0, 'For track: boresight from broadside, positive ahead.',
              'degrees', -90.0, 90.0),
    Parameter('antenna.depression', 0.0, 'For track and rotation: boresight below the horizon.',
              'degrees', -90.0, 90.0),
    Parameter('antenna.target', [0.0, 0.0, 0.0], 'For point: what the antenna looks at, x, y, z '
              'in the imaging frame.', 'm', check=_check_vector),
    Parameter('antenna.rotation_rate', 0.0, 'For rotation: counterclockwise seen from above.',
              'degrees per second', -1e5, 1e5),
    Parameter('antenna.rotation_start', 0.0, 'For rotation: boresight at the start, '
              'counterclockwise from the x axis.', 'degrees', -360.0, 360.0),
    Parameter('antenna.rotation_start_s', 0.0, 'For rotation: time of the start on the clock of '
              'the pulses.', 's', -1e10, 1e10),
)


def mount_from(parameters: Mapping[str, object]) -> Mount | None:
    """Mount that the parameters describe; None where pulses tell the pointing themselves.

    Raises
    ------
    ConfigurationError
        They describe none.
    """
    try:
        return mount_of(parameters)
    except ValueError as error:
        raise ConfigurationError(f'parameter {error}') from error
