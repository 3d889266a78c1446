"""Lines of a grid along which range grows, and the half paths to them."""

from __future__ import annotations

import math

import numpy as np

from ...geometry.grids import EvenGrid, even_positions
from ..profiles.range_resampling import sample_paths

_SAMPLES_PER_SIDE = {2: 5, 3: 3}  # grid positions at which the geometry is bounded, by axes


class GridLines:
    """Lines of a map, plane or volume along the axis that follows range best, where it grows.

    Parameters
    ----------
    grid : EvenGrid
        Map, plane or volume.

    Attributes
    ----------
    n_pixels, n_lines : int
        Pixels of a line, and lines of a layer.
    layouts : (L, 5) int64
        Layers of lines that lie evenly in the image, each as `line_kernels.project_lines`
        describes it. A map or plane is one layer, and so is a volume whose lines do not run along
        its middle axis.
    paths : Paths
        Half paths to some of the pixels, with derivatives by the pixel number.
    """

    def __init__(self, grid: EvenGrid, tx_m, rx_m):
        steps, shape = grid.steps_m, grid.shape
        n = _SAMPLES_PER_SIDE[len(shape)]
        points = even_positions(grid, *(i.ravel() for i in np.meshgrid(
            *(np.linspace(0, size - 1, n) for size in shape), indexing='ij')))
        axes = range(len(shape))
        paths = [sample_paths(tx_m, rx_m, (points, np.broadcast_to(step, points.shape)))
                 for step in steps]
        slopes = [p.derivatives[0] for p in paths]
        least = [np.abs(s).min() if s.min() > 0 or s.max() < 0 else -1.0 for s in slopes]
        axis = max(reversed(axes), key=lambda a: least[a])  # the last one, where they are alike
        forward = bool(slopes[axis].mean() >= 0)
        self.n_pixels = shape[axis]
        self.paths = paths[axis] if forward else paths[axis].reversed()
        # Range is monotonic along lines; between sampled lines it changes by at most its slope.
        beside = sum(np.abs(slopes[a]).max() * (shape[a] / (n - 1) / 2 + 1)
                     for a in axes if a != axis or least[axis] < 0)
        self.range_m = (float(self.paths.length.min() - beside),
                        float(self.paths.length.max() + beside))
        self._lay_out(steps, shape, axis, forward)
        self._start = np.array(grid.origin_m)
        if not forward:
            self._start = self._start + (self.n_pixels - 1) * steps[axis]

    def _lay_out(self, steps, shape, axis: int, forward: bool) -> None:
        """Layers of lines: the axes across are one where their pixels lie evenly in the image."""
        floats = [2 * math.prod(shape[a + 1:]) for a in range(len(shape))]
        layer, line = ([a for a in range(len(shape)) if a != axis][-2:] if len(shape) > 2
                       else (None, 1 - axis))
        self._along = steps[axis] if forward else -steps[axis]
        self._across = steps[line]
        self._layer, n_layers, layer_floats = np.zeros(3), 1, 0
        if layer is not None:
            self._layer, n_layers, layer_floats = steps[layer], shape[layer], floats[layer]
        self._lines_per_layer = shape[line]
        self.n_lines = shape[line]
        if layer_floats == shape[line] * floats[line]:
            self.n_lines, n_layers = n_layers * shape[line], 1
        first, pixel = 0, floats[axis]
        if not forward:
            first, pixel = (self.n_pixels - 1) * pixel, -pixel
        self.layouts = np.array([[self.n_lines, first + i * layer_floats, floats[line], pixel, 1]
                                 for i in range(n_layers)])

    def locate(self, layer: int):
        """Function that gives positions and derivatives of a layer for `line_middles`."""
        def positions(pixel, line):
            number, line = np.divmod(line, self._lines_per_layer)
            position = (self._start + np.multiply.outer(pixel, self._along)
                        + np.multiply.outer(line, self._across)
                        + np.multiply.outer(layer + number, self._layer))
            straight = np.zeros_like(position)
            return position, np.broadcast_to(self._along, position.shape), straight, straight
        return positions
