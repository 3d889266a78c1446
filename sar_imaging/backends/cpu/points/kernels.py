"""Backprojection onto arbitrary points, a map, a terrain or any positions: its compiled loop.

Points are taken in tiles of neighbours. The path to the centre of a tile is computed in float64,
and for each point only what its offset from there adds, in float32 and without cancellation: with
w the vector from the phase centre to the tile's centre, d its length and o the offset,

``|w + o| - d = q / (1 + sqrt(1 + s)),  q = 2 (w/d) o + |o|^2 / d,  s = q / d,``

which rounds the offset, not the range. Tiles too large for that, and echoes whose phase centre is
too near to a tile, are computed in float64 point by point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....compilation import njit, numba
from ....geometry.illumination import Illumination
from ....planning.exact.points import ImagePoints, PointPlan
from ..illumination import LitEchoes, dark_sphere, two_way_amplitude
from ..line_kernels import _cos_cycles, _fraction, _sin_cycles
from ..memory import WorkSpace
from ..profiles import Profiles
from .transposed_loads import PIXELS, RUN, load_columns

TILE = 256  # largest number of points in a tile
NEAREST = 16.0  # least distance of a phase centre in tile radii: the series below holds to 1e-7
_GROUPS_PER_THREAD = 4  # evens the load out

# 1 / (1 + sqrt(1 + s)) = 1/2 - s/8 + s^2/16 - 5 s^3/128 + ...
_B0, _B1, _B2, _B3, _B4, _B5 = (np.float32(v) for v in (
    1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256, -21 / 1024))


def project_points(plan: PointPlan, layers: Sequence[ImagePoints], samples, tx_m, rx_m, image,
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
        Of the echoes.
    """
    profiles = Profiles(plan.window, plan.lattice, plan.range_m, memory)
    work = _work_space()
    for echoes in profiles.chunks(len(samples)):
        planes = profiles.planes(samples[echoes])
        coefficients = np.ascontiguousarray(planes[:, 0].transpose(0, 2, 1))
        for points, part in zip(layers, np.split(image, len(layers)), strict=True):
            _project_points(
                coefficients.reshape(-1), coefficients.shape[:2], tx_m[echoes], rx_m[echoes],
                *points.coordinates, points.strides, points.size, plan.tile,
                profiles.range_at(0), plan.lattice.step_m, profiles.cycles_per_step,
                profiles.cycles_at(0), plan.reach_m, part, *work,
                *_lit(plan, illumination, echoes))


def _lit(plan: PointPlan, illumination: Illumination | None, echoes: slice) -> tuple:
    """Arguments of the compiled loop that tell amplitudes; none where all are lit alike."""
    if illumination is None:
        return (None,) * 6
    lit = LitEchoes.of(illumination.select(echoes))
    n = numba.get_num_threads() * _GROUPS_PER_THREAD * TILE
    return lit, lit.ends, int(plan.lit.each), *np.empty((3, n), np.float32)


def _work_space() -> tuple[np.ndarray, ...]:
    """Arrays that `_project_points` works in, for the threads in use."""
    n = numba.get_num_threads() * _GROUPS_PER_THREAD * TILE
    return (np.empty(3 * n), np.empty(4 * n, np.float32), np.empty(n, np.int32),
            *(np.empty(k * n, np.float32) for k in (1, 1, 1, 1, RUN)))


@njit(parallel=True)
def _project_points(coefficients, shape, tx, rx, xs, ys, zs, strides, size, tile, range_zero, step,
                    cycles_per_step, cycles_zero, reach, image, places, offsets, index, part,
                    cycles, real, imag, columns, lit, ends, each, amplitude, down, across):
    """Tile by tile of the points of `ImagePoints`; free of views, see `line_kernels`.

    `coefficients` are those of each interval side by side, the first and the last ones zero; half
    path and carrier phase are told at the first. Tiles have a multiple of 16 points, at most
    `TILE`, and are computed in float32 up to a radius of `reach`, metres.
    """
    n_echoes, n_cells = shape
    n_y, n_x = size
    height, width = tile
    tiles_x = (n_x + width - 1) // width
    n_tiles = tiles_x * ((n_y + height - 1) // height)
    n_groups = len(index) // TILE
    inverse_step = 1.0 / step
    last = n_cells - 1.0
    for group in numba.prange(n_groups):
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
            if lit is not None:
                bottom, right = min(top + height, n_y) - 1, min(left + width, n_x) - 1
                alone = each | _unknown_corner(xs, ys, zs, strides, top, left, bottom, right)
                for k in range(count):
                    down[to + k] = np.float32(np.int64(k) // width / max(bottom - top, 1))
                    across[to + k] = np.float32(np.int64(k) % width / max(right - left, 1))
            for echo in range(n_echoes):
                if lit is not None:
                    if dark_sphere(lit, ends, echo, cx, cy, cz, radius) == 1:
                        continue
                    if alone == 1:
                        for k in range(count):
                            amplitude[to + k] = two_way_amplitude(
                                lit, echo, places[px + k], places[py + k], places[pz + k])
                    else:
                        w0 = _amplitude_at(lit, echo, xs, ys, zs, strides, top, left)
                        w1 = _amplitude_at(lit, echo, xs, ys, zs, strides, top, right) - w0
                        w2 = _amplitude_at(lit, echo, xs, ys, zs, strides, bottom, left) - w0
                        w3 = _amplitude_at(lit, echo, xs, ys, zs, strides, bottom, right) - w0
                        w3 -= w1 + w2
                        for k in range(count):
                            amplitude[to + k] = w0 + across[to + k] * w1 + down[to + k] * (
                                w2 + across[to + k] * w3)
                ax, ay, az, da = _vector(tx, echo, cx, cy, cz)
                bx, by, bz, db = _vector(rx, echo, cx, cy, cz)
                if radius < min(reach, min(da, db) * (1.0 / NEAREST)):
                    v = (0.5 * (da + db) - range_zero) * inverse_step
                    cell = np.floor(v)
                    t0, c0 = np.float32(v - cell), np.float32(
                        _fraction(cycles_per_step * v + cycles_zero))
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
                    turns, n_last = np.float32(cycles_per_step), np.float32(last)
                    for k in range(count):
                        x, y, z = offsets[ox + k], offsets[oy + k], offsets[oz + k]
                        # q / 2 of both legs, in lattice steps
                        q = ux * x + uy * y + uz * z + wa * offsets[oo + k]
                        p = vx * x + vy * y + vz * z + wb * offsets[oo + k]
                        shift = q * _root_series(q * ia) + p * _root_series(p * ib)
                        t = t0 + shift
                        n = np.floor(t)
                        part[to + k] = t - n
                        n = min(max(n + n0, np.float32(0)), n_last)
                        index[to + k] = np.int32(np.float32(RUN) * n)
                        cycles[to + k] = _fraction(c0 + turns * shift)
                else:
                    for k in range(count):
                        x, y, z = places[px + k], places[py + k], places[pz + k]
                        ax, ay, az, da = _vector(tx, echo, x, y, z)
                        bx, by, bz, db = _vector(rx, echo, x, y, z)
                        v = (0.5 * (da + db) - range_zero) * inverse_step
                        n = np.floor(v)
                        part[to + k] = v - n
                        index[to + k] = np.int32(RUN * min(max(n, 0.0), last))
                        cycles[to + k] = _fraction(cycles_per_step * v + cycles_zero)
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
                    sine, cosine = _sin_cycles(c, c * c), _cos_cycles(c * c)
                    if lit is not None:
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
def _unknown_corner(xs, ys, zs, strides, top, left, bottom, right):
    """1 where a corner of a tile has no position."""
    for i in range(top, bottom + 1, max(bottom - top, 1)):
        for j in range(left, right + 1, max(right - left, 1)):
            x, y, z = _place(xs, ys, zs, strides, i, j)
            if x + y + z != x + y + z:
                return 1
    return 0


@njit(inline='always')
def _amplitude_at(lit, echo, xs, ys, zs, strides, i, j):
    x, y, z = _place(xs, ys, zs, strides, i, j)
    return np.float32(two_way_amplitude(lit, echo, x, y, z))


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
