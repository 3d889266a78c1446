# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plan of exact backprojection: by which route some pulses are added to an image the quickest.

Three routes lead to the same sum: a polar image around the aperture, interpolated to the map (its
lines follow range best); lines of the map, plane or volume itself; and point by point, for grids
near or around the antenna, for terrain and for positions that form no grid.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ...geometry.grids import EvenGrid, MapGrid, PlaneGrid, VolumeGrid, even_positions
from ...geometry.half_paths import Paths, half_paths, sample_paths
from ...signal.radar import RadarParameters
from ..ambiguities import azimuth_warnings
from ..costs import costs
from ..echo_power import chance_db, echo_powers, echoes_alike
from ..plan import Plan, total_db, with_chance
from ..profiles import (
    PhaseHistory,
    RangeGate,
    RangeResampling,
    check_reach,
    covered_ranges,
    end_warnings,
    error_near_ends_db,
    least_cost,
    plan_resampling,
    reach_warnings,
)
from .groups import GroupPlan, plan_groups
from .points import (
    ImagePoints,
    PointPlan,
    draw,
    extent,
    plan_even_points,
    plan_points,
    point_operations,
    resolved_cells,
    some_of,
)

if TYPE_CHECKING:
    from ...geometry.illumination import Illumination
    from .illumination import LineAmplitudes
    from .polar_image import PolarPlan

    _Even: TypeAlias = MapGrid | PlaneGrid | VolumeGrid
    _Route: TypeAlias = 'GroupPlan | PolarPlan | LinePlan | PointPlan'

_SAMPLES_PER_SIDE = {2: 5, 3: 3}  # grid positions at which the geometry is bounded, by axes


class GridLines:
    """Lines of a map, plane or volume along the axis that follows range best, where it grows.

    Parameters
    ----------
    grid : EvenGrid
        Map, plane or volume.
    illumination : Illumination, optional
        Illumination of the echoes; what they do not light is left aside.

    Attributes
    ----------
    n_pixels, n_lines : int
        Pixels of a line, and lines of a layer.
    layouts : (L, 5) int64
        Layers of lines that lie evenly in the image, each as `backends.cpu.lines.project_lines`
        describes it. A map or plane is one layer, and so is a volume whose lines do not run along
        its middle axis.
    layers_together : int
        Number of layers of the grid, in such a layer.
    range_m : (float, float)
        Bounds of the half paths to all pixels, metres.
    slopes : (float, float)
        Bounds of their derivative by the pixel number along a line, metres.
    """

    def __init__(self, grid: EvenGrid, tx_m: np.ndarray, rx_m: np.ndarray,
                 illumination: Illumination | None = None):
        n_axes = len(grid.shape)
        n = _SAMPLES_PER_SIDE[n_axes]
        side = (np.array(grid.shape) - 1) / (n - 1)
        points = even_positions(grid, *(np.indices((n,) * n_axes).reshape(n_axes, -1).T * side).T)
        # a map or plane is a volume of one layer
        shape = (1,) * (3 - n_axes) + grid.shape
        steps = np.concatenate([np.zeros((3 - n_axes, 3)), grid.steps_m])
        axes = range(3 - n_axes, 3)
        length, *found = half_paths(tx_m, rx_m, points, *(
            np.broadcast_to(steps[a], points.shape) for a in axes))
        by_axis = dict(zip(axes, found, strict=True))
        lit = None if illumination is None else illumination.lights(points)
        slopes = by_axis if lit is None else {a: s[lit] for a, s in by_axis.items()}
        least = {a: np.abs(s).min() if s.min() > 0 or s.max() < 0 else -1.0
                 for a, s in slopes.items()}
        axis = max(reversed(axes), key=least.__getitem__)  # the last one, where they are alike
        forward = bool(slopes[axis].mean() >= 0)
        low, high = float(slopes[axis].min()), float(slopes[axis].max())
        self.slopes = (low, high) if forward else (-high, -low)
        self.n_pixels = shape[axis]
        self._points, self._sides = points, (steps * np.array(shape)[:, None])[-2:]
        may = illumination and illumination.may_light(points, (n,) * n_axes)
        if may is not None:  # of cells, of which parts may be lit, all corners
            length, slopes = length[may], {a: s[may] for a, s in by_axis.items()}
        # Range is monotonic along lines; between sampled lines it changes by at most its slope.
        beside = sum(np.abs(slopes[a]).max() * (shape[a] / (n - 1) / 2 + 1)
                     for a in axes if a != axis or least[axis] < 0)
        self.range_m = float(length.min() - beside), float(length.max() + beside)
        layer, line = (a for a in range(3) if a != axis)
        floats = [2 * math.prod(shape[a + 1:]) for a in range(3)]
        self._along, self._across, self._layer = steps[axis], steps[line], steps[layer]
        self._start, first, pixel = np.array(grid.origin_m), 0, floats[axis]
        if not forward:
            self._start = self._start + (self.n_pixels - 1) * self._along
            self._along, first, pixel = -self._along, (self.n_pixels - 1) * pixel, -pixel
        self.n_lines = self._lines_per_layer = shape[line]
        n_layers = shape[layer]
        if floats[layer] == shape[line] * floats[line]:  # all lines lie evenly in the image
            self.n_lines, n_layers = n_layers * shape[line], 1
        self.layers_together = self.n_lines // self._lines_per_layer
        self.layouts = np.array([[self.n_lines, first + i * floats[layer], floats[line], pixel, 1]
                                 for i in range(n_layers)])

    def paths(self, tx_m: np.ndarray, rx_m: np.ndarray, radar: RadarParameters,
              illumination: Illumination | None = None) -> Paths:
        """Half paths to some of the pixels, with derivatives by the pixel number."""
        points = self._points
        found = dataclasses.replace(
            sample_paths(tx_m, rx_m, (points, np.broadcast_to(self._along, points.shape))),
            weight=echo_powers(tx_m, rx_m, points.mean(axis=0), self._sides, radar))
        return found if illumination is None else illumination.of_paths(found, points)

    def locate(self, layer: int) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]:
        """Function that gives positions and derivatives of a layer for `line_middles`."""
        def positions(pixel: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, ...]:
            # lines beside a layer of its own lie beside it
            number = np.clip(line // self._lines_per_layer, 0, self.layers_together - 1)
            line = line - number * self._lines_per_layer
            position = (self._start + np.multiply.outer(pixel, self._along)
                        + np.multiply.outer(line, self._across)
                        + np.multiply.outer(layer + number, self._layer))
            straight = np.zeros_like(position)
            return position, np.broadcast_to(self._along, position.shape), *[straight] * 3
        return positions


# Predictions are for scenes that are evenly bright. Of some dozen scatterers, images are by chance
# darker than their pulses.
_CHANCE_DB = 0.5
_PIXELS_NEAR_ENDS = 20_000  # at which errors are told where profiles end near an image
_LIT_DB = 0.6  # of the target, which the interpolation of amplitudes takes
LEAST_TARGET_DB = -100.0  # that float32 reaches


@dataclasses.dataclass(frozen=True, eq=False)
class LinePlan(Plan):
    """How echoes are added to the lines of a map, plane or volume.

    Attributes
    ----------
    lines : GridLines
        Its lines along which range grows.
    cost : float
        Nanoseconds per pixel.
    amplitudes : LineAmplitudes or None
        Nodes of the echoes' amplitudes; None where all pixels are lit alike.
    """

    lines: GridLines
    window: RangeGate | PhaseHistory
    resampling: RangeResampling
    errors_db: Mapping[str, float]
    cost: float
    amplitudes: LineAmplitudes | None = None

    method = 'lines'

    def operations(self, grid: EvenGrid | ImagePoints, n_echoes: int) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        share = 1.0 if self.amplitudes is None else self.amplitudes.share
        return {'image': 1,
                **self.resampling.operations(n_echoes, math.prod(grid.shape) * share)}

    def n_bytes(self, grid: EvenGrid | ImagePoints) -> int:
        """Memory that adding the echoes takes besides the image, bytes."""
        return 0 if self.amplitudes is None else self.amplitudes.n_bytes(
            self.lines.n_lines, self.lines.n_pixels, self.resampling.segment,
            len(self.lines.layouts))

    def __str__(self) -> str:
        return 'pulses are added along the lines of the grid'


@dataclasses.dataclass(frozen=True, eq=False)
class BackprojectionPlan(Plan):
    """How pulses from some phase centres are added to an image.

    Attributes
    ----------
    tx_m, rx_m : (R, 3) float64
        Phase centres of the echoes that it is for, metres.
    route : GroupPlan, PolarPlan, LinePlan or PointPlan
        The quickest of these.
    chance_db : float
        What the error of an image may exceed that of its route by chance, dB.
    illumination : Illumination or None
        Illumination of the echoes; None where they light all pixels alike.
    """

    grid: _Even | ImagePoints
    radar: RadarParameters
    tx_m: np.ndarray
    rx_m: np.ndarray
    range_m: tuple[float, float]
    route: GroupPlan | PolarPlan | LinePlan | PointPlan
    warnings: tuple[str, ...]
    chance_db: float
    illumination: Illumination | None = None

    @functools.cached_property
    def echoes_alike(self) -> float:
        """Mean number of echoes that an image does not tell apart, see `planning.echo_power`."""
        return echoes_alike(self.tx_m, self.rx_m, *extent(self.grid), self.radar)

    @property
    def method(self) -> str:
        """``'groups'``, ``'polar'``, ``'lines'`` or ``'points'``."""
        return self.route.method

    @property
    def errors_db(self) -> Mapping[str, float]:
        """Predicted error against time-domain correlation by cause, dB."""
        return with_chance(self.route.errors_db, self.chance_db)

    @property
    def seconds(self) -> float:
        """Predicted time on one thread."""
        return costs().seconds(self.operations)

    @property
    def operations(self) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        counts = self.route.operations(self.grid, len(self.tx_m))
        if self.route.window.periodic:  # bins are read, and not transformed (measured)
            counts['profile_bin'] /= 2
        return counts

    @property
    def n_bytes(self) -> int:
        """Memory that adding the echoes takes besides the image, bytes."""
        n_bytes = 0 if self.illumination is None else self.illumination.n_bytes
        return n_bytes + self.route.n_bytes(self.grid)

    def __str__(self) -> str:
        return str(self.route)


def plan_backprojection(grid: _Even | ImagePoints, radar: RadarParameters, n_samples: int,
                        tx_m: np.ndarray, rx_m: np.ndarray, target_db: float,
                        illumination: Illumination | None = None, *, groups: bool = False,
                        before: BackprojectionPlan | None = None, band: PhaseHistory | None = None
                        ) -> BackprojectionPlan:
    """Plan the quickest route of adding echoes to an image.

    With `illumination`, that of the echoes, pixels that an echo does not light take no part in its
    errors and its time. `groups` tells whether the backend images maps from groups of echoes;
    where it does not, or with illumination, there are polar images of all echoes instead.
    `before` is the plan of the pulses before these, of the same image and target. `band` tells of
    phase histories instead of profiles; `radar` and `n_samples` are its own.

    Raises
    ------
    ValueError
        None of the profiles reaches the pixels, or some leave the period of phase histories
        (`BeyondPeriod`).
    """
    asked_db = target_db
    may_err_db = chance_db(resolved_cells(grid, tx_m, rx_m, radar), _CHANCE_DB)
    target_db = max(target_db - may_err_db - _LIT_DB * (illumination is not None),
                    LEAST_TARGET_DB)
    route: _Route
    if isinstance(grid, ImagePoints):
        range_m = grid.bounds(tx_m, rx_m)
        _check_reach(range_m, radar, n_samples, band)
        window = band or RangeGate.around(radar, n_samples, range_m)
        route = plan_points(grid, window, tx_m, rx_m, range_m, target_db,
                            illumination=illumination)
    else:
        range_m, route = _route_to_grid(grid, radar, n_samples, tx_m, rx_m, target_db,
                                        illumination, groups,
                                        None if before is None else before.route, band)
    near = 10 ** (target_db / 10) < route.window.end_error(np.array(range_m)).max()
    if near and illumination is None:
        route = _with_ends(route, grid, radar, tx_m, rx_m)
    some = some_of(grid)
    start, stop = covered_ranges(radar, n_samples)
    beyond: tuple[str, ...] = ()
    if band is None and (range_m[0] < start or stop < range_m[1]):
        beyond = reach_warnings(some, tx_m, rx_m, radar, n_samples, illumination)
    if near and not beyond:
        beyond = end_warnings(route.errors_db['ends of profiles'], asked_db)
    warnings = (*beyond, *azimuth_warnings(some, tx_m, rx_m, radar, illumination))
    return BackprojectionPlan(grid, radar, tx_m.copy(), rx_m.copy(), range_m, route, warnings,
                              may_err_db, illumination)


def _check_reach(range_m: tuple[float, float], radar: RadarParameters, n_samples: int,
                 band: PhaseHistory | None) -> None:
    if band is None:
        check_reach(range_m, radar, n_samples)
    else:
        band.check_period(range_m)


def _with_ends(route: _Route, grid: _Even | ImagePoints, radar: RadarParameters,
               tx_m: np.ndarray, rx_m: np.ndarray) -> _Route:
    """A route with the error that ends of profiles make, told by thousands of pixels."""
    n = _PIXELS_NEAR_ENDS
    points_m = (grid.some(n) if isinstance(grid, ImagePoints)
                else grid.positions(*draw(grid.shape, n)))
    ends_db = error_near_ends_db(route.window, route.resampling.oversampling(radar), tx_m, rx_m,
                                 points_m)
    return dataclasses.replace(route, errors_db={**route.errors_db, 'ends of profiles': ends_db})


def _route_to_grid(grid: _Even, radar: RadarParameters, n_samples: int, tx_m: np.ndarray,
                   rx_m: np.ndarray, target_db: float, illumination: Illumination | None,
                   groups: bool, before: _Route | None, band: PhaseHistory | None
                   ) -> tuple[tuple[float, float], _Route]:
    """Bounds of the half path, and the quickest route."""
    groups = groups and illumination is None and isinstance(grid, MapGrid)
    lines = GridLines(grid, tx_m, rx_m, illumination)
    _check_reach(lines.range_m, radar, n_samples, band)
    # The least cost of each route tells which is worth a plan; illumination makes lines cheaper.
    least = (0.0 if illumination is not None
             else least_cost(lines.slopes, radar) * len(tx_m))
    window = band or RangeGate.around(radar, n_samples, lines.range_m)
    routes: list[tuple[float, Callable[[], _Route | None]]] = [
        (least, lambda: _plan_lines(lines, radar, window, tx_m, rx_m, len(grid.shape), target_db,
                                    illumination))]
    if groups and isinstance(grid, MapGrid):
        routes.append((costs().grouped_pixel, lambda: plan_groups(
            grid, radar, n_samples, tx_m, rx_m, lines.range_m, target_db,
            before=before if isinstance(before, GroupPlan) else None, band=band)))
    elif isinstance(grid, MapGrid):  # polar images lie on horizontal planes
        from .polar_image import plan_polar

        routes.append((costs().map_pixel, lambda: plan_polar(
            grid, tx_m, rx_m, radar, n_samples, target_db, illumination, band)))
    route: _Route | None = None
    cost = costs().point_pixel * len(tx_m)
    if groups:  # small maps near the antenna: the profiles of other routes may take most of it
        cost = costs().nanoseconds(point_operations(
            grid, window, len(tx_m), target_db)) / math.prod(grid.shape)
    for least, plan in sorted(routes, key=lambda known: known[0]):
        found = plan() if least < cost else None
        if found is None:
            continue
        needed = costs().nanoseconds(
            found.operations(grid, len(tx_m))) / math.prod(grid.shape) if groups or isinstance(
                found, GroupPlan) else found.cost
        if needed < cost and (
                illumination is None or found.method != 'polar'
                or total_db(*found.errors_db.values()) <= target_db):
            route, cost = found, needed
    if route is None:
        route = plan_even_points(grid, window, tx_m, rx_m, lines.range_m, target_db,
                                 illumination=illumination)
    return lines.range_m, route


def _plan_lines(lines: GridLines, radar: RadarParameters, window: RangeGate | PhaseHistory,
                tx_m: np.ndarray, rx_m: np.ndarray, n_axes: int, target_db: float,
                illumination: Illumination | None) -> LinePlan | None:
    """Plan along lines; None where range does not follow them, or points are as quick."""
    paths = lines.paths(tx_m, rx_m, radar, illumination)
    resampling = plan_resampling(paths, 1.0, lines.n_pixels, radar, window.n_samples, target_db,
                                 periodic=window.periodic)
    amplitudes = None
    more: dict[str, float] = {}
    if resampling is not None and illumination is not None:
        from .illumination import plan_line_amplitudes

        resampling, amplitudes, more = plan_line_amplitudes(
            illumination, lines, tx_m, rx_m, radar, window, resampling, target_db)
    if resampling is None or resampling.cost >= costs().point_pixel:
        return None
    errors = {'range profiles': resampling.predicted_error_db,
              'ends of profiles': window.mean_end_error_db(
                  paths.length, n_axes, resampling.oversampling(radar)), **more}
    share = 1.0 if amplitudes is None else amplitudes.share
    return LinePlan(lines, window, resampling, errors, resampling.cost * len(tx_m) * share,
                    amplitudes)
