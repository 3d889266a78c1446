# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fourier transforms of many rows or columns at once, in place, in the registers of the processor.

Libraries transform one column after the other, or a few together. Where many columns lie side by
side, `LANES` neighbours fill the vectors of the processor, whatever the length: rows are read as
they lie, nothing is transposed, and each pass combines as many as the registers hold. Where
a core's cache does not hold that many rows, the transform has two parts, each of a few sets of
rows that lie equally far apart.

A pass combines groups of `LANES` samples, as many as its radix says, by a butterfly. The first
pass reads groups from where they are, the last one leaves them where they are wanted, and between
passes they are in memory that stays in a core's cache. Which groups meet, and in which order they
are left, is all in tables, so that nothing is transposed or reordered by itself. A
`ColumnTransform` holds:

- `table`, int64: number of passes, length, whether groups are fetched into the cache before the
  first pass needs them, and the radix of each pass; then, for each pass, `length` places (bytes)
  of the groups that butterfly after butterfly reads; then likewise those that it writes.
- `twiddles`, complex64: by what each group is multiplied before its butterfly, in the same order.

A row of n = height x width samples is transformed as a matrix that lies in memory line by line:
its columns, `LANES` side by side, from the row into work space in a core's cache; then `LANES` of
its lines at a time, transposed on their way into a panel so that they lie side by side, too. As
frequency k of the columns and frequency l of the lines make frequency k + height l of the row,
`LANES` lines leave their frequencies side by side where they belong. Between the two parts element
m of line k is advanced by k m / n cycles: the four-step transform (Gentleman and Sande 1966;
Bailey 1990). Where lines or columns are not a multiple of `LANES`, the last group begins earlier
and transforms some of them once more.

Functions written as instructions take addresses as int64; vectors hold `LANES` numbers, real and
imaginary parts apart, and samples in memory are complex64. SciPy transforms what these do not, and
everything where the environment says so.
"""

from __future__ import annotations

import cmath
import functools
import math
import operator
import os
from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
import scipy.fft
from llvmlite import ir
from numba.core import cgutils, types

from ...compilation import DETERMINISTIC, cfunc, kernel_part, njit, numba
from ...planning.transform_lengths import RADICES, radices_of, row_shape
from .instructions import (
    BLOCK,
    FLOAT,
    GROUP_BYTES,
    INT,
    LANES,
    LINE_BYTES,
    SAMPLE_BYTES,
    VECTOR_BYTES,
    Vector,
    instructions,
    integer_at,
    job_counter,
    take_job,
    transpose,
)
from .memory import aligned_empty

VARIABLE = 'SAR_IMAGING_TRANSFORMS'  # of the environment
OWN, SCIPY = 'own', 'scipy'


def own_transforms() -> bool:
    """Whether the transforms of this package are used, where they know the length.

    Raises
    ------
    ValueError
        The environment asks for some that there are not.
    """
    choice = os.environ.get(VARIABLE, OWN)
    if choice not in (OWN, SCIPY):
        raise ValueError(f'{VARIABLE}={choice!r}; expected {OWN}, or {SCIPY} for those of SciPy')
    return choice == OWN


def transform_by_scipy(data: np.ndarray, axis: int, *, inverse: bool) -> None:
    """Replace samples by their transform along an axis; neither direction divides by n."""
    transform, norm = (scipy.fft.ifft, 'forward') if inverse else (scipy.fft.fft, 'backward')
    result = transform(data, axis=axis, workers=numba.get_num_threads(), overwrite_x=True,
                       norm=norm)
    if not np.may_share_memory(result, data):  # SciPy may overwrite, but need not
        data[:] = result


_VECTOR, _PAIRS = ir.VectorType(FLOAT, LANES), ir.VectorType(FLOAT, 2 * LANES)
_i = types.int64


@instructions(*[_i] * 6)
def butterfly(b, radix, source, sources, target, targets, twiddles):
    """Transform as many groups of `LANES` as the radix says, each times one number before.

    Groups are read where `source` plus an entry of the int64 table `sources` says, and written
    likewise; `twiddles` are complex64.
    """
    _for_each_radix(b, radix, source, sources, target, targets, lambda i: [
        b.spread(b.load(_entry(b, twiddles, FLOAT, 2 * i + part)), LANES) for part in (0, 1)])


@instructions(*[_i] * 6)
def butterfly_by_lane(b, radix, source, sources, target, targets, twiddles):
    """As `butterfly`, each lane times its own number: LANES real, LANES imaginary parts."""
    _for_each_radix(b, radix, source, sources, target, targets, lambda i: [
        Vector(b, b.load(_entry(b, twiddles, _VECTOR, 2 * i + part), align=4)) for part in (0, 1)])


@instructions(*[_i] * 3)
def fetch(b, place, places, number):
    """Bring groups into the cache: `place` plus some entries of the int64 table `places`."""
    with cgutils.for_range(b, number) as loop:
        group = _group(b, place, places, loop.index)
        for at in range(0, GROUP_BYTES, LINE_BYTES):
            b.fetch_line(b.pointer(group, ir.IntType(8), at))


@instructions(_i, None, returns=_i)
def call(b, function, arguments):
    """Call the C function at an address with a tuple of int64; it returns another."""
    values = [b.extract_value(arguments, i) for i in range(arguments.type.count)]
    return b.call(b.pointer(function, ir.FunctionType(INT, [INT] * len(values))), values)


def _for_each_radix(b, radix, source, sources, target, targets, twiddle_of):
    end = b.append_basic_block()
    switch = b.switch(radix, end)
    for r in RADICES:
        block = b.append_basic_block()
        switch.add_case(INT(r), block)
        b.position_at_end(block)
        places = (b.pointer(_group(b, source, sources, i), _PAIRS) for i in range(r))
        groups = [_product(b.parts_of(b.load(place, align=4)), twiddle_of(i))
                  for i, place in enumerate(places)]
        for i, pair in _dft(groups):
            to = b.pointer(_group(b, target, targets, i), _PAIRS)
            b.store(b.interleaved(*pair), to, align=4)
        b.branch(end)
    b.position_at_end(end)


def _entry(b, table, kind, i):
    return b.element(b.pointer(table, kind), INT(i) if isinstance(i, int) else i, kind)


def _group(b, place, table, i):
    """Address of a group."""
    return b.add(place, b.load(_entry(b, table, INT, i)))


def _dft(z: Sequence[Sequence[Vector]]) -> Iterator[tuple[int, Sequence[Vector]]]:
    """Fourier transform of pairs of vectors: by factors near the root, or of a prime length.

    Yields each frequency's number and pair as soon as it is known, so that registers are free.
    """
    n = len(z)
    near = max(f for f in range(1, n) if n % f == 0 and f * f <= n)
    if near == 1:
        yield from _dft_prime(z)
        return
    far = n // near
    inner = [dict(_dft(z[i::far])) for i in range(far)]
    for k in range(near):
        for m, pair in _dft([_times_phasor(inner[i][k], i * k / n) for i in range(far)]):
            yield k + near * m, pair


def _dft_prime(z: Sequence[Sequence[Vector]]) -> Iterator[tuple[int, Sequence[Vector]]]:
    """Frequencies k and n - k share the sums and the differences of elements j and n - j."""
    n = len(z)
    if n == 2:
        yield 0, _sum(*z)
        yield 1, _difference(*z)
        return
    pairs = [(j, _sum(z[j], z[-j]), _difference(z[j], z[-j])) for j in range(1, n // 2 + 1)]
    yield 0, functools.reduce(_sum, [even for _, even, _ in pairs], z[0])
    for k in range(1, n // 2 + 1):
        x, u = z[0], None
        for j, even, odd in pairs:
            w = cmath.exp(2j * math.pi * (j * k % n) / n)
            x, v = _sum(x, _scaled(even, w.real)), _scaled(odd, w.imag)
            u = v if u is None else _sum(u, v)
        u = u[1], -u[0]  # times -j
        yield k, _sum(x, u)
        yield n - k, _difference(x, u)


def _times_phasor(z: Sequence[Vector], cycles: float) -> Sequence[Vector]:
    """Times ``exp(-j 2 pi cycles)``."""
    for _ in range(int(4 * cycles)):
        z = z[1], -z[0]
    if not (rest := 4 * cycles % 1):
        return z
    w = cmath.exp(-0.5j * math.pi * rest)
    return _product(z, (w.real, w.imag))


def _product(z: Sequence[Vector], w: Sequence[Vector] | Sequence[float]) -> Sequence[Vector]:
    return z[0] * w[0] - z[1] * w[1], z[0] * w[1] + z[1] * w[0]


def _scaled(z: Sequence[Vector], factor: float) -> Sequence[Vector]:
    return tuple(part * factor for part in z)


def _sum(u: Sequence[Vector], v: Sequence[Vector]) -> Sequence[Vector]:
    return tuple(map(operator.add, u, v))


def _difference(u: Sequence[Vector], v: Sequence[Vector]) -> Sequence[Vector]:
    return tuple(map(operator.sub, u, v))


class ColumnTransform(NamedTuple):
    """How a column of some length is transformed; see the module's text."""

    table: np.ndarray  # (3 + n_passes + 2 n_passes length,) int64
    twiddles: np.ndarray  # (n_twiddled, n_passes, length) complex64
    first: np.ndarray  # (length,) int64 element at each entry of the first pass

    @property
    def addresses(self) -> tuple[int, int]:
        """Of the table, and of the twiddle factors."""
        return self.table.ctypes.data, self.twiddles.ctypes.data

    def with_gain(self, gain: np.ndarray) -> ColumnTransform:
        """Elements of each of some sets, (S, length) float64, are multiplied by a gain, too.

        S is a multiple of the sets that have factors.
        """
        twiddles = np.tile(self.twiddles, (len(gain) // len(self.twiddles), 1, 1))
        twiddles[:, 0] *= gain[:, self.first]
        return self._replace(twiddles=twiddles)


@functools.lru_cache(maxsize=32)
def plan_passes(length: int, inverse: bool, first_bytes: int, work_bytes: int, last_bytes: int,
                fetch: bool, n_twiddled: int = 1) -> ColumnTransform:
    """Tables of a transform, from the bytes between its elements.

    ``X[k] = sum_m x[m] exp(-j 2 pi m k / N)`` with N a product of radices: element and frequency
    are numbers of mixed digits, and pass i transforms digit i of the element to digit i of the
    frequency (Cooley and Tukey 1965). With D the product of the radices before, and k the
    frequency of the digits done so far, pass i first advances digit d by ``d k / (D radix)``
    cycles.

    Parameters
    ----------
    length : int
        Elements, one that `radices_of` knows.
    inverse : bool
        Sign of the exponent.
    first_bytes, work_bytes, last_bytes : int
        From an element to the next where they are read, between passes, and where frequencies
        are left.
    fetch : bool
        Groups are fetched before they are needed: where so few lie side by side that the
        processor does not do so by itself.
    n_twiddled : int
        Sets of columns; those of set s are the second part of a longer transform, whose element m
        is advanced by s m / (n_twiddled length) cycles.
    """
    radices = cast('tuple[int, ...]', radices_of(length))
    # elements by their digits: each pass replaces one by that of a frequency
    element, digits = np.arange(length).reshape(radices), np.indices(radices)
    number = np.arange(n_twiddled).reshape(-1, *[1] * len(radices))
    frequency, done = np.zeros(radices, np.int64), 1
    cycles = number * element / (n_twiddled * length)
    sources, targets, twiddles = [], [], []
    for i, radix in enumerate(radices):
        cycles = cycles + digits[i] * frequency / (done * radix)
        source = element * (work_bytes if i else first_bytes)
        frequency = frequency + done * digits[i]
        done *= radix
        target = frequency * last_bytes if done == length else element * work_bytes
        twiddle = np.exp((2j if inverse else -2j) * np.pi * cycles).astype(np.complex64)
        sources.append(np.moveaxis(source, i, -1).ravel())
        # forwards, frequency -k is that of the inverse
        order = -np.arange(radix) % radix if inverse else np.arange(radix)
        targets.append(np.moveaxis(target, i, -1)[..., order].ravel())
        twiddles.append(np.moveaxis(twiddle, i + 1, -1).reshape(n_twiddled, length))
        cycles = np.zeros_like(cycles)
    table = np.concatenate([(len(radices), length, fetch), radices, *sources, *targets])
    return ColumnTransform(table, np.stack(twiddles, axis=1), sources[0] // first_bytes)


@functools.cache
def compiled_passes() -> int:
    """Address that `run_passes` wants."""
    numbers = [numba.int64] * 7
    return cfunc(numba.int64(*numbers), fastmath=DETERMINISTIC)(_passes).address


@njit
def run_passes(code, source, work, target, n_groups, table, twiddles, twiddles_apart):
    """Transform `n_groups` times LANES columns that lie side by side; all arguments are int64.

    Numba would compile all butterflies again for each function that calls another, thus `code`,
    from `compiled_passes`. Elements are read at `source`, kept at `work` between passes, and left
    at `target`. `table` and `twiddles` are `ColumnTransform.addresses`, the twiddles those of the
    set; `twiddles_apart` is that of the first pass where they differ between columns of one group,
    else 0.
    """
    call(code, (source, work, target, n_groups, table, twiddles, twiddles_apart))


def _passes(source: int, work: int, target: int, n_groups: int, table: int, twiddles: int,
            twiddles_apart: int) -> int:
    n_passes, length = integer_at(table), integer_at(table + 8)
    fetched = integer_at(table + 16)
    for p in range(n_passes):
        radix = integer_at(table + 8 * (3 + p))
        read, write = work if p else source, work if p < n_passes - 1 else target
        sources = table + 8 * (3 + n_passes + p * length)
        targets = sources + 8 * n_passes * length
        for entry in range(0, length, radix):
            if p == 0 and twiddles_apart:
                butterfly_by_lane(radix, read, sources + 8 * entry, write,
                                            targets + 8 * entry,
                                            twiddles_apart + GROUP_BYTES * entry)
                continue
            twiddle = twiddles + SAMPLE_BYTES * (p * length + entry)
            for group in range(n_groups):
                shift = GROUP_BYTES * group
                if p == 0 and fetched and entry + radix < length:
                    fetch(read + shift, sources + 8 * (entry + radix), radix)
                butterfly(radix, read + shift, sources + 8 * entry, write + shift,
                                  targets + 8 * entry, twiddle)
    return 0


_GROUPS = 1024 // GROUP_BYTES  # of columns together: longer runs of memory


class RowPlan(NamedTuple):
    """How a row of some length is transformed."""

    arguments: tuple[int, ...]  # what `transform_row` wants, good as long as the plan is kept
    work_samples: int  # of work space, complex
    tables: tuple[ColumnTransform, ColumnTransform, np.ndarray]  # `arguments` has their addresses


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
    _rows_in_parallel(data.ctypes.data, data.strides[0], n_rows, n_tasks, jobs.ctypes.data,
                      work.ctypes.data, work.strides[0], plan.arguments)


def plan_row(n: int, inverse: bool) -> RowPlan | None:
    """For rows of a length; None where SciPy is to transform."""
    return _plan_row(n, inverse) if own_transforms() else None


@functools.lru_cache(maxsize=32)
def _plan_row(n: int, inverse: bool) -> RowPlan | None:
    shape = row_shape(n)
    if shape is None:
        return None
    height, width = shape
    pitch = -(-width // BLOCK) * BLOCK  # of lines of the work space: vectors begin alike in each
    columns = plan_passes(height, inverse, width * SAMPLE_BYTES, (_GROUPS + 1) * GROUP_BYTES,
                          pitch * SAMPLE_BYTES, False)
    lines = plan_passes(width, inverse, GROUP_BYTES, GROUP_BYTES, height * SAMPLE_BYTES, False)
    first = np.minimum(np.arange(0, height, LANES), height - LANES)
    line = (first[:, None] + np.arange(LANES))[:, None]
    twiddle = np.exp((2j if inverse else -2j) * np.pi / n * (line * lines.first[:, None] % n))
    # between columns and lines: groups of lines, each (width, 2, LANES)
    twiddles = aligned_empty((len(first), width, 2, LANES), np.float32)
    twiddles[:, :, 0], twiddles[:, :, 1] = twiddle.real, twiddle.imag
    panel = LANES * max(height * (_GROUPS + 1), width)
    return RowPlan((compiled_passes(), panel * SAMPLE_BYTES, height, width, pitch * SAMPLE_BYTES,
                    *columns.addresses, *lines.addresses, twiddles.ctypes.data),
                   panel + height * pitch, (columns, lines, twiddles))


@njit(parallel=True, fastmath=DETERMINISTIC)
def _rows_in_parallel(data, row_bytes, n_rows, n_tasks, jobs, work, task_bytes, plan):
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
    matrix, columns, lines, twiddles = panel + panel_bytes, plan[5:7], plan[7:9], plan[9]
    _transform_columns(code, row, panel, matrix, width, columns)
    for begin in range(0, height, LANES):
        line = min(begin, height - LANES)
        _transpose_lines(matrix + line * line_bytes, line_bytes, panel, width)
        run_passes(code, panel, panel, row + line * SAMPLE_BYTES, 1, *lines,
                   twiddles + begin * width * SAMPLE_BYTES)


@kernel_part
def _transform_columns(code, row, panel, matrix, width, plan):
    for group in range(0, width // LANES, _GROUPS):
        shift = group * GROUP_BYTES
        run_passes(code, row + shift, panel, matrix + shift, min(_GROUPS, width // LANES - group),
                   *plan, 0)
    if width % LANES:
        shift = (width - LANES) * SAMPLE_BYTES
        run_passes(code, row + shift, panel, matrix + shift, 1, *plan, 0)


@kernel_part
def _transpose_lines(lines, line_bytes, panel, width):
    """LANES lines into a panel in which their elements lie side by side."""
    for begin in range(0, width, BLOCK):
        m = min(begin, width - BLOCK)
        for part in range(LANES // BLOCK):
            transpose(lines + part * BLOCK * line_bytes + m * SAMPLE_BYTES, line_bytes,
                      panel + m * GROUP_BYTES + part * VECTOR_BYTES, GROUP_BYTES)


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
    for length, row_step, n_sets, set_step, n_twiddled in ((far, 1, near, far, 1),
                                                         (near, far, far, 1, far)):
        if length > 1:
            step = row_step * row_bytes
            plan = plan_passes(length, inverse, step, work_bytes, step, True, n_twiddled)
            if gain is not None:  # of rows in the order in which the sets hold them
                plan, gain = plan.with_gain(gain.reshape(length, -1).T), None
            jobs = job_counter()
            _columns_in_parallel(
                compiled_passes(), data.ctypes.data, n_groups, groups, n_sets,
                set_step * row_bytes, len(work), jobs.ctypes.data, work.ctypes.data,
                work.strides[0], plan.addresses, len(plan.twiddles), plan.twiddles.strides[0])


def _is_own(n: int) -> bool:
    """Whether columns of n are not left to SciPy."""
    return own_transforms() and bool(radices_of(n))


def _near_factor(n: int) -> int:
    """Factor so that a column is transformed in one or two parts that stay in cache."""
    return n if n <= _LONGEST or not _is_own(n) else _best_factor(n)


@functools.lru_cache(maxsize=4096)
def _best_factor(n: int) -> int:
    def cost(near: int) -> tuple[bool, int, int]:
        n_passes = len(radices_of(near)) + len(radices_of(n // near))
        return max(near, n // near) > _LONGEST, n_passes, near + n // near

    return min((f for f in range(1, n + 1) if n % f == 0), key=cost)


@njit(parallel=True, fastmath=DETERMINISTIC)
def _columns_in_parallel(code, data, n_groups, most, n_sets, set_bytes, n_tasks, jobs, work,
                         task_bytes, plan, n_twiddled, twiddle_bytes):
    """All sets of rows, at most so many groups of a set at a time."""
    n_panels = (n_groups + most - 1) // most
    table, twiddles = plan
    for task in numba.prange(n_tasks):
        job = take_job(jobs)
        while job < n_sets * n_panels:
            number, group = job // n_panels, job % n_panels * most
            corner = data + number * set_bytes + group * GROUP_BYTES
            run_passes(code, corner, work + task * task_bytes, corner,
                       min(most, n_groups - group), table,
                       twiddles + number % n_twiddled * twiddle_bytes, 0)
            job = take_job(jobs)
