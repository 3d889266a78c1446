# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection onto arbitrary points on the device, or onto few for the many trials of a search.

Points are taken in tiles of neighbours, as on the processor. The path to the centre of a tile is
computed in float64, once for each echo, and for each point only what its offset from there adds,
in float32 and without cancellation: with w the vector from the phase centre to the tile's centre,
d its length and o the offset,

``|w + o| - d = q / (1 + sqrt(1 + s)),  q = 2 (w/d) o + |o|^2 / d,  s = q / d.``

Tiles too large for that, and echoes whose phase centre is too near to a tile, are computed in
float64 point by point, in a loop of their own. A thread has `POINTS` points of a tile, for which
it loads what they share once; neighbours read neighbouring cells of a profile.

How an echo illuminates a tile is `illumination`, the last arguments of `add_weighted_points`;
numbers of an item, which is an echo and a tile, lie in `weights`, (WEIGHTS, items) float32 shared
by the threads of a block.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...geometry.illumination import Illumination
from ...planning.exact.points import ImagePoints, PointPlan
from ...signal.radar import RadarParameters
from .arrays import (
    complex_samples,
    cuda,
    function,
    given,
    kernel,
    launch,
    load_pair,
    pairs,
    reports_failures,
    require_device,
    xp,
)
from .illumination import Antennas, amplitude, in_axes
from .phasors import fraction, phasor, short_fraction
from .profiles import Profiles
from .tiles import rows_of_points
from .transfers import in_pieces, to_host

WEIGHTS, _AXES = 12, 9  # numbers of an item, and of the antenna's axes
DARK, BETWEEN, ALONE = (np.int32(v) for v in (0, 1, 2))  # how an echo illuminates a tile


@function
def _dark_sphere(axes, ends, echo, x, y, z, radius):
    """Whether an echo illuminates nothing within a radius of a position, metres.

    How far a point lies beyond an end of the pattern, ``d a - sine |d|`` in azimuth, changes by at
    most ``1 + sine`` times the radius.
    """
    right, ahead, up = in_axes(axes, echo, x, y, z)
    distance = math.sqrt(right * right + ahead * ahead + up * up)
    return (right - ends[0] * distance > (1.0 + abs(ends[0])) * radius
            or ends[1] * distance - right > (1.0 + abs(ends[1])) * radius
            or up * ends[2] - ahead * ends[3] > radius
            or ahead * ends[5] - up * ends[4] > radius or ahead < -radius)


@function
def _bend(low, between, high, before, after):
    """Second difference of three nodes; `before` and `after` are 0 for two points or one."""
    return (high - between) * after - (between - low) * before


@function
def _steps(n):
    """For nodes n points apart: 1 / n, and those of `_bend`."""
    whole = np.float32(1.0) / np.float32(max(n, 1))
    bent = n // 2
    if not bent:
        return whole, np.float32(0.0), np.float32(0.0)
    return whole, whole / np.float32(bent), whole / np.float32(n - bent)


@function
def _row_of_nodes(nodes, at, to_last, echo, n, line, item):
    """Parabola along a row of nodes of a tile: its coefficients go to the item's `line`."""
    low, middle, high = (nodes[at, echo], nodes[at + to_last // 2, echo],
                         nodes[at + to_last, echo])
    whole, before, after = _steps(n)
    bend = _bend(low, middle, high, before, after)
    line[0, item], line[1, item] = low, (high - low) * whole - bend * np.float32(n)
    line[2, item] = bend
    return low + middle + high


@function
def _set_weights(nodes, how, number, across, tile, echo, weights, item):
    """Amplitude over a tile as a polynomial of rows and columns; the sum of its nodes.

    Parabolas along rows of nodes have coefficients that are parabolas along columns.
    """
    down, beside = number // across, number % across
    rows = min(tile[0], how[2] - 1 - down * tile[0])
    columns = min(tile[1], how[3] - 1 - beside * tile[1])
    # to the last node of a tile; an axis of one point has one alone
    to_below, to_right = 2 * min(tile[0] - 1, 1) * how[0], 2 * min(tile[1] - 1, 1)
    corner = down * to_below + beside * to_right
    total = _row_of_nodes(nodes, corner, to_right, echo, columns, weights[:3], item)
    total += _row_of_nodes(nodes, corner + to_below // 2, to_right, echo, columns,
                           weights[3:6], item)
    total += _row_of_nodes(nodes, corner + to_below, to_right, echo, columns, weights[6:9], item)
    whole, before, after = _steps(rows)
    for power in range(3):
        low, middle, high = (weights[power, item], weights[3 + power, item],
                             weights[6 + power, item])
        bend = _bend(low, middle, high, before, after)
        weights[3 + power, item] = (high - low) * whole - bend * np.float32(rows)
        weights[6 + power, item] = bend
    return total


@function
def illuminate_tile(illumination, number, across, tile, place, echo, weights, item):
    """How an echo illuminates a tile, `DARK`, `BETWEEN` or `ALONE`, by what is left in `weights`.

    `place` is the middle of the tile and its radius, metres. In `weights` are the polynomial
    between nodes, or the antenna's right, boresight and up for points of their own.
    """
    nodes, how, axes, _, _, ends = illumination
    if not how[1]:
        total = _set_weights(nodes, how, number, across, tile, echo, weights, item)
        if not math.isnan(total):
            return BETWEEN if total > np.float32(0.0) else DARK
    x, y, z, radius = place
    if _dark_sphere(axes, ends, echo, x, y, z, radius):
        return DARK
    for k in range(_AXES):
        weights[k, item] = np.float32(axes[echo, 3 + k])
    right, ahead, up = in_axes(axes, echo, x, y, z)
    weights[9, item], weights[10, item], weights[11, item] = (np.float32(right), np.float32(ahead),
                                                             np.float32(up))
    return ALONE


@function
def amplitude_alone(illumination, x, y, z, weights, item):
    """Two-way amplitude towards a point, metres from its tile's middle, by what `weights` hold."""
    return amplitude(
        illumination[3], illumination[4],
        weights[9, item] + x * weights[0, item] + y * weights[1, item] + z * weights[2, item],
        weights[10, item] + x * weights[3, item] + y * weights[4, item] + z * weights[5, item],
        weights[11, item] + x * weights[6, item] + y * weights[7, item] + z * weights[8, item])


@function
def amplitude_between(row, column, weights, item):
    """Amplitude at a row and column of a tile, by the polynomial in `weights`."""
    low, slope, bend = weights[0, item], weights[3, item], weights[6, item]
    low += column * (weights[1, item] + column * weights[2, item])
    slope += column * (weights[4, item] + column * weights[5, item])
    bend += column * (weights[7, item] + column * weights[8, item])
    return low + row * (slope + row * bend)


THREADS, POINTS = 128, 2  # of a block, and points of a thread
BLOCK = THREADS * POINTS  # points of a block: of one tile, or of several smaller ones
NEAREST = 16.0  # least distance of a phase centre in tile radii: the series below holds to 1e-7
_ITEMS = 128  # echoes times tiles whose geometry lies in shared memory
_LEGS, _PLACE, _WEIGHTS = 10, 3, WEIGHTS  # numbers of an item
_ONE_LEG, _TWO_LEGS, _EXACT = (np.int32(v) for v in (0, 1, 2))  # how a tile's paths are found
_FAR, _TWO = np.float32(4e6), np.float32(2.0)  # cells beyond which none is; half a path twice

# 1 / (1 + sqrt(1 + s)) = 1/2 - s/8 + s^2/16 - 5 s^3/128 + ...
_B0, _B1, _B2, _B3, _B4, _B5 = (np.float32(v) for v in (
    1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256, -21 / 1024))


@function
def root_series(s):
    """``1 / (1 + sqrt(1 + s))`` for small s, float32."""
    return _B0 + s * (_B1 + s * (_B2 + s * (_B3 + s * (_B4 + s * _B5))))


@function
def distance(centres, echo, first, x, y, z):
    """Distance of a point from a phase centre, metres."""
    a, b = x - centres[echo, first], y - centres[echo, first + 1]
    c = z - centres[echo, first + 2]
    return math.sqrt(a * a + b * b + c * c)


@function
def _place_of(xs, ys, zs, strides, size, i, j):
    """Position of a point, metres, and whether it has one."""
    if i >= size[0] or j >= size[1]:
        return 0.0, 0.0, 0.0, False
    x, y, z = (xs[i * strides[0, 0] + j * strides[0, 1]],
               ys[i * strides[1, 0] + j * strides[1, 1]],
               zs[i * strides[2, 0] + j * strides[2, 1]])
    return x, y, z, not math.isnan(x + y + z)


@kernel()
def bound_tiles(xs, ys, zs, strides, layout, tiles):
    """Centre and radius of each tile, from the points that have a position; a thread for each.

    Parameters
    ----------
    xs, ys, zs, strides :
        Of `ImagePoints`.
    layout : tuple
        Rows and columns of the points; rows and columns of a tile; radius up to which tiles are
        computed in float32, metres.
    tiles : (T, 4) float64
        Centre and radius, metres; a NaN where no point has a position.
    """
    number, size, tile = cuda.grid(1), layout[:2], layout[2:4]
    if number >= tiles.shape[0]:
        return
    across = (size[1] + tile[1] - 1) // tile[1]
    top, left = number // across * tile[0], number % across * tile[1]
    x0, y0, z0 = math.inf, math.inf, math.inf
    x1, y1, z1 = -math.inf, -math.inf, -math.inf
    for i in range(top, min(top + tile[0], size[0])):
        for j in range(left, min(left + tile[1], size[1])):
            x, y, z, known = _place_of(xs, ys, zs, strides, size, i, j)
            if known:
                x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
                x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    tiles[number, 0] = 0.5 * (x0 + x1)  # a NaN of infinities where there is no point
    tiles[number, 1] = 0.5 * (y0 + y1)
    tiles[number, 2] = 0.5 * (z0 + z1)
    tiles[number, 3] = 0.5 * math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)


@function
def set_leg(centres, echo, first, x, y, z, inverse_step, step, legs, at, item):
    """Numbers of a leg to a tile's centre: those of ``q / 2`` in steps, and of s; its length."""
    a, b = x - centres[echo, first], y - centres[echo, first + 1]
    c = z - centres[echo, first + 2]
    d = math.sqrt(a * a + b * b + c * c)
    scale = inverse_step / d
    legs[at, item], legs[at + 1, item] = np.float32(a * scale), np.float32(b * scale)
    legs[at + 2, item], legs[at + 3, item] = np.float32(c * scale), np.float32(0.5 * scale)
    legs[at + 4, item] = np.float32(2.0 * step / d)
    return d


@kernel()
def add_points(planes, profile, centres, xs, ys, zs, strides, layout, tiles, image):
    """Add echoes to points; a grid of blocks of `BLOCK` points, tile by tile.

    Parameters
    ----------
    planes : pairs
        Polynomials of degree 3 of each echo and cell, (R, n, 4) complex64; the first and last
        cells are zero.
    profile : tuple
        Cells n; half path at cell 0, metres a cell, cycles of the carrier a cell, and at cell 0.
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    xs, ys, zs, strides, layout, tiles :
        As of `bound_tiles`; tiles have a power of 2 points, at most `BLOCK`.
    image : (2 * n_points,) float32
        Added to: real and imaginary parts in turn.
    """
    _add(planes, profile, centres, xs, ys, zs, strides, layout, tiles, image, None)


@kernel()
def add_weighted_points(planes, profile, centres, xs, ys, zs, strides, layout, tiles, image,
                        nodes, how, axes, table, scale, ends):
    """As `add_points`, of echoes that illuminate points by an amplitude; what is dark is left out.

    Parameters
    ----------
    planes, profile, centres, xs, ys, zs, strides, layout, tiles, image :
        As of `add_points`.
    nodes : (K, R) float32
        Amplitudes at the nodes of all tiles, NaN where one has no position: amplitudes are then
        found at each point.
    how : (4,) int64
        Nodes of a row; 1 where amplitudes are found at each point of all tiles; rows and columns
        to the last point of the image.
    axes, ends : (R, 12), (6,) float64
        As of `illumination.Antennas`.
    table, scale : (T,), (6,) float32
        Its `table` and `place`.
    """
    _add(planes, profile, centres, xs, ys, zs, strides, layout, tiles, image,
         (nodes, how, axes, table, scale, ends))


@function
def _add(planes, profile, centres, xs, ys, zs, strides, layout, tiles, image, illumination):
    """What both kernels do; `illumination` is None where echoes illuminate all points alike."""
    n_cells, range_zero, step, cycles_per_step, cycles_zero = profile
    size, tile, reach = layout[:2], layout[2:4], layout[4]
    legs = cuda.shared.array((_LEGS, _ITEMS), np.float32)
    place = cuda.shared.array((_PLACE, _ITEMS), np.float32)
    kind = cuda.shared.array(_ITEMS, np.int32)
    any_exact = cuda.shared.array(1, np.int32)
    if illumination is not None:
        mode = cuda.shared.array(_ITEMS, np.int32)
        weights = cuda.shared.array((_WEIGHTS, _ITEMS), np.float32)
    ox = cuda.local.array(POINTS, np.float32)
    oy = cuda.local.array(POINTS, np.float32)
    oz = cuda.local.array(POINTS, np.float32)
    oo = cuda.local.array(POINTS, np.float32)
    real = cuda.local.array(POINTS, np.float32)
    imag = cuda.local.array(POINTS, np.float32)
    thread, n_all = cuda.threadIdx.x, centres.shape[0]
    apart = tile[0] * tile[1] // POINTS  # points of a thread, in the tile's order
    n_tiles = THREADS // apart  # tiles of the block
    mine, k = thread // apart, thread % apart
    number, across = cuda.blockIdx.x * n_tiles + mine, (size[1] + tile[1] - 1) // tile[1]
    top, left = number // across * tile[0], number % across * tile[1]
    for p in range(POINTS):
        i, j = top + (k + p * apart) // tile[1], left + (k + p * apart) % tile[1]
        x, y, z, known = _place_of(xs, ys, zs, strides, size, i, j)
        if known and number < tiles.shape[0]:
            x, y, z = x - tiles[number, 0], y - tiles[number, 1], z - tiles[number, 2]
        else:  # computed in the middle of the tile, and not used
            x, y, z = 0.0, 0.0, 0.0
        ox[p], oy[p], oz[p] = np.float32(x), np.float32(y), np.float32(z)
        oo[p] = np.float32(x * x + y * y + z * z)
        real[p], imag[p] = 0.0, 0.0
    inverse_step, short_cycles = 1.0 / step, np.float32(cycles_per_step)
    last, most = np.int32(n_cells - 1), _ITEMS // n_tiles
    for start in range(0, n_all, most):
        n_echoes = min(most, n_all - start)
        cuda.syncthreads()
        if thread == 0:
            any_exact[0] = 0
        cuda.syncthreads()
        for item in range(thread, n_echoes * n_tiles, THREADS):
            echo, there = start + item // n_tiles, cuda.blockIdx.x * n_tiles + item % n_tiles
            kind[item] = _EXACT  # and without any point, where a tile has none
            if there < tiles.shape[0] and not math.isnan(tiles[there, 3]):
                cx, cy, cz = tiles[there, 0], tiles[there, 1], tiles[there, 2]
                radius = tiles[there, 3]
                if illumination is not None:
                    mode[item] = illuminate_tile(illumination, there, across, tile,
                                                 (cx, cy, cz, radius), echo, weights, item)
                    if mode[item] == DARK:
                        continue
                da = set_leg(centres, echo, 0, cx, cy, cz, inverse_step, step, legs, 0, item)
                db, kind[item] = da, _ONE_LEG
                if (centres[echo, 0] != centres[echo, 3] or centres[echo, 1] != centres[echo, 4]
                        or centres[echo, 2] != centres[echo, 5]):
                    db = set_leg(centres, echo, 3, cx, cy, cz, inverse_step, step, legs, 5, item)
                    kind[item] = _TWO_LEGS
                if not radius < min(reach, min(da, db) * (1.0 / NEAREST)):
                    kind[item], any_exact[0] = _EXACT, 1
                v = (0.5 * (da + db) - range_zero) * inverse_step
                cell = math.floor(v)
                place[0, item] = np.float32(v - cell)
                place[1, item] = np.float32(fraction(cycles_per_step * v + cycles_zero))
                # far outside stays outside whatever the offset
                place[2, item] = np.float32(min(max(cell, -_FAR), _FAR))
        cuda.syncthreads()
        if number >= tiles.shape[0]:
            n_echoes = 0
        for nth in range(n_echoes):
            item, row = nth * n_tiles + mine, np.uint64((start + nth) * n_cells * 4)
            if illumination is not None:
                if mode[item] == DARK:
                    continue
            if kind[item] == _EXACT:
                continue
            for p in range(POINTS):
                # q / 2 of both legs, in cells
                q = (legs[0, item] * ox[p] + legs[1, item] * oy[p] + legs[2, item] * oz[p]
                     + legs[3, item] * oo[p])
                shift = q * root_series(q * legs[4, item])
                if kind[item] == _ONE_LEG:
                    shift *= _TWO
                else:
                    q = (legs[5, item] * ox[p] + legs[6, item] * oy[p] + legs[7, item] * oz[p]
                         + legs[8, item] * oo[p])
                    shift += q * root_series(q * legs[9, item])
                t = place[0, item] + shift
                n = np.float32(math.floor(t))
                at = min(max(np.int32(n + place[2, item]), np.int32(0)), last)
                re, im = _read(planes, row, at, t - n)
                if illumination is not None:
                    if mode[item] == BETWEEN:
                        weight = amplitude_between(np.float32((k + p * apart) // tile[1]),
                                                    np.float32((k + p * apart) % tile[1]),
                                                    weights, item)
                    else:
                        weight = amplitude_alone(illumination, ox[p], oy[p], oz[p], weights, item)
                    re, im = weight * re, weight * im
                cosine, sine = phasor(short_fraction(place[1, item] + short_cycles * shift))
                real[p] += re * cosine
                real[p] -= im * sine
                imag[p] += re * sine
                imag[p] += im * cosine
        for nth in range(n_echoes if any_exact[0] else 0):
            item, echo = nth * n_tiles + mine, start + nth
            if illumination is not None:
                if mode[item] == DARK:
                    continue
            if kind[item] != _EXACT:
                continue
            for p in range(POINTS):
                i, j = top + (k + p * apart) // tile[1], left + (k + p * apart) % tile[1]
                x, y, z, known = _place_of(xs, ys, zs, strides, size, i, j)
                if not known:
                    continue
                v = (0.5 * (distance(centres, echo, 0, x, y, z)
                            + distance(centres, echo, 3, x, y, z)) - range_zero) * inverse_step
                n = math.floor(v)
                re, im = _read(planes, np.uint64(echo * n_cells * 4),
                               np.int32(min(max(n, 0.0), float(last))), np.float32(v - n))
                if illumination is not None:
                    if mode[item] == BETWEEN:
                        weight = amplitude_between(np.float32(i - top), np.float32(j - left),
                                                    weights, item)
                    else:
                        weight = amplitude_alone(illumination, ox[p], oy[p], oz[p], weights, item)
                    re, im = weight * re, weight * im
                cosine, sine = phasor(np.float32(fraction(cycles_per_step * v + cycles_zero)))
                real[p] += re * cosine - im * sine
                imag[p] += re * sine + im * cosine
    for p in range(POINTS):
        i, j = top + (k + p * apart) // tile[1], left + (k + p * apart) % tile[1]
        known = _place_of(xs, ys, zs, strides, size, i, j)[3]
        if known and number < tiles.shape[0]:
            image[2 * (i * size[1] + j)] += real[p]
            image[2 * (i * size[1] + j) + 1] += imag[p]


@function
def _read(planes, row, at, t):
    """Value of an echo at a place in a cell."""
    cell = row + np.uint64(at) * np.uint64(4)  # 32 bytes, which memory delivers at once
    re, im = load_pair(planes, cell + np.uint64(3))
    for power in range(2, -1, -1):
        c, d = load_pair(planes, cell + np.uint64(power))
        re, im = c + t * re, d + t * im
    return re, im


_TOGETHER = 32  # echoes of a chunk of profiles come in multiples of this


class Points:
    """Pixels at any positions, prepared for adding any number of echoes.

    Parameters
    ----------
    plan : PointPlan
        How they are added.
    layers : sequence of ImagePoints
        Where the pixels are, one part of the image after the other.
    rows : slice, optional
        Rows of the layers, if not all; from the first of a tile on.
    """

    def __init__(self, plan: PointPlan, layers: Sequence[ImagePoints], rows: slice | None = None):
        self._plan, self._profiles = plan, Profiles(plan.window, plan.resampling, plan.range_m)
        rows = rows or slice(0, layers[0].size[0])
        self._nodes = [plan.amplitudes and _Nodes(points, rows, plan) for points in layers]
        self._layers = [self._prepared(rows_of_points(points, rows)) for points in layers]

    def _prepared(self, points: ImagePoints) -> tuple[Any, ...]:
        """Coordinates, strides, layout and tiles of a layer, as the kernels take them."""
        (n_y, n_x), (height, width) = points.size, self._plan.tile
        tiles = xp.empty((-(-n_y // height) * -(-n_x // width), 4), np.float64)
        made = (*(xp.asarray(np.ascontiguousarray(c)) for c in points.coordinates),
                xp.asarray(points.strides.astype(np.int64)),
                (n_y, n_x, height, width, self._plan.reach_m), tiles)
        launch(bound_tiles, -(-len(tiles) // THREADS), THREADS, *made)
        return made

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
            illumination: Illumination | None = None) -> None:
        """Add echoes to an image, (K,) float32 array of the device; see `Lines.add`."""
        profiles, plan = self._profiles, self._plan
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        parts = image.reshape(len(self._layers), -1)
        together = BLOCK // (plan.tile[0] * plan.tile[1])
        antennas = illumination and Antennas(illumination)
        n_bytes = max(0 if nodes is None else nodes.echo_bytes for nodes in self._nodes)
        for echoes, some in in_pieces(samples, profiles.chunks(len(samples), _TOGETHER, n_bytes)):
            planes = pairs(profiles.planes(some))
            for made, part, nodes in zip(self._layers, parts, self._nodes, strict=True):
                blocks = -(-len(made[-1]) // together)
                profile = (profiles.n_cells, profiles.range_at(0), plan.resampling.step_m,
                           profiles.cycles_per_step, profiles.cycles_at(0))
                given = planes, profile, centres[echoes], *made, part
                if nodes is None:
                    launch(add_points, blocks, THREADS, *given)
                else:
                    launch(add_weighted_points, blocks, THREADS, *given,
                           *nodes.amplitude_arguments(antennas, echoes))


class _Nodes:
    """Where amplitudes of echoes are found over some rows of a layer of points.

    Attributes
    ----------
    echo_bytes : int
        Memory that the amplitudes of an echo take.
    """

    def __init__(self, points: ImagePoints, rows: slice, plan: PointPlan):
        (n_y, n_x), (height, _) = points.size, plan.tile
        down, across = plan.amplitudes.nodes(points.size, plan.tile)
        if plan.amplitudes.each:
            down = down[:0]  # none is read
        elif height > 1:
            down = down[2 * (rows.start // height):2 * -(-rows.stop // height) + 1]
        positions = points.positions(down[:, None], across).reshape(-1, 3)
        self._positions = xp.asarray(np.ascontiguousarray(positions.T))
        self._how = xp.asarray(np.array([len(across), plan.amplitudes.each, n_y - rows.start, n_x],
                                        np.int64))
        self.echo_bytes = 4 * len(positions)

    def amplitude_arguments(self, antennas: Antennas, echoes: slice) -> tuple[np.ndarray, ...]:
        """The last arguments of `add_weighted_points`."""
        return (antennas.at_nodes(self._positions, echoes), self._how, antennas.axes[echoes],
                antennas.table.astype(np.float32), antennas.place.astype(np.float32),
                antennas.ends)


LENGTH = 16  # pixels of a piece of a line
_LANES = 8  # of echoes: those of a lane are added by one thread of each pixel
_PIECE_THREADS = LENGTH * _LANES


class TrialImages:
    """See `backends.protocol.TrialImages`; profiles go to the device once, images come back.

    Paths are exact and profiles linear between samples.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory.
    """

    length = LENGTH

    @reports_failures
    def __init__(self, radar: RadarParameters, samples: np.ndarray):
        require_device()
        self._radar, self._n_samples = radar, samples.shape[-1]
        self._profiles = complex_samples(samples)

    @reports_failures
    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray,
              step_m: np.ndarray, range_bias_m: float = 0.0) -> np.ndarray:
        """See `backends.protocol.TrialImages.image`."""
        radar = self._radar
        centres = np.concatenate([np.reshape(c, (-1, 3)) for c in (tx_m, rx_m)], axis=1)
        profile = np.array([radar.range_start_m - range_bias_m, radar.sample_spacing_m,
                            2 / radar.wavelength_m])
        image = xp.empty((2, len(starts_m), LENGTH), np.float32)
        launch(add_pieces, len(starts_m), _PIECE_THREADS, pairs(self._profiles), self._n_samples,
               *(xp.asarray(np.ascontiguousarray(v, np.float64)) for v in (
                   centres, starts_m, step_m, profile)), image)
        return to_host(given(image))


@kernel()
def add_pieces(profiles, n_samples, centres, starts, step, profile, image):
    """Backproject profiles onto pieces of lines; a grid of pieces.

    Parameters
    ----------
    profiles, n_samples : pairs, int
        Profiles echo by echo, so many samples each; zero beyond their ends.
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    starts, step : (K, 3), (3,) float64
        First pixel of each piece, and from pixel to pixel, metres.
    profile : (3,) float64
        Half path of sample 0, and from sample to sample, metres; cycles of the carrier per metre.
    image : (2, K, LENGTH) float32
        Real and imaginary part.
    """
    real_sums = cuda.shared.array(_PIECE_THREADS, np.float32)
    imag_sums = cuda.shared.array(_PIECE_THREADS, np.float32)
    thread, piece = cuda.threadIdx.x, cuda.blockIdx.x
    pixel, lane = thread % LENGTH, thread // LENGTH
    x = starts[piece, 0] + pixel * step[0]
    y = starts[piece, 1] + pixel * step[1]
    z = starts[piece, 2] + pixel * step[2]
    real, imag = np.float32(0.0), np.float32(0.0)
    for echo in range(lane, centres.shape[0], _LANES):
        path = 0.5 * (
            math.sqrt((x - centres[echo, 0]) ** 2 + (y - centres[echo, 1]) ** 2
                      + (z - centres[echo, 2]) ** 2)
            + math.sqrt((x - centres[echo, 3]) ** 2 + (y - centres[echo, 4]) ** 2
                        + (z - centres[echo, 5]) ** 2))
        place = min(max((path - profile[0]) / profile[1], -2.0), n_samples + 1.0)
        cell = math.floor(place)
        t, first = np.float32(place - cell), int(cell)
        re, im = np.float32(0.0), np.float32(0.0)
        if 0 <= first < n_samples:
            a, b = load_pair(profiles, np.uint64(echo * n_samples + first))
            re += (np.float32(1.0) - t) * a
            im += (np.float32(1.0) - t) * b
        if -1 <= first < n_samples - 1:
            a, b = load_pair(profiles, np.uint64(echo * n_samples + first + 1))
            re += t * a
            im += t * b
        cosine, sine = phasor(np.float32(fraction(path * profile[2])))
        real += re * cosine - im * sine
        imag += re * sine + im * cosine
    real_sums[thread], imag_sums[thread] = real, imag
    cuda.syncthreads()
    if lane == 0:
        for k in range(1, _LANES):
            real += real_sums[pixel + k * LENGTH]
            imag += imag_sums[pixel + k * LENGTH]
        image[0, piece, pixel] = real
        image[1, piece, pixel] = imag
