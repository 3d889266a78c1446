# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar images of a block: in parts that are merged or as a whole, interpolated to the map.

Images of parts are interpolated to the lines of their sum in tiles that stay in cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...compilation import njit, numba
from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...planning.exact.backprojection import BackprojectionPlan
from ...planning.exact.polar_image import DEGREE, TAPS, AzimuthParts
from .lines import PolarLines
from .memory import WorkSpace, aligned_empty
from .polar_to_map import polar_to_map
from .profiles import Profiles

_BATCH_BYTES = 24 << 20  # of parts that are merged together
_TILE_PAIRS, _TILE_RANGES = 32, 512  # of the sum; what it reads of the parts fits the cache
_ALIGNED = 16  # floats of a cache line


class AzimuthUpsampling:
    """Interpolate images of parts to the lines of their sum.

    Several parts are merged at a time, since reading and writing the sum takes longer than the
    arithmetic of one part.
    """

    def __init__(self, parts: AzimuthParts):
        coarse, fine, interpolator = parts.coarse, parts.fine, parts.interpolator
        v = (fine.alpha - coarse.alpha_start) / coarse.alpha_spacing
        floor = np.clip(np.floor(v), -interpolator.first,
                        coarse.n_alpha - TAPS - interpolator.first)
        start = floor.astype(np.int64) + interpolator.first
        powers = (v - floor)[:, None] ** np.arange(DEGREE + 1)
        weights = powers @ interpolator.weights.astype(np.float64)
        self._start = np.minimum(start[::2], coarse.n_alpha - TAPS - 1)
        self._weights = _in_pairs(weights, start, self._start)
        self._parts = parts

    def add_all(self, form: Callable[[int, np.ndarray], None], total: np.ndarray) -> None:
        """Add the images of all parts to the sum, (2, n_alpha, n_range) float32, in place.

        ``form(number, image)`` adds a part to its image (2, n_alpha_coarse, n) float32, real and
        imaginary parts; its lines end in padding, n is n_range or a little more.
        """
        coarse, fine = self._parts.coarse, self._parts.fine
        width = -(-coarse.n_range // _ALIGNED) * _ALIGNED
        shape = (2, coarse.n_alpha, width)
        n_parts = len(self._parts.echoes)
        at_once = max(1, min(n_parts, _BATCH_BYTES // (4 * math.prod(shape))))
        images = aligned_empty((at_once, *shape), np.float32)
        for first in range(0, n_parts, at_once):
            numbers = range(first, min(first + at_once, n_parts))
            images[:] = 0.0
            for image, number in zip(images, numbers, strict=False):
                form(number, image)
                _rotate_lines(image[0], image[1], self._phasor(number, coarse, -1))
            up = np.concatenate([self._phasor(number, fine, 1) for number in numbers])
            _merge(images.reshape(-1), (len(numbers), *shape[1:]), self._start,
                   self._weights.reshape(-1), up, (fine.n_alpha, fine.n_range),
                   total.reshape(-1))

    def _phasor(self, number: int, grid: PolarGrid, sign: int) -> np.ndarray:
        """(n_alpha,) complex64 carrier of a part's band along direction."""
        cycles = sign * self._parts.frequency[number] * grid.alpha
        return np.exp(1j * np.fmod(cycles, 2 * np.pi)).astype(np.complex64)


@njit(parallel=True)
def _rotate_lines(real, imag, phasor):
    for line in numba.prange(real.shape[0]):
        c, s = phasor[line].real, phasor[line].imag
        for i in range(real.shape[1]):
            re, im = real[line, i], imag[line, i]
            real[line, i] = re * c - im * s
            imag[line, i] = re * s + im * c


def _in_pairs(weights: np.ndarray, start: np.ndarray, common: np.ndarray) -> np.ndarray:
    """(n_pairs, 2, TAPS + 1) float32 weights of neighbouring lines, from their common start.

    They begin at the same coarse line or at the next one; a last single line gets a partner that
    adds nothing.
    """
    pairs = np.zeros((2 * len(common), TAPS + 1), np.float32)
    for shift in (0, 1):
        some = np.flatnonzero(start - np.repeat(common, 2)[:len(start)] == shift)
        pairs[some, shift:shift + TAPS] = weights[some]
    return pairs.reshape(-1, 2, TAPS + 1)


@njit(parallel=True)
def _merge(images, shape, start, weights, phasor, fine_shape, total):
    """Tiles of the sum take all parts in turn; free of views, see `lines.project_lines`.

    Two lines at a time, since reading the parts takes longer than the arithmetic.
    """
    n_parts, n_coarse, width = shape
    n_lines, n_range = fine_shape
    n_pairs, n, one = len(start), np.uint64(width), np.uint64(1)
    n_chunks = (n_pairs + _TILE_PAIRS - 1) // _TILE_PAIRS
    beyond, imag = np.uint64(n_lines * n_range), np.uint64(n_coarse * width)
    for tile in numba.prange(n_chunks * ((n_range + _TILE_RANGES - 1) // _TILE_RANGES)):
        left = (tile // n_chunks) * _TILE_RANGES
        count = np.uint64(min(_TILE_RANGES, n_range - left))
        first_pair = (tile % n_chunks) * _TILE_PAIRS
        for pair in range(first_pair, min(first_pair + _TILE_PAIRS, n_pairs)):
            w = np.uint64(2 * (TAPS + 1) * pair)
            a, b = _taps(weights, w, one), _taps(weights, w + np.uint64(TAPS + 1), one)
            other = min(2 * pair + 1, n_lines - 1)
            to, to2 = np.uint64(2 * pair * n_range + left), np.uint64(other * n_range + left)
            also, also2 = to + beyond, to2 + beyond
            for part in range(n_parts):
                z, z2 = phasor[part * n_lines + 2 * pair], phasor[part * n_lines + other]
                c, s, c2, s2 = z.real, z.imag, z2.real, z2.imag
                p = np.uint64((part * 2 * n_coarse + start[pair]) * width + left)
                for i in range(count):
                    v = _taps(images, p + i, n)
                    re, re2 = _weighted(a, v), _weighted(b, v)
                    v = _taps(images, p + imag + i, n)
                    im, im2 = _weighted(a, v), _weighted(b, v)
                    total[to + i] += re * c - im * s
                    total[also + i] += re * s + im * c
                    total[to2 + i] += re2 * c2 - im2 * s2
                    total[also2 + i] += re2 * s2 + im2 * c2


@njit(inline='always')
def _taps(data, place, apart):
    """TAPS + 1 numbers, so far apart."""
    two, three = apart + apart, np.uint64(3) * apart
    six, nine = three + three, np.uint64(9) * apart
    return (data[place], data[place + apart], data[place + two], data[place + three],
            data[place + three + apart], data[place + three + two], data[place + six],
            data[place + six + apart], data[place + six + two], data[place + nine],
            data[place + nine + apart])


@njit(inline='always')
def _weighted(w, v):
    return (w[0] * v[0] + w[1] * v[1] + w[2] * v[2] + w[3] * v[3] + w[4] * v[4] + w[5] * v[5]
            + w[6] * v[6] + w[7] * v[7] + w[8] * v[8] + w[9] * v[9] + w[10] * v[10])


class PolarImage:
    """Adds echoes to a polar image, and this to the map; see `Backprojection`."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        route = self._route = plan.route
        self._grid: MapGrid = plan.grid
        profiles = Profiles(route.window, route.resampling, route.range_m, memory)
        self._lines = PolarLines(route.projected, profiles, route.amplitudes)
        self._illumination = plan.illumination
        self._merging = route.parts and AzimuthUpsampling(route.parts)
        self._memory = memory

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        route, echoes = self._route, (samples, tx_m, rx_m)
        shape = 2, route.polar.n_alpha, route.polar.n_range
        total = self._memory('polar image', shape, np.float32)
        total[:] = 0.0
        if self._merging is None:
            self._lines.add(*echoes, total, self._illumination)
        else:
            self._merging.add_all(lambda number, part: self._lines.add(
                *(a[route.parts.echoes[number]] for a in echoes), part,
                self._illumination and self._illumination.select(route.parts.echoes[number])),
                total)
        polar_to_map(total, route.polar, self._grid, axis=route.axis,
                     wavelength_m=route.wavelength_m, between=route.between, along=route.along,
                     onto=image)
