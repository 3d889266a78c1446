# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection onto arbitrary points: a map, a terrain, any positions, or few for a search.

Points are taken in tiles of neighbours. The path to the centre of a tile is computed in float64,
and for each point only what its offset from there adds, in float32 and without cancellation: with
w the vector from the phase centre to the tile's centre, d its length and o the offset,

``|w + o| - d = q / (1 + sqrt(1 + s)),  q = 2 (w/d) o + |o|^2 / d,  s = q / d,``

which rounds the offset, not the range. Tiles too large for that, and echoes whose phase centre is
too near to a tile, are computed in float64 point by point.

Neighbouring points read eight consecutive coefficients each, at positions that only the geometry
knows. A compiler turns such reads into one gather per coefficient, which many processors execute
an element at a time; one load of four floats per point followed by a transposition in registers is
several times as fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types

from ...compilation import kernel_part, njit, numba
from ...planning.exact.points import ImagePoints, PointPlan, image_layers
from ...signal.radar import RadarParameters
from .illumination import Antennas, PointAntennas, TileNodes, amplitude_of, dark_sphere
from .instructions import FLOAT, INT, INT32, instructions, order
from .memory import WorkSpace, plain
from .phasors import cos_cycles, fraction, sin_cycles
from .profiles import Profiles

if TYPE_CHECKING:
    from ...geometry.illumination import Illumination
    from ...planning.exact.backprojection import BackprojectionPlan

RUN = 8  # floats per pixel
PIXELS = 16  # pixels read together

_QUAD, _COLUMN = ir.VectorType(FLOAT, 4), ir.VectorType(FLOAT, PIXELS)
_i = types.int64


@instructions(None, _i, None, _i, None, _i, _i)
def load_columns(b, table, offset, index, first, out, to, stride):
    """``out[to + stride i + j] = table[offset + index[first + j] + i]``, i below 8, j below 16.

    `table` and `out`, float32, and `index`, int32, are contiguous. Starts are not checked against
    the size of the table.
    """
    runs = [b.add(offset, b.sext(b.load(b.element(index, first, INT32, pixel)), INT))
            for pixel in range(PIXELS)]
    for half in (0, 4):
        quads = [b.load(b.element(table, run, _QUAD, half), align=4) for run in runs]
        for column, values in enumerate(_transposed(b, quads)):
            place = b.add(to, b.mul(stride, INT(half + column)))
            b.store(values, b.element(out, place, _COLUMN), align=4)


def _transposed(b, quads):
    """Four vectors of 16 from sixteen vectors of four."""
    def pick(x, y, lanes):  # the same of every four floats; 4 to 7 are those of y
        return b.shuffle_vector(x, y, order(lane % 4 + quad + PIXELS * (lane // 4) for quad in
                                            range(0, PIXELS, 4) for lane in lanes))

    rows = []
    for j in range(4):  # pixels j, 4 + j, 8 + j, 12 + j side by side
        halves = [b.shuffle_vector(quads[k + j], quads[k + 4 + j], order(range(8)))
                  for k in (0, 8)]
        rows.append(b.shuffle_vector(*halves, order(range(PIXELS))))
    low = [pick(rows[k], rows[k + 1], (0, 4, 1, 5)) for k in (0, 2)]
    high = [pick(rows[k], rows[k + 1], (2, 6, 3, 7)) for k in (0, 2)]
    return [pick(*pair, lanes) for pair in (low, high) for lanes in ((0, 1, 4, 5), (2, 3, 6, 7))]


TILE = 256  # largest number of points in a tile
NEAREST = 16.0  # least distance of a phase centre in tile radii: the series below holds to 1e-7
_GROUPS_PER_THREAD = 4  # evens the load out

# 1 / (1 + sqrt(1 + s)) = 1/2 - s/8 + s^2/16 - 5 s^3/128 + ...
_B0, _B1, _B2, _B3, _B4, _B5 = (np.float32(v) for v in (
    1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256, -21 / 1024))


class PointImages:
    """Adds echoes to an image point by point, see `Backprojection`."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        self._plan, self._memory, self._illumination = plan.route, memory, plan.illumination
        self._layers = image_layers(plan.grid)

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        project_points(self._plan, self._layers, samples, tx_m, rx_m,
                       image.reshape(-1).view(np.float32), self._memory, self._illumination)


def project_points(plan: PointPlan, layers: Sequence[ImagePoints], samples: np.ndarray,
                   tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
                   memory: WorkSpace | None = None, illumination: Illumination | None = None
                   ) -> None:
    """Add echoes to the points of an image.

    Parameters
    ----------
    plan : PointPlan
        For these echoes.
    layers : sequence of ImagePoints
        Where the pixels are, one part of the image after the other.
    samples : (R, N) complex64
        Profiles of the echoes.
    tx_m, rx_m : (R, 3) float64
        Their phase centres, metres.
    image : (K,) float32
        Real and imaginary parts to add to, in turn; changed in place.
    memory : WorkSpace, optional
        For the profiles.
    illumination : Illumination, optional
        Illumination of the echoes.
    """
    profiles = Profiles(plan.window, plan.resampling, plan.range_m, memory)
    tx_m, rx_m = plain(tx_m, rx_m)
    work, tiles = PointWork.for_threads(), [PointTiles.of(points, plan) for points in layers]
    nodes = [plan.amplitudes and TileNodes(points, plan.tile, plan.amplitudes)
             for points in layers]
    for echoes in profiles.chunks(len(samples)):
        some = PointProfiles.of(profiles, samples[echoes])
        for layer, part, there in zip(tiles, np.split(image, len(layers)), nodes, strict=True):
            _project_points(some, tx_m[echoes], rx_m[echoes], layer, part, work,
                            None if illumination is None else PointIllumination.of(
                                plan, illumination.select(echoes), there))


class PointProfiles(NamedTuple):
    """Profiles of some echoes as the compiled loop over points takes them.

    Parameters
    ----------
    coefficients : (R * n * 8,) float32
        Those of each interval side by side; of the first and the last interval they are zero.
    n_echoes, n_cells : int
        R and n.
    range_zero, step : float
        Half path at the beginning of the first interval, and length of one, metres.
    cycles_per_step, cycles_zero : float
        Phase of the carrier along an interval, and at the beginning of the first.
    """

    coefficients: np.ndarray
    n_echoes: int
    n_cells: int
    range_zero: float
    step: float
    cycles_per_step: float
    cycles_zero: float

    @classmethod
    def of(cls, profiles: Profiles, samples: np.ndarray) -> PointProfiles:
        """Of the profiles of some echoes."""
        coefficients = np.ascontiguousarray(profiles.planes(samples)[:, 0].transpose(0, 2, 1))
        return cls(coefficients.reshape(-1), *coefficients.shape[:2], profiles.range_at(0),
                   profiles.resampling.step_m, profiles.cycles_per_step, profiles.cycles_at(0))


class PointTiles(NamedTuple):
    """Points of an image, and the tiles that they are taken in.

    Parameters
    ----------
    xs, ys, zs, strides, n_y, n_x :
        Coordinates, strides and size of `ImagePoints`.
    height, width : int
        Rows and columns of a tile: a multiple of 16 points, at most `TILE`.
    reach : float
        Radius up to which tiles are computed in float32, metres.
    """

    xs: np.ndarray
    ys: np.ndarray
    zs: np.ndarray
    strides: np.ndarray
    n_y: int
    n_x: int
    height: int
    width: int
    reach: float

    @classmethod
    def of(cls, points: ImagePoints, plan: PointPlan) -> PointTiles:
        """Of some points by a plan."""
        return cls(*points.coordinates, points.strides, *points.size, *plan.tile, plan.reach_m)


class PointWork(NamedTuple):
    """What threads work in: a number of each point of a tile, or three, four or eight."""

    places: np.ndarray
    offsets: np.ndarray
    index: np.ndarray
    part: np.ndarray
    cycles: np.ndarray
    amplitude: np.ndarray
    real: np.ndarray
    imag: np.ndarray
    columns: np.ndarray

    @classmethod
    def for_threads(cls) -> PointWork:
        """For as many as Numba uses now."""
        n = numba.get_num_threads() * _GROUPS_PER_THREAD * TILE
        return cls(np.empty(3 * n), np.empty(4 * n, np.float32), np.empty(n, np.int32),
                   *np.empty((5, n), np.float32), np.empty(RUN * n, np.float32))


class PointIllumination(NamedTuple):
    """How echoes illuminate points.

    Parameters
    ----------
    centre, axes, table, place :
        Of `PointAntennas`.
    ends : (6,) float64
        Ends of `Antennas`.
    each : int
        1 where amplitudes are found at each point of all tiles.
    line, unknown :
        Of `TileNodes`.
    nodes : (K * R,) float32
        Amplitudes at the nodes of each echo in turn.
    down, across : (TILE,) float32
        Row and column of each point of a tile.
    """

    centre: np.ndarray
    axes: np.ndarray
    table: np.ndarray
    place: np.ndarray
    ends: np.ndarray
    each: int
    line: int
    unknown: np.ndarray
    nodes: np.ndarray
    down: np.ndarray
    across: np.ndarray

    @classmethod
    def of(cls, plan: PointPlan, illumination: Illumination, tiles: TileNodes
           ) -> PointIllumination:
        """Of the points of a plan, by some echoes."""
        echoes = PointAntennas.of(illumination)
        return cls(*echoes, Antennas.of(illumination).ends, int(plan.amplitudes.each),
                   tiles.line, tiles.unknown, tiles.amplitudes(echoes), *(
                       v.astype(np.float32) for v in np.divmod(np.arange(TILE), plan.tile[1])))


@njit(parallel=True)
def _project_points(profiles, tx, rx, tiles, image, work, illumination):
    """Threads take tiles in turn; `illumination` is None where all points are illuminated alike.

    What the loop does is a function of its own: Numba 0.68 loses a factor of the amplitudes where
    a parallel loop itself takes named tuples apart. `group` has the type that it has where the
    loop runs: Numba would compile the function for the signed one as well, which nothing calls.
    """
    n_groups = len(work.index) // TILE
    for group in numba.prange(n_groups):
        _add_tiles(np.uint64(group), n_groups, profiles, tx, rx, tiles, image, work, illumination)


@kernel_part(distinct=True, error_model='numpy')
def _add_tiles(group, n_groups, profiles, tx, rx, tiles, image, work, illumination):
    """Add echoes to every so many tiles."""
    coefficients, n_echoes, n_cells, range_zero, step, cycles_per_step, cycles_zero = profiles
    xs, ys, zs, strides, n_y, n_x, height, width, reach = tiles
    places, offsets, index, part, cycles, amplitude, real, imag, columns = work
    if illumination is not None:
        centre, axes, table, place, ends, each, line, unknown, nodes, down, across = illumination
        # nodes to the last one of a tile; an axis of one point has one alone
        to_below, to_right = 2 * min(height - 1, 1) * line, 2 * min(width - 1, 1)
    tiles_x = (n_x + width - 1) // width
    n_tiles = tiles_x * ((n_y + height - 1) // height)
    inverse_step = 1.0 / step
    last = n_cells - 1.0
    count, one, two = np.uint64(height * width), np.uint64(TILE), np.uint64(2 * TILE)
    to = np.uint64(group * TILE)
    px = np.uint64(group * 3 * TILE)
    py, pz = px + one, px + two
    ox = np.uint64(group * 4 * TILE)
    oy, oz = ox + one, ox + two
    oo = oy + two
    r0 = np.uint64(group * RUN * TILE)
    r1, r2 = r0 + one, r0 + two
    r3, i0 = r1 + two, r2 + two
    i1, i2 = i0 + one, i0 + two
    i3 = i1 + two
    for number in range(group, n_tiles, n_groups):
        top, left = number // tiles_x * height, number % tiles_x * width
        x0, y0, z0, x1, y1, z1 = _box(xs, ys, zs, strides, top, min(top + height, n_y), left,
                                      min(left + width, n_x))
        if x0 > x1:
            continue
        cx, cy, cz = 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)
        radius = 0.5 * np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
        for k in range(count):
            # beyond the edge of the array the last points are computed again, and not used
            i = min(top + np.int64(k) // width, n_y - 1)
            j = min(left + np.int64(k) % width, n_x - 1)
            x, y, z = _place(xs, ys, zs, strides, i, j)
            if x + y + z != x + y + z:
                x, y, z = cx, cy, cz
            places[px + k], places[py + k], places[pz + k] = x, y, z
            x, y, z = x - cx, y - cy, z - cz
            offsets[ox + k], offsets[oy + k], offsets[oz + k] = x, y, z
            offsets[oo + k] = x * x + y * y + z * z
            real[to + k] = 0.0
            imag[to + k] = 0.0
        alone = 0
        if illumination is not None:
            # rows and columns from the first node of the tile to the last
            rows, wide = min(height, n_y - 1 - top), min(width, n_x - 1 - left)
            corner = np.int64(number // tiles_x * to_below + number % tiles_x * to_right)
            alone = each
            if each == 0:
                alone = _unknown_node(unknown, corner, to_below, to_right, line)
            # Differences between nodes by the pixel; none of second order for two points.
            iy, ix = np.float32(1.0 / max(rows, 1)), np.float32(1.0 / max(wide, 1))
            y_bent, x_bent = rows // 2, wide // 2
            above = np.float32(min(y_bent, 1) * iy / max(y_bent, 1))
            below = np.float32(min(y_bent, 1) * iy / max(rows - y_bent, 1))
            before = np.float32(min(x_bent, 1) * ix / max(x_bent, 1))
            after = np.float32(min(x_bent, 1) * ix / max(wide - x_bent, 1))
        for echo in range(n_echoes):
            if illumination is not None:
                if alone == 1:
                    if dark_sphere(centre, axes, ends, np.uint64(echo), cx, cy, cz,
                                   radius) == 1:
                        continue
                    for k in range(count):
                        amplitude[to + k] = amplitude_of(
                            centre, axes, table, place, np.uint64(echo), places[px + k],
                            places[py + k], places[pz + k])
                else:
                    # parabolas along rows of nodes, whose coefficients are such along columns
                    at, to_mid = corner * n_echoes + echo, to_below // 2 * n_echoes
                    to_last = to_below * n_echoes
                    mid, end = to_right // 2 * n_echoes, to_right * n_echoes
                    a0, a1, a2 = nodes[at], nodes[at + to_mid], nodes[at + to_last]
                    b0, b1, b2 = (nodes[at + end], nodes[at + to_mid + end],
                                  nodes[at + to_last + end])
                    c0, c1, c2 = (nodes[at + mid], nodes[at + to_mid + mid],
                                  nodes[at + to_last + mid])
                    if a0 + a1 + a2 + b0 + b1 + b2 + c0 + c1 + c2 == 0.0:
                        continue
                    c0 = _bend(a0, c0, b0, before, after)
                    c1 = _bend(a1, c1, b1, before, after)
                    c2 = _bend(a2, c2, b2, before, after)
                    length = np.float32(wide)
                    b0, b1, b2 = ((b0 - a0) * ix - c0 * length, (b1 - a1) * ix - c1 * length,
                                  (b2 - a2) * ix - c2 * length)
                    length = np.float32(rows)
                    d = _bend(a0, a1, a2, above, below)
                    a1, a2 = (a2 - a0) * iy - d * length, d
                    d = _bend(b0, b1, b2, above, below)
                    b1, b2 = (b2 - b0) * iy - d * length, d
                    d = _bend(c0, c1, c2, above, below)
                    c1, c2 = (c2 - c0) * iy - d * length, d
                    for k in range(count):
                        w, s = across[k], down[k]
                        amplitude[to + k] = a0 + w * (b0 + w * c0) + s * (
                            a1 + w * (b1 + w * c1) + s * (a2 + w * (b2 + w * c2)))
            ax, ay, az, da = _vector(tx, echo, cx, cy, cz)
            bx, by, bz, db = _vector(rx, echo, cx, cy, cz)
            if radius < min(reach, min(da, db) * (1.0 / NEAREST)):
                v = (0.5 * (da + db) - range_zero) * inverse_step
                cell = np.floor(v)
                t0, c0 = np.float32(v - cell), np.float32(
                    fraction(cycles_per_step * v + cycles_zero))
                # far outside stays outside whatever the offset
                n0 = np.float32(min(max(cell, -4e6), 4e6))
                scale = inverse_step / da
                ux, uy, uz = (np.float32(ax * scale), np.float32(ay * scale),
                              np.float32(az * scale))
                wa, ia = np.float32(0.5 * scale), np.float32(2.0 * step / da)
                scale = inverse_step / db
                vx, vy, vz = (np.float32(bx * scale), np.float32(by * scale),
                              np.float32(bz * scale))
                wb, ib = np.float32(0.5 * scale), np.float32(2.0 * step / db)
                short_cycles, n_last = np.float32(cycles_per_step), np.float32(last)
                for k in range(count):
                    x, y, z = offsets[ox + k], offsets[oy + k], offsets[oz + k]
                    # q / 2 of both legs, in range steps
                    q = ux * x + uy * y + uz * z + wa * offsets[oo + k]
                    p = vx * x + vy * y + vz * z + wb * offsets[oo + k]
                    shift = q * _root_series(q * ia) + p * _root_series(p * ib)
                    t = t0 + shift
                    n = np.floor(t)
                    part[to + k] = t - n
                    n = min(max(n + n0, np.float32(0)), n_last)
                    index[to + k] = np.int32(np.float32(RUN) * n)
                    cycles[to + k] = fraction(c0 + short_cycles * shift)
            else:
                for k in range(count):
                    x, y, z = places[px + k], places[py + k], places[pz + k]
                    ax, ay, az, da = _vector(tx, echo, x, y, z)
                    bx, by, bz, db = _vector(rx, echo, x, y, z)
                    v = (0.5 * (da + db) - range_zero) * inverse_step
                    n = np.floor(v)
                    part[to + k] = v - n
                    index[to + k] = np.int32(RUN * min(max(n, 0.0), last))
                    cycles[to + k] = fraction(cycles_per_step * v + cycles_zero)
            for first in range(0, height * width, PIXELS):
                load_columns(coefficients, echo * n_cells * RUN, index, np.int64(to) + first,
                             columns, np.int64(r0) + first, TILE)
            for k in range(count):
                t = part[to + k]
                re = columns[r0 + k] + t * (columns[r1 + k] + t * (
                    columns[r2 + k] + t * columns[r3 + k]))
                im = columns[i0 + k] + t * (columns[i1 + k] + t * (
                    columns[i2 + k] + t * columns[i3 + k]))
                c = cycles[to + k]
                sine, cosine = sin_cycles(c, c * c), cos_cycles(c * c)
                if illumination is not None:
                    re, im = re * amplitude[to + k], im * amplitude[to + k]
                real[to + k] += re * cosine - im * sine
                imag[to + k] += re * sine + im * cosine
        for i in range(top, min(top + height, n_y)):
            for j in range(left, min(left + width, n_x)):
                x, y, z = _place(xs, ys, zs, strides, i, j)
                if x + y + z == x + y + z:
                    k = np.uint64((i - top) * width + j - left)
                    image[2 * (i * n_x + j)] += real[to + k]
                    image[2 * (i * n_x + j) + 1] += imag[to + k]


@njit(inline='always')
def _unknown_node(unknown, corner, to_below, to_right, line):
    """1 where a node of a tile has no position."""
    found = 0
    for row in range(corner, corner + to_below + 1, line):
        for node in range(row, row + to_right + 1):
            found |= unknown[node]
    return found


@njit(inline='always')
def _bend(low, between, high, before, after):
    """Second difference of three nodes; `before` and `after` are 0 for two points or one."""
    return (high - between) * after - (between - low) * before


@njit(inline='always')
def _place(xs, ys, zs, strides, i, j):
    return (xs[i * strides[0, 0] + j * strides[0, 1]], ys[i * strides[1, 0] + j * strides[1, 1]],
            zs[i * strides[2, 0] + j * strides[2, 1]])


@njit(inline='always')
def _box(xs, ys, zs, strides, top, bottom, left, right):
    """Lowest and highest coordinates of the points that have a position."""
    x0, y0, z0 = np.inf, np.inf, np.inf
    x1, y1, z1 = -np.inf, -np.inf, -np.inf
    for i in range(top, bottom):
        for j in range(left, right):
            x, y, z = _place(xs, ys, zs, strides, i, j)
            if x + y + z == x + y + z:
                x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
                x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    return x0, y0, z0, x1, y1, z1


@njit(inline='always')
def _vector(centres, echo, x, y, z):
    """Vector from a phase centre to a point, and its length."""
    a, b, c = x - centres[echo, 0], y - centres[echo, 1], z - centres[echo, 2]
    return a, b, c, np.sqrt(a * a + b * b + c * c)


@njit(inline='always')
def _root_series(s):
    return _B0 + s * (_B1 + s * (_B2 + s * (_B3 + s * (_B4 + s * _B5))))


LENGTH = 16  # pixels of a piece of a line


class TrialImages:
    """See `backends.protocol.TrialImages`.

    Paths are quadratic along a piece and profiles linear between samples: good to a tenth or so,
    which is enough to tell a focused image from others.
    """

    length = LENGTH

    def __init__(self, radar: RadarParameters, samples: np.ndarray):
        self._radar = radar
        echoes = samples.reshape(-1, samples.shape[-1])
        planes = np.zeros((2, len(echoes), echoes.shape[1] + 3), np.float32)  # with zeros around
        planes[0, :, 1:-2], planes[1, :, 1:-2] = echoes.real, echoes.imag
        self._planes = planes.reshape(2, -1)

    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray,
              step_m: np.ndarray, range_bias_m: float = 0.0) -> np.ndarray:
        """See `backends.protocol.TrialImages.image`."""
        out, radar = np.zeros((2, len(starts_m) * LENGTH), np.float32), self._radar
        tx_m, rx_m = (np.ascontiguousarray(c).reshape(-1, 3) for c in (tx_m, rx_m))
        add_pieces(*self._planes, tx_m, rx_m, starts_m, step_m,
                   radar.range_start_m - radar.sample_spacing_m - range_bias_m,
                   radar.sample_spacing_m, radar.wavelength_m, *out)
        return out.reshape(2, -1, LENGTH)


@njit(parallel=True)
def add_pieces(real, imag, tx, rx, starts, direction, range_start, spacing, wavelength, out_re,
               out_im):
    """Backproject profiles onto short pieces of lines, see `TrialImages`.

    Profiles of the echoes, `real` and `imag`, (R * N,) float32, begin with a zero and end with
    two. Half path of sample 0 and between samples, and the wavelength, are metres. `out_re` and
    `out_im`, (K * `LENGTH`,) float32, are zero before, and changed in place.
    """
    n_echoes, n = len(tx), len(real) // len(tx)
    half, last = LENGTH // 2, np.float32(n - 2)
    one, cycles_per_m = np.uint64(1), 2.0 / wavelength
    index = (np.arange(LENGTH) - half).astype(np.float32)
    for k in numba.prange(len(starts)):
        to = np.uint64(k * LENGTH)
        for echo in range(n_echoes):
            a = _half_path(starts, k, direction, 0.0, tx, rx, echo)
            b = _half_path(starts, k, direction, 1.0 * half, tx, rx, echo)
            c = _half_path(starts, k, direction, 1.0 * LENGTH, tx, rx, echo)
            slope, bend = (c - a) / LENGTH, (c - 2 * b + a) / (2 * half * half)
            p0 = np.float32(min(max((b - range_start) / spacing, -1e6), 1e6))
            p1, p2 = np.float32(slope / spacing), np.float32(bend / spacing)
            cycles = b * cycles_per_m
            c0 = np.float32(cycles - np.floor(cycles))
            c1, c2 = np.float32(slope * cycles_per_m), np.float32(bend * cycles_per_m)
            base = np.uint64(echo * n)
            for i in range(np.uint64(LENGTH)):
                f = index[i]
                place = min(max(p0 + f * (p1 + f * p2), np.float32(0.0)), last)
                cell = np.int32(place)
                t = place - np.float32(cell)
                j = base + np.uint64(cell)
                re, im = real[j], imag[j]
                re += t * (real[j + one] - re)
                im += t * (imag[j + one] - im)
                g = fraction(c0 + f * (c1 + f * c2))
                sine, cosine = sin_cycles(g, g * g), cos_cycles(g * g)
                out_re[to + i] += re * cosine - im * sine
                out_im[to + i] += re * sine + im * cosine


@njit(inline='always')
def _half_path(starts, k, direction, steps, tx, rx, echo):
    x = starts[k, 0] + steps * direction[0]
    y = starts[k, 1] + steps * direction[1]
    z = starts[k, 2] + steps * direction[2]
    return 0.5 * (
        np.sqrt((x - tx[echo, 0]) ** 2 + (y - tx[echo, 1]) ** 2 + (z - tx[echo, 2]) ** 2)
        + np.sqrt((x - rx[echo, 0]) ** 2 + (y - rx[echo, 1]) ** 2 + (z - rx[echo, 2]) ** 2))
