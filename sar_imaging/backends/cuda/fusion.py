# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Second stage of AFBP on the device: sub-aperture images joined by their spectra, and the map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...geometry.grids import MapGrid
from ...memory import IMAGE_BYTES
from ...planning.afbp.polar_grids import UnifiedPolarGrids
from ...planning.aliasing_error import guard_taper
from ...planning.interpolators import design_interpolator
from ...planning.polar_cover import DEGREE, TAPS, range_axis
from .arrays import (
    check_memory,
    cuda,
    given,
    kernel,
    launch,
    load_pair,
    pairs,
    reports_failures,
    require_device,
    store_pair,
    taken,
    xp,
)
from .polar_to_map import polar_to_map

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


_THREADS = 128


class SpectrumFusion:
    """Fuses sub-aperture images that share a grid, see `backends.protocol.SpectrumFusion`.

    `backends.reference.fuse_bands` has the formulas. Images are taken from the host or the device;
    the fused one is an array of the device. Where contributions are kept, their spectra are
    summed in the order of their numbers when an image is wanted, so that removing and replacing
    leave no rounding behind.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory.
    """

    @reports_failures
    def __init__(self, grid: UnifiedPolarGrids, *, keep: bool = False):
        require_device()
        self.grid, self._keep = grid, keep
        self._wavenumber = grid.range_wavenumbers
        n_bins, polar = len(self._wavenumber), grid.polar
        check_memory(IMAGE_BYTES * (2 * grid.n_fine * n_bins
                                    + 2 * polar.n_alpha * grid.n_fine_range),
                     f'a fused spectrum of {n_bins} x {grid.n_fine} samples and its image',
                     "cut the grid into smaller ones, or use backend='cpu'")
        taper = (guard_taper(grid.n_coarse, grid.n_guard, grid.beta),
                 guard_taper(grid.n_coarse_range, grid.range_guard, grid.beta))
        self._taper = [xp.asarray(v.astype(np.float32)) for v in taper]
        self._wavenumbers = xp.asarray(self._wavenumber.astype(np.float64))
        self._contributions: dict[int, tuple[np.ndarray, float] | None] = {}  # None if not kept
        self._spectrum = None

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""
        return frozenset(self._contributions)

    @reports_failures
    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """Add a sub-aperture, or replace it; see `backends.protocol.SpectrumFusion`."""
        self.grid.check_contribution(image, centre_m)
        if number in self._contributions and not self._keep:
            raise ValueError(f'sub-aperture {number} is in the image already; fuse with keep=True '
                             'to replace contributions')
        there = xp.asarray(taken(image))
        if there.dtype.kind == 'c':
            there = xp.stack([there.real, there.imag])
        self._add([number], xp.ascontiguousarray(there, np.float32)[None], [centre_m])

    @reports_failures
    def add_all(self, numbers: Sequence[int], images: np.ndarray, centres_m: Sequence[float]
                ) -> None:
        """Add sub-apertures that are not in the image, (G, 2, n_alpha, n_range) of the device."""
        self._add(numbers, images, centres_m)

    def _add(self, numbers: Sequence[int], images: np.ndarray, centres_m: Sequence[float]) -> None:
        n, _, n_lines, n_ranges = images.shape
        tapered = xp.empty((n, n_lines, n_ranges), np.complex64)
        launch(taper_images, (-(-n_ranges // _THREADS), n_lines, n), _THREADS, images,
               *self._taper, pairs(tapered))
        folded = xp.fft.fft2(tapered).astype(np.complex64, copy=False)
        if self._keep:
            self._spectrum = None
            for number, one, centre_m in zip(numbers, folded, centres_m, strict=True):
                self._contributions[number] = one[None], centre_m
        else:
            self._add_bands(folded, centres_m)
            self._contributions.update(dict.fromkeys(numbers))

    def remove(self, number: int) -> None:
        """Take a sub-aperture out of the image; see `backends.protocol.SpectrumFusion`."""
        if not self._keep or number not in self._contributions:
            raise ValueError(f'sub-aperture {number} cannot be removed: ' + (
                'it is not in the image' if self._keep else 'contributions are not kept'))
        del self._contributions[number]
        self._spectrum = None

    @reports_failures
    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """Image of what was added so far; see `backends.protocol.SpectrumFusion`."""
        grid, polar, n_bins = self.grid, self.grid.polar, len(self._wavenumber)
        spectrum = self._fused()
        if grid.between is not None:
            cycles = np.fft.fftfreq(grid.n_fine) - 2 * centre_m * (
                polar.alpha_spacing / grid.wavelength_m)
            gain = grid.between.gain(cycles - np.rint(cycles)).astype(np.float32)
            spectrum = spectrum * xp.asarray(gain)[:, None]
        lines = xp.fft.ifft(spectrum, axis=0, norm='forward')
        lines = lines[grid.fine_guard:grid.fine_guard + polar.n_alpha]
        whole = xp.zeros((polar.n_alpha, grid.n_fine_range), np.complex64)
        whole[:, :n_bins - n_bins // 2] = lines[:, n_bins // 2:]
        if n_bins > 1:
            whole[:, -(n_bins // 2):] = lines[:, :n_bins // 2]
        image = xp.fft.ifft(whole, axis=1, norm='forward')
        image = image[:, grid.fine_range_guard:][:, :polar.n_range]
        # sub-aperture images have their phase from where the guards begin
        cycles = 2 * grid.fine_range_guard * polar.range_spacing_m / grid.wavelength_m
        cycles = cycles - 2 * centre_m * (polar.alpha - polar.alpha_start) / grid.wavelength_m
        scale = np.exp(2j * np.pi * np.fmod(cycles, 1.0)) / (grid.n_coarse * grid.n_coarse_range)
        image = image * xp.asarray(scale.astype(np.complex64))[:, None]
        return given(xp.stack([image.real, image.imag]).astype(np.float32, copy=False))

    def take_polar_image(self) -> np.ndarray:
        """As `polar_image`; nothing is included any more."""
        image = self.polar_image()
        self.clear()
        return image

    def clear(self) -> None:
        """Begin another aperture on the same grid: nothing is included any more."""
        self._contributions, self._spectrum = {}, None

    def _fused(self) -> np.ndarray:
        """(n_fine, K) complex64 spectrum."""
        if self._spectrum is None:
            self._spectrum = xp.zeros((self.grid.n_fine, len(self._wavenumber)), np.complex64)
            for number in sorted(self._contributions):
                folded, centre_m = self._contributions[number]
                self._add_bands(folded, [centre_m])
        return self._spectrum

    def _add_bands(self, folded: np.ndarray, centres_m: Sequence[float]) -> None:
        """Add bands that coarse spectra (G, n_coarse, n_coarse_range) hold folded."""
        if self._spectrum is None:
            self._spectrum = xp.zeros((self.grid.n_fine, len(self._wavenumber)), np.complex64)
        grid, n_bins = self.grid, len(self._wavenumber)
        centres = np.array(centres_m, np.float64) * (grid.extent / (2 * math.pi))
        first = np.floor(np.multiply.outer(centres, self._wavenumber[[0, -1]]) + 0.5)
        lowest = int(first.min()) - grid.n_coarse // 2
        n_rows = min(int(first.max() - first.min()) + grid.n_coarse, grid.n_fine)
        launch(add_bands, (-(-n_bins // _THREADS), n_rows), _THREADS,
               pairs(xp.ascontiguousarray(folded)), grid.n_coarse, grid.n_coarse_range,
               xp.asarray(centres), self._wavenumbers, lowest, self._spectrum)


@reports_failures
def form_map(polar_image: np.ndarray, fusion: UnifiedPolarGrids, grid: MapGrid,
             centre_m: float = 0.0, *, overwrite: bool = False) -> np.ndarray:
    """Interpolate a fused image to a map, see `backends.protocol.Backend`.

    The map is an array of the device, and has memory of its own.
    """
    fusion.check_for_map()
    along = design_interpolator(fusion.range_oversampling, taps=TAPS, degree=DEGREE)
    image = xp.zeros(grid.shape, np.complex64)
    polar_to_map(xp.ascontiguousarray(xp.asarray(taken(polar_image))), fusion.polar, grid, image,
                 axis=range_axis(fusion.polar, grid), wavelength_m=fusion.wavelength_m,
                 between=fusion.between, along=along,
                 cycles_per_alpha=2 * centre_m / fusion.wavelength_m)
    return given(image)
