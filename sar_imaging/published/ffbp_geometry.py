"""Geometry of one aperture for fast factorised backprojection: frame, tree and local bands."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..geometry.track_frame import mean_centres
from ..signal.radar import RadarParameters
from .ffbp_grids import check_side, half_bands, outline_of, widest_spacings
from .ffbp_tree import Frame, Node, build_tree, find_frame

_SLIGHTLY_FINER = 0.999  # spacing of range than the band asks for


@dataclasses.dataclass(frozen=True, eq=False)
class FfbpGeometry:
    """An aperture in the frame of its local grids.

    Attributes
    ----------
    frame : Frame
        Track direction and plane.
    tx, rx : (P, C, 3) float64
        Phase centres in the frame, metres.
    edge : (E, 3) float64
        Outline of the scene in the frame, metres.
    edge_step : float
        Distance of its samples, metres.
    inside : (9, 3) float64
        Positions all over the scene in the frame, three by three, metres.
    levels : list of lists of Node
        Sub-apertures, without their grids, shortest first.
    top : list of Node
        Those from which the image is made at last.
    half_range : float
        Half the bandwidth of local images along range, rad/m.
    half_alpha : list of float
        Half the bandwidth along direction cosine by level, rad.
    widest : list of float
        Largest spacings of direction by level.
    """

    frame: Frame
    tx: np.ndarray
    rx: np.ndarray
    edge: np.ndarray
    edge_step: float
    inside: np.ndarray
    levels: list[list[Node]]
    top: list[Node]
    half_range: float
    half_alpha: list[float]
    widest: list[float]

    def range_spacing(self, oversampling: float) -> float:
        """Range spacing, metres, for samples per reciprocal bandwidth."""
        return _SLIGHTLY_FINER * math.pi / self.half_range / oversampling

    def alpha_spacings(self, oversampling: float) -> list[float]:
        """Spacing of direction cosines by level, for samples per reciprocal bandwidth."""
        return [min(math.pi / oversampling / max(half, 1.0), widest)
                for half, widest in zip(self.half_alpha, self.widest, strict=True)]


def ffbp_geometry(grid: MapGrid | PolarGrid, radar: RadarParameters, tx_m, rx_m,
                  pulses_per_subaperture: int, merge_factor: int) -> FfbpGeometry:
    """Geometry of an aperture.

    Raises
    ------
    ValueError
        The scene does not lie on one side of the track.
    """
    edge, inside, edge_step = outline_of(grid)
    centres = mean_centres(tx_m, rx_m)
    frame = find_frame(edge, centres, grid.z_m)
    tx, rx, centres, edge, inside = (frame.enter(a) for a in (tx_m, rx_m, centres, edge, inside))
    levels, top = build_tree(centres, pulses_per_subaperture, merge_factor)
    check_side(levels[0], edge)
    half_range, half_alpha = half_bands(levels, tx, rx, inside, radar)
    return FfbpGeometry(frame, tx, rx, edge, edge_step, inside, levels, top, max(half_range),
                        half_alpha, widest_spacings(levels, inside))
