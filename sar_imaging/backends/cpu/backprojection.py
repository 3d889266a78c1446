# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact backprojection of range profiles, by the route of a plan."""

from __future__ import annotations

import numpy as np

from ...planning.exact.backprojection import BackprojectionPlan
from ...planning.exact.points import image_layers
from .groups import GroupImages
from .illumination import Antennas, TileAmplitudes
from .lines import line_middles, project_lines, shared_phase
from .memory import WorkSpace
from .points import project_points
from .profiles import Profiles


class Backprojection:
    """Adds range profiles to images by one plan, see `backends.protocol.Backprojection`.

    What blocks share is prepared once; `memory` is a `WorkSpace`.
    """

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace | None = None):
        routes = {'polar': _polar, 'lines': _Lines, 'points': _Points, 'groups': _groups}
        self.plan, self.memory = plan, memory or WorkSpace()
        self._route = routes[plan.method](plan, self.memory)

    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        self._route.add(samples, tx_m, rx_m, image)


def _polar(plan: BackprojectionPlan, memory: WorkSpace):
    from .polar_image import PolarImage  # with illumination, or where it is asked for

    return PolarImage(plan, memory)


def _groups(plan: BackprojectionPlan, memory: WorkSpace) -> GroupImages:
    return GroupImages(plan.route, plan.radar.wavelength_m, memory)


class _Lines:
    """Along the lines of the grid itself."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        route, lines = plan.route, plan.route.lines
        self._profiles = Profiles(route.window, route.lattice, lines.range_m, memory)
        self._layers = [(line_middles(lines.locate(layer), lines.n_lines, lines.n_pixels,
                                      route.lattice.segment), layout)
                        for layer, layout in enumerate(lines.layouts)]
        self._phase = shared_phase(self._profiles, lines.n_pixels)
        self._tiles = None
        if route.lit is not None:
            echoes = Antennas.of(plan.illumination)
            self._tiles = [TileAmplitudes(echoes, *route.lit.knots(
                lines.locate(layer), lines.n_lines, lines.n_pixels, route.lattice.segment))
                for layer in range(len(lines.layouts))]

    def add(self, samples, tx_m, rx_m, image) -> None:
        project_lines(self._profiles, samples, tx_m, rx_m, self._layers, self._phase,
                      image.reshape(-1).view(np.float32), self._tiles)


class _Points:
    """Point by point."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        self._plan, self._memory, self._illumination = plan.route, memory, plan.illumination
        self._layers = image_layers(plan.grid)

    def add(self, samples, tx_m, rx_m, image) -> None:
        project_points(self._plan, self._layers, samples, tx_m, rx_m,
                       image.reshape(-1).view(np.float32), self._memory, self._illumination)
