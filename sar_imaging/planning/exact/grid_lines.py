"""Lines of a grid along which range grows, and the half paths to them."""

from __future__ import annotations

import math

import numpy as np

from ...geometry.grids import EvenGrid, even_positions
from ...geometry.half_paths import sample_paths
from ...geometry.illumination import Illumination

_SAMPLES_PER_SIDE = {2: 5, 3: 3}  # grid positions at which the geometry is bounded, by axes


class GridLines:
    """Lines of a map, plane or volume along the axis that follows range best, where it grows.

    Parameters
    ----------
    grid : EvenGrid
        Map, plane or volume.
    illumination : Illumination, optional
        Of the echoes; what they do not light is left aside.

    Attributes
    ----------
    n_pixels, n_lines : int
        Pixels of a line, and lines of a layer.
    layouts : (L, 5) int64
        Layers of lines that lie evenly in the image, each as `backends.cpu.lines.project_lines`
        describes it. A map or plane is one layer, and so is a volume whose lines do not run along
        its middle axis.
    layers_together : int
        Of the grid, in such a layer.
    paths : Paths
        Half paths to some of the pixels, with derivatives by the pixel number.
    """

    def __init__(self, grid: EvenGrid, tx_m, rx_m, illumination: Illumination | None = None):
        n_axes = len(grid.shape)
        n = _SAMPLES_PER_SIDE[n_axes]
        points = even_positions(grid, *(i.ravel() for i in np.meshgrid(
            *(np.linspace(0, size - 1, n) for size in grid.shape), indexing='ij')))
        # a map or plane is a volume of one layer
        shape = (1,) * (3 - n_axes) + grid.shape
        steps = np.concatenate([np.zeros((3 - n_axes, 3)), grid.steps_m])
        axes = range(3 - n_axes, 3)
        paths = {a: sample_paths(tx_m, rx_m, (points, np.broadcast_to(steps[a], points.shape)))
                 for a in axes}
        if illumination is not None:
            paths = {a: illumination.of_paths(p, points) for a, p in paths.items()}
        slopes = {a: p.of_lit(p.derivatives[0]) for a, p in paths.items()}
        least = {a: np.abs(s).min() if s.min() > 0 or s.max() < 0 else -1.0
                 for a, s in slopes.items()}
        axis = max(reversed(axes), key=least.get)  # the last one, where they are alike
        forward = bool(slopes[axis].mean() >= 0)
        self.n_pixels = shape[axis]
        self.paths = paths[axis] if forward else paths[axis].reversed()
        length = self.paths.length
        may = illumination and illumination.may_light(points, (n,) * n_axes)
        if may is not None:  # of cells, of which parts may be lit, all corners
            length, slopes = length[may], {a: p.derivatives[0][may] for a, p in paths.items()}
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

    def locate(self, layer: int):
        """Function that gives positions and derivatives of a layer for `line_middles`."""
        def positions(pixel, line):
            # lines beside a layer of its own lie beside it
            number = np.clip(line // self._lines_per_layer, 0, self.layers_together - 1)
            line = line - number * self._lines_per_layer
            position = (self._start + np.multiply.outer(pixel, self._along)
                        + np.multiply.outer(line, self._across)
                        + np.multiply.outer(layer + number, self._layer))
            straight = np.zeros_like(position)
            return position, np.broadcast_to(self._along, position.shape), straight, straight
        return positions
