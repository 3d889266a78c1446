"""Frame of a track: mean phase centres, main axes, and the side on which the scene lies."""

from __future__ import annotations

import math

import numpy as np

_LEAST_LENGTH = 1e-12  # metres
_LEAST_EXTENT = 1e-6  # of the distance to the scene: a shorter track has no direction


def mean_centres(tx_m, rx_m) -> np.ndarray:
    """(P, 3) float64 mean of all phase centres (P, C, 3) of each pulse, metres."""
    return 0.5 * (np.asarray(tx_m) + rx_m).mean(axis=1)


def unit_vector(vector) -> np.ndarray:
    """(D,) float64 vector of length one, or of none where it has none."""
    vector = np.asarray(vector, np.float64)
    return vector / max(math.hypot(*vector), _LEAST_LENGTH)


def main_axis(places_m) -> tuple[np.ndarray, np.ndarray]:
    """Axes of places, (K, D), by their extent, and the extents, metres.

    Returns
    -------
    axes : (min(K, D), D) float64
        Unit vectors, the longest extent first; their signs are arbitrary.
    extents : (min(K, D),) float64
        Root of the sum of squares along each, metres.
    """
    places_m = np.asarray(places_m, np.float64)
    _, extents, axes = np.linalg.svd(places_m - places_m.mean(axis=0), full_matrices=False)
    return axes, extents


def track_beside(centres_m, scene_m) -> tuple[np.ndarray, int]:
    """Horizontal direction of a track and the side on which a scene lies.

    Parameters
    ----------
    centres_m : (P, 3) float64
        Phase centres, metres.
    scene_m : (2,) or (3,) array_like
        Middle of the scene, metres.

    Returns
    -------
    track : (2,) float64
        Unit vector; broadside to the scene where the track is a point or runs straight up.
    side : int
        +1 where the scene is to the left of it, -1 to the right.
    """
    look = np.asarray(scene_m, np.float64)[:2] - centres_m.mean(axis=0)[:2]
    distance = max(math.hypot(*look), 1e-9)
    axes, extents = main_axis(centres_m[:, :2])
    track = axes[0]
    if extents[0] <= _LEAST_EXTENT * distance:
        track = np.array([-look[1], look[0]]) / distance
    return track, side_of(track, look)


def side_of(track, look) -> int:
    """+1 where a horizontal look is to the left of a track, -1 to the right."""
    return 1 if track[0] * look[1] - track[1] * look[0] >= 0 else -1
