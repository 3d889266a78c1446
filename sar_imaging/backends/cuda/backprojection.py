# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact backprojection of range profiles on the device, by the way that a plan says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...geometry.polar import PolarGrid
from ...planning.exact.backprojection import BackprojectionPlan, LinePlan
from ...planning.exact.points import image_layers
from ...planning.exact.polar_image import TAPS, AzimuthParts, PolarPlan
from . import tiles
from .arrays import (
    cuda,
    free_bytes,
    kernel,
    launch,
    on_device,
    reports_failures,
    require_device,
    synchronise,
    taken,
    xp,
)
from .known import refuse_unknown
from .lines import Lines, line_profiles, polar_lines, ramp
from .points import Points
from .polar_to_map import polar_to_map
from .tiles import Tile, lines_of_grid
from .transfers import add_to_host, to_host

_MOST_BYTES, _SHARE = 1 << 30, 4  # of parts that are merged together, and of the free memory
_RANGES, _LINES, _PIXELS = 32, 8, 4  # threads of a block by axis, and ranges of a thread
_WIDTH = _RANGES * _PIXELS  # ranges of a block
_PARTS, _TAPS = 8, TAPS  # parts whose weights lie in shared memory
_SHARED, _PHASORS = (_PARTS * _LINES * TAPS, _PARTS * _LINES)


class AzimuthUpsampling:
    """Interpolates images of parts to the lines of their sum.

    `backends.reference.upsample_azimuth` has the formula. Several parts are merged at a time.

    Parameters
    ----------
    parts : AzimuthParts
        How the echoes are cut, and the grids.
    lines : slice, optional
        Lines of the sum, where only some are wanted.

    Attributes
    ----------
    coarse, fine : PolarGrid
        Lines of the parts that are read, and those of the sum.
    read : slice
        The former among those of the parts.
    """

    def __init__(self, parts: AzimuthParts, lines: slice | None = None):
        coarse, fine, interpolator = parts.coarse, parts.fine, parts.interpolator
        v = (fine.alpha - coarse.alpha_start) / coarse.alpha_spacing
        floor = np.clip(np.floor(v), -interpolator.first,
                        coarse.n_alpha - TAPS - interpolator.first)
        powers = (v - floor)[:, None] ** np.arange(len(interpolator.weights))
        weights = powers @ interpolator.weights.astype(np.float64)
        start = (floor + interpolator.first).astype(np.int32)
        self.read = slice(0, coarse.n_alpha)
        if lines is not None:
            start, weights = start[lines], weights[lines]
            read = self.read = slice(int(start[0]), int(start[-1]) + TAPS)
            coarse, fine = lines_of_grid(coarse, read), lines_of_grid(fine, lines)
            start = start - np.int32(read.start)
        self._start = xp.asarray(start)
        self._weights = xp.asarray(weights.astype(np.float32))
        self._parts, self.coarse, self.fine = parts, coarse, fine

    def add_all(self, form: Callable[[int, np.ndarray], None], total: np.ndarray) -> None:
        """Add the images of all parts to the sum.

        Parameters
        ----------
        form : callable
            ``form(number, image)`` adds a part to its image, (2 * n_alpha_coarse * n_range,)
            float32 array of the device: real, then imaginary part.
        total : (2, n_alpha, n_range) float32 array of the device
            Sum; changed in place.
        """
        coarse, fine = self.coarse, self.fine
        size, n_parts = 2 * coarse.n_alpha * coarse.n_range, len(self._parts.echoes)
        at_once = min(_MOST_BYTES, free_bytes() // _SHARE) // (4 * size)
        at_once = max(1, min(n_parts, at_once))
        blocks = -(-fine.n_range // _WIDTH), -(-fine.n_alpha // _LINES)
        for first in range(0, n_parts, at_once):
            numbers = range(first, min(first + at_once, n_parts))
            # blocks read beyond the last range, and use nothing of it
            images = xp.zeros(len(numbers) * size + 2 * _WIDTH, np.float32)
            for k, number in enumerate(numbers):
                form(number, images[k * size:(k + 1) * size])
            launch(merge_parts, blocks, (_RANGES, _LINES), images, coarse.n_alpha,
                   self._phasors(numbers, coarse, -1), self._start, self._weights,
                   self._phasors(numbers, fine, 1), total)

    def _phasors(self, numbers: range, grid: PolarGrid, sign: int) -> np.ndarray:
        """(P, n_alpha) complex64 carrier of each part's band along direction."""
        radians = np.multiply.outer(sign * self._parts.frequency[numbers], grid.alpha)
        return xp.asarray(np.exp(1j * np.fmod(radians, 2 * np.pi)).astype(np.complex64))


@kernel()
def merge_parts(images, n_coarse, down, start, weights, up, total):
    """Add interpolated images of parts to their sum; blocks of `_WIDTH` ranges and some lines.

    Parameters
    ----------
    images, n_coarse : (2 * P * n_alpha_coarse * n_range + 2 * _WIDTH,) float32, int
        Of the parts, real, then imaginary parts of each; n_alpha_coarse.
    down, up : (P, n_alpha_coarse), (P, n_alpha) complex64
        Factors of each coarse line, which take a part's carrier off, and of each fine line.
    start, weights : (n_alpha,) int32, (n_alpha, TAPS) float32
        First coarse line of each fine one, and weights.
    total : (2, n_alpha, n_range) float32
        Sum.
    """
    shared_re = cuda.shared.array(_SHARED, np.float32)
    shared_im = cuda.shared.array(_SHARED, np.float32)
    up_re = cuda.shared.array(_PHASORS, np.float32)
    up_im = cuda.shared.array(_PHASORS, np.float32)
    line_re = cuda.local.array(_TAPS, np.float32)
    line_im = cuda.local.array(_TAPS, np.float32)
    slow_re = cuda.local.array(_PIXELS, np.float32)
    slow_im = cuda.local.array(_PIXELS, np.float32)
    real = cuda.local.array(_PIXELS, np.float32)
    imag = cuda.local.array(_PIXELS, np.float32)
    top, row = cuda.blockIdx.y * _LINES, cuda.threadIdx.y
    thread, n_parts = row * _RANGES + cuda.threadIdx.x, down.shape[0]
    n_lines, n_range = total.shape[1], total.shape[2]
    line, first = min(top + row, n_lines - 1), cuda.blockIdx.x * _WIDTH + cuda.threadIdx.x
    apart, between = np.uint64(n_range), np.uint64(n_coarse * n_range)
    for p in range(_PIXELS):
        real[p], imag[p] = 0.0, 0.0
    for begin in range(0, n_parts, _PARTS):
        n_some = min(_PARTS, n_parts - begin)
        cuda.syncthreads()
        for item in range(thread, n_some * _LINES * _TAPS, _RANGES * _LINES):
            part, there = begin + item // (_LINES * _TAPS), item // _TAPS % _LINES
            k, there = item % _TAPS, min(top + there, n_lines - 1)
            factor, w = down[part, start[there] + k], weights[there, k]
            shared_re[item], shared_im[item] = w * factor.real, w * factor.imag
        for item in range(thread, n_some * _LINES, _RANGES * _LINES):
            factor = up[begin + item // _LINES, min(top + item % _LINES, n_lines - 1)]
            up_re[item], up_im[item] = factor.real, factor.imag
        cuda.syncthreads()
        for number in range(n_some):
            at = np.uint64((2 * (begin + number) * n_coarse + start[line]) * n_range + first)
            item = np.uint64((number * _LINES + row) * _TAPS)
            for p in range(_PIXELS):
                slow_re[p], slow_im[p] = 0.0, 0.0
            for k in range(_TAPS):
                at_k = item + np.uint64(k)
                line_re[k], line_im[k] = shared_re[at_k], shared_im[at_k]
            for k in range(_TAPS):
                cosine, sine = line_re[k], line_im[k]
                for p in range(_PIXELS):
                    # steps from range to range are constants of the instructions
                    re = images[at + np.uint64(p * _RANGES)]
                    im = images[at + between + np.uint64(p * _RANGES)]
                    slow_re[p] += re * cosine
                    slow_re[p] -= im * sine
                    slow_im[p] += re * sine
                    slow_im[p] += im * cosine
                at += apart
            cosine, sine = up_re[number * _LINES + row], up_im[number * _LINES + row]
            for p in range(_PIXELS):
                real[p] += slow_re[p] * cosine - slow_im[p] * sine
                imag[p] += slow_re[p] * sine + slow_im[p] * cosine
    for p in range(_PIXELS):
        i = first + p * _RANGES
        if i < n_range and top + row < n_lines:
            total[0, line, i] += real[p]
            total[1, line, i] += imag[p]


class Backprojection:
    """Adds range profiles to images by one plan, see `backends.protocol.Backprojection`.

    Arrays of the device are taken as well: an image that lies there stays there. Samples may be
    pairs of integers, (R, N, 2), which are converted there. An image of the host that does not
    fit the device's memory is computed tile by tile.

    Attributes
    ----------
    tiles : list of Tile
        Tiles of an image of the host.

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
        refuse_unknown(plan.route)
        self.plan, self.tiles = plan, tiles.cut(plan)
        self._latest: tuple[Tile | None, object] = (None, None)

    @reports_failures
    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        echoes = samples, tx_m, rx_m
        if on_device(image):
            whole = tiles.whole(self.plan)
            there = xp.zeros(whole.shape, np.complex64)
            self._route(whole).add(*echoes, there.reshape(-1).view(np.float32))
            onto = whole.part_of(taken(image))
            onto += there
            return
        sums: list[tuple[Tile, np.ndarray]] = []
        for tile in self.tiles:  # sums wait, that a failure leaves the image as it was
            sums = [(waiting, to_host(there)) for waiting, there in sums]
            there = xp.zeros(tile.shape, np.complex64)
            self._route(tile).add(*echoes, there.reshape(-1).view(np.float32))
            sums.append((tile, there))
        synchronise()
        for tile, there in sums:
            add_to_host(there, tile.part_of(image))

    def _route(self, tile: Tile) -> _Polar | _AlongLines | _OntoPoints:
        """What adds echoes to a tile; that of the latest one is kept."""
        if self._latest[0] != tile:
            self._latest = None, None  # its memory first
            routes = {PolarPlan: _Polar, LinePlan: _AlongLines}
            self._latest = tile, routes.get(type(self.plan.route), _OntoPoints)(self.plan, tile)
        return self._latest[1]


class _Polar:
    """By a polar image, in parts that are merged or as a whole, interpolated to the map."""

    def __init__(self, plan: BackprojectionPlan, tile: Tile):
        route, self._illumination = plan.route, plan.illumination
        self._route = route
        self._grid, self._polar, merging, lines = plan.grid, route.polar, None, None
        if tile.rows is not None:
            self._grid = tiles.strip_of_map(plan.grid, route.axis, tile.rows)
            lines = tiles.lines_of_strip(route.polar, self._grid, route.between.first,
                                         route.between.centred.shape[1])
            self._polar = tiles.lines_of_grid(route.polar, lines)
        if route.parts is not None:
            merging = AzimuthUpsampling(route.parts, lines)
        profiles = line_profiles(route.window, route.resampling, route.range_m)
        coarse, read = (route.polar, lines) if merging is None else (
            route.parts.coarse, merging.read)
        self._lines = polar_lines(coarse, profiles, read, route.amplitudes)
        self._merging = merging

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        route, echoes = self._route, (samples, tx_m, rx_m)
        total = xp.zeros((2, *self._polar.shape), np.float32)
        if self._merging is None:
            self._lines.add(*echoes, total.reshape(-1), self._illumination)
        else:
            self._merging.add_all(lambda number, part: self._lines.add(
                *(a[route.parts.echoes[number]] for a in echoes), part,
                self._illumination and self._illumination.select(route.parts.echoes[number])),
                total)
        polar_to_map(total, self._polar, self._grid,
                     image.view(np.complex64).reshape(self._grid.shape), axis=route.axis,
                     wavelength_m=route.wavelength_m, between=route.between, along=route.along)


class _AlongLines:
    """Along the lines of the grid itself."""

    def __init__(self, plan: BackprojectionPlan, tile: Tile):
        route, lines = plan.route, plan.route.lines
        profiles = line_profiles(route.window, route.resampling, lines.range_m)
        if tile.rows is None:
            layers = [(lines.locate(layer), layout) for layer, layout in enumerate(lines.layouts)]
        else:
            layers = [(lines.locate(tile.layer), (tile.shape[0], 0, 2 * lines.n_pixels, 2, 1))]
        self._illumination = plan.illumination
        self._lines = Lines(profiles, layers, lines.n_pixels,
                            ramp(profiles.cycles_per_step * route.resampling.n_phases,
                                 lines.n_pixels), route.amplitudes, tile.rows, lines.n_lines)

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        self._lines.add(samples, tx_m, rx_m, image, self._illumination)


class _OntoPoints:
    """Point by point."""

    def __init__(self, plan: BackprojectionPlan, tile: Tile):
        layers = image_layers(plan.grid)
        self._points = Points(plan.route, layers if tile.rows is None else [layers[tile.layer]],
                              tile.rows)
        self._illumination = plan.illumination

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        self._points.add(samples, tx_m, rx_m, image, self._illumination)
