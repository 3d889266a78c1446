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
    stride = (grid.n_x, 1) if axis == 0 else (1, grid.n_x)
    _resample(real, imag, rows - origin[1 - axis], line - origin[axis], sign, track,
              polar.height_m, polar.range_start_m, polar.range_spacing_m, polar.alpha_start,
              polar.alpha_spacing, 2 / wavelength_m, along_alpha.weights, along_range.weights,
              along_alpha.first, stride[0], stride[1], image.reshape(-1))


@njit(parallel=True)
def _resample(real, imag, rows, line, sign, track, height, range_start, range_step, alpha_start,
              alpha_step, cycles_per_m, weights_alpha, weights_range, first, row_stride,
              pixel_stride, image):
    n_alpha, n_range = real.shape
    n = len(line)
    for j in numba.prange(len(rows)):
        beside = rows[j]
        row_re, row_im = np.zeros(n_range, np.float32), np.zeros(n_range, np.float32)
        cell = np.empty(n_range, np.int64)
        fraction = np.empty(n_range, np.float32)
        for i in range(n_range):
            r = range_start + i * range_step
            ahead = sign * np.sqrt(max(r * r - beside * beside - height * height, 0.0))
            v = ((ahead * track[0] + beside * track[1]) / r - alpha_start) / alpha_step
            floor = min(max(np.floor(v), -1.0 * first), n_alpha - TAPS - 1.0 * first)
            cell[i] = np.int64(floor) + first
            fraction[i] = v - floor
        start = 0
        while start < n_range:  # runs of ranges that read the same directions
            stop = start + 1
            while stop < n_range and cell[stop] == cell[start]:
                stop += 1
            for k in range(TAPS):
                _add_weighted(real[cell[start] + k], imag[cell[start] + k], fraction,
                              weights_alpha, k, start, stop, row_re, row_im)
            start = stop
        _along_range(row_re, row_im, line, beside, height, range_start, range_step,
                     cycles_per_m, weights_range, first, n, image, j * row_stride, pixel_stride)


@njit
def _add_weighted(source_re, source_im, fraction, weights, k, start, stop, out_re, out_im):
    for i in range(start, stop):
        w = _weight(weights, k, fraction[i])
        out_re[i] += w * source_re[i]
        out_im[i] += w * source_im[i]


@njit(inline='always')
def _weight(weights, k, t):
    return weights[0, k] + t * (weights[1, k] + t * (weights[2, k] + t * (
        weights[3, k] + t * (weights[4, k] + t * weights[5, k]))))


@njit
def _along_range(row_re, row_im, line, beside, height, range_start, range_step, cycles_per_m,
                 weights, first, n, image, base, stride):
    index, fraction = np.empty(n, np.int64), np.empty(n, np.float32)
    sine, cosine = np.empty(n, np.float32), np.empty(n, np.float32)
    out_re, out_im = np.zeros(n, np.float32), np.zeros(n, np.float32)
    for k in range(n):
        r = np.sqrt(line[k] * line[k] + beside * beside + height * height)
        v = (r - range_start) / range_step
        floor = min(max(np.floor(v), -1.0 * first), len(row_re) - TAPS - 1.0 * first)
        index[k] = np.int64(floor) + first
        fraction[k] = v - floor
        c = np.float32(_fraction(cycles_per_m * (r - range_start)))
        sine[k], cosine[k] = _sin_cycles(c, c * c), _cos_cycles(c * c)
    for tap in range(TAPS):
        for k in range(n):
            w = _weight(weights, tap, fraction[k])
            out_re[k] += w * row_re[index[k] + tap]
            out_im[k] += w * row_im[index[k] + tap]
    for k in range(n):
        image[base + k * stride] += (out_re[k] * cosine[k] - out_im[k] * sine[k]
                                     + np.complex64(1j) * (out_re[k] * sine[k]
                                                           + out_im[k] * cosine[k]))
