"""Segments of pixels along which merges expand the geometry, and what that leaves of it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from .ffbp_tree import Node
from .neighbour_weights import MARGIN

LANES = 16  # pixels beyond a segment, whole vectors
_SEGMENTS = (112, 48, 16)  # with LANES more, whole vectors
_SAMPLED_NODES = 64  # per level, where the geometry is looked at closely
_CUBIC_CYCLES = 2e-5  # error of the expansion of the carrier phase along a segment: -78 dB


@dataclasses.dataclass(frozen=True)
class Segment:
    """How a level's images are merged from their parts.

    Attributes
    ----------
    length : int
        Pixels; 0 where geometry is computed for every pixel.
    drift_range, drift_alpha : float
        Root mean squares of how far the part's samples run from its pixels at the ends of a
        segment, samples.
    cycles : float
        Root mean square error of the carrier phase at the ends of a segment, cycles.
    """

    length: int = 0
    drift_range: float = 0.0
    drift_alpha: float = 0.0
    cycles: float = 0.0

    def drift(self, axis: int) -> float:
        """Along range (0) or direction (1), samples."""
        return (self.drift_range, self.drift_alpha)[axis]


def choose_segment(nodes: list[Node], alpha_spacings: list[float], points, spacing: float,
                   wavelength_m: float) -> Segment:
    """Longest segment along which the expansions of a merge are exact enough.

    Parameters
    ----------
    nodes : list of Node
        Sub-apertures of one level.
    alpha_spacings : list of float
        Spacing of direction cosines of all levels.
    points : (K, 3) float64
        Positions all over the scene, in the frame, metres.
    spacing : float
        Range spacing, metres.
    wavelength_m : float
        At the carrier, metres.
    """
    if not any(n.children for n in nodes):
        return Segment()
    some = nodes[::max(1, len(nodes) // _SAMPLED_NODES)]
    pairs = [(n, c) for n in some for c in n.children]
    spacings = np.array([alpha_spacings[c.level] for _, c in pairs])[:, None]
    parent = np.array([n.centre for n, _ in pairs])[:, None]
    child = np.array([c.centre for _, c in pairs])[:, None]
    for length in _SEGMENTS:
        # the quartic term at the end of a segment, by the fourth difference over it
        fourth, *drifts = _drifts(points, parent, child, spacings, spacing, length)
        cycles = np.abs(fourth) * 16 / 24 * 2 / wavelength_m
        if cycles.max() <= _CUBIC_CYCLES and max(np.abs(d).max() for d in drifts) <= MARGIN:
            return Segment(length, *map(_rms, drifts), _rms(cycles))
    return Segment()


def _rms(values) -> float:
    return math.sqrt(np.mean(np.square(values)))


def _drifts(points, parent, child, alpha_spacing, spacing, segment) -> tuple[np.ndarray, ...]:
    """Fourth difference of the child's range along a segment of the parent, metres, and drifts.

    The fourth difference over a segment is ``4! (half / 2)^4 / 24`` of the fourth derivative.
    Drifts are those of range and direction from the middle to the ends, samples.
    """
    half = segment / 2 * spacing
    offset = points - parent
    r = np.linalg.norm(offset, axis=-1)
    alpha, height = offset[..., 0] / r, offset[..., 2]

    def coordinates(f):
        ground = np.sqrt(np.maximum((r + f) ** 2 * (1 - alpha ** 2) - height ** 2, 0.0))
        a, c = (r + f) * alpha, ground
        shift = parent - child
        rc = np.sqrt((a + shift[..., 0]) ** 2 + (c + shift[..., 1]) ** 2
                     + (height + shift[..., 2]) ** 2)
        return rc, (a + shift[..., 0]) / rc

    nodes = half * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    ranges, alphas = zip(*(coordinates(f) for f in nodes), strict=True)
    fourth = ranges[0] - 4 * ranges[1] + 6 * ranges[2] - 4 * ranges[3] + ranges[4]
    along_range = np.array([ranges[0] + half, ranges[4] - half]) - ranges[2]
    along_alpha = np.array([alphas[0], alphas[4]]) - alphas[2]
    return (fourth, along_range / spacing,
            along_alpha / alpha_spacing * (1 + LANES / segment))
