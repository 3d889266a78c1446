"""Backprojection onto arbitrary points: the kernels.

Points are taken in tiles of neighbours, as on the processor. The path to the centre of a tile is
computed in float64, once for each echo, and for each point only what its offset from there adds,
in float32 and without cancellation: with w the vector from the phase centre to the tile's centre,
d its length and o the offset,

``|w + o| - d = q / (1 + sqrt(1 + s)),  q = 2 (w/d) o + |o|^2 / d,  s = q / d.``

Tiles too large for that, and echoes whose phase centre is too near to a tile, are computed in
float64 point by point. A thread has one point; neighbours read neighbouring cells of a profile.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import cuda, function, kernel, load_pair
from ..illumination import amplitude, in_axes
from ..phasors import fraction, phasor, short_fraction

THREADS = 256  # points of a block: of one tile, or of several smaller ones
NEAREST = 16.0  # least distance of a phase centre in tile radii: the series below holds to 1e-7
_ITEMS = 128  # echoes times tiles whose geometry lies in shared memory
_LEGS, _PLACE, _WEIGHTS = 10, 3, 9  # numbers of an item
_DARK, _BETWEEN, _ALONE = (np.int32(v) for v in (0, 1, 2))  # how an echo lights a tile

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


@kernel()
def bound_tiles(xs, ys, zs, strides, size, tile, tiles):
    """Centre and radius of each tile, from the points that have a position; a thread for each.

    Parameters
    ----------
    xs, ys, zs, strides, size :
        Of `ImagePoints`.
    tile : (2,) int64
        Rows and columns of a tile.
    tiles : (T, 4) float64
        Centre and radius, metres; a NaN where no point has a position.
    """
    number = cuda.grid(1)
    if number >= tiles.shape[0]:
        return
    across = (size[1] + tile[1] - 1) // tile[1]
    top, left = number // across * tile[0], number % across * tile[1]
    x0, y0, z0 = math.inf, math.inf, math.inf
    x1, y1, z1 = -math.inf, -math.inf, -math.inf
    for i in range(top, min(top + tile[0], size[0])):
        for j in range(left, min(left + tile[1], size[1])):
            x = xs[i * strides[0, 0] + j * strides[0, 1]]
            y = ys[i * strides[1, 0] + j * strides[1, 1]]
            z = zs[i * strides[2, 0] + j * strides[2, 1]]
            if not math.isnan(x + y + z):
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
def add_points(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step,
               cycles_per_step, cycles_zero, reach, image):
    """Add echoes to points; a grid of blocks of `THREADS` points, tile by tile.

    Parameters
    ----------
    planes : pairs
        Polynomials of degree 3 of each echo and cell, (R, n, 4) complex64; the first and last
        cells are zero.
    n_cells : int
        n.
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    xs, ys, zs, strides, size, tile, tiles :
        As of `bound_tiles`; tiles have a power of 2 points, at most `THREADS`.
    range_zero, step, cycles_per_step, cycles_zero : float
        Half path at cell 0, metres a cell, cycles of the carrier a cell, and at cell 0.
    reach : float
        Radius up to which tiles are computed in float32, metres.
    image : (2 * n_points,) float32
        Added to: real and imaginary parts in turn.
    """
    _add(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step,
         cycles_per_step, cycles_zero, reach, image, None)


@kernel()
def add_lit_points(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero,
                   step, cycles_per_step, cycles_zero, reach, image, knots, how, axes, table,
                   scale, ends):
    """As `add_points`, of echoes that light points by an amplitude; what is dark is left out.

    Parameters
    ----------
    planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step, \
cycles_per_step, cycles_zero, reach, image :
        As of `add_points`.
    knots : (K, R) float32
        Amplitudes at the knots of all tiles, NaN where one has no position: amplitudes are then
        found at each point.
    how : (6,) int64
        Degree of the interpolation along rows and columns; knots of a row; 1 where amplitudes are
        found at each point of all tiles; rows and columns to the last point of the image.
    axes, ends : (R, 12), (6,) float64
        As of `illumination.Antennas`.
    table, scale : (T,), (6,) float32
        Its `table` and `place`.
    """
    _add(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step,
         cycles_per_step, cycles_zero, reach, image, (knots, how, axes, table, scale, ends))


@function
def _dark_sphere(axes, ends, echo, x, y, z, radius):
    """Whether an echo lights nothing within a radius of a position, metres.

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
    """Second difference of three knots; `before` and `after` are 0 for a line."""
    return (high - between) * after - (between - low) * before


@function
def _steps(degree, n):
    """For knots n points apart: 1 / n, and those of `_bend`."""
    whole = np.float32(1.0) / np.float32(max(n, 1))
    bent = degree // 2 * (n // 2)
    if not bent:
        return whole, np.float32(0.0), np.float32(0.0)
    return whole, whole / np.float32(bent), whole / np.float32(n - bent)


@function
def _row_of_knots(knots, at, degree, echo, n, line, item):
    """Parabola along a row of knots of a tile: its coefficients go to the item's `line`."""
    low, middle, high = (knots[at, echo], knots[at + degree // 2, echo],
                         knots[at + degree, echo])
    whole, before, after = _steps(degree, n)
    bend = _bend(low, middle, high, before, after)
    line[0, item], line[1, item] = low, (high - low) * whole - bend * np.float32(n)
    line[2, item] = bend
    return low + middle + high


@function
def _set_weights(knots, how, number, across, tile, echo, weights, item):
    """Amplitude over a tile as a polynomial of rows and columns; the sum of its knots.

    Parabolas along rows of knots have coefficients that are parabolas along columns.
    """
    down, beside = number // across, number % across
    rows = min(tile[0], how[4] - 1 - down * tile[0])
    columns = min(tile[1], how[5] - 1 - beside * tile[1])
    corner = down * how[0] * how[2] + beside * how[1]
    total = _row_of_knots(knots, corner, how[1], echo, columns, weights[:3], item)
    total += _row_of_knots(knots, corner + how[0] // 2 * how[2], how[1], echo, columns,
                           weights[3:6], item)
    total += _row_of_knots(knots, corner + how[0] * how[2], how[1], echo, columns,
                           weights[6:9], item)
    whole, before, after = _steps(how[0], rows)
    for power in range(3):
        low, middle, high = (weights[power, item], weights[3 + power, item],
                             weights[6 + power, item])
        bend = _bend(low, middle, high, before, after)
        weights[3 + power, item] = (high - low) * whole - bend * np.float32(rows)
        weights[6 + power, item] = bend
    return total


@function
def _light_tile(light, number, across, tile, place, echo, weights, item):
    """How an echo lights a tile, `_DARK`, `_BETWEEN` or `_ALONE`, by what is left in `weights`.

    `place` is the middle of the tile and its radius, metres. In `weights` are the polynomial
    between knots, or the antenna's right, boresight and up for points of their own.
    """
    knots, how, axes, _, _, ends = light
    if not how[3]:
        total = _set_weights(knots, how, number, across, tile, echo, weights, item)
        if not math.isnan(total):
            return _BETWEEN if total > np.float32(0.0) else _DARK
    x, y, z, radius = place
    if _dark_sphere(axes, ends, echo, x, y, z, radius):
        return _DARK
    for k in range(_WEIGHTS):
        weights[k, item] = np.float32(axes[echo, 3 + k])
    return _ALONE


@function
def _amplitude_alone(light, echo, x, y, z, weights, item):
    """Two-way amplitude towards a point, metres, by the antenna's axes in `weights`."""
    _, _, axes, table, scale, _ = light
    x, y, z = (np.float32(x - axes[echo, 0]), np.float32(y - axes[echo, 1]),
               np.float32(z - axes[echo, 2]))
    return amplitude(table, scale,
                     x * weights[0, item] + y * weights[1, item] + z * weights[2, item],
                     x * weights[3, item] + y * weights[4, item] + z * weights[5, item],
                     x * weights[6, item] + y * weights[7, item] + z * weights[8, item])


@function
def _amplitude_between(row, column, weights, item):
    """Amplitude at a row and column of a tile, by the polynomial in `weights`."""
    low, slope, bend = weights[0, item], weights[3, item], weights[6, item]
    low += column * (weights[1, item] + column * weights[2, item])
    slope += column * (weights[4, item] + column * weights[5, item])
    bend += column * (weights[7, item] + column * weights[8, item])
    return low + row * (slope + row * bend)


@function
def _add(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step,
         cycles_per_step, cycles_zero, reach, image, light):
    """What both kernels do; `light` is None where echoes light all points alike."""
    legs = cuda.shared.array((_LEGS, _ITEMS), np.float32)
    place = cuda.shared.array((_PLACE, _ITEMS), np.float32)
    exact = cuda.shared.array(_ITEMS, np.int32)
    if light is not None:
        lit = cuda.shared.array(_ITEMS, np.int32)
        weights = cuda.shared.array((_WEIGHTS, _ITEMS), np.float32)
    thread, n_all = cuda.threadIdx.x, centres.shape[0]
    n_points = tile[0] * tile[1]  # of a tile
    n_own = THREADS // n_points  # tiles of the block
    mine = thread // n_points
    number, k = cuda.blockIdx.x * n_own + mine, thread % n_points
    across = (size[1] + tile[1] - 1) // tile[1]
    i = number // across * tile[0] + k // tile[1]
    j = number % across * tile[1] + k % tile[1]
    x, y, z = math.nan, math.nan, math.nan
    if number < tiles.shape[0] and i < size[0] and j < size[1]:
        x = xs[i * strides[0, 0] + j * strides[0, 1]]
        y = ys[i * strides[1, 0] + j * strides[1, 1]]
        z = zs[i * strides[2, 0] + j * strides[2, 1]]
    known = not math.isnan(x + y + z)
    ox, oy, oz, oo = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    if known:
        a, b, c = x - tiles[number, 0], y - tiles[number, 1], z - tiles[number, 2]
        ox, oy, oz, oo = (np.float32(a), np.float32(b), np.float32(c),
                          np.float32(a * a + b * b + c * c))
    inverse_step, turns = 1.0 / step, np.float32(cycles_per_step)
    last, most = n_cells - 1, _ITEMS // n_own
    real, imag = np.float32(0.0), np.float32(0.0)
    for start in range(0, n_all, most):
        n_echoes = min(most, n_all - start)
        cuda.syncthreads()
        for item in range(thread, n_echoes * n_own, THREADS):
            echo, own = start + item // n_own, cuda.blockIdx.x * n_own + item % n_own
            if own < tiles.shape[0]:
                cx, cy, cz, radius = tiles[own, 0], tiles[own, 1], tiles[own, 2], tiles[own, 3]
                if light is not None:
                    lit[item] = _light_tile(light, own, across, tile, (cx, cy, cz, radius), echo,
                                            weights, item)
                    if lit[item] == _DARK:
                        continue
                da = set_leg(centres, echo, 0, cx, cy, cz, inverse_step, step, legs, 0, item)
                db = set_leg(centres, echo, 3, cx, cy, cz, inverse_step, step, legs, 5, item)
                exact[item] = not radius < min(reach, min(da, db) * (1.0 / NEAREST))
                v = (0.5 * (da + db) - range_zero) * inverse_step
                cell = math.floor(v)
                place[0, item] = np.float32(v - cell)
                place[1, item] = np.float32(fraction(cycles_per_step * v + cycles_zero))
                # far outside stays outside whatever the offset
                place[2, item] = np.float32(min(max(cell, -4e6), 4e6))
        cuda.syncthreads()
        for nth in range(n_echoes if known else 0):
            item, echo = nth * n_own + mine, start + nth
            if light is not None:
                if lit[item] == _DARK:
                    continue
            if exact[item]:
                v = (0.5 * (distance(centres, echo, 0, x, y, z)
                            + distance(centres, echo, 3, x, y, z)) - range_zero) * inverse_step
                n = math.floor(v)
                t, at = np.float32(v - n), int(min(max(n, 0.0), float(last)))
                cycles = np.float32(fraction(cycles_per_step * v + cycles_zero))
            else:
                # q / 2 of both legs, in cells
                q = (legs[0, item] * ox + legs[1, item] * oy + legs[2, item] * oz
                     + legs[3, item] * oo)
                p = (legs[5, item] * ox + legs[6, item] * oy + legs[7, item] * oz
                     + legs[8, item] * oo)
                shift = q * root_series(q * legs[4, item]) + p * root_series(p * legs[9, item])
                t = place[0, item] + shift
                n = np.float32(math.floor(t))
                at = min(max(int(n + place[2, item]), 0), last)
                t -= n
                cycles = short_fraction(place[1, item] + turns * shift)
            # 32 bytes, which memory delivers at once
            cell = np.uint64(echo * n_cells + at) * np.uint64(4)
            re, im = load_pair(planes, cell + np.uint64(3))
            for power in range(2, -1, -1):
                c, d = load_pair(planes, cell + np.uint64(power))
                re, im = c + t * re, d + t * im
            if light is not None:
                if lit[item] == _BETWEEN:
                    weight = _amplitude_between(np.float32(k // tile[1]), np.float32(k % tile[1]),
                                                weights, item)
                else:
                    weight = _amplitude_alone(light, echo, x, y, z, weights, item)
                re, im = weight * re, weight * im
            cosine, sine = phasor(cycles)
            real += re * cosine
            real -= im * sine
            imag += re * sine
            imag += im * cosine
    if known:
        image[2 * (i * size[1] + j)] += real
        image[2 * (i * size[1] + j) + 1] += imag
