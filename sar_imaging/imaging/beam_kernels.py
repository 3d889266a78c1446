"""Compiled loops of sub-aperture images by beams: pulses to beams, beams to image lines.

Like `kernels.project_lines` they take flat arrays and unsigned indices, without views, for the
compiler's sake.
"""

from __future__ import annotations

import numpy as np

from ..compilation import njit, numba
from .kernels import _cos_cycles, _fraction, _sin_cycles

LANES = 16  # bins or pixels of one vector
ROWS = 4  # phasors multiplied at once
BINS = 128  # whose samples stay in the cache
TAPS, DEGREE = 14, 5  # of the interpolation between beams and along range
HALF = TAPS // 2  # whose weights fit into registers
STORED = 16  # taps of a table of weights

_u = np.uint64


@njit(parallel=True)
def form_beams(samples, shape, runs, common, gain, order, shift, carrier, beside, turn_step,
               phasor_step, cycles_per_bin, group, out, base_re, base_im, turn_re, turn_im, row_re,
               row_im, phasor_re, phasor_im, sum_re, sum_im):
    """Sum the rows' spectra for each beam, ``out_m[b] = sum_i S_i[b] exp(j k_b path_im)``.

    The phase is exact for the middle of each group of beams. For the others the part of it that
    grows from bin to bin is held over a vector of bins, and rows on opposite sides of the centre
    may share a phasor, one of them its conjugate.

    Parameters
    ----------
    samples : (2 * R * N,) float32
        Spectra of R rows; real and imaginary parts in turn.
    shape : tuple of int
        ``(N, M, n)``: bins, beams, bins of a beam's spectrum.
    runs : (T, 4) int64
        Bins of each task: the first one in `samples` and in `out`, its number counted from the
        carrier's, how many.
    common : (2 * N,) float32
        Factor of each bin of `samples`, real and imaginary parts in turn.
    gain : (R,) float32
        Factor of each row.
    order : (2 * Q,) or (Q,) int64
        Row of each of Q phasors, then of its conjugate if rows share them; -1 for none.
    shift : (G * len(order),) float64
        What a row's path is longer for the middle of a group of beams than the reference's,
        metres, in that order.
    carrier : (G * len(order),) float64
        Phase of that at the carrier, cycles.
    beside : (G * Q * group,) float64
        What a row's path is longer for a beam than for the group's middle, metres: groups, blocks
        of `ROWS` phasors, beams, phasors of the block.
    turn_step : (2 * G * len(order),) float32
        Phasors of `shift` over a vector of bins, real parts first.
    phasor_step : (2 * G * Q * group,) float32
        The same of `beside`.
    cycles_per_bin : (2,) float64
        Cycles per metre of half path at the carrier, and what they grow from bin to bin.
    group : int
        Beams of a group.
    out : (2 * M * n,) float32
        Written to.
    base_re, base_im : (T * BINS * len(order),) float32
        Work space.
    turn_re, turn_im : (T * G * len(order) * LANES,) float32
        Work space.
    row_re, row_im : (T * 2 * Q * LANES,) float32
        Work space.
    phasor_re, phasor_im : (T * G * Q * group,) float32
        Work space.
    sum_re, sum_im : (T * group * LANES,) float32
        Work space.
    """
    n_bins, n_beams, n_out = shape
    n_rows, n_groups = len(order), (n_beams + group - 1) // group
    n_turns, n_phasors = n_groups * n_rows * LANES, len(beside)
    q = n_phasors // (n_groups * group)
    half = 0.5 * (LANES - 1)
    for task in numba.prange(len(runs)):
        first, target, number, left = runs[task, 0], runs[task, 1], runs[task, 2], runs[task, 3]
        base, rows, sums = task * BINS * n_rows, task * 2 * q * LANES, task * group * LANES
        turn, phasor = task * n_turns, task * n_phasors
        for k in range(n_groups * n_rows):
            cycles = cycles_per_bin[1] * shift[k]
            start = _fraction(carrier[k] + number * cycles)
            to = _u(turn + k * LANES)
            for i in range(LANES):
                c = np.float32(_fraction(start + i * cycles))
                turn_re[to + _u(i)] = _cos_cycles(c * c)
                turn_im[to + _u(i)] = _sin_cycles(c, c * c)
        per_metre = cycles_per_bin[0] + (number + half) * cycles_per_bin[1]
        for k in range(_u(n_phasors)):
            c = np.float32(_fraction(per_metre * beside[k]))
            phasor_re[_u(phasor) + k] = _cos_cycles(c * c)
            phasor_im[_u(phasor) + k] = _sin_cycles(c, c * c)
        while left > 0:
            count = min(left, BINS)
            n_vectors = (count + LANES - 1) // LANES
            _load_rows(samples, n_bins, first, count, common, gain, order, base_re, base_im, base)
            for g in range(n_groups):
                n_some = min(group, n_beams - g * group)
                for v in range(n_vectors):
                    _turn(base_re, base_im, base + v * n_rows * LANES, turn_re, turn_im,
                          turn + g * n_rows * LANES, turn_step, g * n_rows, n_groups * n_rows, q,
                          n_rows, row_re, row_im, rows)
                    for i in range(_u(n_some * LANES)):
                        sum_re[_u(sums) + i] = 0.0
                        sum_im[_u(sums) + i] = 0.0
                    steps = phasor + g * q * group
                    _add_rows(row_re, row_im, rows, phasor_re, phasor_im, steps, q, group, n_some,
                              sum_re, sum_im, sums)
                    some = _u(min(LANES, count - v * LANES))
                    for m in range(n_some):
                        source = _u(sums + m * LANES)
                        to = _u(2 * ((g * group + m) * n_out + target + v * LANES))
                        for i in range(some):
                            out[to + _u(2) * i] = sum_re[source + i]
                            out[to + _u(2) * i + _u(1)] = sum_im[source + i]
                    now, step = _u(steps), _u(g * q * group)
                    for i in range(_u(q * group)):
                        cosine, sine = phasor_re[now + i], phasor_im[now + i]
                        re, im = phasor_step[step + i], phasor_step[_u(n_phasors) + step + i]
                        phasor_re[now + i] = cosine * re - sine * im
                        phasor_im[now + i] = cosine * im + sine * re
            first, target, left = first + count, target + count, left - count
            number += count


@njit(inline='always')
def _load_rows(samples, n_bins, first, count, common, gain, order, base_re, base_im, base):
    """Some bins of all rows times their factors, vector by vector, zero beyond the last."""
    n_rows, whole = len(order), count // LANES
    for place in range(n_rows):
        row = order[place]
        if row < 0:
            for v in range((count + LANES - 1) // LANES):
                to = _u(base + (v * n_rows + place) * LANES)
                for lane in range(LANES):
                    base_re[to + _u(lane)] = 0.0
                    base_im[to + _u(lane)] = 0.0
            continue
        weight = gain[row]
        source, factor = _u(2 * (row * n_bins + first)), _u(2 * first)
        for v in range(whole):
            to = _u(base + (v * n_rows + place) * LANES)
            for lane in range(LANES):
                i = _u(lane)
                re, im = samples[source + _u(2) * i], samples[source + _u(2) * i + _u(1)]
                cosine = weight * common[factor + _u(2) * i]
                sine = weight * common[factor + _u(2) * i + _u(1)]
                base_re[to + i] = re * cosine - im * sine
                base_im[to + i] = re * sine + im * cosine
            source += _u(2 * LANES)
            factor += _u(2 * LANES)
        for lane in range((count > whole * LANES) * LANES):
            to = _u(base + (whole * n_rows + place) * LANES + lane)
            base_re[to] = 0.0
            base_im[to] = 0.0
            if lane < count - whole * LANES:
                i = _u(2 * lane)
                re, im = samples[source + i], samples[source + i + _u(1)]
                cosine, sine = weight * common[factor + i], weight * common[factor + i + _u(1)]
                base_re[to] = re * cosine - im * sine
                base_im[to] = re * sine + im * cosine


@njit(inline='always')
def _turn(base_re, base_im, base, turn_re, turn_im, turn, step, first, n_steps, n_phasors, n_rows,
          row_re, row_im, rows):
    """Rows seen from the group's middle: what a phasor's real and imaginary part count each.

    A row's phasor multiplies its samples and j times them; where rows share one, their sum and j
    times their difference.
    """
    for row in range(n_phasors):
        source, now = _u(base + row * LANES), _u(turn + row * LANES)
        to = _u(rows + row * 2 * LANES)
        beside = to + _u(LANES)
        turn_cosine, turn_sine = step[first + row], step[n_steps + first + row]
        for lane in range(LANES):
            i = _u(lane)
            cosine, sine = turn_re[now + i], turn_im[now + i]
            x, y = base_re[source + i], base_im[source + i]
            re, im = x * cosine - y * sine, x * sine + y * cosine
            row_re[to + i] = re
            row_im[to + i] = im
            row_re[beside + i] = -im
            row_im[beside + i] = re
            turn_re[now + i] = cosine * turn_cosine - sine * turn_sine
            turn_im[now + i] = cosine * turn_sine + sine * turn_cosine
    for row in range(n_phasors, n_rows):
        source, now = _u(base + row * LANES), _u(turn + row * LANES)
        to = _u(rows + (row - n_phasors) * 2 * LANES)
        beside = to + _u(LANES)
        turn_cosine, turn_sine = step[first + row], step[n_steps + first + row]
        for lane in range(LANES):
            i = _u(lane)
            cosine, sine = turn_re[now + i], turn_im[now + i]
            x, y = base_re[source + i], base_im[source + i]
            re, im = x * cosine - y * sine, x * sine + y * cosine
            row_re[to + i] += re
            row_im[to + i] += im
            row_re[beside + i] += im
            row_im[beside + i] -= re
            turn_re[now + i] = cosine * turn_cosine - sine * turn_sine
            turn_im[now + i] = cosine * turn_sine + sine * turn_cosine


@njit(inline='always')
def _add_rows(row_re, row_im, rows, phasor_re, phasor_im, steps, n_phasors, group, n_some, sum_re,
              sum_im, sums):
    """Add all rows, times their phasors, to each beam of a group, for one vector of bins."""
    for block in range(n_phasors // ROWS):
        s0 = _u(rows + 2 * block * ROWS * LANES)
        s1, s2, s3 = s0 + _u(LANES), s0 + _u(2 * LANES), s0 + _u(3 * LANES)
        s4, s5, s6 = s0 + _u(4 * LANES), s0 + _u(5 * LANES), s0 + _u(6 * LANES)
        s7 = s0 + _u(7 * LANES)
        for m in range(n_some):
            p = _u(steps + (block * group + m) * ROWS)
            c0, c1, c2, c3 = (phasor_re[p], phasor_re[p + _u(1)], phasor_re[p + _u(2)],
                              phasor_re[p + _u(3)])
            d0, d1, d2, d3 = (phasor_im[p], phasor_im[p + _u(1)], phasor_im[p + _u(2)],
                              phasor_im[p + _u(3)])
            to = _u(sums + m * LANES)
            for j in range(LANES):
                i = _u(j)
                sum_re[to + i] += (c0 * row_re[s0 + i] + d0 * row_re[s1 + i]
                                   + c1 * row_re[s2 + i] + d1 * row_re[s3 + i]
                                   + c2 * row_re[s4 + i] + d2 * row_re[s5 + i]
                                   + c3 * row_re[s6 + i] + d3 * row_re[s7 + i])
                sum_im[to + i] += (c0 * row_im[s0 + i] + d0 * row_im[s1 + i]
                                   + c1 * row_im[s2 + i] + d1 * row_im[s3 + i]
                                   + c2 * row_im[s4 + i] + d2 * row_im[s5 + i]
                                   + c3 * row_im[s6 + i] + d3 * row_im[s7 + i])


@njit(parallel=True)
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
