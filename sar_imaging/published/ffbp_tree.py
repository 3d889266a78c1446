"""Tree of sub-apertures for fast factorised backprojection, and the frame that they share.

Every sub-aperture has a grid around its own centre (Zhang et al., figure 2a), sampled as finely
along direction as its length asks for. The grids of one level share their spacings.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..geometry.track_frame import track_beside


@dataclasses.dataclass(frozen=True, eq=False)
class Node:
    """A sub-aperture: its pulses, its parts and its image's grid.

    Attributes
    ----------
    pulses : slice
        Its pulses.
    level : int
        0 for the shortest ones.
    children : tuple of Node
        Parts from which its image is made; none at level 0.
    centre : (3,) float64
        Origin of its grid: along track, across track and up, metres.
    range_start, alpha_start : float
        First range, metres, and direction cosine.
    shape : (int, int)
        Directions and ranges.
    """

    pulses: slice
    level: int
    children: tuple[Node, ...]
    centre: np.ndarray
    range_start: float = 0.0
    alpha_start: float = 0.0
    shape: tuple[int, int] = (0, 0)


@dataclasses.dataclass(frozen=True, eq=False)
class Level:
    """What the sub-apertures of one length share.

    Attributes
    ----------
    nodes : tuple of Node
        The sub-apertures, in order.
    alpha_spacing : float
        Spacing of direction cosines.
    segment : int
        Pixels along which geometry is expanded when their images are made from their parts;
        0 where it must be computed for every pixel.
    """

    nodes: tuple[Node, ...]
    alpha_spacing: float
    segment: int

    @property
    def size(self) -> int:
        """Pixels of the largest image."""
        return max(n.shape[0] * n.shape[1] for n in self.nodes)


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """Common track direction and plane of all local grids.

    Attributes
    ----------
    track, across : (2,) float64
        Horizontal unit vectors along the track and from it into the scene.
    z_m : float
        Height of the plane, metres.
    """

    track: np.ndarray
    across: np.ndarray
    z_m: float

    def enter(self, points) -> np.ndarray:
        """Positions (..., 3) as along track, across track and up."""
        points = np.asarray(points, float)
        return np.stack([points[..., :2] @ self.track, points[..., :2] @ self.across,
                         points[..., 2]], axis=-1)

    def leave(self, point) -> tuple[float, float, float]:
        """A position along track, across track and up in the imaging frame."""
        x, y = point[0] * self.track + point[1] * self.across
        return float(x), float(y), float(point[2])


def find_frame(outline, centres, z_m: float) -> Frame:
    """Frame of an aperture and the scene that it looks at.

    Parameters
    ----------
    outline : (E, 3) float64
        Edge of the scene, metres.
    centres : (P, 3) float64
        Phase centres, metres.
    z_m : float
        Height of the plane, metres.
    """
    track, side = track_beside(centres, outline.mean(axis=0))
    return Frame(track, side * np.array([-track[1], track[0]]), z_m)


def build_tree(centres, pulses_per_subaperture: int, merge_factor: int
               ) -> tuple[list[list[Node]], list[Node]]:
    """Sub-apertures of every level, and those from which the image is made at last.

    Groups are as even as can be; a group of one stays as it is, so that any number of
    sub-apertures will do. Origins lie in the middle of the phase centres.

    Parameters
    ----------
    centres : (P, 3) float64
        Phase centres in the frame, metres.
    pulses_per_subaperture, merge_factor : int
        Pulses of the shortest sub-apertures, and how many of them are merged at a time.

    Returns
    -------
    levels : list of lists of Node
        Shortest first.
    top : list of Node
        At most `merge_factor` sub-apertures that make up the whole aperture.
    """
    def made(starts, parts):
        """Sub-apertures, each up to where the next one starts."""
        middles = 0.5 * (np.minimum.reduceat(centres, starts)
                         + np.maximum.reduceat(centres, starts))
        return [some[0] if len(some) == 1 else Node(slice(start, stop), len(levels), some, middle)
                for start, stop, some, middle
                in zip(starts, [*starts[1:], len(centres)], parts, middles, strict=True)]

    levels, starts = [], list(range(0, len(centres), pulses_per_subaperture))
    top = made(starts, [()] * len(starts))
    levels.append(top)
    while len(top) > merge_factor:
        groups = -(-len(top) // merge_factor)
        edges = [len(top) * i // groups for i in range(groups + 1)]
        parts = [tuple(top[a:b]) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        top = made([part[0].pulses.start for part in parts], parts)
        levels.append([n for n in top if n.level == len(levels)])
    return levels, top
