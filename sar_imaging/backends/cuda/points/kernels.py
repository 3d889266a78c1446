"""Backprojection onto arbitrary points: the kernels.

Points are taken in tiles of neighbours, as on the processor. The path to the centre of a tile is
computed in float64, once for each echo, and for each point only what its offset from there adds,
in float32 and without cancellation: with w the vector from the phase centre to the tile's centre,
d its length and o the offset,

``|w + o| - d = q / (1 + sqrt(1 + s)),  q = 2 (w/d) o + |o|^2 / d,  s = q / d.``

Tiles too large for that, and echoes whose phase centre is too near to a tile, are computed in
float64 point by point, in a loop of their own. A thread has `POINTS` points of a tile, for which
it loads what they share once; neighbours read neighbouring cells of a profile.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import cuda, function, kernel, load_pair
from ..phasors import fraction, phasor, short_fraction
from .lit_tiles import BETWEEN, DARK, WEIGHTS, amplitude_alone, amplitude_between, light_tile

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
def add_points(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step,
               cycles_per_step, cycles_zero, reach, image):
    """Add echoes to points; a grid of blocks of `BLOCK` points, tile by tile.

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
        As of `bound_tiles`; tiles have a power of 2 points, at most `BLOCK`.
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
def _add(planes, n_cells, centres, xs, ys, zs, strides, size, tile, tiles, range_zero, step,
         cycles_per_step, cycles_zero, reach, image, light):
    """What both kernels do; `light` is None where echoes light all points alike."""
    legs = cuda.shared.array((_LEGS, _ITEMS), np.float32)
    place = cuda.shared.array((_PLACE, _ITEMS), np.float32)
    kind = cuda.shared.array(_ITEMS, np.int32)
    any_exact = cuda.shared.array(1, np.int32)
    if light is not None:
        lit = cuda.shared.array(_ITEMS, np.int32)
        weights = cuda.shared.array((_WEIGHTS, _ITEMS), np.float32)
    ox = cuda.local.array(POINTS, np.float32)
    oy = cuda.local.array(POINTS, np.float32)
    oz = cuda.local.array(POINTS, np.float32)
    oo = cuda.local.array(POINTS, np.float32)
    real = cuda.local.array(POINTS, np.float32)
    imag = cuda.local.array(POINTS, np.float32)
    thread, n_all = cuda.threadIdx.x, centres.shape[0]
    apart = tile[0] * tile[1] // POINTS  # points of a thread, in the tile's order
    n_own = THREADS // apart  # tiles of the block
    mine, k = thread // apart, thread % apart
    number, across = cuda.blockIdx.x * n_own + mine, (size[1] + tile[1] - 1) // tile[1]
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
    inverse_step, turns = 1.0 / step, np.float32(cycles_per_step)
    last, most = np.int32(n_cells - 1), _ITEMS // n_own
    for start in range(0, n_all, most):
        n_echoes = min(most, n_all - start)
        cuda.syncthreads()
        if thread == 0:
            any_exact[0] = 0
        cuda.syncthreads()
        for item in range(thread, n_echoes * n_own, THREADS):
            echo, own = start + item // n_own, cuda.blockIdx.x * n_own + item % n_own
            kind[item] = _EXACT  # and without any point, where a tile has none
            if own < tiles.shape[0] and not math.isnan(tiles[own, 3]):
                cx, cy, cz, radius = tiles[own, 0], tiles[own, 1], tiles[own, 2], tiles[own, 3]
                if light is not None:
                    lit[item] = light_tile(light, own, across, tile, (cx, cy, cz, radius), echo,
                                            weights, item)
                    if lit[item] == DARK:
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
            item, row = nth * n_own + mine, np.uint64((start + nth) * n_cells * 4)
            if light is not None:
                if lit[item] == DARK:
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
                if light is not None:
                    if lit[item] == BETWEEN:
                        weight = amplitude_between(np.float32((k + p * apart) // tile[1]),
                                                    np.float32((k + p * apart) % tile[1]),
                                                    weights, item)
                    else:
                        weight = amplitude_alone(light, ox[p], oy[p], oz[p], weights, item)
                    re, im = weight * re, weight * im
                cosine, sine = phasor(short_fraction(place[1, item] + turns * shift))
                real[p] += re * cosine
                real[p] -= im * sine
                imag[p] += re * sine
                imag[p] += im * cosine
        for nth in range(n_echoes if any_exact[0] else 0):
            item, echo = nth * n_own + mine, start + nth
            if light is not None:
                if lit[item] == DARK:
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
                if light is not None:
                    if lit[item] == BETWEEN:
                        weight = amplitude_between(np.float32(i - top), np.float32(j - left),
                                                    weights, item)
                    else:
                        weight = amplitude_alone(light, ox[p], oy[p], oz[p], weights, item)
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
