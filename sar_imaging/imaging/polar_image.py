"""Polar image of a block: backprojection in parts, merged, and interpolated to the map."""

from __future__ import annotations

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.radar import RadarParameters
from .merging import AngularMerging
from .polar import PolarPlan
from .projection import PolarLines, Profiles
from .resampling import add_polar_to_map


def add_by_polar(plan: PolarPlan, radar: RadarParameters, rows, grid: MapGrid, image) -> None:
    """Add rows to a map by way of their polar image.

    Parameters
    ----------
    plan : PolarPlan
        Made for these rows.
    radar : RadarParameters
        Of the compressed profiles.
    rows : tuple
        Samples (R, N) complex64, transmit and receive phase centres (R, 3) float64, metres.
    grid : MapGrid
        Of the map.
    image : (n_y, n_x) complex64
        Map, changed in place; contiguous in C order.
    """
    polar = plan.polar
    profiles = Profiles(plan.window, plan.lattice, plan.range_m)
    total = np.zeros((2, polar.n_alpha, polar.n_range), np.float32)
    if plan.parts is None:
        PolarLines(polar, profiles).add(*rows, total)
    else:
        lines, merging = PolarLines(plan.parts.coarse, profiles), AngularMerging(plan.parts)
        merging.add_all(lambda number, image: lines.add(
            *(a[plan.parts.rows[number]] for a in rows), image), total)
    add_polar_to_map(total[0], total[1], polar, grid, image, axis=plan.axis,
                     wavelength_m=radar.wavelength_m, between=plan.between, along=plan.along)
