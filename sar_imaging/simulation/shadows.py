# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Shadows in a simulated scene: boxes and tree crowns between the radar and the scatterers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

_TOUCHING_M = 0.05  # a ray that leaves the surface of its own box is not in its shadow


@dataclasses.dataclass(frozen=True)
class Box:
    """Opaque body on the ground: a building or a car.

    Parameters
    ----------
    x_m, y_m : (2,) floats
        From and to, imaging frame, metres.
    height_m : float
        Above the ground at z = 0, metres.
    """

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    height_m: float

    def path_m(self, points_m: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Length of the rays inside the body.

        Parameters
        ----------
        points_m : (S, 3) float64
            Where the rays begin, metres.
        direction : (S, 3) float64
            Unit vectors.

        Returns
        -------
        (S,) float64
            Metres.
        """
        enter, leave = np.zeros(len(points_m)), np.full(len(points_m), np.inf)
        bounds = (self.x_m, self.y_m, (0.0, self.height_m))
        for axis, (low, high) in enumerate(bounds):
            with np.errstate(divide='ignore', invalid='ignore'):
                a, b = ((edge - points_m[:, axis]) / direction[:, axis] for edge in (low, high))
            enter, leave = np.fmax(enter, np.fmin(a, b)), np.fmin(leave, np.fmax(a, b))
        return np.maximum(leave - enter, 0.0)


@dataclasses.dataclass(frozen=True)
class Crown:
    """Sphere of leaves, which lets a part of the wave through.

    Parameters
    ----------
    centre_m : (3,) floats
        Imaging frame, metres.
    radius_m : float
        Metres.
    """

    centre_m: tuple[float, float, float]
    radius_m: float

    def path_m(self, points_m: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Length of the rays inside the sphere, see `Box.path_m`."""
        offset = points_m - self.centre_m
        middle = -np.einsum('sa,sa->s', offset, direction)
        squared = self.radius_m**2 - np.einsum('sa,sa->s', offset, offset) + middle**2
        half = np.sqrt(np.maximum(squared, 0.0))
        return np.where(squared > 0, np.maximum(middle + half, 0)
                        - np.maximum(middle - half, 0), 0.0)


def transmission(points_m: np.ndarray, radar_m: Iterable[float], boxes: Iterable[Box],
                 crowns: Iterable[Crown], loss_db_per_m: float) -> np.ndarray:
    """Part of the amplitude that comes from each point to the radar and back.

    Rays are straight, edges sharp: no diffraction.

    Parameters
    ----------
    points_m : (S, 3) float64
        Scatterers, metres.
    radar_m : (3,) floats
        Phase centre, metres.
    boxes, crowns : iterables of Box and of Crown
        What stands in the way.
    loss_db_per_m : float
        Loss of crowns, one way, dB per metre.

    Returns
    -------
    (S,) float64
        0 in the shadow of a box, 1 in the open.
    """
    direction = np.asarray(radar_m, float) - points_m
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    leaves_m = sum((c.path_m(points_m, direction) for c in crowns), np.zeros(len(points_m)))
    out = 10 ** (-2 * loss_db_per_m * leaves_m / 20)
    for box in boxes:
        out[box.path_m(points_m, direction) > _TOUCHING_M] = 0.0
    return out
