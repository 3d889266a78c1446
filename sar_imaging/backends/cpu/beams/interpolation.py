"""Compiled loop that interpolates the lines of a polar image from the beams of a sub-aperture.

Free of views for the compiler, see `line_kernels`; sums over beams and cells are `accumulation`'s.
"""

from __future__ import annotations

import numpy as np

from ....compilation import DETERMINISTIC, njit, numba
from ....planning.afbp.beam_gain import BEAM_TAPS
from ....planning.afbp.beams import CELL_TAPS
from ..line_kernels import _cos_cycles, _fraction, _sin_cycles
from ..threads import take_job
from .accumulation import STORED, TILE, fetch, sum_beams, sum_cells, sum_lit_cells

ALIGNED = 8  # cells of a line of the cache
_PIECES = 32  # of a job
_FIRST_BEAM, _FIRST_CELL = 1 - BEAM_TAPS // 2, 1 - CELL_TAPS // 2  # of the neighbours

_u = np.uint64


def summed_cells(segment: int) -> int:
    """Cells that a segment is interpolated from, from the beginning of a line of the cache on."""
    return -(-(segment + CELL_TAPS + ALIGNED) // TILE) * TILE


def work_size(segment: int) -> int:
    """Numbers of the work space of a task."""
    return 6 * STORED + 8 * summed_cells(segment)


@njit(parallel=True, fastmath=DETERMINISTIC)
def interpolate_beams(beams, shape, lines, centre, track, range_m, direction, cycles_per_m,
                      zero_cycles, curvature, between, along, index, image, work, jobs, lit,
                      lit_apart):
    """Interpolate beams to the lines of a polar image at range baseband.

    `backends.reference.interpolate_beams` has the formula. Within a segment of a line the places
    between beams and cells, and the phase that the line has beyond its range baseband, are
    polynomials of the pixel number, and weights are expanded to second order around the middle.
    The orders of the direction are kept apart until a pixel's own place between beams is known:
    its cells, mixed each for a place of its own, would have other frequencies than those that
    their spectrum is corrected for.

    Parameters
    ----------
    beams, image : (2 * M * n,), (2 * n_lines * n_pixels,) float32
        Beams at range baseband, cells ascending, real and imaginary parts in turn; image, real,
        then imaginary parts, written to.
    shape : tuple of int
        ``(M, n, n_lines, n_pixels, segment)``: beams, their cells, lines of the image, their
        pixels and those of a segment. `TILE` cells are to spare.
    lines : (S, n_lines, 12) float64
        From `lines.segment_middles`.
    centre, track : (3,), (2,) float64
        Phase centre that the beams start from, metres, and the direction of the axis.
    range_m, direction : (3,), (2,) float64
        Range of the first cell, spacing of cells and of pixels, metres; direction cosine of the
        first beam, spacing of beams.
    cycles_per_m, zero_cycles : float
        Carrier phase per metre of half path, and that of no half path, cycles.
    curvature : (2,) float64
        Of the beams, 1/m, and what its differences count between neighbouring beams, m.
    between, along : (DEGREE + 1, STORED) float32
        Weights of the interpolation between beams and along range; zero beyond their taps.
    index : (summed_cells(segment),) float32
        Pixel numbers of a segment, counted from its middle, and those that follow; segments are
        whole vectors.
    work, jobs : (T * work_size(segment),) float32, int
        Work space of T tasks, and the address of a `job_counter`.
    lit : (3, n_lines, K) float32 or None
        Amplitude of echoes by their phase from beam to beam, `lit_lines.parabolas`; None where all
        pixels are lit alike.
    lit_apart : int
        Segments between its knots.
    """
    n_beams, n_cells, n_lines, n_pixels, segment = shape
    n_mixed = len(index)
    size = 6 * STORED + 8 * n_mixed
    n_tasks = len(work) // size
    half, n_pieces = segment // 2, lines.shape[0] * n_lines
    apart, part = _u(2 * n_cells), _u(n_mixed)
    spacing = cycles_per_m * range_m[2]
    for task in numba.prange(n_tasks):
        w = _u(size * task)
        mixed = w + _u(6 * STORED)
        sums = mixed + _u(6 * n_mixed)
        # Neighbouring lines read the same part of the beams, so they come in turn.
        job = take_job(jobs)
        while job * _PIECES < n_pieces:
            for piece in range(job * _PIECES, min((job + 1) * _PIECES, n_pieces)):
                number, line = piece // n_lines, piece % n_lines
                x = lines[number, line, 0] - centre[0]
                y = lines[number, line, 1] - centre[1]
                z = lines[number, line, 2] - centre[2]
                ex, ey, ez = (lines[number, line, 3], lines[number, line, 4],
                              lines[number, line, 5])
                gx, gy, gz = (lines[number, line, 6], lines[number, line, 7],
                              lines[number, line, 8])
                hx, hy, hz = (lines[number, line, 9], lines[number, line, 10],
                              lines[number, line, 11])
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
                place = np.int64(min(max(cell - half + _FIRST_CELL, 0.0), n_cells - n_mixed - 0.0))
                # Vectors that straddle two lines of the cache take twice as long to load.
                start = place // ALIGNED * ALIGNED
                row = np.int64(min(max(beam + _FIRST_BEAM, 0.0), n_beams - BEAM_TAPS - 0.0))
                source = _u(2 * (row * n_cells + start))
                fetch(beams, source + _u(BEAM_TAPS) * apart, _u(2 * n_mixed))  # for the next line
                sum_beams(beams, source, apart, part, work, w, mixed)
                if lit is None:
                    sum_cells(index, _u(segment), (v1, v2, v3), (u1, u2, bend, bend1), work,
                              w + _u(3 * STORED), mixed + _u(place - start), sums, part)
                else:
                    a0, a1 = _along_segment(lit, line, number, lit_apart, segment, 0)
                    b0, b1 = _along_segment(lit, line, number, lit_apart, segment, 1)
                    q0, q1 = _along_segment(lit, line, number, lit_apart, segment, 2)
                    sum_lit_cells(index, _u(segment), (v1, v2, v3), (u1, u2, bend, bend1), work,
                                  w + _u(3 * STORED), mixed + _u(place - start), sums, part,
                                  (a0, a1, b0, b1, q0, q1))
                some = _u(min(segment, n_pixels - number * segment))
                real = _u(line * n_pixels + number * segment)
                imag = real + _u(n_lines * n_pixels)
                fetch(image, real + _u(n_pixels), _u(segment))
                fetch(image, imag + _u(n_pixels), _u(segment))
                for i in range(some):
                    f = index[i]
                    c = _fraction(c0 + f * (c1 + f * (c2 + f * c3)))
                    sine, cosine = _sin_cycles(c, c * c), _cos_cycles(c * c)
                    re, im = work[sums + i], work[sums + part + i]
                    image[real + i] = re * cosine - im * sine
                    image[imag + i] = re * sine + im * cosine
            job = take_job(jobs)


@njit(inline='always')
def _along_segment(lit, line, number, apart, segment, order):
    """Value in the middle of a segment, and growth from pixel to pixel, between two knots."""
    knot = number // apart
    grown = (lit[order, line, knot + 1] - lit[order, line, knot]) / np.float32(apart)
    share = np.float32(number - knot * apart + 0.5)
    return lit[order, line, knot] + share * grown, grown / np.float32(segment)


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
