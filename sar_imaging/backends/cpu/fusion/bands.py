"""Where the bands of sub-aperture images lie in the fused spectrum, and their sum there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....compilation import DETERMINISTIC, njit, numba
from ..beams.accumulation import fetch
from ..fft import vector_passes as passes
from ..fft.butterflies import GROUP_BYTES, LANES, SAMPLE_BYTES
from ..fft.columns import panel_groups, transform_columns
from ..memory import aligned_empty
from ..threads import job_counter, take_job

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


def add_transformed(lines, n_bins: int, band: Band, rows, spectrum) -> None:
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
    plan = passes.plan(n_coarse, False, row_bytes, panel_bytes, panel_bytes, True)
    work = aligned_empty((numba.get_num_threads(), 2, n_coarse * panel_bytes // 4), np.float32)
    jobs = job_counter()
    _add_transformed(passes.compiled(), lines.ctypes.data, (n_coarse, n_bins, groups),
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
    table, turns = plan
    for task in numba.prange(n_tasks):
        own = address + task * work_bytes
        panel = np.uint64(task * work_bytes // 4 + n_coarse * pitch)
        job = take_job(jobs)
        while job < n_panels:
            first = job * n_columns
            last = min(first + n_columns, n_bins)
            passes.run(code, lines + first * SAMPLE_BYTES, own, own + work_bytes // 2,
                       (last - first + LANES - 1) // LANES, table, turns, 0)
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
