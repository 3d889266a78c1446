"""Extent of the scene as the platform sees it: ranges and directions over an aperture."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from .settings import Acquisition, Imaging

_TRACK_POINTS = 33  # of the aperture, and of each side of the grid


@dataclasses.dataclass(frozen=True)
class Scene:
    """Ranges and directions of the grid.

    Parameters
    ----------
    range_m : float
        From the middle of the aperture to the middle of the grid, metres.
    near_m, far_m : float
        Least and largest distance of a pixel during the aperture, metres.
    direction : (2,) floats
        Least and largest direction cosine to the track, seen from the middle of the aperture.
    grazing_cosine : float
        Ground range over slant range at the middle of the grid.
    across_cosine : float
        Part of the cross-range direction that lies in the ground and across the line of sight.
    squint_sine : float
        Sine of the angle between track and line of sight; 1 is broadside.
    both_sides : bool
        True when the grid has pixels left and right of the track.
    """

    range_m: float
    near_m: float
    far_m: float
    direction: tuple[float, float]
    grazing_cosine: float
    across_cosine: float
    squint_sine: float
    both_sides: bool

    @property
    def direction_extent(self) -> float:
        """Extent of the scene in direction cosine."""
        return self.direction[1] - self.direction[0]


def see_scene(acquisition: Acquisition, imaging: Imaging) -> Scene:
    """Scene of a grid from a straight track.

    Parameters
    ----------
    acquisition : Acquisition
        Track; it has to move.
    imaging : Imaging
        Grid and length of the aperture.

    Returns
    -------
    Scene
    """
    grid, top_m = imaging.grid, imaging.top_m
    centre = np.asarray(acquisition.centre_m)
    velocity = np.asarray(acquisition.velocity_m_per_s)
    along = velocity / np.linalg.norm(velocity)
    half_s = 0.5 * (imaging.pulses_per_aperture - 1) / acquisition.prf_hz
    track = centre + np.linspace(-half_s, half_s, _TRACK_POINTS)[:, None] * velocity
    edge = _boundary(grid)
    if top_m != grid.z_m:  # a volume: around its highest layer, too
        edge = np.concatenate([edge[:-1], _boundary(dataclasses.replace(
            grid, centre_m=(*grid.centre_m[:2], top_m)))])
    corners = edge[:: _TRACK_POINTS - 1]
    # The nearest pixel of a rectangle or box to a point: the point's coordinates, clipped.
    nearest = np.stack([np.clip(track[:, 0], grid.x_m[0], grid.x_m[-1]),
                        np.clip(track[:, 1], grid.y_m[-1], grid.y_m[0]),
                        np.clip(track[:, 2], grid.z_m, top_m)], axis=1)
    far = np.linalg.norm(track[:, None] - corners, axis=-1).max()
    from_middle = np.concatenate([edge, _straight_ahead(grid, centre, along)]) - centre
    # On the platform itself every direction is as good as another.
    distance = np.maximum(np.linalg.norm(from_middle, axis=1), 1e-9)
    cosines = from_middle @ along / distance
    beside = from_middle[:, 1] * along[0] - from_middle[:, 0] * along[1]
    to_grid = np.asarray(imaging.middle_grid.centre_m) - centre
    range_m = float(np.linalg.norm(to_grid))
    sight = to_grid / max(range_m, 1e-9)
    cross = along - (along @ sight) * sight
    squint = float(np.linalg.norm(cross))
    ground = math.hypot(*sight[:2])
    beside_sight = np.array([-sight[1], sight[0], 0.0]) / max(ground, 1e-9)
    return Scene(
        range_m=range_m, near_m=float(np.linalg.norm(track - nearest, axis=1).min()),
        far_m=float(far), direction=(float(cosines.min()), float(cosines.max())),
        grazing_cosine=ground, across_cosine=abs(float(cross @ beside_sight)) / max(squint, 1e-9),
        squint_sine=squint, both_sides=bool(beside.min() < 0 < beside.max()))


def _straight_ahead(grid, centre, along) -> np.ndarray:
    """(0 or 1, 3) pixel that the line of flight points at: the extreme direction inside a grid."""
    height = grid.z_m - centre[2]
    if abs(along[2]) * 1e9 <= abs(height) or height == 0:
        return np.empty((0, 3))
    x, y = centre[:2] + along[:2] * (height / along[2])
    return np.array([[np.clip(x, grid.x_m[0], grid.x_m[-1]),
                      np.clip(y, grid.y_m[-1], grid.y_m[0]), grid.z_m]])


def _boundary(grid) -> np.ndarray:
    """(4 (n - 1) + 1, 3) points around the grid, from corner to corner; the first comes twice."""
    x = [grid.x_m[0], grid.x_m[-1], grid.x_m[-1], grid.x_m[0], grid.x_m[0]]
    y = [grid.y_m[0], grid.y_m[0], grid.y_m[-1], grid.y_m[-1], grid.y_m[0]]
    at = np.arange(4 * (_TRACK_POINTS - 1) + 1) / (_TRACK_POINTS - 1)
    return np.stack([np.interp(at, range(5), x), np.interp(at, range(5), y),
                     np.full(len(at), grid.z_m)], axis=1)
