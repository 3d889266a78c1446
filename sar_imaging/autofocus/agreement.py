"""Check whether two halves of the scene, each by itself, give the same geometry."""

from __future__ import annotations

import math

import numpy as np

from ..signal.pulses import PulseBlock
from .models import GeometryModel
from .residual import deal
from .search import detrend, search
from .tiles import Tiles

_SUBAPERTURES = 128
_FEWEST_POINTS = 2  # of a half


def disagreement_rad(block: PulseBlock, model: GeometryModel, parameters, points) -> float:
    """Rms difference of the phases that two halves of the bright points ask for, radians.

    Each half is searched for the sharpest parameters by itself, from the common ones on. What only
    displaces a tile does not count. An error that is right agrees to a fraction of a radian;
    parameters that merely make noise or ghosts sharper suit one half and not the other.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    model : GeometryModel
        Unknowns.
    parameters : (Q,) float64
        Found with all points.
    points : (K, 3) float64
        Bright points of the image with these parameters, metres.

    Returns
    -------
    float
        NaN where a half has fewer than two points.
    """
    geometry = model(parameters)
    half = deal(points, geometry)
    if not len(parameters) or min(np.bincount(half, minlength=2)) < _FEWEST_POINTS:
        return math.nan
    tiles = Tiles(block, geometry, points, min(_SUBAPERTURES, block.n_pulses))
    changes = []
    for k in (0, 1):
        found = search(block, model, points[half == k], parameters, first_segments=1)
        changes.append(tiles.half_path_change(model(found.parameters)))
    return float(tiles.wavenumber * np.sqrt(np.mean(np.square(detrend(changes[0] - changes[1])))))
