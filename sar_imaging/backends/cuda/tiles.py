# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images in tiles that the device's memory holds, one after the other, by one plan.

Tiles are cut so that each pixel is computed as in the whole image: between the lines of a grid,
between tiles of points, and into strips of a map, which read their own lines of the polar image.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...memory import IMAGE_BYTES
from ...planning.exact.backprojection import BackprojectionPlan, LinePlan
from ...planning.exact.points import ImagePoints, image_layers
from ...planning.exact.polar_image import PolarPlan
from . import arrays

if TYPE_CHECKING:  # rows, bytes of one, in steps of how many, and the tiles of some
    _Rows: TypeAlias = 'tuple[int, float, int, Callable[[slice], Iterator[Tile]]]'

_SHARE = 0.5  # of the free memory, for a tile; polynomials and transforms take the rest
_COORDINATE_BYTES, _LINE_BYTES = 8, 8 * 12  # of a point, and of the geometry of a segment
_LEAST_LINES = 16  # of the polar image of a strip: interpolators need neighbours


@dataclasses.dataclass(frozen=True)
class Tile:
    """A part of an image.

    Attributes
    ----------
    shape : (int, int)
        Shape of its memory on the device, complex64.
    part_of : callable
        The (n, m) complex64 part of the host's image of the plan's shape, as it lies there.
    layer : int
        Of lines or points; 0 where there is one.
    rows : slice or None
        Lines of the layer, rows of points, or rows or columns of the map; None where the tile is
        all of the image.
    """

    shape: tuple[int, int]
    part_of: Callable[[np.ndarray], np.ndarray] = dataclasses.field(compare=False)
    layer: int = 0
    rows: slice | None = None


def cut(plan: BackprojectionPlan) -> list[Tile]:
    """Tiles of an image, as few as the device's free memory allows.

    Raises
    ------
    DeviceError
        The smallest tile does not fit.
    """
    kinds = {LinePlan: _lines, PolarPlan: _strips}
    n_rows, row_bytes, step, tiles = kinds.get(type(plan.route), _points)(plan)
    free, n_layers = arrays.free_bytes() * _SHARE, math.prod(plan.grid.shape[:-2]) or 1
    if n_layers * n_rows * row_bytes <= free:
        return [whole(plan)]
    together = min(n_rows, int(free // row_bytes) // step * step)
    if not together:
        size = ' x '.join(map(str, reversed(plan.grid.shape)))
        arrays.check_memory(
            math.ceil(min(step, n_rows) * row_bytes / _SHARE),
            f'the smallest tile of an image of {size} pixels', "use backend='cpu'")
    return [tile for lo in range(0, n_rows, together)
            for tile in tiles(slice(lo, min(lo + together, n_rows)))]


def whole(plan: BackprojectionPlan) -> Tile:
    """All of an image as one tile."""
    shape = plan.grid.shape
    size = math.prod(shape[:-1]), shape[-1] if shape else 1
    return Tile(size, lambda image: image.reshape(size))


def _lines(plan: BackprojectionPlan) -> _Rows:
    """Some lines of every layer."""
    lines, segment = plan.route.lines, plan.route.resampling.segment
    n_segments = -(-lines.n_pixels // segment)
    row_bytes = IMAGE_BYTES * lines.n_pixels + _LINE_BYTES * n_segments
    if plan.route.amplitudes is not None:
        row_bytes += plan.route.amplitudes.n_bytes(
            lines.n_lines, lines.n_pixels, segment) / lines.n_lines

    def tiles(rows: slice) -> Iterator[Tile]:
        shape = rows.stop - rows.start, lines.n_pixels
        for layer, (_, first, across, along, _) in enumerate(lines.layouts):
            start, steps = (first + rows.start * across) // 2, (across // 2, along // 2)
            yield Tile(shape, lambda image, start=start, steps=steps: np.lib.stride_tricks
                       .as_strided(image.reshape(-1)[start:], shape,
                                   [IMAGE_BYTES * step for step in steps]), layer, rows)

    return lines.n_lines, row_bytes, 1, tiles


def _points(plan: BackprojectionPlan) -> _Rows:
    """Some rows of tiles of every layer."""
    layers = image_layers(plan.grid)
    (n_rows, n_columns), height = layers[0].size, plan.route.tile[0]
    row_bytes = IMAGE_BYTES * n_columns + _COORDINATE_BYTES * sum(
        n_columns if stride[1] else 1 for stride in layers[0].strides if stride[0])
    if plan.route.amplitudes is not None:
        row_bytes += plan.route.amplitudes.n_bytes((n_rows, n_columns), plan.route.tile) / n_rows

    def tiles(rows: slice) -> Iterator[Tile]:
        for layer in range(len(layers)):
            inside = slice(layer * n_rows + rows.start, layer * n_rows + rows.stop)
            yield Tile((rows.stop - rows.start, n_columns), lambda image, inside=inside:
                       image.reshape(-1, n_columns)[inside], layer, rows)

    return n_rows, row_bytes, height, tiles


def _strips(plan: BackprojectionPlan) -> _Rows:
    """Rows of a map, or columns where range follows y, with their lines of the polar image."""
    route, grid = plan.route, plan.grid
    n_y, n_x = grid.shape
    n_rows, n_pixels = (n_y, n_x) if route.axis == 0 else (n_x, n_y)
    # as many lines of the polar image as rows of the map, or more
    lines = max(1.0, route.polar.n_alpha / n_rows)
    row_bytes = IMAGE_BYTES * (n_pixels + lines * route.polar.n_range)
    if route.amplitudes is not None:
        coarse = route.polar if route.parts is None else route.parts.coarse
        row_bytes += route.amplitudes.n_bytes(*coarse.shape, route.resampling.segment) / n_rows
    step = max(1, round(_LEAST_LINES / lines))

    def tiles(rows: slice) -> Iterator[Tile]:
        n = rows.stop - rows.start
        if route.axis == 0:
            yield Tile((n, n_x), lambda image: image[rows], rows=rows)
        else:
            yield Tile((n_y, n), lambda image: image[:, rows], rows=rows)

    return n_rows, row_bytes, step, tiles


def rows_of_points(points: ImagePoints, rows: slice) -> ImagePoints:
    """Some rows of points, whose coordinates are cut as well."""
    n_columns = points.size[1]
    cut = [values[rows.start * step[0]:(rows.stop - 1) * step[0] + (n_columns - 1) * step[1] + 1]
           for values, step in zip(points.coordinates, points.strides, strict=True)]
    return ImagePoints(*cut, points.strides, (rows.stop - rows.start, n_columns))


def strip_of_map(grid: MapGrid, axis: int, rows: slice) -> MapGrid:
    """Some rows of a map, or columns where range follows y (`axis` 1)."""
    x, y, z = grid.centre_m
    n = rows.stop - rows.start
    if axis == 0:
        return MapGrid((x, float(grid.y_m[rows].mean()), z), grid.n_x, n, grid.spacing_m)
    return MapGrid((float(grid.x_m[rows].mean()), y, z), n, grid.n_y, grid.spacing_m)


def lines_of_strip(polar: PolarGrid, grid: MapGrid, first: int, n_taps: int) -> slice:
    """Lines of a polar image that the interpolation to a map reads.

    Directions are largest and smallest on the map's edge: they have no extreme beside the track.
    """
    x, y = grid.x_m, grid.y_m
    edge = (np.concatenate([x, x, np.full(len(y), x[0]), np.full(len(y), x[-1])]),
            np.concatenate([np.full(len(x), y[0]), np.full(len(x), y[-1]), y, y]))
    _, alpha = polar.from_map(*edge)
    place = (np.array([alpha.min(), alpha.max()]) - polar.alpha_start) / polar.alpha_spacing
    lo = min(max(math.floor(place[0]) + first - 1, 0), polar.n_alpha - n_taps)
    hi = max(min(math.ceil(place[1]) + first + n_taps + 1, polar.n_alpha), lo + n_taps)
    return slice(max(lo, 0), hi)


def lines_of_grid(polar: PolarGrid, lines: slice) -> PolarGrid:
    """The grid of some lines of a polar image."""
    return dataclasses.replace(polar, n_alpha=lines.stop - lines.start, alpha_start=(
        polar.alpha_start + lines.start * polar.alpha_spacing))
