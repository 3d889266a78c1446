# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range profiles on the range grid that backprojection reads, on the device."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ...planning.interpolators import LINE_DEGREE, TAPS
from ...planning.profiles import PhaseHistory, RangeGate, RangeResampling, rise
from .arrays import (
    check_memory,
    complex_samples,
    cuda,
    free_bytes,
    kernel,
    launch,
    load_pair,
    pairs,
    store_pair,
    xp,
)

_GUARD = 8  # range cells beyond the ranges of the image
_MOST_BYTES, _SHARE = 1 << 30, 4  # of polynomials at once, and of the free memory one part in so
_THREADS = 128
_TAPS, _MOST_WEIGHTS = TAPS, TAPS * (LINE_DEGREE + 1)


def profile_spectra(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int
                    ) -> np.ndarray:
    """Fourier coefficients of what an image needs of some profiles, bin 0 first.

    `backends.reference.resample_profiles.profile_spectra` has the formula; the gain is left out.

    Parameters
    ----------
    source : RangeGate or PhaseHistory
        What is needed of the profiles.
    samples : (R, K) complex64 array of the device
        Profiles, or phase histories.
    n_padded : int
        Samples with zeros behind them; K for phase histories.

    Returns
    -------
    (R, n_padded) complex64
    """
    if source.periodic:
        return samples
    window = np.ones(source.n_samples, np.float32)
    if source.n_rise:
        window[:source.n_rise] = rise(source.n_rise)
    if source.n_fall:
        window[-source.n_fall:] = rise(source.n_fall)[::-1]
    lead = max(-source.first, 0)
    cut = xp.pad(samples, ((0, 0), (lead, 0)))[:, source.first + lead:] if lead else (
        samples[:, source.first:])
    cut = cut[:, :source.n_samples] * xp.asarray(window)
    return xp.fft.fft(cut, n_padded, axis=-1).astype(np.complex64, copy=False)


def pad_band(spectrum: np.ndarray, zero: int, gain: np.ndarray, n_out: int) -> np.ndarray:
    """Spectra times the gain, with zeros between positive and negative frequencies or cropped.

    Positive frequencies start at bin `zero` of the spectra (R, N), negative ones end before it;
    returns (R, n_out) complex64.
    """
    n_echoes, n = spectrum.shape
    keep = min(n, n_out)
    upper, lower, negative = (keep + 1) // 2, keep // 2, (zero - keep // 2) % n
    padded = xp.zeros((n_echoes, n_out), np.complex64)
    padded[:, :upper] = spectrum[:, zero:zero + upper] * gain[zero:zero + upper]
    if lower:
        padded[:, -lower:] = (spectrum[:, negative:negative + lower]
                              * gain[negative:negative + lower])
    return padded


class Profiles:
    """Range profiles of one radar on a range grid, for the ranges that an image can reach.

    Parameters
    ----------
    source : RangeGate or PhaseHistory
        What the profiles are made of; `resampling` was planned for as many samples.
    resampling : RangeResampling
        How they are read.
    range_m : (float, float)
        Half paths that are read, metres.
    fold : int
        Power of 2 of the cells of a block, within which each coefficient of all cells stands
        together; 0 for the coefficients of each cell side by side.
    """

    def __init__(self, source: RangeGate | PhaseHistory, resampling: RangeResampling,
                 range_m: tuple[float, float], fold: int = 0):
        self.resampling, self._source, self._fold = resampling, source, fold
        self._pad = max(resampling.segment, _GUARD)
        lo, hi = ((r - source.range_start_m) / resampling.cell_m for r in range_m)
        if not source.periodic:
            lo, hi = max(lo, 0), min(hi, resampling.n_cells)
        self._first = math.floor(lo) - _GUARD - self._pad
        n_cells = math.ceil(hi) + _GUARD + self._pad - self._first
        self.n_cells = -(-n_cells >> fold) << fold
        self._gain = xp.asarray(source.gain(resampling.n_padded,
                                            resampling.oversampling(source.radar)))
        self._weights = xp.asarray(resampling.interpolator.weights)

    @property
    def wavelength_m(self) -> float:
        """Of the carrier, metres."""
        return self._source.radar.wavelength_m

    @property
    def cycles_per_step(self) -> float:
        """Carrier phase per range step, cycles."""
        return 2 * self.resampling.step_m / self.wavelength_m

    def range_at(self, cell: int) -> float:
        """Half path at a cell of the planes, metres."""
        return self._source.range_start_m + (self._first + cell) * self.resampling.cell_m

    def cycles_at(self, cell: int) -> float:
        """Carrier phase at a cell of the planes, fraction of a cycle."""
        path_m = self.range_at(cell) - self._source.phase_range_m
        return math.fmod(2 * path_m / self.wavelength_m, 1.0)

    def chunks(self, n_echoes: int, together: int, more_bytes: int = 0) -> Iterator[slice]:
        """Slices of echoes, a multiple of `together`, whose polynomials fit the memory.

        `more_bytes` are what else an echo takes there.
        """
        resampling = self.resampling
        dense = resampling.n_cells * resampling.n_phases
        echo_bytes = (4 * resampling.interpolator.n_planes * resampling.n_phases * self.n_cells
                      + 8 * (5 * resampling.n_padded + 3 * dense)  # with copies and transforms
                      + more_bytes)
        echoes = min(_MOST_BYTES, free_bytes() // _SHARE) // echo_bytes
        if not echoes // together:
            check_memory(min(together, n_echoes) * echo_bytes,
                         f'one pass of {together} range profiles', "use backend='cpu'")
        step = max(echoes // together, 1) * together
        return (slice(lo, min(lo + step, n_echoes)) for lo in range(0, n_echoes, step))

    def planes(self, samples: np.ndarray) -> np.ndarray:
        """Polynomial coefficients of some profiles.

        Parameters
        ----------
        samples : (R, N) complex64, or (R, N, 2) integer
            Profiles, or phase histories, of the host or of the device.

        Returns
        -------
        (R, U, n / B, degree + 1, B) complex64 array of the device
            Coefficients of each phase and cell, in blocks of B cells.
        """
        resampling, source, n_echoes = self.resampling, self._source, len(samples)
        n_powers, n_phases = len(resampling.interpolator.weights), resampling.n_phases
        spectrum = profile_spectra(source, complex_samples(samples), resampling.n_padded)
        padded = pad_band(spectrum, source.zero, self._gain, resampling.n_cells * n_phases)
        dense = xp.fft.ifft(padded, axis=-1, norm='forward').astype(np.complex64, copy=False)
        planes = xp.empty((n_echoes, n_phases, self.n_cells >> self._fold, n_powers,
                           1 << self._fold), np.complex64)
        launch(farrow_coefficients, (-(-self.n_cells // _THREADS), n_phases, n_echoes), _THREADS,
               pairs(dense), dense.shape[1], self._weights, self._first,
               resampling.interpolator.first, self._pad, source.periodic, self.n_cells, n_phases,
               self._fold, pairs(planes))
        return planes


@kernel()
def farrow_coefficients(dense, length, weights, first_cell, first, pad, periodic, n_cells,
                        n_phases, fold, planes):
    """Coefficients of each interval of a range grid; a grid of (cells, phases, echoes).

    ``c_q = sum_k weights[q, k] s[U cell + phase + first + k]`` (`Interpolator`).

    Parameters
    ----------
    dense, length : pairs, int
        Profiles at all positions of the range grid, from its cell 0 on: echo by echo so many.
    weights : (degree + 1, TAPS) float32
        Weights of the neighbours in each coefficient.
    first_cell, first, pad : int
        Cell of the range grid that is cell 0 of `planes`; offset of the first neighbour; cells at
        both ends of `planes` that are zero.
    periodic : bool
        The profiles repeat; they are zero beyond their ends otherwise.
    n_cells, n_phases, fold : int
        n, U, and the power of 2 of the cells of a block.
    planes : pairs
        Coefficients, as `Profiles.planes` has them.
    """
    shared = cuda.shared.array(_MOST_WEIGHTS, np.float32)
    real = cuda.local.array(_TAPS, np.float32)
    imag = cuda.local.array(_TAPS, np.float32)
    thread, phase, echo = cuda.threadIdx.x, cuda.blockIdx.y, cuda.blockIdx.z
    n_powers = weights.shape[0]
    for k in range(thread, n_powers * _TAPS, cuda.blockDim.x):
        shared[k] = weights[k // _TAPS, k % _TAPS]
    cuda.syncthreads()
    cell = cuda.blockIdx.x * cuda.blockDim.x + thread
    if cell >= n_cells:
        return
    at, begins = (first_cell + cell) * n_phases + phase + first, echo * length
    if periodic:
        at %= length
    for k in range(_TAPS):
        real[k], imag[k] = np.float32(0.0), np.float32(0.0)
        if pad <= cell < n_cells - pad and 0 <= at < length:
            real[k], imag[k] = load_pair(dense, np.uint64(begins + at))
        at += 1
        if periodic and at == length:
            at = 0
    block = (echo * n_phases + phase) * (n_cells >> fold) + (cell >> fold)
    out = (block * n_powers << fold) + (cell & ((1 << fold) - 1))
    for q in range(n_powers):
        re, im = np.float32(0.0), np.float32(0.0)
        for k in range(_TAPS):
            w = shared[np.uint64(q * _TAPS + k)]
            re += w * real[k]
            im += w * imag[k]
        store_pair(planes, np.uint64(out + (q << fold)), re, im)
