"""A geometry model whose offset of two clocks is searched for over a wide range."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from .models import Geometry, GeometryModel
from .offset_curve import OffsetCurve

OFFSET = 'time_offset_s'  # its parameter
_NARROWED_STEPS = 2.0  # what an offset may still be wrong by, after the coarse search


def by_offset(model: GeometryModel) -> Callable[[float], Geometry]:
    """Geometry as a function of the offset of the clocks alone."""
    which = model.names.index(OFFSET)

    def geometry(offset_s: float) -> Geometry:
        parameters = model.start.copy()
        parameters[which] += offset_s
        return model(parameters)

    return geometry


def within(model: GeometryModel, lowest_s: float, highest_s: float) -> GeometryModel:
    """The model with errors of the offset held where the track is known, for searches' steps."""
    which = model.names.index(OFFSET)
    middle = model.start[which]

    def geometry(parameters):
        held = np.array(parameters, np.float64)
        held[which] = np.clip(held[which], middle + lowest_s, middle + highest_s)
        return model(held)

    return dataclasses.replace(model, function=geometry)


def narrowed(model: GeometryModel, curve: OffsetCurve) -> GeometryModel:
    """The model begun at the offset that the curve tells, which is hardly wrong any more."""
    which = model.names.index(OFFSET)
    start, scale = model.start.copy(), model.scale.copy()
    start[which] += curve.best_s
    scale[which] = min(scale[which], _NARROWED_STEPS * curve.step_s)
    return dataclasses.replace(model, start=start, scale=scale)
