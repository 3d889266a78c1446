"""Compiled loops of fast factorised backprojection, and its interpolation kernels.

All of them work on images at range baseband: value times ``exp(-j 4 pi (r - r_0) / lambda)`` with
the first range r_0 of the image's own grid, real and imaginary parts apart in one flat array.
Positions are float64; the carrier phase is reduced to a fraction of a cycle in float64 before it
becomes float32.
"""

from __future__ import annotations

import math

import numpy as np

from ..compilation import njit, numba
from .kernels import LINES, _cos_cycles, _fraction, _sin_cycles

#: Neighbours that each kernel reads along range and along direction.
TAPS = {'linear': 2, 'cubic': 4, 'knab8': 8}
MARGIN = 0.25  # how far beyond its interval a kernel is evaluated, pixels
LANES = 16  # float32 values of the widest vector registers
PADDING = 256  # values after an image that a segment may read
_DEGREE = 7
_PIXELS = 64  # of the requested grid, whose geometry is computed together


def kernel_weights(kernel: str, oversampling: float) -> np.ndarray:
    """Weights of an interpolation kernel as polynomials.

    Sample ``first + k``, first = 1 - taps / 2, has the weight ``sum_q w[k, q] x^q`` at the
    position ``x + 1/2`` between samples 0 and 1.

    Parameters
    ----------
    kernel : str
        A key of `TAPS`: 'linear', 'cubic' (Lagrange), or 'knab8', a sinc in Knab's window (IEEE
        Trans. Inf. Theory 25, 1979), whose polynomials are a fit to within 1e-5.
    oversampling : float
        Sample rate over two-sided bandwidth; sets the width of Knab's window.

    Returns
    -------
    (taps, 8) float32
    """
    taps = TAPS[kernel]
    first = 1 - taps // 2
    x = np.cos(np.pi * (np.arange(64) + 0.5) / 64) * (0.5 + MARGIN)
    distance = x[:, None] + 0.5 - (np.arange(taps) + first)
    if kernel == 'knab8':
        values = _knab(distance, taps / 2, oversampling)
    else:  # Lagrange's polynomials
        nodes = np.arange(taps) + first - 0.5
        values = np.stack([np.prod([(x - m) / (n - m) for m in nodes if m != n], axis=0)
                           for n in nodes], axis=-1)
    powers = x[:, None] ** np.arange(_DEGREE + 1)
    weights = np.linalg.lstsq(powers, values, rcond=None)[0].T
    return np.ascontiguousarray(weights, np.float32)


def _knab(x, half, oversampling):
    """Sinc in the window of Knab, which continues smoothly beyond its ends."""
    v = math.pi * half * (1 - 1 / oversampling)
    root = np.sqrt((1 - (x / half) ** 2).astype(complex))
    return np.sinc(x) * (np.cosh(v * root) / np.cosh(v)).real


def paired(weights: np.ndarray) -> np.ndarray:
    """Weights (taps, 8) as `merge` reads them: even, then odd powers of one tap of each pair.

    The kernels are symmetric, so that tap k at x weighs what tap ``taps - 1 - k`` does at -x.
    """
    half = weights[:len(weights) // 2]
    return np.ascontiguousarray(np.concatenate([half[:, ::2], half[:, 1::2]], axis=1).reshape(-1))


@njit(parallel=True)
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
    for group in numba.prange(lines.shape[0]):
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


@njit(parallel=True)
def merge(child, child_shape, parent, parent_shape, geometry, weights_range, weights_alpha, pairs,
          segment, index, start, work):
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
    work : (groups * 6 * (segment + LANES),) float32
        Work space; the number of groups into which lines are divided among threads.
    """
    du, dv, height_p, height_c = geometry[0], geometry[1], geometry[2], geometry[3]
    step, range_p, range_c = geometry[4], geometry[5], geometry[6]
    cycles_per_pixel = geometry[11]
    turns = np.float32(cycles_per_pixel)
    n_lines, n = parent_shape
    child_lines, child_n = child_shape
    child_size, parent_size = child_lines * child_n, n_lines * n
    width = segment + LANES
    n_groups = len(work) // (6 * width)
    half, first = segment // 2, 1 - pairs
    last = np.uint64(2 * pairs - 1)
    centre = np.float32(0.5)
    for group in numba.prange(n_groups):
        at_re = np.uint64(group * 6 * width)
        at_im, at_u = at_re + np.uint64(width), at_re + np.uint64(2 * width)
        at_t = at_re + np.uint64(3 * width)
        to_re, to_im = at_re + np.uint64(4 * width), at_re + np.uint64(5 * width)
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
                    work[at_u + i] = u0 + f * (u1 + f * u2)
                    work[at_re + i] = 0.0
                    work[at_im + i] = 0.0
                for k in range(pairs):
                    w = 8 * k
                    e0, e1, e2, e3 = (weights_alpha[w], weights_alpha[w + 1],
                                      weights_alpha[w + 2], weights_alpha[w + 3])
                    o0, o1, o2, o3 = (weights_alpha[w + 4], weights_alpha[w + 5],
                                      weights_alpha[w + 6], weights_alpha[w + 7])
                    near = source + np.uint64(k) * row_step
                    far = source + (last - np.uint64(k)) * row_step
                    near_im, far_im = near + np.uint64(child_size), far + np.uint64(child_size)
                    for i in range(reach):
                        x = work[at_u + i]
                        xx = x * x
                        even = e0 + xx * (e1 + xx * (e2 + xx * e3))
                        odd = x * (o0 + xx * (o1 + xx * (o2 + xx * o3)))
                        wn, wf = even + odd, even - odd
                        work[at_re + i] += wn * child[near + i] + wf * child[far + i]
                        work[at_im + i] += wn * child[near_im + i] + wf * child[far_im + i]
                for i in range(count):
                    f = index[i] - np.float32(half)
                    work[at_t + i] = t0 + f * (t1 + f * (t2 + f * t3)) - centre
                    work[to_re + i] = 0.0
                    work[to_im + i] = 0.0
                for k in range(pairs):
                    w = 8 * k
                    e0, e1, e2, e3 = (weights_range[w], weights_range[w + 1],
                                      weights_range[w + 2], weights_range[w + 3])
                    o0, o1, o2, o3 = (weights_range[w + 4], weights_range[w + 5],
                                      weights_range[w + 6], weights_range[w + 7])
                    near, far = at_re + np.uint64(k), at_re + last - np.uint64(k)
                    near_im, far_im = near + np.uint64(width), far + np.uint64(width)
                    for i in range(count):
                        x = work[at_t + i]
                        xx = x * x
                        even = e0 + xx * (e1 + xx * (e2 + xx * e3))
                        odd = x * (o0 + xx * (o1 + xx * (o2 + xx * o3)))
                        wn, wf = even + odd, even - odd
                        work[to_re + i] += wn * work[near + i] + wf * work[far + i]
                        work[to_im + i] += wn * work[near_im + i] + wf * work[far_im + i]
                pixel = np.uint64(line * n + begin)
                pixel_im = pixel + np.uint64(parent_size)
                for i in range(count):
                    cycles = _fraction(turns * (work[at_t + i] + centre) + phase)
                    square = cycles * cycles
                    sine, cosine = _sin_cycles(cycles, square), _cos_cycles(square)
                    re, im = work[to_re + i], work[to_im + i]
                    work[to_re + i] = re * cosine - im * sine
                    work[to_im + i] = re * sine + im * cosine
                inside = np.uint64(min(segment, n - begin))
                if start == 1:
                    for i in range(inside):
                        parent[pixel + i] = work[to_re + i]
                        parent[pixel_im + i] = work[to_im + i]
                else:
                    for i in range(inside):
                        parent[pixel + i] += work[to_re + i]
                        parent[pixel_im + i] += work[to_im + i]


@njit(parallel=True)
def add_to_grid(local, shape, geometry, grid, image_shape, weights_range, weights_alpha, image):
    """Interpolate a local image to the pixels of a map or of another polar grid and add it.

    The value of each pixel is a weighted sum of taps x taps neighbours, for which the carrier
    ``exp(+j 4 pi (r - r_0) / lambda)`` is put back.

    Parameters
    ----------
    local : (2 * n_alpha * n_range + PADDING,) float32
        Image at range baseband.
    shape : (int, int)
        Its n_alpha, n_range.
    geometry : (10,) float64
        Of the local grid: origin x, y, metres, and its height above the plane; track x, y; first
        range and spacing, metres; first direction cosine and spacing; cycles per metre of range.
    grid : (4,) or (11,) float64
        Pixels of the image. Map: x and y of the first pixel, step of x by column and of y by row,
        metres. Polar: origin x, y and its height above the plane, track x, y, its normal x, y,
        first range and spacing, first direction cosine and spacing.
    image_shape : (int, int)
        Rows and columns of the image.
    weights_range, weights_alpha : (8, taps) float32
        Transposed `kernel_weights`; 2, 4 or 8 taps.
    image : (2 * rows * columns,) float32
        Complex values to add to.
    """
    n_alpha, n_range = shape
    rows, columns = image_shape
    taps = weights_range.shape[1]
    first = 1 - taps // 2
    imag = n_alpha * n_range
    ox, oy, height = geometry[0], geometry[1], geometry[2]
    ux, uy = geometry[3], geometry[4]
    per_range, per_alpha = 1.0 / geometry[6], 1.0 / geometry[8]
    for row in numba.prange(rows):
        x, y = np.empty(_PIXELS), np.empty(_PIXELS)
        place = np.empty(_PIXELS, np.int64)
        along_range, along_alpha = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.float32)
        cosine, sine = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.float32)
        w_range, w_alpha = np.empty(8, np.float32), np.empty(8, np.float32)
        for begin in range(0, columns, _PIXELS):
            count = min(_PIXELS, columns - begin)
            if len(grid) == 4:
                for i in range(count):
                    x[i] = grid[0] + (begin + i) * grid[2] - ox
                    y[i] = grid[1] + row * grid[3] - oy
            else:
                alpha = grid[9] + row * grid[10]
                for i in range(count):
                    r = grid[7] + (begin + i) * grid[8]
                    ground = np.sqrt(r * r * (1.0 - alpha * alpha) - grid[2] * grid[2])
                    x[i] = grid[0] + r * alpha * grid[3] + ground * grid[5] - ox
                    y[i] = grid[1] + r * alpha * grid[4] + ground * grid[6] - oy
            for i in range(count):
                r = np.sqrt(x[i] * x[i] + y[i] * y[i] + height * height)
                v = (r - geometry[5]) * per_range
                u = ((x[i] * ux + y[i] * uy) / r - geometry[7]) * per_alpha
                node = min(max(np.floor(v), -1.0 * first), n_range - taps - 1.0 * first)
                line = min(max(np.floor(u), -1.0 * first), n_alpha - taps - 1.0 * first)
                along_range[i] = v - node - 0.5
                along_alpha[i] = u - line - 0.5
                place[i] = (np.int64(line) + first) * n_range + np.int64(node) + first
                cycles = np.float32(_fraction(geometry[9] * (r - geometry[5])))
                sine[i] = _sin_cycles(cycles, cycles * cycles)
                cosine[i] = _cos_cycles(cycles * cycles)
            for i in range(count):
                if taps == 8:
                    _weigh(weights_range, along_range[i], w_range, 8)
                    _weigh(weights_alpha, along_alpha[i], w_alpha, 8)
                    re = _sum8(local, place[i], n_range, w_range, w_alpha)
                    im = _sum8(local, place[i] + imag, n_range, w_range, w_alpha)
                else:
                    _weigh(weights_range, along_range[i], w_range, taps)
                    _weigh(weights_alpha, along_alpha[i], w_alpha, taps)
                    re = _sum(local, place[i], n_range, w_range, w_alpha, taps)
                    im = _sum(local, place[i] + imag, n_range, w_range, w_alpha, taps)
                pixel = 2 * (row * columns + begin + i)
                image[pixel] += re * cosine[i] - im * sine[i]
                image[pixel + 1] += re * sine[i] + im * cosine[i]


@njit(inline='always')
def _weigh(table, x, weights, taps):
    for k in range(taps):
        weights[k] = (table[0, k] + x * (table[1, k] + x * (table[2, k] + x * (
            table[3, k] + x * (table[4, k] + x * (table[5, k] + x * (
                table[6, k] + x * table[7, k])))))))


@njit(inline='always')
def _sum8(values, place, step, w_range, w_alpha):
    """Weighted sum of 8 x 8 neighbours, the eight of a line side by side in one register."""
    p0 = np.uint64(place)
    n = np.uint64(step)
    p1 = p0 + n
    p2 = p1 + n
    p3 = p2 + n
    p4 = p3 + n
    p5 = p4 + n
    p6 = p5 + n
    p7 = p6 + n
    total = np.float32(0.0)
    for k in range(np.uint64(8)):
        total += w_range[k] * (
            w_alpha[0] * values[p0 + k] + w_alpha[1] * values[p1 + k]
            + w_alpha[2] * values[p2 + k] + w_alpha[3] * values[p3 + k]
            + w_alpha[4] * values[p4 + k] + w_alpha[5] * values[p5 + k]
            + w_alpha[6] * values[p6 + k] + w_alpha[7] * values[p7 + k])
    return total


@njit(inline='always')
def _sum(values, place, step, w_range, w_alpha, taps):
    total = np.float32(0.0)
    for m in range(taps):
        part = np.float32(0.0)
        for k in range(taps):
            part += w_range[k] * values[place + m * step + k]
        total += w_alpha[m] * part
    return total
