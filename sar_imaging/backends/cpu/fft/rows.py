"""Fourier transforms of the rows of an array, in place.

A row of n = height x width samples is transformed as a matrix that lies in memory line by line:
its columns, `LANES` side by side, from the row into work space in a core's cache; then `LANES` of
its lines at a time, transposed on their way into a panel so that they lie side by side, too. As
frequency k of the columns and frequency l of the lines make frequency k + height l of the row,
`LANES` lines leave their frequencies side by side where they belong. Between the two parts element
m of line k is turned by k m / n cycles: the four-step transform (Gentleman and Sande 1966; Bailey
1990). Where lines or columns are not a multiple of `LANES`, the last group begins earlier and
transforms some of them once more.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from ....compilation import DETERMINISTIC, njit, numba
from ....planning.afbp.row_length import row_shape
from ..memory import aligned_empty
from ..threads import job_counter, take_job
from . import vector_passes as passes
from .butterflies import BLOCK, GROUP_BYTES, LANES, SAMPLE_BYTES, VECTOR_BYTES, transpose
from .choice import own_transforms, transform_by_scipy

_GROUPS = 1024 // GROUP_BYTES  # of columns together: longer runs of memory


class RowPlan(NamedTuple):
    """How a row of some length is transformed."""

    height: int
    width: int
    columns: passes.Plan
    lines: passes.Plan
    turns: np.ndarray  # between the two: groups of lines, each (width, 2, LANES) float32

    @property
    def work_samples(self) -> int:
        """Complex samples of work space."""
        return self._panel + self.height * _pitch(self.width)

    @property
    def arguments(self) -> tuple[int, ...]:
        """What `transform_row` wants, good as long as the plan is kept."""
        return (passes.compiled(), self._panel * SAMPLE_BYTES, self.height, self.width,
                _pitch(self.width) * SAMPLE_BYTES, *self.columns.addresses,
                *self.lines.addresses, self.turns.ctypes.data)

    @property
    def _panel(self) -> int:
        return LANES * max(self.height * (_GROUPS + 1), self.width)


def transform_rows(data: np.ndarray, *, inverse: bool = False) -> None:
    """Transform the rows of an array in place.

    Parameters
    ----------
    data : (n_rows, n) complex64
        Samples of a row lie side by side; rows may be any distance apart. Lengths that
        `row_length` gives are quickest, memory from `aligned_empty`, and rows a multiple of 8
        samples apart; where a length has too large factors SciPy transforms.
    inverse : bool
        Transform with ``exp(+j 2 pi k m / n)`` instead of ``exp(-j 2 pi k m / n)``; neither
        divides by n.

    Raises
    ------
    ValueError
        The array is not complex64, or samples of a row do not lie side by side.
    """
    if data.dtype != np.complex64 or not data[:1].flags.c_contiguous:
        raise ValueError('expected complex64, samples of a row side by side; got '
                         f'{data.dtype}, strides {data.strides}')
    n_rows, n = data.shape
    plan = plan_row(n, inverse)
    if plan is None:
        transform_by_scipy(data, 1, inverse=inverse)
        return
    n_tasks = min(numba.get_num_threads(), n_rows)
    work, jobs = aligned_empty((n_tasks, plan.work_samples), np.complex64), job_counter()
    _transform(data.ctypes.data, data.strides[0], n_rows, n_tasks, jobs.ctypes.data,
               work.ctypes.data, work.strides[0], plan.arguments)


def _pitch(width: int) -> int:
    """Samples from a line of the work space to the next: vectors begin alike in each."""
    return -(-width // BLOCK) * BLOCK


def plan_row(n: int, inverse: bool) -> RowPlan | None:
    """For rows of a length; None where SciPy is to transform."""
    return _plan_row(n, inverse) if own_transforms() else None


@functools.lru_cache(maxsize=32)
def _plan_row(n: int, inverse: bool) -> RowPlan | None:
    shape = row_shape(n)
    if shape is None:
        return None
    height, width = shape
    columns = passes.plan(height, inverse, width * SAMPLE_BYTES, (_GROUPS + 1) * GROUP_BYTES,
                          _pitch(width) * SAMPLE_BYTES, False)
    lines = passes.plan(width, inverse, GROUP_BYTES, GROUP_BYTES, height * SAMPLE_BYTES, False)
    first = np.minimum(np.arange(0, height, LANES), height - LANES)
    line = (first[:, None] + np.arange(LANES))[:, None]
    turn = np.exp((2j if inverse else -2j) * np.pi / n * (line * lines.first[:, None] % n))
    turns = aligned_empty((len(first), width, 2, LANES), np.float32)
    turns[:, :, 0], turns[:, :, 1] = turn.real, turn.imag
    return RowPlan(height, width, columns, lines, turns)


@njit(parallel=True, fastmath=DETERMINISTIC)
def _transform(data, row_bytes, n_rows, n_tasks, jobs, work, task_bytes, plan):
    """All rows, as many at a time as there are tasks."""
    for task in numba.prange(n_tasks):
        number = take_job(jobs)
        while number < n_rows:
            transform_row(data + number * row_bytes, work + task * task_bytes, plan)
            number = take_job(jobs)


@njit
def transform_row(row, panel, plan):
    """Transform a row in place, within a compiled function.

    Columns go into the matrix, then its lines, by way of the panel, back into the row. `row` and
    `panel` are the addresses of its samples and of work space for `RowPlan.work_samples`; `plan`
    is `RowPlan.arguments`, flat, since loops in parallel take no other tuples.
    """
    code, panel_bytes, height, width, line_bytes = plan[:5]
    matrix, columns, lines, turns = panel + panel_bytes, plan[5:7], plan[7:9], plan[9]
    _transform_columns(code, row, panel, matrix, width, columns)
    for begin in range(0, height, LANES):
        line = min(begin, height - LANES)
        _transpose_lines(matrix + line * line_bytes, line_bytes, panel, width)
        passes.run(code, panel, panel, row + line * SAMPLE_BYTES, 1, *lines,
                   turns + begin * width * SAMPLE_BYTES)


@njit
def _transform_columns(code, row, panel, matrix, width, plan):
    for group in range(0, width // LANES, _GROUPS):
        shift = group * GROUP_BYTES
        passes.run(code, row + shift, panel, matrix + shift, min(_GROUPS, width // LANES - group),
                   *plan, 0)
    if width % LANES:
        shift = (width - LANES) * SAMPLE_BYTES
        passes.run(code, row + shift, panel, matrix + shift, 1, *plan, 0)


@njit
def _transpose_lines(lines, line_bytes, panel, width):
    """LANES lines into a panel in which their elements lie side by side."""
    for begin in range(0, width, BLOCK):
        m = min(begin, width - BLOCK)
        for part in range(LANES // BLOCK):
            transpose(lines + part * BLOCK * line_bytes + m * SAMPLE_BYTES, line_bytes,
                      panel + m * GROUP_BYTES + part * VECTOR_BYTES, GROUP_BYTES)
