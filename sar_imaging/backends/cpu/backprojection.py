"""Exact backprojection of range profiles, by the way that a plan says."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...planning.exact.backprojection import BackprojectionPlan, LinePlan
from ...planning.exact.lit_lines import knot_positions
from ...planning.exact.points import PointPlan, image_layers
from ...planning.exact.polar_image import PolarPlan
from .azimuth_upsampling import AzimuthUpsampling
from .illumination import LitEchoes
from .line_kernels import project_lines
from .lines import PolarLines, line_middles, shared_phase
from .lit.tiles import LitTiles
from .memory import WorkSpace
from .points.kernels import project_points
from .polar_to_map import polar_to_map
from .profiles import Profiles


class Backprojection:
    """Adds range profiles to images by one plan, see `backends.protocol.Backprojection`.

    What blocks share is prepared once; `memory` is a `WorkSpace`.
    """

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace | None = None):
        ways = {PolarPlan: _Polar, LinePlan: _Lines, PointPlan: _Points}
        self.plan, self.memory = plan, memory or WorkSpace()
        self._way = ways[type(plan.way)](plan, self.memory)

    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        self._way.add(samples, tx_m, rx_m, image)


class _Polar:
    """By a polar image, in parts that are merged or as a whole, interpolated to the map."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        way = self._way = plan.way
        self._grid: MapGrid = plan.grid
        profiles = Profiles(way.window, way.lattice, way.range_m, memory)
        self._lines = PolarLines(way.polar if way.parts is None else way.parts.coarse, profiles,
                                 way.lit)
        self._illumination = plan.illumination
        self._merging = way.parts and AzimuthUpsampling(way.parts)
        self._memory = memory

    def add(self, samples, tx_m, rx_m, image) -> None:
        way, echoes = self._way, (samples, tx_m, rx_m)
        total = self._memory('polar image', (2, way.polar.n_alpha, way.polar.n_range), np.float32)
        total[:] = 0.0
        if self._merging is None:
            self._lines.add(*echoes, total, self._illumination)
        else:
            self._merging.add_all(lambda number, part: self._lines.add(
                *(a[way.parts.echoes[number]] for a in echoes), part,
                self._illumination and self._illumination.select(way.parts.echoes[number])), total)
        polar_to_map(total, way.polar, self._grid, axis=way.axis, wavelength_m=way.wavelength_m,
                     between=way.between, along=way.along, onto=image)


class _Lines:
    """Along the lines of the grid itself."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        way, lines = plan.way, plan.way.lines
        self._profiles = Profiles(way.window, way.lattice, lines.range_m, memory)
        self._layers = [(line_middles(lines.locate(layer), lines.n_lines, lines.n_pixels,
                                      way.lattice.segment), layout)
                        for layer, layout in enumerate(lines.layouts)]
        self._phase = shared_phase(self._profiles, lines.n_pixels)
        self._lit = None
        if way.lit is not None:
            echoes = LitEchoes.of(plan.illumination)
            self._lit = [LitTiles(echoes, *knot_positions(
                lines.locate(layer), lines.n_lines, lines.n_pixels, way.lattice.segment,
                way.lit.apart)) for layer in range(len(lines.layouts))]

    def add(self, samples, tx_m, rx_m, image) -> None:
        project_lines(self._profiles, samples, tx_m, rx_m, self._layers, self._phase,
                      image.reshape(-1).view(np.float32), self._lit)


class _Points:
    """Point by point."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        self._plan, self._memory, self._illumination = plan.way, memory, plan.illumination
        self._layers = image_layers(plan.grid)

    def add(self, samples, tx_m, rx_m, image) -> None:
        project_points(self._plan, self._layers, samples, tx_m, rx_m,
                       image.reshape(-1).view(np.float32), self._memory, self._illumination)
