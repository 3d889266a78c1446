"""Autofocus: estimate motion and phase errors from the image itself.

- `autofocus`: estimates, images again exactly, and accepts only what is better (`report`);
- `models`, `alignment_model`, `track`: what may be wrong with the geometry;
- `search`, `offset_search`, `residual`, `agreement`: how it is found and how far it is believed;
- `tiles`: the small tiles around bright points that are looked at;
- `phase_gradient`: phase gradient autofocus of polar images; `live`: autofocus in the nodes.
"""

from .autofocus import Autofocus, AutofocusReport, AutofocusResult
from .models import (
    Geometry,
    GeometryModel,
    apply_geometry,
    nominal,
    with_range_bias,
    with_time_offset,
    with_track_error,
)

__all__ = [
    'Autofocus', 'AutofocusReport', 'AutofocusResult', 'Geometry', 'GeometryModel',
    'apply_geometry', 'nominal', 'with_range_bias', 'with_time_offset', 'with_track_error',
]
