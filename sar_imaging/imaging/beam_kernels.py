"""Compiled loop that forms the beams of a sub-aperture from the spectra of its rows.

Like `kernels.project_lines` it takes flat arrays and unsigned indices, without views, for the
compiler's sake.
"""

from __future__ import annotations

import numpy as np

from ..compilation import REPEATABLE, njit, numba
from .kernels import _cos_cycles, _fraction, _sin_cycles

LANES = 16  # bins of one vector
ROWS = 4  # phasors multiplied at once
BINS = 128  # whose samples stay in the cache

_u = np.uint64


@njit(parallel=True, fastmath=REPEATABLE)
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
