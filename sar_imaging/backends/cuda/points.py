"""Backprojection onto arbitrary points on the device.

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
from collections.abc import Sequence

import numpy as np

from ...planning.exact.points import ImagePoints, PointPlan
from .arrays import cuda, function, kernel, launch, load_pair, pairs, xp
from .phasors import fraction, phasor, short_fraction
from .profiles import Profiles
from .transfers import in_pieces

_TOGETHER = 32  # echoes of a chunk of profiles come in multiples of this
THREADS = 256  # points of a block: of one tile, or of several smaller ones
NEAREST = 16.0  # least distance of a phase centre in tile radii: the series below holds to 1e-7
_ITEMS = 128  # echoes times tiles whose geometry lies in shared memory
_LEGS, _PLACE = 10, 3  # numbers of an item

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
    legs = cuda.shared.array((_LEGS, _ITEMS), np.float32)
    place = cuda.shared.array((_PLACE, _ITEMS), np.float32)
    exact = cuda.shared.array(_ITEMS, np.int32)
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
            cosine, sine = phasor(cycles)
            real += re * cosine
            real -= im * sine
            imag += re * sine
            imag += im * cosine
    if known:
        image[2 * (i * size[1] + j)] += real
        image[2 * (i * size[1] + j) + 1] += imag


class Points:
    """Pixels at any positions, prepared for adding any number of echoes.

    Parameters
    ----------
    plan : PointPlan
        How they are added.
    layers : sequence of ImagePoints
        Where the pixels are, one part of the image after the other.
    """

    def __init__(self, plan: PointPlan, layers: Sequence[ImagePoints]):
        self._plan, self._profiles = plan, Profiles(plan.window, plan.lattice, plan.range_m)
        self._tile = xp.asarray(np.array(plan.tile, np.int64))
        self._layers = [self._prepared(points) for points in layers]

    def _prepared(self, points: ImagePoints) -> tuple:
        """Coordinates, strides, size, tile and tiles of a layer, as the kernels take them."""
        (n_y, n_x), (height, width) = points.size, self._plan.tile
        tiles = xp.empty((-(-n_y // height) * -(-n_x // width), 4), np.float64)
        made = (*(xp.asarray(np.ascontiguousarray(c)) for c in points.coordinates),
                xp.asarray(points.strides.astype(np.int64)),
                xp.asarray(np.array(points.size, np.int64)), self._tile, tiles)
        launch(bound_tiles, -(-len(tiles) // THREADS), THREADS, *made)
        return made

    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, (K,) float32 array of the device; see `Lines.add`."""
        profiles, plan = self._profiles, self._plan
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        parts = image.reshape(len(self._layers), -1)
        own = THREADS // (plan.tile[0] * plan.tile[1])
        for echoes, some in in_pieces(samples, profiles.chunks(len(samples), _TOGETHER)):
            planes = pairs(profiles.planes(some))
            for made, part in zip(self._layers, parts, strict=True):
                launch(add_points, -(-len(made[-1]) // own), THREADS, planes, profiles.n_cells,
                       centres[echoes], *made, profiles.range_at(0), plan.lattice.step_m,
                       profiles.cycles_per_step, profiles.cycles_at(0), plan.reach_m, part)
