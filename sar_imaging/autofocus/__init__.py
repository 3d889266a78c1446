"""Motion and phase errors estimated from the image itself."""

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
