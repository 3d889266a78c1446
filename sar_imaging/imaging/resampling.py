"""Polar image to map, in two passes of one-dimensional interpolation.

A strip of map rows at a time: first along direction, to where each polar range meets a row, then
along range, to the pixels of the row. Both passes work on the image at range baseband and use the
least-squares interpolators of `interpolation`, so that the error is known; the carrier
``exp(j k_c r)`` is put back in float64 at the end. Neither pass gathers: `LANES` neighbours that
read the same samples are computed together, and where they do not all read the same ones, each
start of samples that occurs among them takes its turn.
"""

from __future__ import annotations

import numpy as np

from ..compilation import njit, numba
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from .interpolation import Interpolator
from .kernels import _cos_cycles, _fraction, _sin_cycles
from .work_space import aligned_empty

TAPS, DEGREE = 14, 5
HALF = TAPS // 2
LANES = 16  # pixels computed together: one vector of float32
PIXELS = 8  # of a row that are written together
_TASKS_PER_THREAD = 4
_CHUNKS = 16  # of LANES ranges: what they take for all rows of a strip stays in cache


def add_polar_to_map(real, imag, polar: PolarGrid, grid: MapGrid, image, *, axis: int,
                     wavelength_m: float, interpolator: Interpolator) -> None:
    """Interpolate a polar image at range baseband and add it to a map image.

    Parameters
    ----------
    real, imag : (n_alpha, n_range) float32
        Image times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0 the first range. Lines are contiguous
        and equally far apart in both.
    polar : PolarGrid
        Its grid; it must reach `TAPS` pixels beyond the map on all sides and have `LANES` ranges
        or more.
    grid : MapGrid
        Grid of the map.
    image : (n_y, n_x) complex64
        Map to add to, contiguous in C order.
    axis : int
        Map axis that follows range: 0 when rows of the second pass follow x, 1 for y.
    wavelength_m : float
        At the carrier, metres.
    interpolator : Interpolator
        Of both passes, with `TAPS` taps and degree `DEGREE`.
    """
    origin = np.array(polar.origin_m)
    line = (grid.x_m, grid.y_m)[axis] - origin[axis]
    rows = (grid.y_m, grid.x_m)[axis] - origin[1 - axis]
    # side of the origin on which the pixels of a line lie
    sign = 1.0 if line.mean() > 0 else -1.0
    track = np.array(polar.track)[[axis, 1 - axis]]
    steps = np.array((grid.n_x, 1) if axis == 0 else (1, grid.n_x))
    offset = _offsets(rows, line[len(line) // 2], polar)
    length = polar.n_range + TAPS + int(offset.max())
    n_tasks = min(len(offset) // LANES, _TASKS_PER_THREAD * numba.get_num_threads())
    strip = aligned_empty((2, n_tasks * length * LANES), np.float32)
    strip[:] = 0.0
    lanes = aligned_empty((5, n_tasks * LANES), np.float32)
    _resample(_flat(real), _flat(imag), real.shape, real.strides[0] // real.itemsize, rows, line,
              sign, track, polar.height_m, polar.range_start_m, polar.range_spacing_m,
              polar.alpha_start, polar.alpha_spacing, 2 / wavelength_m,
              interpolator.centred[:, :HALF].reshape(-1), interpolator.first, steps, offset,
              image.reshape(-1).view(np.float32), length, np.empty(n_tasks), *strip, *lanes,
              aligned_empty((2 * n_tasks * LANES * PIXELS,), np.float32))


def _flat(lines: np.ndarray) -> np.ndarray:
    """Lines and what lies between them."""
    width = lines.strides[0] // lines.itemsize
    n = (len(lines) - 1) * width + lines.shape[1]
    return np.lib.stride_tricks.as_strided(lines, (n,), (lines.itemsize,))


def _offsets(rows, middle: float, polar: PolarGrid) -> np.ndarray:
    """(n_strips * LANES,) int64 ranges by which each row of a strip is set off.

    With them the pixels of a column of a strip read nearly the same place.
    """
    n = -(-len(rows) // LANES) * LANES
    padded = rows[np.minimum(np.arange(n), len(rows) - 1)]
    r = np.sqrt(middle ** 2 + padded ** 2 + polar.height_m ** 2)
    number = np.floor(r / polar.range_spacing_m).astype(np.int64).reshape(-1, LANES)
    return (number.max(axis=1, keepdims=True) - number).reshape(-1)


@njit(inline='always')
def _weights(weights, k, t):
    """Weights of tap k and of its mirror image, t samples from the middle between them."""
    t2 = t * t
    even = weights[k] + t2 * (weights[2 * HALF + k] + t2 * weights[4 * HALF + k])
    odd = weights[HALF + k] + t2 * (weights[3 * HALF + k] + t2 * weights[5 * HALF + k])
    return even + t * odd, even - t * odd


@njit(parallel=True)
def _resample(real, imag, shape, apart, rows, line, sign, track, height, range_start, range_step,
              alpha_start, alpha_step, cycles_per_m, weights, first, steps, offset, image, length,
              tasks, strip_re, strip_im, fraction, start, lane_re, lane_im, cycles, few):
    """Both passes, strip by strip; like `kernels.project_lines` free of views for the compiler."""
    n_alpha, n_range = shape
    n_rows, n_pixels, n_tasks = len(rows), len(line), len(tasks)
    n_chunks = (n_range + LANES - 1) // LANES
    n_strips, width = len(offset) // LANES, np.uint64(apart)
    inverse_alpha, inverse_range = 1.0 / alpha_step, 1.0 / range_step
    for task in numba.prange(n_tasks):
        lane = np.uint64(task * LANES)
        base = np.uint64(task * length * LANES)
        for number in range(task * n_strips // n_tasks, (task + 1) * n_strips // n_tasks):
            for part in range(((n_chunks + _CHUNKS - 1) // _CHUNKS) * LANES):
                j, first_chunk = part % LANES, part // LANES * _CHUNKS
                row = number * LANES + j
                beside = rows[min(row, n_rows - 1)]
                beside2 = beside * beside + height * height
                for chunk in range(first_chunk, min(first_chunk + _CHUNKS, n_chunks)):
                    i0 = min(chunk * LANES, n_range - LANES)
                    low, high = n_alpha, -1
                    for i in range(LANES):
                        r = range_start + (i0 + i) * range_step
                        ahead = sign * np.sqrt(max(r * r - beside2, 0.0))
                        v = ((ahead * track[0] + beside * track[1]) / r
                             - alpha_start) * inverse_alpha
                        floor = np.floor(v)
                        fraction[lane + np.uint64(i)] = v - floor - 0.5
                        n = np.int64(min(max(floor + first, 0.0), n_alpha - TAPS - 0.0))
                        start[lane + np.uint64(i)] = n
                        low, high = min(low, n), max(high, n)
                    for i in range(LANES):
                        lane_re[lane + np.uint64(i)] = 0.0
                        lane_im[lane + np.uint64(i)] = 0.0
                    for n in range(low, high + 1):
                        turn = np.float32(n)
                        source = np.uint64(n * apart + i0)
                        for i in range(LANES):
                            to = lane + np.uint64(i)
                            re, im, t = np.float32(0.0), np.float32(0.0), fraction[to]
                            for k in range(HALF):
                                w, w2 = _weights(weights, k, t)
                                place = source + np.uint64(k) * width + np.uint64(i)
                                mirrored = place + np.uint64(TAPS - 1 - 2 * k) * width
                                re += w * real[place] + w2 * real[mirrored]
                                im += w * imag[place] + w2 * imag[mirrored]
                            mask = max(np.float32(1.0) - abs(start[to] - turn), np.float32(0.0))
                            lane_re[to] += mask * re
                            lane_im[to] += mask * im
                    target = base + np.uint64((i0 + offset[row]) * LANES + j)
                    for i in range(LANES):
                        strip_re[target + np.uint64(i * LANES)] = lane_re[lane + np.uint64(i)]
                        strip_im[target + np.uint64(i * LANES)] = lane_im[lane + np.uint64(i)]
            for first_pixel in range(0, n_pixels, PIXELS):
                n_some = min(PIXELS, n_pixels - first_pixel)
                for p in range(n_some):
                    ahead2 = line[first_pixel + p] * line[first_pixel + p] + height * height
                    low, high = length, -1
                    for j in range(LANES):
                        row = number * LANES + j
                        beside = rows[min(row, n_rows - 1)]
                        r = np.sqrt(ahead2 + beside * beside)
                        v = (r - range_start) * inverse_range
                        floor = np.floor(v)
                        fraction[lane + np.uint64(j)] = v - floor - 0.5
                        n = (np.int64(min(max(floor + first, 0.0), n_range - TAPS - 0.0))
                             + offset[row])
                        start[lane + np.uint64(j)] = n
                        low, high = min(low, n), max(high, n)
                        cycles[lane + np.uint64(j)] = _fraction(
                            cycles_per_m * (r - range_start))
                        lane_re[lane + np.uint64(j)] = 0.0
                        lane_im[lane + np.uint64(j)] = 0.0
                    for n in range(low, high + 1):
                        turn = np.float32(n)
                        source = base + np.uint64(n * LANES)
                        for j in range(LANES):
                            to = lane + np.uint64(j)
                            re, im, t = np.float32(0.0), np.float32(0.0), fraction[to]
                            for k in range(HALF):
                                w, w2 = _weights(weights, k, t)
                                place = source + np.uint64(k * LANES + j)
                                mirrored = place + np.uint64((TAPS - 1 - 2 * k) * LANES)
                                re += w * strip_re[place] + w2 * strip_re[mirrored]
                                im += w * strip_im[place] + w2 * strip_im[mirrored]
                            mask = max(np.float32(1.0) - abs(start[to] - turn), np.float32(0.0))
                            lane_re[to] += mask * re
                            lane_im[to] += mask * im
                    for j in range(LANES):
                        to = lane + np.uint64(j)
                        c = cycles[to]
                        sine, cosine = _sin_cycles(c, c * c), _cos_cycles(c * c)
                        re, im = lane_re[to], lane_im[to]
                        place = np.uint64(2 * ((task * LANES + j) * PIXELS + p))
                        few[place] = re * cosine - im * sine
                        few[place + np.uint64(1)] = re * sine + im * cosine
                # whole cache lines at a time: rows often lie a power of two apart
                for j in range(min(LANES, n_rows - number * LANES)):
                    source = np.uint64(2 * (task * LANES + j) * PIXELS)
                    place = 2 * ((number * LANES + j) * steps[0] + first_pixel * steps[1])
                    for p in range(n_some):
                        to = np.uint64(place + 2 * p * steps[1])
                        image[to] += few[source + np.uint64(2 * p)]
                        image[to + np.uint64(1)] += few[source + np.uint64(2 * p + 1)]
