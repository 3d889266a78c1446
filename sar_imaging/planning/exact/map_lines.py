"""Lines of a map along which range grows, and the half paths to them."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ..profiles.range_resampling import sample_paths

_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded


class MapLines:
    """Lines of a map grid along the axis that follows range best, in the direction of growth.

    Parameters
    ----------
    grid : MapGrid
        The map.
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.

    Attributes
    ----------
    n_pixels, n_lines : int
        Pixels of a line, and lines.
    layout : (5,) int64
        As `kernels.project_lines` describes it.
    paths : lattice.Paths
        Half paths to some of the pixels, with derivatives by the pixel number.
    range_m : (float, float)
        Bounds of the half path over the map, metres.
    """

    def __init__(self, grid: MapGrid, tx_m, rx_m):
        n = _SAMPLES_PER_SIDE
        x, y = (np.linspace(a[0], a[-1], n) for a in (grid.x_m, grid.y_m))
        points = np.stack([*(v.ravel() for v in np.meshgrid(x, y)), np.full(n * n, grid.z_m)],
                          axis=-1)
        steps = np.array([[grid.spacing_m, 0, 0], [0, -grid.spacing_m, 0]])
        paths = [sample_paths(tx_m, rx_m, (points, np.broadcast_to(step, points.shape)))
                 for step in steps]
        slopes = [p.derivatives[0] for p in paths]
        least = [np.abs(s).min() if s.min() > 0 or s.max() < 0 else -1.0 for s in slopes]
        axis = int(np.argmax(least))
        forward = slopes[axis].mean() >= 0
        self._along = steps[axis] if forward else -steps[axis]
        self._across = steps[1 - axis]
        self.n_pixels, self.n_lines = grid.shape[1 - axis], grid.shape[axis]
        self._start = np.array([grid.x_m[0], grid.y_m[0], grid.z_m])
        pixel, line = ((2, 2 * grid.n_x), (2 * grid.n_x, 2))[axis]
        first = 0
        if not forward:
            self._start = self._start - (self.n_pixels - 1) * self._along
            first, pixel = (self.n_pixels - 1) * pixel, -pixel
        self.layout = np.array([self.n_lines, first, line, pixel, 1])
        self.paths = paths[axis] if forward else paths[axis].reversed()
        # Range is monotonic along lines; between sampled lines it changes by at most its slope.
        beside = np.abs(slopes[1 - axis]).max() * (self.n_lines / (n - 1) / 2 + 1)
        if least[axis] < 0:
            beside += np.abs(slopes[axis]).max() * (self.n_pixels / (n - 1) / 2 + 1)
        self.range_m = (float(self.paths.length.min() - beside),
                        float(self.paths.length.max() + beside))

    def locate(self, pixel, line):
        """Positions and derivatives for `line_middles`."""
        position = (self._start + np.multiply.outer(pixel, self._along)
                    + np.multiply.outer(line, self._across))
        straight = np.zeros_like(position)
        return position, np.broadcast_to(self._along, position.shape), straight, straight
