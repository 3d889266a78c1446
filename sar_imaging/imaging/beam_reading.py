"""Compiled loop that interpolates the lines of a polar image from the beams of a sub-aperture.

Like `kernels.project_lines` it takes flat arrays and unsigned indices, without views, for the
compiler's sake.
"""

from __future__ import annotations

import numpy as np

from ..compilation import REPEATABLE, njit, numba
from .kernels import _cos_cycles, _fraction, _sin_cycles

TAPS, DEGREE = 14, 5  # of the interpolation between beams and along range
HALF = TAPS // 2  # whose weights fit into registers
STORED = 16  # taps of a table of weights

_u = np.uint64


@njit(parallel=True, fastmath=REPEATABLE)
def read_beams(beams, shape, lines, centre, track, range_m, direction, cycles_per_m, zero_cycles,
               curvature, between, along, first, index, image, work, mixed, mixed_re, mixed_im):
    """Interpolate beams to the lines of a polar image at range baseband.

    Between beams first, then along range; within a segment of a line both positions, and the
    phase that the line has beyond its range baseband, are polynomials of the pixel number, and
    the weights are expanded to second order around the middle. Beams have the curvature of one
    distance; a second derivative by direction, weighted by the difference, gives that of others.

    Parameters
    ----------
    beams : (2 * M * n,) float32
        Beams at range baseband, cells ascending; real and imaginary parts in turn.
    shape : tuple of int
        ``(M, n, n_lines, n_pixels)``: beams, cells, lines of the image and their pixels.
    lines : (S, n_lines, 12) float64
        Position in the middle of each segment of each line, then its first to third derivative
        by the pixel number, metres.
    centre, track : (3,), (2,) float64
        Phase centre that the beams start from, metres, and the direction of the axis.
    range_m : (3,) float64
        Of the first cell, then the spacing of cells and of pixels, metres.
    direction : (2,) float64
        Direction cosine of the first beam, and spacing of beams.
    cycles_per_m, zero_cycles : float
        Carrier phase per metre of half path, and that of no half path, cycles.
    curvature : (2,) float64
        Of the beams, 1/m, and what its differences count between neighbouring beams, m.
    between, along : (DEGREE + 1, STORED) float32
        Weights of the interpolation between beams and along range; zero beyond `TAPS`.
    first : int
        Offset of the first neighbour.
    index : (segment + STORED,) float32
        Pixel numbers of a segment, counted from its middle, and those that follow; segments are
        whole vectors.
    image : (2 * n_lines * n_pixels,) float32
        Real, then imaginary parts; written to.
    work : (T * 6 * STORED,) float32
        Work space of T tasks.
    mixed : (T * 6 * (segment + STORED),) float32
        Work space.
    mixed_re, mixed_im : (T * (segment + STORED),) float32
        Work space.
    """
    n_beams, n_cells, n_lines, n_pixels = shape
    n_mixed, n_tasks = len(index), len(work) // (6 * STORED)
    segment = n_mixed - STORED
    half, n_pieces = segment // 2, lines.shape[0] * n_lines
    apart, order = _u(2 * n_cells), _u(2 * n_mixed)
    spacing = cycles_per_m * range_m[2]
    for task in numba.prange(n_tasks):
        w = _u(6 * STORED * task)
        mix, part = _u(6 * task * n_mixed), _u(task * n_mixed)
        # Neighbouring lines read the same part of the beams, so they come in turn.
        for piece in range(task * n_pieces // n_tasks, (task + 1) * n_pieces // n_tasks):
            number, line = piece // n_lines, piece % n_lines
            x = lines[number, line, 0] - centre[0]
            y = lines[number, line, 1] - centre[1]
            z = lines[number, line, 2] - centre[2]
            ex, ey, ez = lines[number, line, 3], lines[number, line, 4], lines[number, line, 5]
            gx, gy, gz = lines[number, line, 6], lines[number, line, 7], lines[number, line, 8]
            hx, hy, hz = lines[number, line, 9], lines[number, line, 10], lines[number, line, 11]
            d = np.sqrt(x * x + y * y + z * z)
            d1 = (x * ex + y * ey + z * ez) / d
            d2 = (ex * ex + ey * ey + ez * ez + x * gx + y * gy + z * gz - d1 * d1) / d
            d3 = (3.0 * (ex * gx + ey * gy + ez * gz) + x * hx + y * hy + z * hz
                  - 3.0 * d1 * d2) / d
            s = (x * track[0] + y * track[1]) / d
            s1 = (ex * track[0] + ey * track[1] - s * d1) / d
            s2 = (gx * track[0] + gy * track[1] - 2.0 * s1 * d1 - s * d2) / d
            v = (d - range_m[0]) / range_m[1]
            cell = np.floor(v)
            v1 = np.float32(d1 / range_m[1] - 1.0)
            v2, v3 = np.float32(0.5 * d2 / range_m[1]), np.float32(d3 / range_m[1] / 6.0)
            u = (s - direction[0]) / direction[1]
            beam = np.floor(u)
            u1, u2 = np.float32(s1 / direction[1]), np.float32(0.5 * s2 / direction[1])
            c0 = np.float32(_fraction(cycles_per_m * d - spacing * (number * segment + half)
                                      + zero_cycles))
            c1 = np.float32(cycles_per_m * d1 - spacing)
            c2, c3 = np.float32(0.5 * cycles_per_m * d2), np.float32(cycles_per_m * d3 / 6.0)
            bend = np.float32((1.0 - s * s) * (1.0 / d - curvature[0]) * curvature[1])
            bend1 = np.float32((s * s - 1.0) * d1 / (d * d) * curvature[1])
            _expand_weights(between, np.float32(u - beam), work, w)
            _expand_weights(along, np.float32(v - cell), work, w + _u(3 * STORED))
            start = np.int64(min(max(cell - half + first, 0.0), n_cells - n_mixed - 0.0))
            row = np.int64(min(max(beam + first, 0.0), n_beams - TAPS - 0.0))
            source = _u(2 * (row * n_cells + start))
            for i in range(_u(6 * n_mixed)):
                mixed[mix + i] = 0.0
            for side in range(2):
                tap = _u(side * HALF)
                _mix_beams(beams, source + tap * apart, apart, work, w + tap, mixed, mix, order)
            shift = np.float32(first) - np.float32(v - cell)
            for i in range(_u(n_mixed)):
                f, j = index[i] + shift, mix + _u(2) * i
                t, b = f * (u1 + f * u2), bend + f * bend1
                re, im = mixed[j + _u(2) * order], mixed[j + _u(2) * order + _u(1)]
                mixed_re[part + i] = mixed[j] + t * (mixed[j + order] + t * re) - b * im
                mixed_im[part + i] = (mixed[j + _u(1)]
                                      + t * (mixed[j + order + _u(1)] + t * im) + b * re)
            some = _u(min(segment, n_pixels - number * segment))
            for i in range(_u(2 * segment)):
                mixed[mix + i] = 0.0
            for side in range(2):
                tap = _u(side * HALF)
                _mix_cells(mixed_re, mixed_im, part + tap, work, w + _u(3 * STORED) + tap, index,
                           v1, v2, v3, mixed, mix, _u(segment))
            real = _u(line * n_pixels + number * segment)
            imag = real + _u(n_lines * n_pixels)
            for i in range(some):
                f = index[i]
                c = _fraction(c0 + f * (c1 + f * (c2 + f * c3)))
                sine, cosine = _sin_cycles(c, c * c), _cos_cycles(c * c)
                re, im = mixed[mix + i], mixed[mix + _u(segment) + i]
                image[real + i] = re * cosine - im * sine
                image[imag + i] = re * sine + im * cosine


@njit(inline='always')
def _expand_weights(weights, t, work, to):
    """Weights of the taps at t, and their first two orders around it."""
    for k in range(STORED):
        w2, w3, w4, w5 = weights[2, k], weights[3, k], weights[4, k], weights[5, k]
        i = to + _u(k)
        work[i] = weights[0, k] + t * (weights[1, k] + t * (w2 + t * (w3 + t * (w4 + t * w5))))
        work[i + _u(STORED)] = weights[1, k] + t * (
            np.float32(2) * w2 + t * (np.float32(3) * w3 + t * (np.float32(4) * w4
                                                               + t * (np.float32(5) * w5))))
        work[i + _u(2 * STORED)] = w2 + t * (
            np.float32(3) * w3 + t * (np.float32(6) * w4 + t * (np.float32(10) * w5)))


@njit(inline='always')
def _mix_beams(beams, source, apart, work, w, out, to, n):
    """Add half of the beams with the weights of each order, which then stay in registers."""
    a0, a1, a2, a3, a4, a5, a6 = _weights(work, w)
    b0, b1, b2, b3, b4, b5, b6 = _weights(work, w + _u(STORED))
    c0, c1, c2, c3, c4, c5, c6 = _weights(work, w + _u(2 * STORED))
    s1 = source + apart
    s2 = s1 + apart
    s3 = s2 + apart
    s4 = s3 + apart
    s5 = s4 + apart
    s6 = s5 + apart
    for i in range(n):
        x0, x1, x2, x3 = beams[source + i], beams[s1 + i], beams[s2 + i], beams[s3 + i]
        x4, x5, x6 = beams[s4 + i], beams[s5 + i], beams[s6 + i]
        out[to + i] += (a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3 + a4 * x4 + a5 * x5 + a6 * x6)
        out[to + n + i] += (b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3 + b4 * x4 + b5 * x5 + b6 * x6)
        out[to + n + n + i] += (c0 * x0 + c1 * x1 + c2 * x2 + c3 * x3 + c4 * x4 + c5 * x5
                                + c6 * x6)


@njit(inline='always')
def _mix_cells(real, imag, source, work, w, index, v1, v2, v3, out, to, n):
    """Add half of the cells around each pixel."""
    a0, a1, a2, a3, a4, a5, a6 = _weights(work, w)
    b0, b1, b2, b3, b4, b5, b6 = _weights(work, w + _u(STORED))
    c0, c1, c2, c3, c4, c5, c6 = _weights(work, w + _u(2 * STORED))
    s1, s2, s3 = source + _u(1), source + _u(2), source + _u(3)
    s4, s5, s6 = source + _u(4), source + _u(5), source + _u(6)
    for i in range(n):
        f = index[i]
        t = f * (v1 + f * (v2 + f * v3))
        w0, w1, w2 = a0 + t * (b0 + t * c0), a1 + t * (b1 + t * c1), a2 + t * (b2 + t * c2)
        w3, w4, w5 = a3 + t * (b3 + t * c3), a4 + t * (b4 + t * c4), a5 + t * (b5 + t * c5)
        w6 = a6 + t * (b6 + t * c6)
        out[to + i] += (w0 * real[source + i] + w1 * real[s1 + i] + w2 * real[s2 + i]
                        + w3 * real[s3 + i] + w4 * real[s4 + i] + w5 * real[s5 + i]
                        + w6 * real[s6 + i])
        out[to + n + i] += (w0 * imag[source + i] + w1 * imag[s1 + i] + w2 * imag[s2 + i]
                            + w3 * imag[s3 + i] + w4 * imag[s4 + i] + w5 * imag[s5 + i]
                            + w6 * imag[s6 + i])


@njit(inline='always')
def _weights(work, w):
    return (work[w], work[w + _u(1)], work[w + _u(2)], work[w + _u(3)], work[w + _u(4)],
            work[w + _u(5)], work[w + _u(6)])
