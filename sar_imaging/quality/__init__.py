# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image quality: impulse responses, error against a reference, focus, entropy, contrast.

- `impulse_response`: widths and sidelobes of cuts, and of scatterers in an image;
- `measures`: figures of whole images, with a reference and without;
- `verification`: error against time-domain correlation, from some pixels;
- `interpolation`: band-limited interpolation of sampled cuts, and of images without their carrier.
"""

from .impulse_response import (
    ImpulseResponse,
    ScattererQuality,
    UnmeasurableError,
    impulse_response,
    measure_scatterer,
)
from .interpolation import crop, project_on_plane, sample_image, to_baseband
from .measures import (
    FocusFigure,
    contrast,
    entropy,
    error_db,
    focus_figure,
    mean_square_error,
    signal_to_distortion_db,
)

__all__ = [
    'FocusFigure', 'ImpulseResponse', 'ScattererQuality', 'UnmeasurableError', 'contrast', 'crop',
    'entropy', 'error_db', 'focus_figure', 'impulse_response', 'mean_square_error',
    'measure_scatterer', 'project_on_plane', 'sample_image', 'signal_to_distortion_db',
    'to_baseband',
]
