"""Parameters of backprojection."""

from __future__ import annotations

from sar_imaging.backends import AUTO
from sar_imaging.imaging.methods import AFBP, EXACT

from .images import (
    antenna_pattern,
    autofocus,
    image_brightness,
    image_files,
    image_products,
    obstacle_products,
    volume_cloud,
)
from .images.image_grid import GRID_PARAMETERS
from .images.terrain import TERRAIN_FILE
from .poses import pose_input
from .runtime.backends import BACKEND
from .runtime.parameters import ANY_TIME, Parameter, one_of

IMAGE, SUBAPERTURES, VOLUME = 'image', 'subapertures', 'volume'
MIN_PULSE_FRACTION = Parameter(
    'min_pulse_fraction', 0.5, 'Least share of its pulses that an aperture needs to be imaged.',
    '', 0.0, 1.0, changes=ANY_TIME)

PARAMETERS = (
    Parameter('mode', IMAGE, f'{IMAGE}: exact images of whole apertures; {SUBAPERTURES}: '
              f'sub-aperture images for afbp_fusion; {VOLUME}: exact volumes as point clouds.',
              check=one_of(IMAGE, SUBAPERTURES, VOLUME)),
    *GRID_PARAMETERS,
    TERRAIN_FILE,
    Parameter('aperture_timeout_s', 5.0, 'An aperture is closed when no input came for this long, '
              'by the wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME),
    MIN_PULSE_FRACTION,
    Parameter('method', EXACT, f'Imager in mode {IMAGE}: {EXACT} backprojection, as pulses come; '
              f'{AFBP} of whole apertures; {AUTO}: of these the quicker one that meets target_db.',
              check=one_of(AUTO, EXACT, AFBP)),
    BACKEND,
    Parameter('target_db', -80.0, 'Largest predicted error against time-domain correlation in '
              f'modes {IMAGE} and {VOLUME}.', 'dB', -100.0, -20.0),
    Parameter('subapertures.target_db', -60.0, 'Largest predicted error in mode '
              f'{SUBAPERTURES}.', 'dB', -85.0, -20.0),
    Parameter('subapertures.pulses', 0, 'Length of a sub-aperture; 0 for the quickest.', 'pulses',
              0, 2**31 - 1),
    Parameter('subapertures.sliding', False, 'Every sub-aperture ends an image of one '
              "aperture's length."),
    Parameter('subapertures.follow', False, 'The image moves along with the antenna, on the '
              'pixels that the grid continues to.'),
    Parameter('subapertures.follow_ahead', 0.0, 'From the middle of an aperture to that of its '
              'image, along the direction of flight.', 'm', -1e6, 1e6),
    Parameter('subapertures.follow_left', 0.0, 'From the middle of an aperture to that of its '
              'image, to the left of the direction of flight.', 'm', -1e6, 1e6),
    *autofocus.PARAMETERS,
    *pose_input.TRACK_PARAMETERS,
    *antenna_pattern.PARAMETERS,
    *image_brightness.PARAMETERS,
    *image_products.PARAMETERS,
    *image_files.PARAMETERS,
    *obstacle_products.PARAMETERS,
    *volume_cloud.PARAMETERS,
)
