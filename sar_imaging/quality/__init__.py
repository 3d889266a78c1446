"""Image quality: impulse responses, error against a reference, focus, entropy, contrast.

- `impulse_response`, `scatterers`: widths and sidelobes of cuts, and of scatterers in an image;
- `baseband`: images without their carrier, cropped and read between pixels;
- `measures`, `focus`: figures of whole images, with a reference and without;
- `verification`: error against time-domain correlation, from some pixels;
- `interpolation`: band-limited interpolation of sampled cuts and images.
"""

from .baseband import crop, project_on_plane, sample_image, to_baseband
from .focus import FocusFigure, focus_figure
from .impulse_response import ImpulseResponse, UnmeasurableError, impulse_response
from .measures import (
    contrast,
    entropy,
    error_db,
    mean_square_error,
    signal_to_distortion_db,
)
from .scatterers import ScattererQuality, measure_scatterer

__all__ = [
    'FocusFigure', 'ImpulseResponse', 'ScattererQuality', 'UnmeasurableError', 'contrast', 'crop',
    'entropy', 'error_db', 'focus_figure', 'impulse_response', 'mean_square_error',
    'measure_scatterer', 'project_on_plane', 'sample_image', 'signal_to_distortion_db',
    'to_baseband',
]
