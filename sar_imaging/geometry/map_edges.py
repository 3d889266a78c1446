"""Edges of a map in polar coordinates, and the margin that its interpolation needs."""

from __future__ import annotations

import numpy as np

from .grids import MapGrid

EDGE_SAMPLES = 65  # per edge of the map


def edge_positions(grid: MapGrid, origin_m, track, axis: int,
                   reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and directions of a map's edges.

    A row of the map that slants across the ranges leaves its directions on the way to the ranges
    beyond it that its last pixels are interpolated from.

    Parameters
    ----------
    grid : MapGrid
        Map.
    origin_m : (3,) floats
        Of the polar coordinates, metres.
    track : (2,) floats
        Horizontal unit vector from which directions are measured.
    axis : int
        Map axis that follows range.
    reach_m : float
        How far beyond a pixel its row is read along range, metres.

    Returns
    -------
    range_m : (E,) float64
        Distances of points on the edges from the origin, metres.
    alpha : (3, E) float64
        Direction cosines of the row at the nearest range that is read, at the point itself and at
        the furthest.
    """
    x = np.linspace(grid.x_m[0], grid.x_m[-1], EDGE_SAMPLES) - origin_m[0]
    y = np.linspace(grid.y_m[0], grid.y_m[-1], EDGE_SAMPLES) - origin_m[1]
    pairs = [(x, end) for end in y[[0, -1]]] + [(end, y) for end in x[[0, -1]]]
    edges = np.concatenate([np.stack(np.broadcast_arrays(*pair), axis=-1) for pair in pairs])
    height2 = (origin_m[2] - grid.z_m) ** 2
    range_m = np.sqrt((edges ** 2).sum(axis=1) + height2)
    read = range_m + reach_m * np.array([[-1.0], [0.0], [1.0]])
    row = edges[:, 1 - axis]
    ahead = np.sqrt(np.maximum(read ** 2 - row ** 2 - height2, 0.0))
    ahead = np.copysign(ahead, edges[:, axis])
    return range_m, (ahead * track[axis] + row * track[1 - axis]) / read
