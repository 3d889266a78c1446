"""Autofocus: estimate motion and phase errors from the image itself.

- `autofocus`: estimates errors, images again, accepts only sharper images (`report`);
- `evidence`: whether to use an answer, and to claim it;
- `models`, `offset_models`, `alignment_model`, `track`: geometries with unknown parameters;
- `search`, `offset_search`, `residual`, `agreement`: estimates of the parameters, and checks;
- `tiles`: image tiles around bright points;
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
