"""Compiled inner loops of backprojection.

Both kernels sum, for every pixel, ``s_mn(D) exp(+j k_c D)`` over the rows of a block (a row is
one channel of one pulse; D is half the two-way path). Geometry is float64, samples and
accumulators float32. The range profile arrives as cubic polynomials per lattice interval
(`interpolation`); a position on the lattice is ``v = (D - R0) / step = n + t`` with an integer n,
and the carrier phase there is ``cycles_per_step * v`` plus a constant, of which only the fraction
of a cycle is kept, in float64, before it becomes float32.
"""

from __future__ import annotations

import numpy as np

from ..compilation import njit, numba

LINES = 64  # image lines whose geometry is computed together
SINCOS_ERROR_DB = -108.0

# exp(j 2 pi c) for |c| <= 1/2 as minimax polynomials in c^2; rms error 4e-6 (sine), 6e-7 (cosine)
_S1, _S3, _S5, _S7, _S9 = (np.float32(v) for v in (
    6.2830558, -41.33121428, 81.36681482, -74.47800122, 32.78139356))
_C0, _C2, _C4, _C6, _C8, _C10 = (np.float32(v) for v in (
    0.99999922, -19.73898258, 64.92872795, -85.27240902, 58.79408621, -21.07685034))


@njit(inline='always')
def _fraction(x):
    return x - np.rint(x)


@njit(inline='always')
def _sin_cycles(c, x):
    return c * (_S1 + x * (_S3 + x * (_S5 + x * (_S7 + x * _S9))))


@njit(inline='always')
def _cos_cycles(x):
    return _C0 + x * (_C2 + x * (_C4 + x * (_C6 + x * (_C8 + x * _C10))))


@njit(inline='always')
def _path(x, y, z, ex, ey, ez):
    """Length of ``(x, y, z) + i e`` at i = 0 and its first three derivatives by i."""
    d = np.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / d
    d1 = (x * ex + y * ey + z * ez) * inverse
    d2 = (ex * ex + ey * ey + ez * ez - d1 * d1) * inverse
    return d, d1, d2, -3.0 * d1 * d2 * inverse


@njit(parallel=True)
def project_lines(planes, shape, tx, rx, start, along, across, range_zero, step,
                  cycles_per_step, cycles_zero, ramp, image, layout, index, work_re, work_im,
                  coefficients, base):
    """Add rows to an image whose lines follow the range direction.

    Neighbouring pixels of a line lie one lattice cell apart (up to a small drift), so that a
    segment of a line reads contiguous coefficients.

    Parameters
    ----------
    planes : (R * U * 8 * n,) float32
        `interpolation.polynomial_planes`; the first and last `segment` cells are zero.
    shape : tuple of int
        ``(R, U, n)``: rows, lattice positions per cell, cells.
    tx, rx : (R, 3) float64
        Phase centres of the rows, metres.
    start, along, across : (3,) float64
        First pixel, step to the next pixel of a line (range increases), step to the next line.
    range_zero, step : float
        Half path at the first lattice position that is not padding, and between lattice
        positions, metres.
    cycles_per_step, cycles_zero : float
        Carrier phase per lattice step and at `range_zero`, cycles.
    ramp : (n_pixels,) complex64
        ``exp(j 2 pi cycles_per_step U i)``: the part of the phase that all lines share.
    image : (n_lines * n_pixels,) complex64
        Image to add to.
    layout : (4,) int64
        Number of lines, index of the first pixel in `image`, and the steps of the index to the
        next line and to the next pixel of a line.
    index : (segment,) float32
        Pixel numbers of a segment, counted from its middle; their number is even.
    work_re, work_im : (G * LINES * segment,) float32
        Work space for the ``G = ceil(n_lines / LINES)`` groups of lines, as the next two.
    coefficients : (G, 5, LINES) float32
        Work space.
    base : (G, LINES) int64
        Work space.

    Notes
    -----
    Numba tells the compiler that the arrays of a parallel loop do not overlap only while the loop
    takes no view of one; without that, tests for overlap before each short loop double the time.
    """
    n_rows, n_phases, n_cells = shape
    segment = len(index)
    n_lines, n_pixels = layout[0], len(ramp)
    half = segment // 2
    # Unsigned indices spare the compiler the test for negative ones, which stops vectorisation.
    p, length = np.uint64(n_cells), np.uint64(segment)
    inverse_step, inverse_phases = 1.0 / step, 1.0 / n_phases
    for group in numba.prange(base.shape[0]):
        first_line = group * LINES
        count = min(LINES, n_lines - first_line)
        for first_pixel in range(0, n_pixels, segment):
            for i in range(group * LINES * segment, (group + 1) * LINES * segment):
                work_re[i], work_im[i] = 0.0, 0.0
            middle = first_pixel + half
            for row in range(n_rows):
                for j in range(LINES):
                    line = first_line + j
                    x = start[0] + middle * along[0] + line * across[0]
                    y = start[1] + middle * along[1] + line * across[1]
                    z = start[2] + middle * along[2] + line * across[2]
                    a, a1, a2, a3 = _path(x - tx[row, 0], y - tx[row, 1], z - tx[row, 2],
                                          along[0], along[1], along[2])
                    b, b1, b2, b3 = _path(x - rx[row, 0], y - rx[row, 1], z - rx[row, 2],
                                          along[0], along[1], along[2])
                    v = (0.5 * (a + b) - range_zero) * inverse_step
                    n = np.floor(v)
                    cell = np.floor((n + 0.5) * inverse_phases)
                    phase = n - cell * n_phases
                    coefficients[group, 0, j] = v - n
                    coefficients[group, 1, j] = 0.5 * (a1 + b1) * inverse_step - n_phases
                    coefficients[group, 2, j] = 0.25 * (a2 + b2) * inverse_step
                    coefficients[group, 3, j] = (a3 + b3) * inverse_step * (1.0 / 12.0)
                    coefficients[group, 4, j] = _fraction(
                        cycles_per_step * (n - middle * float(n_phases)) + cycles_zero)
                    # A segment outside the profile reads padding only.
                    cell = min(max(cell, -1.0 * half), n_cells - 2.0 * segment + half)
                    base[group, j] = np.int64(phase * 8.0 * n_cells + cell + half)
                offset = row * n_phases * 8 * n_cells
                for j in range(count):
                    t0, t1 = coefficients[group, 0, j], coefficients[group, 1, j]
                    t2, t3 = coefficients[group, 2, j], coefficients[group, 3, j]
                    c0, c1 = coefficients[group, 4, j], np.float32(cycles_per_step)
                    r0 = np.uint64(base[group, j] + offset)
                    r1 = r0 + p
                    r2 = r1 + p
                    r3 = r2 + p
                    i0 = r3 + p
                    i1 = i0 + p
                    i2 = i1 + p
                    i3 = i2 + p
                    w = np.uint64((group * LINES + j) * segment)
                    for i in range(length):
                        f = index[i]
                        t = t0 + f * (t1 + f * (t2 + f * t3))
                        c = _fraction(c1 * t + c0)
                        x = c * c
                        sine, cosine = _sin_cycles(c, x), _cos_cycles(x)
                        re = planes[r0 + i] + t * (planes[r1 + i]
                                                 + t * (planes[r2 + i] + t * planes[r3 + i]))
                        im = planes[i0 + i] + t * (planes[i1 + i]
                                                 + t * (planes[i2 + i] + t * planes[i3 + i]))
                        work_re[w + i] += re * cosine - im * sine
                        work_im[w + i] += re * sine + im * cosine
            for j in range(count):
                w = (group * LINES + j) * segment
                pixel = layout[1] + (first_line + j) * layout[2] + first_pixel * layout[3]
                for i in range(min(segment, n_pixels - first_pixel)):
                    image[pixel + i * layout[3]] += ramp[first_pixel + i] * (
                        work_re[w + i] + np.complex64(1j) * work_im[w + i])


@njit(parallel=True)
def project_points(polynomials, tx, rx, points, range_zero, step, cycles_per_step, cycles_zero,
                   image):
    """Add rows to arbitrary points.

    Parameters
    ----------
    polynomials : (R, n, 8) float32
        Coefficients of each lattice interval side by side; the first and last are zero.
    tx, rx : (R, 3) float64
        Phase centres of the rows, metres.
    points : (n_points, 3) float64
        Positions, metres.
    range_zero, step, cycles_per_step, cycles_zero : float
        As for `project_lines`; position 0 is the first interval.
    image : (n_points,) complex64
        Values to add to.
    """
    n_rows, n, _ = polynomials.shape
    n_points = len(points)
    block = 64
    inverse_step = 1.0 / step
    for group in numba.prange((n_points + block - 1) // block):
        first = group * block
        count = min(block, n_points - first)
        interval = np.empty(block, np.int64)
        fraction = np.empty(block, np.float32)
        sine, cosine = np.empty(block, np.float32), np.empty(block, np.float32)
        total_re, total_im = np.zeros(block, np.float32), np.zeros(block, np.float32)
        for row in range(n_rows):
            for k in range(count):
                x, y, z = points[first + k, 0], points[first + k, 1], points[first + k, 2]
                a, b, c = x - tx[row, 0], y - tx[row, 1], z - tx[row, 2]
                d, e, f = x - rx[row, 0], y - rx[row, 1], z - rx[row, 2]
                v = (0.5 * (np.sqrt(a * a + b * b + c * c) + np.sqrt(d * d + e * e + f * f))
                     - range_zero) * inverse_step
                cell = np.floor(v)
                interval[k] = np.int64(min(max(cell, 0.0), n - 1.0))
                fraction[k] = v - cell
                cycles = np.float32(_fraction(cycles_per_step * v + cycles_zero))
                sine[k] = _sin_cycles(cycles, cycles * cycles)
                cosine[k] = _cos_cycles(cycles * cycles)
            for k in range(count):
                q, t = polynomials[row, interval[k]], fraction[k]
                re = q[0] + t * (q[1] + t * (q[2] + t * q[3]))
                im = q[4] + t * (q[5] + t * (q[6] + t * q[7]))
                total_re[k] += re * cosine[k] - im * sine[k]
                total_im[k] += re * sine[k] + im * cosine[k]
        for k in range(count):
            image[first + k] += total_re[k] + np.complex64(1j) * total_im[k]
