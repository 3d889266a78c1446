"""Image quality: point response figures, distortion against a reference, entropy, contrast."""

from .impulse_response import ImpulseResponse, UnmeasurableError, impulse_response
from .measures import (
    contrast,
    entropy,
    error_db,
    mean_square_error,
    signal_to_distortion_db,
)
from .scatterers import (
    ScattererQuality,
    crop,
    measure_scatterer,
    project_on_plane,
    sample_image,
    to_baseband,
)

__all__ = [
    'ImpulseResponse', 'ScattererQuality', 'UnmeasurableError', 'contrast', 'crop', 'entropy',
    'error_db', 'impulse_response', 'mean_square_error', 'measure_scatterer', 'project_on_plane',
    'sample_image', 'signal_to_distortion_db', 'to_baseband',
]
