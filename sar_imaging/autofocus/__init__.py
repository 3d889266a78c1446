# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus: estimate motion and phase errors from the image itself.

- `autofocus`: estimates errors, images again, accepts only sharper images (`report`);
- `corrected_track`: the track that the image tells, with covariances;
- `evidence`: whether to use an answer, and to claim it;
- `models`, `track`: geometries with unknown parameters;
- `search`, `residual`: estimates of the parameters; `offset_search`, `offset_curve`: of an
  offset of the clocks, and what that is worth;
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
