# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Interpolation of a polar image to a map on the device, in two passes of one dimension each."""

from __future__ import annotations

import math

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...planning.interpolators import Interpolator
from ...planning.polar_cover import DEAPODISED_TAPS, DEGREE, TAPS
from .arrays import cuda, free_bytes, function, kernel, launch, xp
from .phasors import fraction, phasor

_MOST_BYTES, _SHARE = 1 << 28, 8  # of rows between the passes, and of the free memory
_THREADS = 128
_MOST_WEIGHTS, _POWERS, _TAPS, _FEW = TAPS * (DEGREE + 1), DEGREE + 1, TAPS, DEAPODISED_TAPS


def polar_to_map(image: np.ndarray, polar: PolarGrid, grid: MapGrid, onto: np.ndarray, *,
                 axis: int, wavelength_m: float, between: Interpolator, along: Interpolator,
                 cycles_per_alpha: float = 0.0) -> None:
    """Add a polar image at range baseband, with its carrier, to a map.

    `backends.reference.polar_to_map` has the formulas.

    Parameters
    ----------
    image : (2, n_alpha, n_range) float32 array of the device
        Real and imaginary part.
    polar, grid, axis, wavelength_m, between, along :
        As for the reference.
    onto : (n_y, n_x) complex64 array of the device
        Added to.
    cycles_per_alpha : float
        Carrier along direction that is put back, too.
    """
    ahead = (grid.x_m, grid.y_m)[axis] - polar.origin_m[axis]
    beside = (grid.y_m, grid.x_m)[axis] - polar.origin_m[1 - axis]
    side = 1.0 if ahead.mean() > 0 else -1.0
    geometry = xp.asarray(np.array([
        polar.height_m ** 2, polar.range_start_m, polar.range_spacing_m, side * polar.track[axis],
        polar.track[1 - axis], polar.alpha_start, polar.alpha_spacing, 2 / wavelength_m,
        cycles_per_alpha, polar.track[axis]]))
    weights = [xp.asarray(v.centred.reshape(-1)) for v in (between, along)]
    ahead, beside = xp.asarray(ahead), xp.asarray(beside)
    some = min(_MOST_BYTES, free_bytes() // _SHARE) // (8 * polar.n_range)
    some = max(1, min(some, len(beside)))
    by = {TAPS: to_ranges, DEAPODISED_TAPS: to_ranges_by_few}[between.n_taps]
    rows, flat = xp.empty(2 * some * polar.n_range, np.float32), image.reshape(-1)
    # a row of the map is one of its second axis where range follows y
    pixels = onto if axis == 0 else onto.T
    for first in range(0, len(beside), some):
        part = beside[first:first + some]
        launch(by, (-(-polar.n_range // _THREADS), len(part)), _THREADS, flat, *polar.shape,
               part, geometry, weights[0], between.first, rows)
        launch(to_pixels, (-(-len(ahead) // _THREADS), len(part)), _THREADS, rows,
               polar.n_range, part, ahead, geometry, weights[1], along.first,
               pixels[first:first + some])


@function
def _share(weights, shared):
    """Copy an interpolator's polynomials to the memory of the block."""
    for k in range(cuda.threadIdx.x, weights.size, cuda.blockDim.x):
        shared[k] = weights[k]
    cuda.syncthreads()


@function
def _weight(shared, n_taps, k, t):
    """Weight of neighbour k at a place t between samples, by Horner's rule."""
    w = shared[np.uint64((_POWERS - 1) * n_taps + k)]
    for power in range(_POWERS - 2, -1, -1):
        w = shared[np.uint64(power * n_taps + k)] + t * w
    return w


@kernel()
def to_ranges(image, n_lines, n_range, beside, geometry, weights, first, rows):
    """Lines of a polar image to where its ranges meet rows of the map; a grid of (ranges, rows).

    Parameters
    ----------
    image : (2 * n_alpha * n_range,) float32
        Polar image: real, then imaginary parts.
    n_lines, n_range : int
        Its size.
    beside : (Q,) float64
        Distance of the rows beside the origin, metres.
    geometry : (10,) float64
        Square of the height, m^2; first range and spacing, metres; track along the rows, times
        the side on which their pixels lie, and across them; first direction and spacing; cycles
        per metre of range, and of direction; track along the rows.
    weights, first : (6 * TAPS,) float32, int
        Of the interpolator between lines, centred, power by power, and its first neighbour.
    rows : (2 * Q * n_range,) float32
        Rows at all ranges.
    """
    _to_ranges(image, n_lines, n_range, beside, geometry, weights, first, rows, _TAPS)


@kernel()
def to_ranges_by_few(image, n_lines, n_range, beside, geometry, weights, first, rows):
    """As `to_ranges`, by an interpolator of `DEAPODISED_TAPS` neighbours.

    Parameters
    ----------
    image, n_lines, n_range, beside, geometry, weights, first, rows :
        As of `to_ranges`.
    """
    _to_ranges(image, n_lines, n_range, beside, geometry, weights, first, rows, _FEW)


@function
def _to_ranges(image, n_lines, n_range, beside, geometry, weights, first, rows, n_taps):
    """What both kernels do."""
    shared = cuda.shared.array(_MOST_WEIGHTS, np.float32)
    reading = cuda.local.array(_TAPS, np.float32)
    thread, row = cuda.threadIdx.x, cuda.blockIdx.y
    _share(weights, shared)
    i = cuda.blockIdx.x * cuda.blockDim.x + thread
    if i >= n_range:
        return
    distance, q = geometry[1] + i * geometry[2], beside[row]
    meets = math.sqrt(max(distance * distance - q * q - geometry[0], 0.0))
    alpha = (meets * geometry[3] + q * geometry[4]) / distance
    highest = float(n_lines - n_taps - first)
    place = min(max((alpha - geometry[5]) / geometry[6], float(-first)), highest + 1.0)
    n = min(math.floor(place), highest)
    t, line = np.float32(place - n - 0.5), int(n) + first
    at, imaginary, out = line * n_range + i, n_lines * n_range, row * n_range + i
    real, imag = np.float32(0.0), np.float32(0.0)
    for k in range(n_taps):
        reading[k] = _weight(shared, n_taps, k, t)
    begins, imag_begins = np.uint64(at), np.uint64(at + imaginary)
    for k in range(n_taps):
        real += reading[k] * image[begins]
        imag += reading[k] * image[imag_begins]
        begins, imag_begins = begins + np.uint64(n_range), imag_begins + np.uint64(n_range)
    rows[np.uint64(out)] = real
    rows[np.uint64(out + beside.size * n_range)] = imag


@kernel()
def to_pixels(rows, n_range, beside, ahead, geometry, weights, first, image):
    """Ranges of rows to their pixels, with the carrier; a grid of (pixels, rows).

    Parameters
    ----------
    rows, n_range, beside, geometry :
        As of `to_ranges`.
    ahead : (P,) float64
        Distance of the pixels ahead of the origin, metres.
    weights, first :
        Of the interpolator along range, of `TAPS` neighbours, centred, and its first neighbour.
    image : (Q, P) complex64
        Added to.
    """
    shared = cuda.shared.array(_MOST_WEIGHTS, np.float32)
    reading = cuda.local.array(_TAPS, np.float32)
    thread, row = cuda.threadIdx.x, cuda.blockIdx.y
    _share(weights, shared)
    i = cuda.blockIdx.x * cuda.blockDim.x + thread
    if i >= image.shape[1]:
        return
    p, q = ahead[i], beside[row]
    distance = math.sqrt(p * p + q * q + geometry[0])
    beyond = distance - geometry[1]
    highest = float(n_range - _TAPS - first)
    place = min(max(beyond / geometry[2], float(-first)), highest + 1.0)
    n = min(math.floor(place), highest)
    t, at = np.float32(place - n - 0.5), row * n_range + int(n) + first
    imaginary, real, imag = beside.size * n_range, np.float32(0.0), np.float32(0.0)
    for k in range(_TAPS):
        reading[k] = _weight(shared, _TAPS, k, t)
    begins, imag_begins = np.uint64(at), np.uint64(at + imaginary)
    for k in range(_TAPS):  # steps are constants of the instructions
        real += reading[k] * rows[begins + np.uint64(k)]
        imag += reading[k] * rows[imag_begins + np.uint64(k)]
    alpha = (p * geometry[9] + q * geometry[4]) / distance
    cosine, sine = phasor(np.float32(fraction(
        geometry[7] * beyond + geometry[8] * (alpha - geometry[5]))))
    image[row, i] += complex(real * cosine - imag * sine, real * sine + imag * cosine)
