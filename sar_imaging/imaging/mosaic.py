"""Strip of map patches that follow the platform, on one lattice of pixels."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.grids import MapGrid


def patch_beside(grid: MapGrid, track_m, ahead_left_m: tuple[float, float]) -> MapGrid:
    """Map patch beside an aperture, on the pixels that a grid continues to.

    Parameters
    ----------
    grid : MapGrid
        Size, spacing, height and lattice of the patch.
    track_m : (P, 2) float64
        Horizontal phase centres of the aperture, metres.
    ahead_left_m : (float, float)
        From the middle of the aperture to that of the patch: ahead along the direction of
        flight, and to the left of it, metres.

    Returns
    -------
    MapGrid
    """
    flight = track_m[-1] - track_m[0]
    ahead, left = ahead_left_m
    u = flight / max(math.hypot(*flight), 1e-12)
    wanted = track_m.mean(axis=0) + ahead * u + left * np.array([-u[1], u[0]])
    steps = np.rint((wanted - grid.centre_m[:2]) / grid.spacing_m)
    return dataclasses.replace(grid, centre_m=(
        *(grid.centre_m[:2] + steps * grid.spacing_m), grid.z_m))
