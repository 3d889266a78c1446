# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range profiles on the range grid that backprojection reads: resampled, and as polynomials.

The polynomials are those of `planning.interpolators` (Farrow 1988).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from llvmlite import ir
from numba.core import types

from ...compilation import kernel_part, njit, numba
from ...planning.interpolators import TAPS
from ...planning.profiles import PhaseHistory, RangeGate, RangeResampling, rise
from ...signal.radar import RadarParameters
from .fft import plan_row, transform_by_scipy, transform_row, transform_rows
from .instructions import FLOAT, INT, LANES, Vector, instructions, job_counter, take_job
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
        self._length = self._count - 2 * self._pad + 2 * TAPS
        first, stop = self._first + self._pad - TAPS, self._length
        self._cells = resampling.n_cells, first, *((0, stop) if source.periodic else (
            min(max(-first, 0), stop), max(min(resampling.n_cells - first, stop), 0)))

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

    def chunks(self, n_echoes: int) -> Iterator[slice]:
        """Slices of echoes that are added in one pass."""
        resampling = self.resampling
        n_bytes = 4 * resampling.interpolator.n_planes * resampling.n_phases * self._count
        step = min(resampling.echoes_per_pass,
                   max(numba.get_num_threads(), _CHUNK_BYTES // n_bytes))
        return (slice(lo, min(lo + step, n_echoes)) for lo in range(0, n_echoes, step))

    def planes(self, samples: np.ndarray) -> np.ndarray:
        """Polynomial coefficients of some profiles.

        Parameters
        ----------
        samples : (R, N) complex64
            Profiles, or phase histories.

        Returns
        -------
        (R, U, 2 * (degree + 1), n) float32
            Planes of real, then imaginary coefficients of each phase; zeros at both ends. Valid
            until the next call, which writes to the same memory: fresh memory for every few
            profiles costs as much as filling it.
        """
        resampling, memory = self.resampling, self._buffer
        n_phases, n_dense = resampling.n_phases, resampling.n_cells * resampling.n_phases
        rows = spectra(self._source, samples, resampling.n_padded, memory)
        plan = plan_row(n_dense, inverse=True)
        if plan is None:
            rows = _dense_by_scipy(rows, self._source.zero, self._gain[::2], n_dense)
        n_tasks = min(numba.get_num_threads(), len(rows))
        split = memory('split', (n_tasks, 2 * n_phases * self._length), np.float32)
        work = (memory('dense', (n_tasks, 2 * n_dense), np.float32),
                memory('transform', (n_tasks, 2 * plan.work_samples if plan else 0), np.float32),
                split)
        planes, jobs = self._room(len(rows)), job_counter()
        weights = resampling.interpolator.weights
        _make_planes(np.ascontiguousarray(rows).view(np.float32), (self._source.zero, self._gain),
                     work, plan.arguments if plan else (0,) * 10, self._cells,
                     self._neighbours(split), weights, (0,) * (len(weights) - 1), self._pad,
                     planes, jobs.ctypes.data)
        return planes

    def _room(self, n_echoes: int) -> np.ndarray:
        """Memory of `planes`, (R, U, 2 * (degree + 1), n) float32, whose ends are zero."""
        shape = self.resampling.n_phases, self.resampling.interpolator.n_planes, self._count
        planes = self._buffer('planes', (n_echoes, *shape), np.float32)
        layout, (known, n_known) = (*shape, self._pad), self._buffer.layouts.get(
            'planes', (None, 0))
        if known != layout or n_known < n_echoes:
            planes[..., :self._pad] = planes[..., -self._pad:] = 0.0
            self._buffer.layouts['planes'] = layout, n_echoes
        return planes

    def _neighbours(self, split: np.ndarray) -> np.ndarray:
        """(T, U, TAPS) int64 addresses of those of each phase's interval 0, for each task.

        Sample ``U * (cell - pad) + phase`` is number ``cell - pad + TAPS`` of its phase.
        """
        n_phases, first = self.resampling.n_phases, self.resampling.interpolator.first
        step = np.arange(n_phases)[:, None] + np.arange(TAPS) + first
        at = (step % n_phases) * self._length + step // n_phases + TAPS
        task = split.ctypes.data + split.strides[0] * np.arange(len(split))
        return task[:, None, None] + split.itemsize * at


def _dense_by_scipy(spectra: np.ndarray, zero: int, gain: np.ndarray, n_dense: int) -> np.ndarray:
    """(R, n_dense) complex64 profiles, of a length that `transform_row` does not know."""
    n = spectra.shape[1]
    keep, dense = min(n, n_dense), np.zeros((len(spectra), n_dense), np.complex64)
    upper, lower = (keep + 1) // 2, keep // 2
    weighted = np.roll(spectra * gain, -zero, axis=1)
    dense[:, :upper], dense[:, n_dense - lower:] = weighted[:, :upper], weighted[:, n - lower:]
    transform_by_scipy(dense, 1, inverse=True)
    return dense


@njit(parallel=True)
def _make_planes(rows, band, work, plan, cells, neighbours, weights, degrees, pad, out, jobs):
    """Coefficients of intervals, echo by echo, so that samples stay in a core's cache.

    Parameters
    ----------
    rows : (R, 2 K) float32
        Spectra; dense profiles where `plan` has no lines.
    band : (int, (2 K,) float32)
        Bin of zero frequency, and gain.
    work : ((T, 2 K'), (T, W), (T, 2 U L)) float32
        Of each task: dense profile, for its transform, its phases.
    plan : tuple of int
        `RowPlan.arguments` of a dense profile.
    cells : (int, int, int, int)
        As `_split_phases` wants them.
    neighbours : (T, U, TAPS) int64
        Addresses of those of interval 0.
    weights, degrees : (degree + 1, TAPS) float32, tuple
        Of `Interpolator`; the tuple is as long as the degree.
    pad : int
        Cells at both ends that stay as they are; between them are LANES or more.
    out : (R, U, 2 * (degree + 1), n) float32
        Planes.
    jobs : int
        Address of a `job_counter`.
    """
    dense, panels, split = work
    zero, gain = band
    for task in numba.prange(len(split)):
        echo = take_job(jobs)
        while echo < len(out):
            row = rows[echo]
            if plan[2] > 0:
                _pad_band(row, zero, gain, dense[task])
                row = dense[task]
                transform_row(np.int64(row.ctypes.data), np.int64(panels[task].ctypes.data), plan)
            _split_phases(row, cells, out.shape[1], split[task])
            _weigh_phases(split[task], neighbours[task], weights, degrees, pad, out[echo])
            echo = take_job(jobs)


@kernel_part(distinct=True)
def _pad_band(spectrum, zero, gain, out):
    """A spectrum times the gain, with zeros between positive and negative frequencies or cropped.

    `spectrum` and `gain` are (2 K,), `out` is (2 K',) float32, as of `_make_planes`: real and
    imaginary parts come in turn. Positive frequencies start at bin `zero` of the spectrum,
    negative ones end before it. Written for the compiler, see `lines.project_lines`.
    """
    n, n_out = len(spectrum) // 2, len(out) // 2
    keep = min(n, n_out)
    upper, lower = np.uint64(2 * ((keep + 1) // 2)), np.uint64(2 * (keep // 2))
    positive, negative = np.uint64(2 * zero), np.uint64(2 * ((zero - keep // 2) % n))
    between, behind = np.uint64(2 * (n_out - keep)), np.uint64(2 * (n_out - keep // 2))
    for k in range(upper):
        out[k] = spectrum[positive + k] * gain[positive + k]
    for k in range(between):
        out[upper + k] = 0.0
    for k in range(lower):
        out[behind + k] = spectrum[negative + k] * gain[negative + k]


@kernel_part(distinct=True)
def _split_phases(dense, cells, n_phases, out):
    """Real, then imaginary parts of some cells of a profile, each phase by phase.

    `dense` is (2 K',), `out` (2 U L,) float32, as of `_make_planes`. `cells` are those of the
    dense profile, which repeats; the first that is read; and, counted from it, the first that
    there is and the end: others are 0.
    """
    n_cells, first, start, stop = cells
    length = len(out) // (2 * n_phases)
    for part in range(2 * n_phases):
        for i in range(start):
            out[part * length + i] = 0.0
        for i in range(stop, length):
            out[part * length + i] = 0.0
    done = start
    while done < stop:
        cell = (first + done) % n_cells
        some = min(stop - done, n_cells - cell)
        _separate(dense[2 * cell * n_phases:], n_phases, np.uint64(some), np.uint64(length),
                  out[done:])
        done += some


@kernel_part(distinct=True)
def _separate(dense, n_phases, n, apart, out):
    """Parts of n cells, from (real, imaginary) of phase after phase to rows `apart` floats apart.

    The compiler has vectors for steps that it knows.
    """
    if n_phases == 1:
        for i in range(n):
            for part in range(np.uint64(2)):
                out[part * apart + i] = dense[np.uint64(2) * i + part]
    elif n_phases == 2:
        second, third, fourth = apart, np.uint64(2) * apart, np.uint64(3) * apart
        for i in range(n):
            at = np.uint64(4) * i
            out[i], out[third + i] = dense[at], dense[at + np.uint64(1)]
            out[second + i], out[fourth + i] = dense[at + np.uint64(2)], dense[at + np.uint64(3)]
    else:
        for phase in range(np.uint64(n_phases)):
            for part in range(np.uint64(2)):
                to = (part * np.uint64(n_phases) + phase) * apart
                for i in range(n):
                    at = np.uint64(2) * (i * np.uint64(n_phases) + phase) + part
                    out[to + i] = dense[at]


@kernel_part
def _weigh_phases(split, neighbours, weights, degrees, pad, out):
    """Coefficients of an echo from its split samples, arguments as of `_make_planes`.

    Phase by phase; the last vector begins earlier than where others end.
    """
    n_phases, n_planes, n = out.shape
    inside, imaginary = n - 2 * pad, 2 * len(split)
    for phase in range(n_phases):
        table = neighbours[phase].ctypes.data
        target = out[phase].ctypes.data + 4 * pad
        weigh_samples(table, imaginary, weights.ctypes.data, degrees, 0, inside - LANES + 1,
                      target, 4 * n)
        weigh_samples(table, imaginary, weights.ctypes.data, degrees, inside - LANES, inside,
                      target, 4 * n)


def spectra(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int, buffer: WorkSpace
            ) -> np.ndarray:
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
