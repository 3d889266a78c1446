# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range profiles on the range grid that backprojection reads: resampled, and as polynomials.

The polynomials are those of `planning.interpolators` (Farrow 1988).
"""

from __future__ import annotations

import math

import numpy as np
from llvmlite import ir
from numba.core import types

from ...compilation import njit, numba
from ...planning.interpolators import TAPS
from ...planning.profiles import PhaseHistory, RangeGate, RangeResampling, rise
from ...signal.radar import RadarParameters
from .fft import transform_rows
from .instructions import FLOAT, INT, LANES, Vector, instructions
from .memory import WorkSpace

_i = types.int64
_FLOATS = ir.VectorType(FLOAT, LANES)


@instructions(_i, _i, _i, None, _i, _i, _i, _i)
def weigh_samples(b, samples, imaginary, weights, degrees, begin, end, target, plane_bytes):
    """Coefficients of intervals, LANES at a time: real, then imaginary ones, `plane_bytes` apart.

    `samples` is the address of the table of those of the TAPS neighbours of interval 0,
    `imaginary` the bytes from a real part to its imaginary one; `weights` are (degree + 1, TAPS)
    float32, and the tuple `degrees` is as long as their degree. Vectors begin with interval
    `begin`, and before `end`.
    """
    n = degrees.type.count + 1
    neighbours = [b.load(b.pointer(samples, INT, 8 * k)) for k in range(TAPS)]
    before, loop, behind = b.block, b.append_basic_block(), b.append_basic_block()
    b.branch(loop)
    b.position_at_end(loop)
    interval = b.phi(INT)
    shift = b.mul(interval, INT(4))
    sums = [None] * (2 * n)
    for k, neighbour in enumerate(neighbours):
        place = b.add(neighbour, shift)
        parts = [Vector(b, b.load(b.pointer(at, _FLOATS), align=4))
                 for at in (place, b.add(place, imaginary))]
        for q in range(n):
            w = b.spread(b.load(b.pointer(weights, FLOAT, 4 * (TAPS * q + k))), LANES)
            for i, part in enumerate(parts):
                term = w * part
                sums[i * n + q] = term if k == 0 else sums[i * n + q] + term
    to = b.add(target, shift)
    for q, total in enumerate(sums):
        b.store(total.value, b.pointer(b.add(to, b.mul(plane_bytes, INT(q))), _FLOATS), align=4)
    following = b.add(interval, INT(LANES))
    interval.add_incoming(begin, before)
    interval.add_incoming(following, loop)
    b.cbranch(b.icmp_signed('<', following, end), loop, behind)
    b.position_at_end(behind)


def farrow_coefficients(samples, weights, first, pad, out):
    """Coefficients of every interval of a range grid with the phase first.

    Parameters
    ----------
    samples : (2, R, U, n - 2 * pad + 2 * TAPS) float32
        Real and imaginary part of R profiles; sample ``U * (cell - pad) + phase`` stands at
        ``[phase, cell - pad + TAPS]``. Contiguous.
    weights, first : (degree + 1, TAPS) float32, int
        Of `Interpolator`.
    pad : int
        Cells at both ends that stay as they are; between them are LANES or more.
    out : (R, U, 2 * (degree + 1), n) float32
        Planes of real, then imaginary coefficients of each phase.
    """
    n_phases, length = samples.shape[2:]
    step = np.arange(n_phases)[:, None] + np.arange(TAPS) + first
    start = (step % n_phases) * length + step // n_phases + TAPS
    weights = np.ascontiguousarray(weights)
    _weigh_all(samples.ctypes.data, samples.shape, 4 * start, weights.ctypes.data,
               (0,) * (len(weights) - 1), pad, out)


@njit(parallel=True)
def _weigh_all(samples, shape, start, weights, degrees, pad, out):
    """Echoes and phases in parallel; the last vector begins earlier than where others end."""
    _, n_echoes, n_phases, length = shape
    n_planes, n = out.shape[2:]
    inside, imaginary = n - 2 * pad, 4 * n_echoes * n_phases * length
    neighbours = np.empty((n_echoes * n_phases, TAPS), np.int64)
    for task in numba.prange(n_echoes * n_phases):
        echo, phase = task // n_phases, task % n_phases
        for k in range(TAPS):
            neighbours[task, k] = samples + 4 * echo * n_phases * length + start[phase, k]
        table = neighbours.ctypes.data + 8 * task * TAPS
        target = out.ctypes.data + 4 * (task * n_planes * n + pad)
        weigh_samples(table, imaginary, weights, degrees, 0, inside - LANES + 1, target, 4 * n)
        weigh_samples(table, imaginary, weights, degrees, inside - LANES, inside, target, 4 * n)


_CHUNK_BYTES = 64 << 20  # coefficients of one pass over the image
_GUARD = 8  # range cells beyond the ranges of the image


class Profiles:
    """Range profiles of one radar on a range grid, for the ranges that an image can reach.

    Parameters
    ----------
    source : RangeGate or PhaseHistory
        What the profiles are made of; `resampling` was planned for as many samples.
    memory : WorkSpace, optional
        Shared with other profiles that are made in turn.
    """

    def __init__(self, source: RangeGate | PhaseHistory, resampling: RangeResampling,
                 range_m: tuple[float, float], memory: WorkSpace | None = None):
        self.radar: RadarParameters = source.radar
        self.resampling, self._source = resampling, source
        self._buffer = memory or WorkSpace()
        self._pad = max(resampling.segment, _GUARD)
        lo, hi = ((r - source.range_start_m) / resampling.cell_m for r in range_m)
        if not source.periodic:
            lo, hi = max(lo, 0), min(hi, resampling.n_cells)
        self._first = math.floor(lo) - _GUARD - self._pad
        self._count = math.ceil(hi) + _GUARD + self._pad - self._first
        gain = source.gain(resampling.n_padded, resampling.oversampling(self.radar))
        self._gain = np.repeat(gain, 2)  # of real and imaginary part

    @property
    def n_cells(self) -> int:
        """Cells of the planes."""
        return self._count

    @property
    def cycles_per_step(self) -> float:
        """Carrier phase per range step, cycles."""
        return 2 * self.resampling.step_m / self.radar.wavelength_m

    def range_at(self, cell: int) -> float:
        """Half path at a cell of the planes, metres."""
        return self._source.range_start_m + (self._first + cell) * self.resampling.cell_m

    def cycles_at(self, cell: int) -> float:
        """Carrier phase at a cell of the planes, fraction of a cycle."""
        path_m = self.range_at(cell) - self._source.phase_range_m
        return math.fmod(2 * path_m / self.radar.wavelength_m, 1.0)

    def chunks(self, n_echoes: int):
        """Slices of echoes that are added in one pass."""
        resampling = self.resampling
        n_bytes = 4 * resampling.interpolator.n_planes * resampling.n_phases * self._count
        step = min(resampling.echoes_per_pass,
                   max(numba.get_num_threads(), _CHUNK_BYTES // n_bytes))
        return (slice(lo, min(lo + step, n_echoes)) for lo in range(0, n_echoes, step))

    def planes(self, samples) -> np.ndarray:
        """Polynomial coefficients of some profiles.

        Parameters
        ----------
        samples : (R, N) complex64
            Profiles, or phase histories.

        Returns
        -------
        (R, U, 2 * (degree + 1), n) float32
            As `farrow_coefficients` makes them. Valid until the next call, which writes to the
            same memory: fresh memory for every few profiles costs as much as filling it.
        """
        resampling, n_echoes = self.resampling, len(samples)
        spectrum = spectra(self._source, samples, resampling.n_padded, self._buffer)
        padded = self._buffer('padded', (n_echoes, resampling.n_cells * resampling.n_phases),
                              np.complex64)
        _pad_band(spectrum.reshape(-1).view(np.float32), spectrum.shape, self._source.zero,
                  self._gain, padded.reshape(-1).view(np.float32), padded.shape[1])
        transform_rows(padded, inverse=True)
        length = self._count - 2 * self._pad + 2 * TAPS
        first = self._first + self._pad - TAPS
        split = self._buffer('split', (2, n_echoes, resampling.n_phases, length), np.float32)
        inside = (0, length) if self._source.periodic else (
            min(max(-first, 0), length), max(min(resampling.n_cells - first, length), 0))
        _split_phases(padded.reshape(-1).view(np.float32), resampling.n_cells, first, *inside,
                      split)
        interpolator = resampling.interpolator
        planes = self._buffer('planes', (n_echoes, resampling.n_phases, interpolator.n_planes,
                                         self._count), np.float32)
        layout, (known, n_known) = (*planes.shape[1:], self._pad), self._buffer.layouts.get(
            'planes', (None, 0))
        if known != layout or n_known < n_echoes:
            planes[..., :self._pad] = planes[..., -self._pad:] = 0.0
            self._buffer.layouts['planes'] = layout, n_echoes
        farrow_coefficients(split, interpolator.weights, interpolator.first, self._pad, planes)
        return planes


@njit(parallel=True)
def _pad_band(spectrum, shape, zero, gain, out, n_out):
    """Spectra times the gain, with zeros between positive and negative frequencies or cropped.

    Real and imaginary parts come in turn. Positive frequencies start at bin `zero` of the
    spectra, negative ones end before it. Written for the compiler, see `lines.project_lines`.
    """
    n_echoes, n = shape
    keep = min(n, n_out)
    upper, lower = np.uint64(2 * ((keep + 1) // 2)), np.uint64(2 * (keep // 2))
    positive, negative = np.uint64(2 * zero), np.uint64(2 * ((zero - keep // 2) % n))
    for echo in numba.prange(n_echoes):
        to, source = np.uint64(echo * 2 * n_out), np.uint64(echo * 2 * n)
        for k in range(upper):
            out[to + k] = spectrum[source + positive + k] * gain[positive + k]
        to += upper
        between = np.uint64(2 * (n_out - keep))
        for k in range(between):
            out[to + k] = 0.0
        to += between
        for k in range(lower):
            out[to + k] = spectrum[source + negative + k] * gain[negative + k]


@njit(parallel=True)
def _split_phases(dense, n_cells, first, start, stop, out):
    """Real and imaginary part of cells, phase by phase; 0 before `start` and from `stop` on.

    Cells are counted from `first` of the dense profile, which repeats.
    """
    _, n_echoes, n_phases, length = out.shape
    step = np.uint64(2 * n_phases)
    for echo in numba.prange(n_echoes):
        for phase in range(n_phases):
            for part in range(2):
                for i in range(length):
                    out[part, echo, phase, i] = 0.0
                done = start
                while done < stop:
                    cell = (first + done) % n_cells
                    source = np.uint64(2 * ((echo * n_cells + cell) * n_phases + phase) + part)
                    some = min(stop - done, n_cells - cell)
                    for i in range(some):
                        out[part, echo, phase, done + i] = dense[source + np.uint64(i) * step]
                    done += some


def spectra(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int,
            buffer) -> np.ndarray:
    """Spectra of what an image needs of some profiles.

    Parameters
    ----------
    source, samples, n_padded :
        As for `backends.reference.resample_profiles.profile_spectra`.
    buffer : callable
        ``buffer(name, shape, dtype)`` gives the memory.

    Returns
    -------
    (R, n_padded) complex64
    """
    if source.periodic:
        return samples
    padded = buffer('spectrum', (len(samples), n_padded), np.complex64)
    cut_profiles(source, samples, padded)
    transform_rows(padded)
    return padded


def cut_profiles(window: RangeGate, samples: np.ndarray, out: np.ndarray) -> None:
    """Copy the window of profiles (R, N) to the start of `out` (R, M), zero beyond it."""
    n, lead = window.n_samples, max(-window.first, 0)
    out[:, :lead] = 0.0
    out[:, lead:n] = samples[:, window.first + lead:window.first + n]
    out[:, n:] = 0.0
    if window.n_rise:
        out[:, :window.n_rise] *= rise(window.n_rise)
    if window.n_fall:
        out[:, n - window.n_fall:n] *= rise(window.n_fall)[::-1]
