"""Exact backprojection of range profiles on the device, by the way that a plan says."""

from __future__ import annotations

import numpy as np

from ...planning.exact.backprojection import BackprojectionPlan, LinePlan
from ...planning.exact.points import image_layers
from ...planning.exact.polar_image import PolarPlan
from . import tiles
from .arrays import on_device, reports_failures, require_device, synchronise, taken, xp
from .azimuth_upsampling import AzimuthUpsampling
from .known import refuse_unknown
from .lines.lines import Lines, line_profiles, polar_lines, ramp
from .points.points import Points
from .polar_to_map import polar_to_map
from .tiles import Tile
from .transfers import add_to_host, to_host


class Backprojection:
    """Adds range profiles to images by one plan, see `backends.protocol.Backprojection`.

    Arrays of the device are taken as well: an image that lies there stays there. Samples may be
    pairs of integers, (R, N, 2), which are converted there. An image of the host that does not
    fit the device's memory is computed tile by tile.

    Attributes
    ----------
    tiles : list of Tile
        Of an image of the host.

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
        self.plan, self.tiles = plan, tiles.cut(plan)
        self._latest: tuple[Tile | None, object] = (None, None)

    @reports_failures
    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        echoes = samples, tx_m, rx_m
        if on_device(image):
            whole = tiles.whole(self.plan)
            there = xp.zeros(whole.shape, np.complex64)
            self._way(whole).add(*echoes, there.reshape(-1).view(np.float32))
            onto = whole.part_of(taken(image))
            onto += there
            return
        sums = []
        for tile in self.tiles:  # sums wait, that a failure leaves the image as it was
            sums = [(waiting, to_host(there)) for waiting, there in sums]
            there = xp.zeros(tile.shape, np.complex64)
            self._way(tile).add(*echoes, there.reshape(-1).view(np.float32))
            sums.append((tile, there))
        synchronise()
        for tile, there in sums:
            add_to_host(there, tile.part_of(image))

    def _way(self, tile: Tile):
        """What adds echoes to a tile; that of the latest one is kept."""
        if self._latest[0] != tile:
            self._latest = None, None  # its memory first
            ways = {PolarPlan: _Polar, LinePlan: _AlongLines}
            self._latest = tile, ways.get(type(self.plan.way), _OntoPoints)(self.plan, tile)
        return self._latest[1]


class _Polar:
    """By a polar image, in parts that are merged or as a whole, interpolated to the map."""

    def __init__(self, plan: BackprojectionPlan, tile: Tile):
        way, self._illumination = plan.way, plan.illumination
        self._way = way
        self._grid, self._polar, merging, lines = plan.grid, way.polar, None, None
        if tile.rows is not None:
            self._grid = tiles.strip_of_map(plan.grid, way.axis, tile.rows)
            lines = tiles.lines_of_strip(way.polar, self._grid, way.between.first,
                                         way.between.centred.shape[1])
            self._polar = tiles.lines_of_grid(way.polar, lines)
        if way.parts is not None:
            merging = AzimuthUpsampling(way.parts, lines)
        profiles = line_profiles(way.window, way.lattice, way.range_m)
        self._lines = polar_lines(way.polar, profiles, lines, way.lit) if merging is None else (
            polar_lines(way.parts.coarse, profiles, merging.read, way.lit))
        self._merging = merging

    def add(self, samples, tx_m, rx_m, image) -> None:
        way, echoes = self._way, (samples, tx_m, rx_m)
        total = xp.zeros((2, *self._polar.shape), np.float32)
        if self._merging is None:
            self._lines.add(*echoes, total.reshape(-1), self._illumination)
        else:
            self._merging.add_all(lambda number, part: self._lines.add(
                *(a[way.parts.echoes[number]] for a in echoes), part,
                self._illumination and self._illumination.select(way.parts.echoes[number])), total)
        polar_to_map(total, self._polar, self._grid,
                     image.view(np.complex64).reshape(self._grid.shape), axis=way.axis,
                     wavelength_m=way.wavelength_m, between=way.between, along=way.along)


class _AlongLines:
    """Along the lines of the grid itself."""

    def __init__(self, plan: BackprojectionPlan, tile: Tile):
        way, lines = plan.way, plan.way.lines
        profiles = line_profiles(way.window, way.lattice, lines.range_m)
        if tile.rows is None:
            layers = [(lines.locate(layer), layout) for layer, layout in enumerate(lines.layouts)]
        else:
            layers = [(lines.locate(tile.layer), (tile.shape[0], 0, 2 * lines.n_pixels, 2, 1))]
        self._illumination = plan.illumination
        self._lines = Lines(profiles, layers, lines.n_pixels,
                            ramp(profiles.cycles_per_step * way.lattice.n_phases, lines.n_pixels),
                            way.lit, tile.rows, lines.n_lines)

    def add(self, samples, tx_m, rx_m, image) -> None:
        self._lines.add(samples, tx_m, rx_m, image, self._illumination)


class _OntoPoints:
    """Point by point."""

    def __init__(self, plan: BackprojectionPlan, tile: Tile):
        layers = image_layers(plan.grid)
        self._points = Points(plan.way, layers if tile.rows is None else [layers[tile.layer]],
                              tile.rows)
        self._illumination = plan.illumination

    def add(self, samples, tx_m, rx_m, image) -> None:
        self._points.add(samples, tx_m, rx_m, image, self._illumination)
