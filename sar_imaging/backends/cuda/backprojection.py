"""Exact backprojection of range profiles on the device, by the way that a plan says."""

from __future__ import annotations

import math

import numpy as np

from ...memory import IMAGE_BYTES
from ...planning.exact.backprojection import BackprojectionPlan, LinePlan
from ...planning.exact.points import PointPlan, image_layers
from ...planning.exact.polar_image import PolarPlan
from .arrays import check_memory, on_device, reports_failures, require_device, to_host, xp
from .azimuth_upsampling import AzimuthUpsampling
from .known import refuse_unknown
from .lines import Lines, polar_lines, ramp
from .points import Points
from .polar_to_map import polar_to_map
from .profiles import Profiles


class Backprojection:
    """Adds range profiles to images by one plan, see `backends.protocol.Backprojection`.

    Arrays of the device are taken as well: an image that lies there stays there. Samples may be
    pairs of integers, (R, N, 2), which are converted there.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory; the image is as it was.
    """

    memory = None  # the device's own pool serves all plans

    @reports_failures
    def __init__(self, plan: BackprojectionPlan, memory: object = None):
        require_device()
        refuse_unknown(plan)
        refuse_unknown(plan.way)
        ways = {PolarPlan: _Polar, LinePlan: _along_lines, PointPlan: _onto_points}
        check_memory(plan.n_bytes + IMAGE_BYTES * math.prod(plan.grid.shape),
                     'an image of ' + ' x '.join(map(str, reversed(plan.grid.shape))) + ' pixels',
                     "cut the grid into smaller ones, or use backend='cpu'")
        self.plan = plan
        self._way = ways[type(plan.way)](plan)

    @reports_failures
    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        there = xp.asarray(image)
        self._way.add(samples, tx_m, rx_m, there.reshape(-1).view(np.float32))
        if not on_device(image):
            image[...] = to_host(there)


class _Polar:
    """By a polar image, in parts that are merged or as a whole, interpolated to the map."""

    def __init__(self, plan: BackprojectionPlan):
        way = self._way = plan.way
        self._grid = plan.grid
        profiles = Profiles(way.window, way.lattice, way.range_m)
        self._lines = polar_lines(way.polar if way.parts is None else way.parts.coarse, profiles)
        self._merging = way.parts and AzimuthUpsampling(way.parts)

    def add(self, samples, tx_m, rx_m, image) -> None:
        way, echoes = self._way, (samples, tx_m, rx_m)
        total = xp.zeros((2, way.polar.n_alpha, way.polar.n_range), np.float32)
        if self._merging is None:
            self._lines.add(*echoes, total.reshape(-1))
        else:
            self._merging.add_all(lambda number, part: self._lines.add(
                *(a[way.parts.rows[number]] for a in echoes), part), total)
        polar_to_map(total, way.polar, self._grid,
                     image.view(np.complex64).reshape(self._grid.shape), axis=way.axis,
                     wavelength_m=way.wavelength_m, between=way.between, along=way.along)


def _along_lines(plan: BackprojectionPlan) -> Lines:
    """Along the lines of the grid itself."""
    way, lines = plan.way, plan.way.lines
    profiles = Profiles(way.window, way.lattice, lines.range_m)
    layers = [(lines.locate(layer), layout) for layer, layout in enumerate(lines.layouts)]
    return Lines(profiles, layers, lines.n_pixels,
                 ramp(profiles.cycles_per_step * way.lattice.n_phases, lines.n_pixels))


def _onto_points(plan: BackprojectionPlan) -> Points:
    return Points(plan.way, image_layers(plan.grid))
