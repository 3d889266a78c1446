"""Fourier transforms down the columns of an array, in place.

Libraries transform one column after the other, or a few together. Where many columns lie side by
side, `LANES` neighbours fill the vectors of the processor, whatever the length: rows are read as
they lie, nothing is transposed, and each pass combines as many as the registers hold. Where
a core's cache does not hold that many rows, the transform has two parts, each of a few sets of
rows that lie equally far apart.
"""

from __future__ import annotations

import functools

import numpy as np

from ....compilation import DETERMINISTIC, njit, numba
from ....planning.afbp.row_length import radices_of
from ..memory import aligned_empty
from ..threads import job_counter, take_job
from . import vector_passes as passes
from .butterflies import GROUP_BYTES, LANES, SAMPLE_BYTES
from .choice import own_transforms, transform_by_scipy

_LONGEST = 512  # rows that stay in a core's cache
_MOST_BYTES = 1024  # of a row together: longer runs of memory
_WORK_BYTES = 160 << 10  # between passes: leaves room in a second cache of 256 KiB, too


def rows_to_transform(n: int) -> np.ndarray:
    """(n,) int64 row in which `transform_columns` wants each element of a column of n."""
    near = _near_factor(n)
    m = np.arange(n)
    return m % near * (n // near) + m // near


def panel_groups(n: int) -> int | None:
    """Groups of `LANES` columns of n that are transformed together; None where in two parts."""
    whole = _is_own(n) and _near_factor(n) == n
    return _groups(n) if whole else None


def _groups(longest: int) -> int:
    return max(1, min(_MOST_BYTES, _WORK_BYTES // longest) // GROUP_BYTES)


def transform_columns(data: np.ndarray, n_columns: int, *, inverse: bool = False,
                      gain: np.ndarray | None = None) -> None:
    """Transform the first columns of an array in place.

    Parameters
    ----------
    data, n_columns : (n, width) complex64, int
        Contiguous in C order, `width` a multiple of `LANES`, rows in the order of
        `rows_to_transform`; frequencies 0 to n - 1 replace them in theirs. The columns that
        complete a multiple of `LANES` are transformed, too. Memory from `aligned_empty` is
        quickest.
    inverse : bool
        As for `transform_rows`.
    gain : (n,) float64, optional
        By what the elements of a column are multiplied before; takes no time.

    Raises
    ------
    ValueError
        The array is not complex64 and contiguous, or its width does not suit.
    """
    if data.dtype != np.complex64 or not data.flags.c_contiguous or data.shape[1] % LANES:
        raise ValueError(f'expected contiguous complex64, rows a multiple of {LANES} long; got '
                         f'{data.dtype}, shape {data.shape}, strides {data.strides}')
    n, width = data.shape
    if not _is_own(n):
        if gain is not None:
            data[:, :n_columns] *= gain.astype(np.float32)[:, None]
        transform_by_scipy(data[:, :n_columns], 0, inverse=inverse)
        return
    near, row_bytes = _near_factor(n), width * SAMPLE_BYTES
    far, n_groups = n // near, -(-n_columns // LANES)
    longest = max(near, far)
    groups = _groups(longest)
    # one more, since rows at multiples of 4 KiB would displace each other from the cache
    work_bytes = (groups + 1) * GROUP_BYTES
    work = aligned_empty((numba.get_num_threads(), longest * work_bytes // SAMPLE_BYTES),
                         np.complex64)
    # element m1 + near m2 lies in row m1 far + m2: over m2, then over m1
    for length, row_step, n_sets, set_step, n_turned in ((far, 1, near, far, 1),
                                                         (near, far, far, 1, far)):
        if length > 1:
            step = row_step * row_bytes
            plan = passes.plan(length, inverse, step, work_bytes, step, True, n_turned)
            if gain is not None:  # of rows in the order in which the sets hold them
                plan, gain = plan.with_gain(gain.reshape(length, -1).T), None
            jobs = job_counter()
            _transform(passes.compiled(), data.ctypes.data, n_groups, groups, n_sets,
                       set_step * row_bytes, len(work), jobs.ctypes.data, work.ctypes.data,
                       work.strides[0], plan.addresses, len(plan.turns), plan.turns.strides[0])


def _is_own(n: int) -> bool:
    """Whether columns of n are not left to SciPy."""
    return own_transforms() and bool(radices_of(n))


def _near_factor(n: int) -> int:
    """Factor so that a column is transformed in one or two parts that stay in cache."""
    return n if n <= _LONGEST or not _is_own(n) else _best_factor(n)


@functools.lru_cache(maxsize=4096)
def _best_factor(n: int) -> int:
    def cost(near):
        n_passes = len(radices_of(near)) + len(radices_of(n // near))
        return max(near, n // near) > _LONGEST, n_passes, near + n // near

    return min((f for f in range(1, n + 1) if n % f == 0), key=cost)


@njit(parallel=True, fastmath=DETERMINISTIC)
def _transform(code, data, n_groups, most, n_sets, set_bytes, n_tasks, jobs, work, task_bytes,
               plan, n_turned, turns_bytes):
    """All sets of rows, at most so many groups of a set at a time."""
    n_panels = (n_groups + most - 1) // most
    table, turns = plan
    for task in numba.prange(n_tasks):
        job = take_job(jobs)
        while job < n_sets * n_panels:
            number, group = job // n_panels, job % n_panels * most
            corner = data + number * set_bytes + group * GROUP_BYTES
            passes.run(code, corner, work + task * task_bytes, corner,
                       min(most, n_groups - group), table,
                       turns + number % n_turned * turns_bytes, 0)
            job = take_job(jobs)
