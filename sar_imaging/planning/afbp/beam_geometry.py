"""Paths of a sub-aperture's echoes as its beams take them: by direction from its middle alone."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...geometry.polar import PolarGrid

_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded
_DIRECTIONS = 33  # between which paths are compared
_MARGIN = 0.1  # of the directions of a grid, beyond them
_CLEAR = 0.9  # of the largest direction cosine on the plane
_DIRECTION_STEP = 1e-4  # of the direction cosine, for a derivative


@dataclasses.dataclass(frozen=True)
class BeamGeometry:
    """Polar coordinates around the middle of a sub-aperture, on the plane of a polar grid.

    Attributes
    ----------
    polar : PolarGrid
        Whose plane, track direction and side they share.
    centre_m : (3,) float64
        Mean phase centre, metres.
    range_m : float
        Distance at which the paths of echoes are compared, metres: the harmonic mean of the
        extremes, from which their curvature differs least.
    direction : (float, float)
        Extremes of the direction cosine over the grid.
    """

    polar: PolarGrid
    centre_m: np.ndarray
    range_m: float
    direction: tuple[float, float]

    @classmethod
    def of(cls, polar: PolarGrid, edges: np.ndarray, tx_m, rx_m) -> BeamGeometry | None:
        """Coordinates for some echoes; None where the plane is too steep below them.

        `edges` are the grid's, from `grid_edges`.
        """
        centre = 0.5 * (tx_m + rx_m).sum(axis=0) / len(tx_m)
        offset = edges - centre
        length = np.sqrt(np.einsum('sk,sk->s', offset, offset))
        direction = offset[:, :2] @ np.array(polar.track) / length
        low, high = float(direction.min()), float(direction.max())
        range_m = 2 / (1 / float(length.min()) + 1 / float(length.max()))
        height = (float(centre[2]) - polar.z_m) / range_m
        steepest = max(abs(low), abs(high)) + _MARGIN * (high - low)
        steep = steepest ** 2 + height ** 2 >= 0.98
        return None if steep else cls(polar, centre, range_m, (low, high))

    @property
    def known(self) -> tuple[float, float]:
        """Extremes of the directions in which the plane lies well within sight."""
        (low, high), height = self.direction, (self.centre_m[2] - self.polar.z_m) / self.range_m
        margin, clear = _MARGIN * (high - low), _CLEAR * math.sqrt(1 - height ** 2)
        return min(low - margin, -clear), max(high + margin, clear)

    def beam_path(self, tx_m, rx_m, direction) -> np.ndarray:
        """`extra_path`, continued straight beyond the known directions, where it ends.

        `direction` ascends.
        """
        low, high = self.known
        if low <= direction[0] and direction[-1] <= high:
            return self.extra_path(tx_m, rx_m, direction)
        before, after = self.slope(tx_m, rx_m, (low, high))
        direction = direction[:, None]
        return (self.extra_path(tx_m, rx_m, np.clip(direction[:, 0], low, high))
                + before * np.minimum(direction - low, 0.0)
                + after * np.maximum(direction - high, 0.0))

    def extra_path(self, tx_m, rx_m, direction) -> np.ndarray:
        """(S, R) by how much half paths are longer than the distance from the centre, metres.

        With w the offset of a phase centre from the middle and p that of the point in a
        direction, ``|p - w| - |p| = (|w|^2 - 2 w p) / (|p - w| + |p|)``, which cancels nothing.
        """
        height = self.centre_m[2] - self.polar.z_m
        along = self.range_m * np.asarray(direction, np.float64)
        across = np.sqrt(np.maximum(self.range_m ** 2 - along ** 2 - height ** 2, 0.0))
        point = (along[:, None] * self.polar.track + across[:, None] * self.polar.across)
        # beyond the plane's horizon points lie further away than they are taken to
        beyond = np.einsum('sk,sk->s', point, point) + height ** 2 - self.range_m ** 2
        offset = np.concatenate([tx_m, rx_m]) - self.centre_m
        square = np.einsum('rk,rk->r', offset, offset) + 2 * height * offset[:, 2]
        longer = square - 2 * point @ offset[:, :2].T + beyond[:, None]
        path = longer / (np.sqrt(self.range_m ** 2 + longer) + self.range_m)
        return 0.5 * (path[:, :len(tx_m)] + path[:, len(tx_m):])

    def slope(self, tx_m, rx_m, direction) -> np.ndarray:
        """(S, R) derivative of `extra_path` by direction, metres."""
        return self.expansion(tx_m, rx_m, direction)[1]

    def expansion(self, tx_m, rx_m, direction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(S, R) `extra_path`, its first and its second derivative by direction, metres."""
        step, wide = _DIRECTION_STEP, 10 * _DIRECTION_STEP
        beside = np.add.outer((-wide, -step, 0.0, step, wide), direction)
        furthest_before, before, path, after, furthest_after = self.extra_path(
            tx_m, rx_m, beside.ravel()).reshape(*beside.shape, -1)
        return (path, (after - before) / (2 * step),
                (furthest_before - 2 * path + furthest_after) / wide ** 2)

    def uneven(self, tx_m, rx_m) -> float:
        """`unevenness` of echoes."""
        return unevenness(self.slope(tx_m, rx_m, self.direction))

    def spread(self, tx_m, rx_m, beyond: float = 0.0) -> float:
        """Largest derivative of `beam_path` by direction up to so far beyond the grid, metres."""
        low, high = self.direction
        directions = np.linspace(low - beyond, high + beyond, _DIRECTIONS)
        path = self.beam_path(tx_m, rx_m, directions)
        growth = path[1:] - path[:-1]
        return float(max(growth.max(), -growth.min()) / (directions[1] - directions[0]))


def unevenness(slope: np.ndarray) -> float:
    """By how much echoes on opposite sides fail to be opposite, rms, metres of slope.

    `slope` is (2, R), that of `extra_path` in the extreme directions.
    """
    slope = np.sort(slope)
    worst = np.abs(slope + slope[:, ::-1]).max(axis=0)
    return math.sqrt(worst @ worst / len(worst)) / 2


def grid_edges(polar: PolarGrid) -> np.ndarray:
    """(S, 3) float64 positions along the near and the far edge of a grid, metres."""
    return polar.lines(*polar.sampled(2, _SAMPLES_PER_SIDE))[0]
