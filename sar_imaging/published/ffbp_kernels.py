"""Compiled loops of fast factorised backprojection.

All of them work on images at range baseband: value times ``exp(-j 4 pi (r - r_0) / lambda)`` with
the first range r_0 of the image's own grid, real and imaginary parts apart in one flat array.
Positions are float64; the carrier phase is reduced to a fraction of a cycle in float64 before it
becomes float32.
"""

from __future__ import annotations

import numpy as np

from ..backends.cpu.line_kernels import LINES, _cos_cycles, _fraction, _sin_cycles
from ..compilation import njit, numba
from .ffbp_grids import LANES
from .neighbour_sums import interpolate2, interpolate4, interpolate8

PADDING = 256  # values after an image that a segment may read
PIXELS = 64  # of the requested grid, whose geometry is computed together


def paired(weights: np.ndarray) -> np.ndarray:
    """Weights (taps, 8) as `merge` reads them: even, then odd powers of one tap of each pair.

    The kernels are symmetric, so that tap k at x weighs what tap ``taps - 1 - k`` does at -x.
    """
    half = weights[:len(weights) // 2]
    return np.ascontiguousarray(np.concatenate([half[:, ::2], half[:, 1::2]], axis=1).reshape(-1))


@njit
def local_lines(geometry, n_alpha, segment, lines):
    """Lines of a local polar grid as `kernels.project_lines` wants them.

    Parameters
    ----------
    geometry : (12,) float64
        Origin x, y, z of the grid and height of its plane, metres; track x, y and its normal x,
        y; first range and spacing, metres; first direction cosine and spacing.
    n_alpha, segment : int
        Directions, and pixels of a segment.
    lines : (G, S, 12, LINES) float64
        Position in the middle of each segment and its first to third derivative by the pixel
        number, metres.
    """
    ux, uy, vx, vy = geometry[4], geometry[5], geometry[6], geometry[7]
    step = geometry[9]
    height = geometry[2] - geometry[3]
    for group in range(lines.shape[0]):
        for number in range(lines.shape[1]):
            r = geometry[8] + (number * segment + segment // 2) * step
            for j in range(LINES):
                alpha = geometry[10] + min(group * LINES + j, n_alpha - 1) * geometry[11]
                squeeze = 1 - alpha * alpha
                ground = np.sqrt(max(r * r * squeeze - height * height, 1e-12))
                g1 = r * squeeze / ground
                g2 = (squeeze - g1 * g1) / ground
                g3 = -3 * g1 * g2 / ground
                lines[group, number, 0, j] = geometry[0] + r * alpha * ux + ground * vx
                lines[group, number, 1, j] = geometry[1] + r * alpha * uy + ground * vy
                lines[group, number, 2, j] = geometry[3]
                lines[group, number, 3, j] = (alpha * ux + g1 * vx) * step
                lines[group, number, 4, j] = (alpha * uy + g1 * vy) * step
                lines[group, number, 5, j] = 0.0
                lines[group, number, 6, j] = g2 * vx * step * step
                lines[group, number, 7, j] = g2 * vy * step * step
                lines[group, number, 8, j] = 0.0
                lines[group, number, 9, j] = g3 * vx * step * step * step
                lines[group, number, 10, j] = g3 * vy * step * step * step
                lines[group, number, 11, j] = 0.0


@njit(inline='always')
def _weigh(real, at_re, imag, at_im, step, weights, pairs, places, at, count, out_re, out_im):
    """Weighted sums of neighbours `step` apart; a constant number of pairs unrolls the loop."""
    for i in range(count):
        x = places[at + i]
        xx = x * x
        re, im = np.float32(0.0), np.float32(0.0)
        for k in range(pairs):
            w = np.uint64(8) * k
            even = weights[w] + xx * (weights[w + np.uint64(1)] + xx * (
                weights[w + np.uint64(2)] + xx * weights[w + np.uint64(3)]))
            odd = x * (weights[w + np.uint64(4)] + xx * (weights[w + np.uint64(5)] + xx * (
                weights[w + np.uint64(6)] + xx * weights[w + np.uint64(7)])))
            near = k * step + i
            far = (pairs + pairs - np.uint64(1) - k) * step + i
            sum_re = real[at_re + near] + real[at_re + far]
            sum_im = imag[at_im + near] + imag[at_im + far]
            re += even * sum_re + odd * (real[at_re + near] - real[at_re + far])
            im += even * sum_im + odd * (imag[at_im + near] - imag[at_im + far])
        out_re[at + i] = re
        out_im[at + i] = im


@njit(parallel=True)
def merge(child, child_shape, parent, parent_shape, geometry, weights_range, weights_alpha, pairs,
          segment, index, start, place, line_re, line_im, out_re, out_im):
    """Interpolate a local image to the polar grid of a longer sub-aperture.

    Both grids have the same range spacing and plane, so that a segment of a line of the parent
    follows a line of the child: the neighbours are loaded contiguously, first along direction
    for all ranges that the segment reads, then along range.

    Parameters
    ----------
    child, parent : (2 * n_alpha * n_range + PADDING,) float32
        Images; the child must cover the parent and the kernel.
    child_shape, parent_shape : (int, int)
        Their n_alpha, n_range.
    geometry : (12,) float64
        Origin of the child from the parent's along and across track; heights of the parent's and
        the child's origin above the plane, metres; range spacing, the parent's and the child's
        first range, metres; the parent's first direction cosine and spacing; the child's.
        Cycles of carrier phase per range pixel come last.
    weights_range, weights_alpha : (pairs * 8,) float32
        From `paired`.
    pairs : int
        Pairs of taps.
    segment : int
        Pixels along which the geometry is expanded, a multiple of `LANES`.
    index : (segment + LANES,) float32
        Numbers 0, 1, 2, ...
    start : int
        1 to overwrite the parent, 0 to add to it.
    place, line_re, line_im, out_re, out_im : (groups * (segment + LANES),) float32
        Work space for each of the groups into which lines are divided among threads. Separate
        arrays, because the compiler knows that these do not overlap.
    """
    du, dv, height_p, height_c = geometry[0], geometry[1], geometry[2], geometry[3]
    step, range_p, range_c = geometry[4], geometry[5], geometry[6]
    cycles_per_pixel = geometry[11]
    turns = np.float32(cycles_per_pixel)
    n_lines, n = parent_shape
    child_lines, child_n = child_shape
    child_size, parent_size = child_lines * child_n, n_lines * n
    width = segment + LANES
    n_groups = len(place) // width
    half, first = segment // 2, 1 - pairs
    one, centre = np.uint64(1), np.float32(0.5)
    for group in numba.prange(n_groups):
        at = np.uint64(group * width)
        for line in range(group * n_lines // n_groups, (group + 1) * n_lines // n_groups):
            alpha = geometry[7] + line * geometry[8]
            squeeze = 1.0 - alpha * alpha
            for begin in range(0, n, segment):
                # The child's coordinates in the middle of the segment, and their derivatives
                # by the parent's range
                r = range_p + (begin + half) * step
                ground = np.sqrt(r * r * squeeze - height_p * height_p)
                g1 = r * squeeze / ground
                g2 = (squeeze - g1 * g1) / ground
                g3 = -3.0 * g1 * g2 / ground
                a, c = r * alpha - du, ground - dv
                rc = np.sqrt(a * a + c * c + height_c * height_c)
                inverse = 1.0 / rc
                r1 = (a * alpha + c * g1) * inverse
                r2 = (alpha * alpha + g1 * g1 + c * g2 - r1 * r1) * inverse
                r3 = (3.0 * g1 * g2 + c * g3 - 3.0 * r1 * r2) * inverse
                ac = a * inverse
                a1 = (alpha - ac * r1) * inverse
                a2 = -(2.0 * a1 * r1 + ac * r2) * inverse
                # in pixels
                v = (rc - range_c) / step
                node = np.floor(v)
                u = (ac - geometry[9]) / geometry[10]
                row = np.floor(u)
                t0, t1 = np.float32(v - node), np.float32(r1 - 1.0)
                t2, t3 = np.float32(0.5 * r2 * step), np.float32(r3 * step * step / 6.0)
                scale = step / geometry[10] / r1
                u0, u1 = np.float32(u - row - 0.5), np.float32(a1 * scale)
                u2 = np.float32(0.5 * a2 * scale * step / r1)
                phase = np.float32(_fraction(cycles_per_pixel * (node - begin - half)))
                count = np.uint64((min(segment, n - begin) + LANES - 1) // LANES * LANES)
                reach = count + np.uint64(LANES)
                low = np.int64(row) + first
                low = min(max(low, 0), child_lines - 2 * pairs)
                from_ = low * child_n + np.int64(node) - half + first
                from_ = min(max(from_, 0), (child_lines - 2 * pairs + 1) * child_n)
                source, row_step = np.uint64(from_), np.uint64(child_n)
                behind = np.float32(first - half) - t0
                for i in range(reach):
                    f = index[i] + behind
                    place[at + i] = u0 + f * (u1 + f * u2)
                source_im = source + np.uint64(child_size)
                if pairs == 4:
                    _weigh(child, source, child, source_im, row_step, weights_alpha, np.uint64(4),
                           place, at, reach, line_re, line_im)
                elif pairs == 2:
                    _weigh(child, source, child, source_im, row_step, weights_alpha, np.uint64(2),
                           place, at, reach, line_re, line_im)
                else:
                    _weigh(child, source, child, source_im, row_step, weights_alpha, np.uint64(1),
                           place, at, reach, line_re, line_im)
                for i in range(count):
                    f = index[i] - np.float32(half)
                    place[at + i] = t0 + f * (t1 + f * (t2 + f * t3)) - centre
                if pairs == 4:
                    _weigh(line_re, at, line_im, at, one, weights_range, np.uint64(4),
                           place, at, count, out_re, out_im)
                elif pairs == 2:
                    _weigh(line_re, at, line_im, at, one, weights_range, np.uint64(2),
                           place, at, count, out_re, out_im)
                else:
                    _weigh(line_re, at, line_im, at, one, weights_range, np.uint64(1),
                           place, at, count, out_re, out_im)
                pixel = np.uint64(line * n + begin)
                pixel_im = pixel + np.uint64(parent_size)
                for i in range(count):
                    cycles = _fraction(turns * (place[at + i] + centre) + phase)
                    square = cycles * cycles
                    sine, cosine = _sin_cycles(cycles, square), _cos_cycles(square)
                    re, im = out_re[at + i], out_im[at + i]
                    out_re[at + i] = re * cosine - im * sine
                    out_im[at + i] = re * sine + im * cosine
                inside = np.uint64(min(segment, n - begin))
                if start == 1:
                    for i in range(inside):
                        parent[pixel + i] = out_re[at + i]
                        parent[pixel_im + i] = out_im[at + i]
                else:
                    for i in range(inside):
                        parent[pixel + i] += out_re[at + i]
                        parent[pixel_im + i] += out_im[at + i]


@njit(parallel=True)
def add_to_grid(local, shape, geometry, grid, layout, weights_range, weights_alpha, taps,
                image, x, y, place, along_range, along_alpha, cosine, sine):
    """Interpolate a local image to the pixels of any map or polar grid and add it.

    The value of each pixel is a weighted sum of taps x taps neighbours, for which the carrier
    ``exp(+j 4 pi (r - r_0) / lambda)`` is put back.

    Parameters
    ----------
    local : (2 * n_alpha * n_range + PADDING,) float32
        Image at range baseband.
    shape : (int, int)
        Its n_alpha, n_range.
    geometry : (11,) float64
        Of the local grid: origin x, y, metres, and its height above the plane; track x, y; first
        range and spacing, metres; first direction cosine and spacing; cycles per metre of range.
        Last come the cycles per column that the image leaves out: 0, or for an image at range
        baseband the cycles per pixel.
    grid : (4,) or (11,) float64
        Pixels of the image. Map: x and y of the first pixel, step of x by column and of y by row,
        metres. Polar: origin x, y and its height above the plane, track x, y, its normal x, y,
        first range and spacing, first direction cosine and spacing.
    layout : (5,) int64
        Rows and columns of the image; steps of the index in `image` from row to row, from column
        to column, and from a real part to its imaginary part.
    weights_range, weights_alpha : (8 * taps,) float32
        `neighbour_weights.kernel_weights`, transposed.
    taps : int
        2, 4 or 8.
    image : (N,) float32
        Real and imaginary parts to add to.
    x, y : (groups * PIXELS,) float64
        Work space for each of the groups into which rows are divided among threads.
    place : (groups * PIXELS,) int64
        Work space.
    along_range, along_alpha, cosine, sine : (groups * PIXELS,) float32
        Work space.
    """
    n_alpha, n_range = shape
    rows, columns = layout[0], layout[1]
    column_step, imag_step = np.uint64(layout[3]), np.uint64(layout[4])
    first = 1 - taps // 2
    imag = n_alpha * n_range
    ox, oy, height = geometry[0], geometry[1], geometry[2]
    ux, uy = geometry[3], geometry[4]
    per_range, per_alpha = 1.0 / geometry[6], 1.0 / geometry[8]
    n_groups = len(x) // PIXELS
    for group in numba.prange(n_groups):
        at = np.uint64(group * PIXELS)
        for row in range(group * rows // n_groups, (group + 1) * rows // n_groups):
            for begin in range(0, columns, PIXELS):
                count = np.uint64(min(PIXELS, columns - begin))
                if len(grid) == 4:
                    for i in range(count):
                        x[at + i] = grid[0] + (begin + np.float64(i)) * grid[2] - ox
                        y[at + i] = grid[1] + row * grid[3] - oy
                else:
                    alpha = grid[9] + row * grid[10]
                    for i in range(count):
                        r = grid[7] + (begin + np.float64(i)) * grid[8]
                        ground = np.sqrt(r * r * (1.0 - alpha * alpha) - grid[2] * grid[2])
                        x[at + i] = grid[0] + r * alpha * grid[3] + ground * grid[5] - ox
                        y[at + i] = grid[1] + r * alpha * grid[4] + ground * grid[6] - oy
                for i in range(count):
                    r = np.sqrt(x[at + i] * x[at + i] + y[at + i] * y[at + i] + height * height)
                    v = (r - geometry[5]) * per_range
                    u = ((x[at + i] * ux + y[at + i] * uy) / r - geometry[7]) * per_alpha
                    node = min(max(np.floor(v), -1.0 * first), n_range - taps - 1.0 * first)
                    line = min(max(np.floor(u), -1.0 * first), n_alpha - taps - 1.0 * first)
                    along_range[at + i] = v - node - 0.5
                    along_alpha[at + i] = u - line - 0.5
                    place[at + i] = np.int64((line + first) * n_range + node + first)
                    cycles = np.float32(_fraction(geometry[9] * (r - geometry[5])
                                                  - geometry[10] * (begin + np.float64(i))))
                    sine[at + i] = _sin_cycles(cycles, cycles * cycles)
                    cosine[at + i] = _cos_cycles(cycles * cycles)
                pixel = np.uint64(row * layout[2] + begin * layout[3])
                for i in range(count):
                    if taps == 8:
                        re, im = interpolate8(local, place[at + i], n_range, imag, weights_range,
                                              weights_alpha, along_range[at + i],
                                              along_alpha[at + i])
                    elif taps == 4:
                        re, im = interpolate4(local, place[at + i], n_range, imag, weights_range,
                                              weights_alpha, along_range[at + i],
                                              along_alpha[at + i])
                    else:
                        re, im = interpolate2(local, place[at + i], n_range, imag, weights_range,
                                              weights_alpha, along_range[at + i],
                                              along_alpha[at + i])
                    c, s = cosine[at + i], sine[at + i]
                    to = pixel + i * column_step
                    image[to] += re * c - im * s
                    image[to + imag_step] += re * s + im * c
