"""Plan of exact backprojection: in which way some pulses are added to an image the quickest.

Three ways lead to the same sum: a polar image around the aperture, interpolated to the map (its
lines follow range best); lines of the map itself; and point by point, for grids near or around
the antenna, for terrain and for positions that form no grid.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ...geometry.grids import MapGrid
from ...signal.radar import RadarParameters
from ..costs import costs
from ..error_budget import total_db
from ..profiles.range_gate import RangeWindow
from ..profiles.range_resampling import Lattice, plan_lattice, point_lattice
from .map_lines import MapLines
from .points import ImagePoints, PointPlan, plan_points
from .polar_image import PolarPlan, plan_polar


@dataclasses.dataclass(frozen=True)
class LinePlan:
    """How rows are added to the lines of a map.

    Attributes
    ----------
    lines : MapLines
        Lines of the map along which range grows.
    window : RangeWindow
        Part of the profiles that is needed.
    lattice : Lattice
        How it is resampled.
    predicted_error_db : float
        Predicted error against time-domain correlation, dB.
    """

    lines: MapLines
    window: RangeWindow
    lattice: Lattice
    predicted_error_db: float


@dataclasses.dataclass(frozen=True)
class BackprojectionPlan:
    """How pulses from some phase centres are added to an image.

    Attributes
    ----------
    grid : MapGrid or ImagePoints
        Where the pixels are.
    radar : RadarParameters
        Of the profiles.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the rows that it is for, metres.
    range_m : (float, float)
        Bounds of the half path to the pixels, metres.
    way : PolarPlan, LinePlan or PointPlan
        The quickest of the three.
    """

    grid: MapGrid | ImagePoints
    radar: RadarParameters
    tx_m: np.ndarray
    rx_m: np.ndarray
    range_m: tuple[float, float]
    way: PolarPlan | LinePlan | PointPlan

    @property
    def method(self) -> str:
        """``'polar'``, ``'lines'`` or ``'points'``."""
        return {PolarPlan: 'polar', LinePlan: 'lines', PointPlan: 'points'}[type(self.way)]

    @property
    def predicted_error_db(self) -> float:
        """Predicted error against time-domain correlation, dB."""
        return self.way.predicted_error_db

    def is_for(self, tx_m, rx_m) -> bool:
        """Whether it was made for these phase centres."""
        return np.array_equal(tx_m, self.tx_m) and np.array_equal(rx_m, self.rx_m)


def plan_backprojection(grid: MapGrid | ImagePoints, radar: RadarParameters, n_samples: int, tx_m,
                        rx_m, target_db: float) -> BackprojectionPlan:
    """Plan the quickest way of adding rows to an image.

    Parameters
    ----------
    grid : MapGrid or ImagePoints
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of a profile.
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    target_db : float
        Wanted error against time-domain correlation, dB.
    """
    if isinstance(grid, ImagePoints):
        range_m = grid.bounds(tx_m, rx_m)
        way = plan_points(grid, radar, n_samples, tx_m, rx_m, range_m, target_db)
    else:
        range_m, way = _way_to_map(grid, radar, n_samples, tx_m, rx_m, target_db)
    return BackprojectionPlan(grid, radar, tx_m.copy(), rx_m.copy(), range_m, way)


def _way_to_map(grid, radar, n_samples, tx_m, rx_m, target_db):
    """Bounds of the half path, and the quickest way."""
    lines = MapLines(grid, tx_m, rx_m)
    window = RangeWindow.around(radar, n_samples, lines.range_m)
    lattice = plan_lattice(lines.paths, 1.0, lines.n_pixels, radar, window.n_samples, target_db)
    cost, way = point_lattice(radar, n_samples, target_db).cost * len(tx_m), None
    if lattice is not None and lattice.cost * len(tx_m) < cost:
        cost = lattice.cost * len(tx_m)
        way = LinePlan(lines, window, lattice, total_db(
            lattice.predicted_error_db, window.mean_end_error_db(lines.paths.length)))
    if cost > costs().map_pixel:  # for fewer pulses a polar image cannot pay
        polar = plan_polar(grid, tx_m, rx_m, radar, n_samples, target_db)
        if polar is not None and polar.cost < cost:
            way = polar
    if way is None:
        way = plan_points(ImagePoints.of_map(grid), radar, n_samples, tx_m, rx_m, lines.range_m,
                          target_db)
    return lines.range_m, way
