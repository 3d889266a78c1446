# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Second stage of AFBP: sub-aperture images fused by their spectra, and read onto a map.

Zhang et al., section II.B; `backends.reference.fuse_bands` has the formulas. Unfolding the bands
that coarse images hold folded, and adding them in the spectrum of the full aperture, interpolates
and sums all images at once. What is done with a line before and after its transform is done while
the line is in cache.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...compilation import DETERMINISTIC, njit, numba
from ...geometry.grids import MapGrid
from ...planning.afbp.polar_grids import UnifiedPolarGrids
from ...planning.aliasing_error import guard_taper
from ...planning.interpolators import design_interpolator
from ...planning.polar_cover import DEGREE, TAPS, range_axis
from . import fft
from .beams import fetch
from .fft import (
    GROUP_BYTES,
    LANES,
    SAMPLE_BYTES,
    panel_groups,
    plan_row,
    rows_to_transform,
    transform_columns,
    transform_row,
    transform_rows,
)
from .instructions import job_counter, take_job
from .memory import aligned_empty, aligned_zeros
from .phasors import cos_cycles, fraction, sin_cycles
from .polar_to_map import polar_to_map

_AHEAD = 2  # rows of a panel, whose place in the spectrum is fetched before they are added


class Band(NamedTuple):
    """Which range wavenumbers of a spectrum the angular ones of a band take."""

    row: int  # first angular wavenumber
    begin: np.ndarray  # (rows,) int64
    end: np.ndarray

    @classmethod
    def whole(cls, n_fine: int, n_bins: int) -> Band:
        """All range wavenumbers of all angular ones."""
        return cls(0, np.zeros(n_fine, np.int64), np.full(n_fine, n_bins))


def add_transformed(lines: np.ndarray, n_bins: int, band: Band, rows: np.ndarray,
                    spectrum: np.ndarray) -> None:
    """Transform lines along direction and add them to their band of a spectrum.

    While the transform of some columns is in a core's cache, it is added; what becomes of the
    lines is not said.

    Parameters
    ----------
    lines, n_bins : (n_coarse, width) complex64, int
        As `transform_columns` wants them; the first `n_bins` columns are range wavenumbers.
    band : Band
        Angular wavenumber n of the spectrum takes n mod n_coarse of the lines.
    rows : (n_fine,) int64
        Row of `spectrum` in which each angular wavenumber lies.
    spectrum : (n_fine, at least n_bins) complex64
        Added to; contiguous.
    """
    n_coarse = len(lines)
    groups = panel_groups(n_coarse)
    if groups is None:  # of no use, or too long for it
        transform_columns(lines, n_bins)
        add_band(lines, *band, *Band.whole(len(spectrum), n_bins), rows, spectrum)
        return
    row_bytes, panel_bytes = lines.strides[0], (groups + 1) * GROUP_BYTES
    plan = fft.plan_passes(n_coarse, False, row_bytes, panel_bytes, panel_bytes, True)
    work = aligned_empty((numba.get_num_threads(), 2, n_coarse * panel_bytes // 4), np.float32)
    jobs = job_counter()
    _add_transformed(fft.compiled_passes(), lines.ctypes.data, (n_coarse, n_bins, groups),
                     jobs.ctypes.data, work.reshape(-1), work.ctypes.data, work.strides[0],
                     plan.addresses, *band, rows, spectrum.reshape(-1).view(np.float32))


@njit(parallel=True, fastmath=DETERMINISTIC)
def _add_transformed(code, lines, shape, jobs, work, address, work_bytes, plan, row, begin, end,
                     rows, spectrum):
    """Arrays are flat float32, for the compiler; a task has work space, then a panel."""
    n_coarse, n_bins, groups = shape
    n_fine, n_columns = len(rows), groups * LANES
    width, pitch = len(spectrum) // len(rows), (groups + 1) * GROUP_BYTES // 4
    n_tasks, n_panels = 4 * len(work) // work_bytes, (n_bins + n_columns - 1) // n_columns
    table, twiddles = plan
    for task in numba.prange(n_tasks):
        space = address + task * work_bytes
        panel = np.uint64(task * work_bytes // 4 + n_coarse * pitch)
        job = take_job(jobs)
        while job < n_panels:
            first = job * n_columns
            last = min(first + n_columns, n_bins)
            fft.run_passes(code, lines + first * SAMPLE_BYTES, space, space + work_bytes // 2,
                           (last - first + LANES - 1) // LANES, table, twiddles, 0)
            for k in range(len(begin)):
                ahead = min(k + _AHEAD, len(begin) - 1)
                if begin[ahead] < last and end[ahead] > first:
                    fetch(spectrum, np.uint64(rows[(row + ahead) % n_fine] * width + 2 * first),
                          np.uint64(2 * (last - first)))
                low, high = max(begin[k], first), min(end[k], last)
                source = panel + np.uint64((row + k) % n_coarse * pitch + 2 * (low - first))
                target = np.uint64(rows[(row + k) % n_fine] * width + 2 * low)
                for i in range(np.uint64(2 * max(high - low, 0))):
                    spectrum[target + i] += work[source + i]
            job = take_job(jobs)


@njit(parallel=True)
def add_band(lines, row, begin, end, within_row, within_begin, within_end, rows, spectrum):
    """Add transformed lines to their band, within another one."""
    n_coarse, n_fine = lines.shape[0], spectrum.shape[0]
    for k in numba.prange(min(len(begin), n_fine)):  # bands repeat with the grid
        target = rows[(row + k) % n_fine]
        for n in range(k, len(begin), n_fine):
            source = (row + n) % n_coarse
            for m in range((row + n - within_row) % n_fine, len(within_begin), n_fine):
                first = max(begin[n], within_begin[m])
                last = min(end[n], within_end[m])
                for b in range(first, last):
                    spectrum[target, b] += lines[source, b]


@njit(parallel=True)
def clear_band(row, begin, end, rows, spectrum):
    """Set a band of a spectrum to zero."""
    n_fine = spectrum.shape[0]
    for k in numba.prange(min(len(begin), n_fine)):
        target = rows[(row + k) % n_fine]
        for n in range(k, len(begin), n_fine):
            for b in range(begin[n], end[n]):
                spectrum[target, b] = 0.0


_NOTHING = (0,) * 10  # in place of a plan


def fold_lines(image: np.ndarray, along_alpha: np.ndarray, along_range: np.ndarray,
               rows: np.ndarray, out: np.ndarray) -> None:
    """Taper a sub-aperture image and transform it along range.

    Parameters
    ----------
    image :
        As for `backends.protocol.SpectrumFusion.add`.
    along_alpha, along_range : (n_coarse,) float32, (n_range,) complex64
        Taper of each line, and of each range with a phase.
    rows : (n_coarse,) int64
        Row of `out` in which the spectrum of each line is wanted.
    out : (n_coarse, at least n_range) complex64
        Written to; contiguous. What lies beyond the n_range wavenumbers is zero.
    """
    plan = plan_row(len(along_range), False)
    arguments, n_work = (_NOTHING, 1) if plan is None else (plan.arguments, plan.work_samples)
    work, jobs = aligned_empty((numba.get_num_threads(), n_work), np.complex64), job_counter()
    image = np.ascontiguousarray(image)
    _fold_lines(image.view(np.float32).reshape(-1), int(image.ndim == 3), along_alpha,
                along_range.view(np.float32), rows, out.view(np.float32).reshape(-1),
                out.shape[1], out.ctypes.data, work.ctypes.data, work.strides[0], len(work),
                jobs.ctypes.data, arguments)
    if plan is None:
        transform_rows(out[:, :len(along_range)])


def finish_lines(spectrum: np.ndarray, n_bins: int, n_range: int, first: int, scale: np.ndarray,
                 phasor: np.ndarray, out: np.ndarray) -> None:
    """Transform rows of the fused spectrum to lines of the image.

    Parameters
    ----------
    spectrum : (L, at least n_bins) complex64
        Rows, transformed along direction; contiguous.
    n_bins, n_range, first : int
        Range wavenumbers, from the lowest one; length of the transform; range at which the wanted
        ones begin.
    scale, phasor : (L,) and (N,) complex64
        Factors of each line, and of each wanted range.
    out : (L * 2 * N,) float32
        Real, then imaginary parts of each line; none of the rows lie in it.
    """
    plan = plan_row(n_range, True)
    if plan is None:
        lines = np.zeros((len(spectrum), n_range), np.complex64)
        lines[:, :n_bins] = spectrum[:, :n_bins]
        transform_rows(lines, inverse=True)
        lines = lines[:, first:first + len(phasor)] * (scale[:, None] * phasor)
        out[:] = np.stack([lines.real, lines.imag], axis=1).ravel()
        return
    n_tasks, jobs = numba.get_num_threads(), job_counter()
    # rows apart by no multiple of 4 KiB
    work = aligned_empty((n_tasks, n_range + 8 + plan.work_samples), np.complex64)
    _finish_lines(spectrum.view(np.float32).reshape(-1), spectrum.shape[1], n_bins, n_range,
                  first, scale.view(np.float32), phasor.view(np.float32), out,
                  work.view(np.float32).reshape(-1), work.ctypes.data, work.strides[0], n_tasks,
                  jobs.ctypes.data, plan.arguments)


@njit(parallel=True)
def _fold_lines(image, planes, along_alpha, along_range, rows, out, width, address, work,
                work_bytes, n_tasks, jobs, plan):
    """Arrays are flat float32, for the compiler."""
    n_lines, n = len(along_alpha), np.uint64(len(along_range) // 2)
    apart = np.uint64(n_lines) * n
    for task in numba.prange(n_tasks):
        line = take_job(jobs)
        while line < n_lines:
            w, row = along_alpha[line], rows[line]
            first, to = np.uint64(line) * n, np.uint64(2 * row * width)
            if planes:
                _taper(image, first, np.uint64(1), apart, w, along_range, n, out, to)
            else:
                _taper(image, np.uint64(2) * first, np.uint64(2), np.uint64(1), w, along_range, n,
                       out, to)
            for i in range(to + np.uint64(2) * n, to + np.uint64(2 * width)):
                out[i] = 0.0
            if plan[0]:
                transform_row(address + row * width * SAMPLE_BYTES, work + task * work_bytes, plan)
            line = take_job(jobs)


@njit(inline='always')
def _taper(image, place, step, imag, w, along_range, n, out, to):
    for i in range(n):
        even, odd = np.uint64(2) * i, np.uint64(2) * i + np.uint64(1)
        x, y = w * image[place + step * i], w * image[place + step * i + imag]
        out[to + even] = along_range[even] * x - along_range[odd] * y
        out[to + odd] = along_range[even] * y + along_range[odd] * x


@njit(parallel=True)
def _finish_lines(spectrum, row, n_bins, n_range, first, scale, phasor, out, lines, address,
                  work_bytes, n_tasks, jobs, plan):
    """All arrays are flat float32, for the compiler; a task's line comes before its work space."""
    n, n_lines = np.uint64(len(phasor) // 2), len(scale) // 2
    for task in numba.prange(n_tasks):
        line = np.uint64(task * (work_bytes // 4))
        number = take_job(jobs)
        while number < n_lines:
            source = np.uint64(2 * number * row)
            for i in range(np.uint64(2 * n_bins)):
                lines[line + i] = spectrum[source + i]
            for i in range(np.uint64(2 * n_bins), np.uint64(2 * n_range)):
                lines[line + i] = 0.0
            place = address + task * work_bytes
            transform_row(place, place + (n_range + 7) // 8 * 8 * SAMPLE_BYTES, plan)
            a, b = scale[2 * number], scale[2 * number + 1]
            begin, to = line + np.uint64(2 * first), np.uint64(2 * number) * n
            for i in range(n):
                even, odd = np.uint64(2) * i, np.uint64(2) * i + np.uint64(1)
                c, d = a * phasor[even] - b * phasor[odd], a * phasor[odd] + b * phasor[even]
                x, y = lines[begin + even], lines[begin + odd]
                out[to + i] = c * x - d * y
                out[to + n + i] = c * y + d * x
            number = take_job(jobs)


_LINES_PER_CALL = 32  # of the fused image


class SpectrumFusion:
    """Fuse sub-aperture images that share a grid, see `backends.protocol.SpectrumFusion`.

    Where contributions are kept, removing and replacing leave no rounding behind: wavenumbers
    that a change concerns are summed again from the contributions, the others stay as they are.
    That takes about two to three times the memory of the fused spectrum more.
    """

    def __init__(self, grid: UnifiedPolarGrids, *, keep: bool = False):
        self.grid, self._keep = grid, keep
        n_coarse, n_fine = grid.n_coarse_range, grid.n_fine_range
        self._wavenumber = grid.range_wavenumbers
        self._shape = grid.n_fine, len(self._wavenumber)
        most = len(self._wavenumber) // 2
        # Times this along range, images have the lowest wavenumber at zero.
        phasor = np.exp(2j * np.pi * (most * np.arange(n_coarse) % n_coarse) / n_coarse)
        self._taper = (guard_taper(grid.n_coarse, grid.n_guard, grid.beta).astype(np.float32),
                       (guard_taper(n_coarse, grid.range_guard, grid.beta) * phasor
                        ).astype(np.complex64))
        self._coarse_rows = rows_to_transform(grid.n_coarse)
        self._fine_rows = rows_to_transform(grid.n_fine)
        place = grid.fine_range_guard + np.arange(grid.polar.n_range)
        self._phasor_back = np.exp(-2j * np.pi * (most * place % n_fine) / n_fine
                                 ).astype(np.complex64)
        # kept from one sub-aperture to the next: fresh memory takes as long as the work
        self._lines = aligned_empty((grid.n_coarse, _padded(n_coarse)), np.complex64)
        self._memory: np.ndarray | None  # of the spectrum and, in its place, the image
        self._contributions: dict[int, tuple[np.ndarray, Band] | None]  # None if not kept
        self._changed: list[Band]  # that came or went
        self.clear()

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""
        return frozenset(self._contributions)

    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """Add a sub-aperture, or replace it; see `backends.protocol.SpectrumFusion`."""
        self.grid.check_contribution(image, centre_m)
        if number in self._contributions and not self._keep:
            raise ValueError(f'sub-aperture {number} is in the image already; fuse with keep=True '
                             'to replace contributions')
        fold_lines(image, *self._taper, self._coarse_rows, self._lines)
        n_bins, band = len(self._wavenumber), self._band(centre_m)
        if self._keep:
            if number in self._contributions:
                self.remove(number)
            transform_columns(self._lines, n_bins)
            self._contributions[number] = self._lines[:, :n_bins].copy(), band
            self._changed.append(band)
        else:
            add_transformed(self._lines, n_bins, band, self._fine_rows, self._whole())
            self._contributions[number] = None

    def remove(self, number: int) -> None:
        """Take a sub-aperture out of the image; see `backends.protocol.SpectrumFusion`."""
        if not self._keep or number not in self._contributions:
            raise ValueError(f'sub-aperture {number} cannot be removed: ' + (
                'it is not in the image' if self._keep else 'contributions are not kept'))
        self._changed.append(self._contributions.pop(number)[1])

    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """Image of what was added so far; see `backends.protocol.SpectrumFusion`."""
        fused = self._fused()
        memory = aligned_empty(self._memory.shape, np.complex64)
        self._spectrum(memory)[:] = fused
        return self._to_image(memory, centre_m)

    def take_polar_image(self) -> np.ndarray:
        """As `polar_image`, in less memory: the fused spectrum is used up."""
        self._fused()
        image = self._to_image(self._memory)
        self.clear()
        return image

    def clear(self) -> None:
        """Begin another aperture on the same grid: nothing is included any more."""
        self._memory, self._contributions, self._changed = None, {}, []

    def _whole(self) -> np.ndarray:
        """Spectrum, with memory before it for the image.

        Line l of the image is written over from ``l n_range`` on, while line l of the spectrum,
        which it is made from, begins at ``ahead + (guard + l) n_padded``. The first must end
        before the second begins, for l up to the lines of a call further on:
        ``ahead >= n_alpha n_range - (guard + n_alpha) n_padded + lines n_range``.
        """
        if self._memory is None:
            polar, (n_fine, n_bins) = self.grid.polar, self._shape
            # Lines of the image may be longer than those of the spectrum that they replace, and
            # those of a call replace none that the call has still to read.
            ahead = _padded(max(0, polar.n_alpha * polar.n_range
                                - (self.grid.fine_guard + polar.n_alpha) * _padded(n_bins))
                            + _LINES_PER_CALL * polar.n_range)
            self._memory = aligned_zeros((ahead + n_fine * _padded(n_bins),), np.complex64)
        return self._spectrum(self._memory)

    def _spectrum(self, memory: np.ndarray) -> np.ndarray:
        """(n_fine, range wavenumbers, padded) at the end, rows in the order of their transform."""
        n_fine, n_bins = self._shape
        return memory[-n_fine * _padded(n_bins):].reshape(n_fine, -1)

    def _fused(self) -> np.ndarray:
        spectrum, n_coarse, n_fine = self._whole(), self.grid.n_coarse, self.grid.n_fine
        if not self._keep:
            return spectrum
        if n_coarse > n_fine or len(self._changed) * n_coarse > n_fine:
            self._changed = [Band.whole(*self._shape)]
        for band in self._changed:
            clear_band(*band, self._fine_rows, spectrum)
            # in the order of a sum of all
            for number in sorted(self._contributions):
                folded, other = self._contributions[number]
                add_band(folded, *other, *band, self._fine_rows, spectrum)
        self._changed = []
        return spectrum

    def _band(self, centre_m: float) -> Band:
        """Where a band lies, as `backends.reference.fuse_bands` says.

        As its middle only grows with the range wavenumber, or only falls where x_u is negative,
        an angular bin has range wavenumbers without gap.
        """
        n_coarse, n_bins = self.grid.n_coarse, len(self._wavenumber)
        middle = np.rint(self._wavenumber * (centre_m * self.grid.extent / (2 * math.pi)))
        first = middle.astype(np.int64) - n_coarse // 2
        ascending = first if centre_m >= 0 else first[::-1]
        row = np.arange(ascending[0], ascending[-1] + n_coarse)
        begin, end = (np.searchsorted(ascending, r, 'right') for r in (row - n_coarse, row))
        if centre_m < 0:
            begin, end = n_bins - end, n_bins - begin
        return Band(int(row[0]), begin, end)

    def _to_image(self, memory: np.ndarray, centre_m: float = 0.0) -> np.ndarray:
        """Image of a spectrum, over which it is written line by line."""
        grid, n_bins = self.grid, len(self._wavenumber)
        polar = grid.polar
        spectrum = self._spectrum(memory)
        gain = None
        if grid.between is not None:
            middle = centre_m * polar.alpha_spacing * 2 / grid.wavelength_m
            cycles = np.arange(grid.n_fine) / grid.n_fine - middle
            gain = grid.between.gain(cycles - np.rint(cycles))
        transform_columns(spectrum, n_bins, inverse=True, gain=gain)
        # Guards moved the first range; the carrier is referred to that of the wanted grid.
        cycles = 2 * grid.fine_range_guard * polar.range_spacing_m / grid.wavelength_m
        cycles -= 2 * centre_m / grid.wavelength_m * (polar.alpha - polar.alpha_start)
        scale = np.exp(2j * np.pi * np.fmod(cycles, 1.0)) / (grid.n_coarse * grid.n_coarse_range)
        scale = scale.astype(np.complex64)
        image = memory[:polar.n_alpha * polar.n_range].view(np.float32)
        width = 2 * polar.n_range
        for start in range(0, polar.n_alpha, _LINES_PER_CALL):
            stop = min(start + _LINES_PER_CALL, polar.n_alpha)
            finish_lines(spectrum[grid.fine_guard + start:grid.fine_guard + stop], n_bins,
                         grid.n_fine_range, grid.fine_range_guard, scale[start:stop],
                         self._phasor_back, image[start * width:stop * width])
        return image.reshape(polar.n_alpha, 2, polar.n_range).swapaxes(0, 1)


def _padded(n: int) -> int:
    return -(-n // LANES) * LANES


def form_map(polar_image: np.ndarray, fusion: UnifiedPolarGrids, grid: MapGrid,
             centre_m: float = 0.0, *, overwrite: bool = False) -> np.ndarray:
    """Interpolate a fused image to a map, see `backends.protocol.Backend`.

    With `overwrite` the polar image becomes the memory of the map, where range follows x and the
    map is not much finer than the polar image; otherwise the map gets memory of its own.
    """
    fusion.check_for_map()
    along = design_interpolator(fusion.range_oversampling, taps=TAPS, degree=DEGREE)
    image = polar_to_map(polar_image, fusion.polar, grid, axis=range_axis(fusion.polar, grid),
                         wavelength_m=fusion.wavelength_m, between=fusion.between, along=along,
                         overwrite=overwrite)
    if centre_m:
        polar = fusion.polar
        _restore_carrier(grid.x_m - polar.origin_m[0], grid.y_m - polar.origin_m[1],
                         polar.height_m ** 2, *polar.track, polar.alpha_start,
                         2 * centre_m / fusion.wavelength_m, image)
    return image


@njit(parallel=True)
def _restore_carrier(x, y, height2, along_x, along_y, alpha_start, cycles_per_alpha, image):
    """Put the carrier along direction back."""
    for row in numba.prange(image.shape[0]):
        beside2, along = y[row] * y[row] + height2, y[row] * along_y
        for i in range(image.shape[1]):
            alpha = (x[i] * along_x + along) / np.sqrt(x[i] * x[i] + beside2)
            c = fraction(cycles_per_alpha * (alpha - alpha_start))
            sine, cosine = sin_cycles(c, c * c), cos_cycles(c * c)
            z = image[row, i]
            image[row, i] = complex(z.real * cosine - z.imag * sine,
                                    z.real * sine + z.imag * cosine)
