"""Polar image to map, in two passes of one-dimensional interpolation.

Row by row of the map: first along direction, to where each polar range meets the row, then along
range, to the pixels of the row. Both passes work on the image at range baseband and use the
least-squares interpolators of `interpolation`, so that the error is known; the carrier
``exp(j k_c r)`` is put back in float64 at the end.
"""

from __future__ import annotations

import numpy as np

from ..compilation import njit, numba
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from .interpolation import Interpolator
from .kernels import _cos_cycles, _fraction, _sin_cycles

TAPS, DEGREE = 10, 5
_ROWS_PER_CALL = 256  # bounds the work space


def add_polar_to_map(real, imag, polar: PolarGrid, grid: MapGrid, image, *, axis: int,
                     wavelength_m: float, along_alpha: Interpolator,
                     along_range: Interpolator) -> None:
    """Interpolate a polar image at range baseband and add it to a map image.

    Parameters
    ----------
    real, imag : (n_alpha, n_range) float32
        Image times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0 the first range.
    polar : PolarGrid
        Its grid; it must reach `TAPS` pixels beyond the map on all sides.
    grid : MapGrid
        Grid of the map.
    image : (n_y, n_x) complex64
        Map to add to, contiguous in C order.
    axis : int
        Map axis that follows range: 0 when rows of the second pass follow x, 1 for y.
    wavelength_m : float
        At the carrier, metres.
    along_alpha, along_range : Interpolator
        With `TAPS` taps and degree `DEGREE`.
    """
    origin = np.array(polar.origin_m)
    line = (grid.x_m, grid.y_m)[axis]
    rows = (grid.y_m, grid.x_m)[axis]
    # side of the origin on which the pixels of a line lie
    sign = 1.0 if line.mean() > origin[axis] else -1.0
    track = np.array(polar.track)[[axis, 1 - axis]]
    row_step, pixel_step = (grid.n_x, 1) if axis == 0 else (1, grid.n_x)
    n, m = min(len(rows), _ROWS_PER_CALL), max(polar.n_range, len(line))
    index, fraction = np.empty(n * m, np.int64), np.empty(n * m, np.float32)
    work = np.empty((4, n * m), np.float32)
    for start in range(0, len(rows), n):
        part = rows[start:start + n]
        _resample(real.reshape(-1), imag.reshape(-1), real.shape, part - origin[1 - axis],
                  line - origin[axis], sign, track[0], track[1], polar.height_m,
                  polar.range_start_m, polar.range_spacing_m, polar.alpha_start,
                  polar.alpha_spacing, 2 / wavelength_m, along_alpha.weights,
                  along_range.weights, along_alpha.first, start * row_step, row_step, pixel_step,
                  image.reshape(-1).view(np.float32), index, fraction, *work)


@njit(parallel=True)
def _resample(real, imag, shape, rows, line, sign, track_ahead, track_beside, height,
              range_start, range_step, alpha_start, alpha_step, cycles_per_m, weights_alpha,
              weights_range, first, origin, row_step, pixel_step, image, index, fraction,
              row_re, row_im, out_re, out_im):
    """Both passes, row by row; like `kernels.project_lines` free of views for the compiler."""
    n_alpha, n_range = shape
    n = len(line)
    width = max(n_range, n)
    for j in numba.prange(len(rows)):
        beside = rows[j]
        base = j * width
        for i in range(n_range):
            r = range_start + i * range_step
            ahead = sign * np.sqrt(max(r * r - beside * beside - height * height, 0.0))
            v = ((ahead * track_ahead + beside * track_beside) / r - alpha_start) / alpha_step
            floor = min(max(np.floor(v), -1.0 * first), n_alpha - TAPS - 1.0 * first)
            index[base + i] = np.int64(floor) + first
            fraction[base + i] = v - floor
            row_re[base + i] = 0.0
            row_im[base + i] = 0.0
        start = 0
        while start < n_range:  # runs of ranges that read the same directions
            stop = start + 1
            while stop < n_range and index[base + stop] == index[base + start]:
                stop += 1
            length, to = np.uint64(stop - start), np.uint64(base + start)
            for k in range(TAPS):
                source = np.uint64((index[base + start] + k) * n_range + start)
                w0, w1, w2 = weights_alpha[0, k], weights_alpha[1, k], weights_alpha[2, k]
                w3, w4, w5 = weights_alpha[3, k], weights_alpha[4, k], weights_alpha[5, k]
                for i in range(length):
                    t = fraction[to + i]
                    w = w0 + t * (w1 + t * (w2 + t * (w3 + t * (w4 + t * w5))))
                    row_re[to + i] += w * real[source + i]
                    row_im[to + i] += w * imag[source + i]
            start = stop
        for k in range(n):
            r = np.sqrt(line[k] * line[k] + beside * beside + height * height)
            v = (r - range_start) / range_step
            floor = min(max(np.floor(v), -1.0 * first), n_range - TAPS - 1.0 * first)
            index[base + k] = np.int64(floor) + first + base
            fraction[base + k] = v - floor
            out_re[base + k] = 0.0
            out_im[base + k] = 0.0
        to, length = np.uint64(base), np.uint64(n)
        for tap in range(TAPS):
            w0, w1, w2 = weights_range[0, tap], weights_range[1, tap], weights_range[2, tap]
            w3, w4, w5 = weights_range[3, tap], weights_range[4, tap], weights_range[5, tap]
            for k in range(length):
                t = fraction[to + k]
                w = w0 + t * (w1 + t * (w2 + t * (w3 + t * (w4 + t * w5))))
                source = np.uint64(index[to + k] + tap)
                out_re[to + k] += w * row_re[source]
                out_im[to + k] += w * row_im[source]
        pixel = 2 * (origin + j * row_step)
        for k in range(n):
            r = np.sqrt(line[k] * line[k] + beside * beside + height * height)
            c = np.float32(_fraction(cycles_per_m * (r - range_start)))
            sine, cosine = _sin_cycles(c, c * c), _cos_cycles(c * c)
            re, im = out_re[base + k], out_im[base + k]
            image[pixel + 2 * k * pixel_step] += re * cosine - im * sine
            image[pixel + 2 * k * pixel_step + 1] += re * sine + im * cosine
