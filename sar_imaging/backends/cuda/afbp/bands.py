"""Spectra of sub-aperture images and their sum: kernels, each for several images at once."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import cuda, kernel, load_pair, store_pair

_MEANS = 5  # of `EdgeBrightness`
_HALF = 0.5


@kernel()
def taper_images(images, along_alpha, along_range, tapered):
    """Images times the tapers of both axes, complex; a grid of (ranges, lines, G).

    Parameters
    ----------
    images : (G, 2, n_alpha, n_range) float32
        Real and imaginary parts.
    along_alpha, along_range : (n_alpha,), (n_range,) float32
        Tapers.
    tapered : pairs
        (G, n_alpha, n_range) complex64.
    """
    i, line, g = (cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, cuda.blockIdx.y,
                  cuda.blockIdx.z)
    n_lines, n_ranges = images.shape[2], images.shape[3]
    if i >= n_ranges:
        return
    weight = along_alpha[line] * along_range[i]
    store_pair(tapered, np.uint64((g * n_lines + line) * n_ranges + i),
               weight * images[g, 0, line, i], weight * images[g, 1, line, i])


@kernel()
def add_bands(folded, n_coarse, n_ranges, centres, wavenumbers, lowest, spectrum):
    """Add bands to a spectrum; a grid of (range wavenumbers, rows that they reach).

    Parameters
    ----------
    folded : pairs
        (G, n_coarse, n_ranges) complex64: holds bin n of a band in row ``n mod n_coarse``, and
        range wavenumber k, counted from the middle of K, in column ``k mod n_ranges``.
    n_coarse, n_ranges : int
        Rows and columns.
    centres : (G,) float64
        Middle of each band, bins times metres a radian.
    wavenumbers : (K,) float64
        Rad/m.
    lowest : int
        Bin of the first row.
    spectrum : (n_fine, K) complex64
        Row ``n mod n_fine`` is added to.
    """
    column, row = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, cuda.blockIdx.y
    n_fine, n_bins = spectrum.shape
    if column >= n_bins:
        return
    real, imag = np.float32(0.0), np.float32(0.0)
    at = column - n_bins // 2
    if at < 0:
        at += n_ranges
    for g in range(centres.size):
        first = int(math.floor(centres[g] * wavenumbers[column] + _HALF)) - n_coarse // 2
        n = lowest + row - first
        if n < 0 or n >= n_fine:  # of all rows with the same place in the spectrum, the first
            n %= n_fine
        while n < n_coarse:  # more than one where the band overlaps itself
            re, im = load_pair(folded, np.uint64(
                (g * n_coarse + (first + n) % n_coarse) * n_ranges + at))
            real += re
            imag += im
            n += n_fine
    spectrum[(lowest + row) % n_fine, column] += complex(real, imag)


@kernel()
def edge_powers(images, lines, ranges, power):
    """Mean powers of images by `EdgeBrightness.factors`; a grid of (lines, G).

    Parameters
    ----------
    images : (G, 2, n_alpha, n_range) float32
        Real and imaginary parts.
    lines, ranges : (5, n_alpha), (5, n_range) float32
        Factors of the five means.
    power : (5,) float64
        Added to.
    """
    shared = cuda.shared.array(_MEANS, np.float32)
    mine = cuda.local.array(_MEANS, np.float32)
    line, g, thread = cuda.blockIdx.x, cuda.blockIdx.y, cuda.threadIdx.x
    for k in range(_MEANS):
        mine[k] = 0.0
        if thread == 0:
            shared[k] = 0.0
    cuda.syncthreads()
    for i in range(thread, images.shape[3], cuda.blockDim.x):
        re, im = images[g, 0, line, i], images[g, 1, line, i]
        here = re * re + im * im
        for k in range(_MEANS):
            mine[k] += ranges[k, i] * here
    for k in range(_MEANS):
        if lines[k, line] > np.float32(0.0):
            cuda.atomic.add(shared, k, lines[k, line] * mine[k])
    cuda.syncthreads()
    if thread == 0:
        for k in range(_MEANS):
            cuda.atomic.add(power, k, float(shared[k]))
