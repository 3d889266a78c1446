"""Lines of AFBP's second stage along range: tapered to their spectrum, and back to an image.

What is done with a line before and after its transform is done while the line is in cache.
"""

from __future__ import annotations

import numpy as np

from ....compilation import njit, numba
from ..fft.butterflies import SAMPLE_BYTES
from ..fft.rows import plan_row, transform_row, transform_rows
from ..memory import aligned_empty
from ..threads import job_counter, take_job

_NOTHING = (0,) * 10  # in place of a plan


def fold_lines(image, along_alpha, along_range, rows, out) -> None:
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


def finish_lines(spectrum, n_bins: int, n_range: int, first: int, scale, turn, out) -> None:
    """Transform rows of the fused spectrum to lines of the image.

    Parameters
    ----------
    spectrum : (L, at least n_bins) complex64
        Rows, transformed along direction; contiguous.
    n_bins, n_range, first : int
        Range wavenumbers, from the lowest one; length of the transform; range at which the wanted
        ones begin.
    scale, turn : (L,) and (N,) complex64
        Factors of each line, and of each wanted range.
    out : (L * 2 * N,) float32
        Real, then imaginary parts of each line; none of the rows lie in it.
    """
    plan = plan_row(n_range, True)
    if plan is None:
        lines = np.zeros((len(spectrum), n_range), np.complex64)
        lines[:, :n_bins] = spectrum[:, :n_bins]
        transform_rows(lines, inverse=True)
        lines = lines[:, first:first + len(turn)] * (scale[:, None] * turn)
        out[:] = np.stack([lines.real, lines.imag], axis=1).ravel()
        return
    n_tasks, jobs = numba.get_num_threads(), job_counter()
    # rows apart by no multiple of 4 KiB
    work = aligned_empty((n_tasks, n_range + 8 + plan.work_samples), np.complex64)
    _finish_lines(spectrum.view(np.float32).reshape(-1), spectrum.shape[1], n_bins, n_range,
                  first, scale.view(np.float32), turn.view(np.float32), out,
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
def _finish_lines(spectrum, row, n_bins, n_range, first, scale, turn, out, lines, address,
                  work_bytes, n_tasks, jobs, plan):
    """All arrays are flat float32, for the compiler; a task's line comes before its work space."""
    n, n_lines = np.uint64(len(turn) // 2), len(scale) // 2
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
                c, d = a * turn[even] - b * turn[odd], a * turn[odd] + b * turn[even]
                x, y = lines[begin + even], lines[begin + odd]
                out[to + i] = c * x - d * y
                out[to + n + i] = c * y + d * x
            number = take_job(jobs)
