"""Fourier transforms down the columns of an array, in place.

Libraries transform one column after the other, or a few together. Where many columns lie side by
side, `LANES` neighbours fill the vectors of the processor, whatever the length: rows are read as
they lie, nothing is transposed, and each pass combines rows in cache by small matrices.
"""

from __future__ import annotations

import functools

import numpy as np
import scipy.fft

from ..compilation import REPEATABLE, njit, numba

LANES = 16  # columns transformed together: one vector of float32
_RADICES = (4, 2, 3, 5, 7, 11)
_LONGEST = 512  # rows that stay in a core's cache
_GROUPS = 8  # of LANES read and written together: longer runs of each row
_TASKS_PER_THREAD = 4


def rows_to_transform(n: int) -> np.ndarray:
    """(n,) int64 row in which `transform_columns` wants each element of a column of n."""
    near = _near_factor(n)
    m = np.arange(n)
    return m % near * (n // near) + m // near


def transform_columns(data: np.ndarray, n_columns: int, *, inverse: bool = False) -> None:
    """Transform the first columns of an array in place.

    Parameters
    ----------
    data : (n, width) complex64
        Contiguous in C order, `width` a multiple of `LANES`, rows in the order of
        `rows_to_transform`; frequencies 0 to n - 1 replace them in theirs. The columns that
        complete a multiple of `LANES` are transformed, too.
    n_columns : int
        How many to transform.
    inverse : bool
        Transform with ``exp(+j 2 pi k m / n)`` instead of ``exp(-j 2 pi k m / n)``; neither
        divides by n.
    """
    n, width = data.shape
    if _radices(n) is None:
        transform = scipy.fft.ifft if inverse else scipy.fft.fft
        data[:, :n_columns] = transform(data[:, :n_columns], axis=0,
                                        norm='forward' if inverse else 'backward')
        return
    sign, near = 1 if inverse else -1, _near_factor(n)
    far = n // near
    flat, n_groups = data.reshape(-1).view(np.float32), -(-n_columns // LANES)
    turns = np.exp(sign * 2j * np.pi / n * np.arange(n)).astype(np.complex64).view(np.float32)
    n_tasks = _TASKS_PER_THREAD * numba.get_num_threads()
    work = [np.empty(n_tasks * n * max(near, far) * LANES, np.float32)
            for n in (_GROUPS, _GROUPS, 1, 1)]
    # element m1 + near m2 lies in row m1 far + m2: over m2, then over m1
    for length, row_step, n_sets, set_step, turn in ((far, 1, near, far, 1),
                                                     (near, far, far, 1, 0)):
        if length > 1:
            _transform(flat, LANES, width, n_groups, length, row_step, n_sets, set_step, turns,
                       turn, *_plan(length, sign), np.empty(n_tasks), *work)


@functools.lru_cache(maxsize=64)
def _radices(n: int) -> tuple[int, ...] | None:
    """Factors of a length; None where one of them is too large for this way."""
    found = []
    for radix in _RADICES:
        while n % radix == 0:
            found.append(radix)
            n //= radix
    return tuple(found) if n == 1 else None


def _near_factor(n: int) -> int:
    """Factor so that a column is transformed in one or two parts that stay in cache."""
    if n <= _LONGEST or _radices(n) is None:
        return n
    return min((f for f in range(1, n + 1) if n % f == 0), key=lambda f: f + n // f)


@functools.lru_cache(maxsize=64)
def _plan(length: int, sign: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radix of each pass, where its matrices begin, and the matrices."""
    done, tables = 1, []
    for radix in _radices(length):
        turns = np.outer(np.arange(done * radix), np.arange(radix)) % (done * radix)
        done *= radix
        tables.append(np.exp(sign * 2j * np.pi / done * turns).astype(np.complex64).ravel())
    first = np.cumsum([0] + [2 * len(table) for table in tables[:-1]])
    return (np.array(_radices(length), np.int64), first.astype(np.int64),
            np.concatenate(tables).view(np.float32))


def _combiner(radix: int):
    """Pass of one radix, known to the compiler."""
    @njit(inline='always')
    def combine(done, left, weights, first, from_re, from_im, to_re, to_im, base, to):
        """Transforms of length `done`, `radix * left` of them, become `left` longer ones."""
        apart = np.uint64(done * left * LANES)
        for j in range(left):
            for q in range(radix):
                for k in range(done):
                    target = to + np.uint64(((j * radix + q) * done + k) * LANES)
                    source = base + np.uint64((j * done + k) * LANES)
                    row = np.uint64(first + 2 * (k + done * q) * radix)
                    for i in range(LANES):
                        a, b = np.float32(0.0), np.float32(0.0)
                        for p in range(radix):
                            re, im = weights[row + np.uint64(2 * p)], weights[
                                row + np.uint64(2 * p + 1)]
                            place = source + np.uint64(p) * apart + np.uint64(i)
                            x, y = from_re[place], from_im[place]
                            a += re * x - im * y
                            b += re * y + im * x
                        to_re[target + np.uint64(i)] = a
                        to_im[target + np.uint64(i)] = b

    return combine


_combine_4, _combine_2, _combine_3, _combine_5, _combine_7, _combine_11 = map(_combiner, _RADICES)


@njit(inline='always')
def _combine(radix, done, left, weights, first, from_re, from_im, to_re, to_im, base, to):
    if radix == 4:
        _combine_4(done, left, weights, first, from_re, from_im, to_re, to_im, base, to)
    elif radix == 2:
        _combine_2(done, left, weights, first, from_re, from_im, to_re, to_im, base, to)
    elif radix == 3:
        _combine_3(done, left, weights, first, from_re, from_im, to_re, to_im, base, to)
    elif radix == 5:
        _combine_5(done, left, weights, first, from_re, from_im, to_re, to_im, base, to)
    elif radix == 7:
        _combine_7(done, left, weights, first, from_re, from_im, to_re, to_im, base, to)
    else:
        _combine_11(done, left, weights, first, from_re, from_im, to_re, to_im, base, to)


@njit(parallel=True, fastmath=REPEATABLE)
def _transform(data, lanes, width, n_groups, length, row_step, n_sets, set_step, turns, turn,
               radices, first, weights, tasks, one_re, one_im, other_re, other_im):
    """Rows ``set set_step + n row_step``, set by set, times turns to the power of ``n set``.

    Loops over as many `lanes` as there are, unknown to the compiler, become vectors of pairs.
    """
    n_tasks, n_blocks = len(tasks), (n_groups + _GROUPS - 1) // _GROUPS
    n_jobs, size = n_sets * n_blocks, np.uint64(length * LANES)
    for task in numba.prange(n_tasks):
        other = np.uint64(task) * size
        for job in range(task * n_jobs // n_tasks, (task + 1) * n_jobs // n_tasks):
            number, group = job // n_blocks, job % n_blocks * _GROUPS
            n_some = min(_GROUPS, n_groups - group)
            corner = 2 * (number * set_step * width + group * LANES)
            for n in range(length):
                place = np.uint64(corner + 2 * n * row_step * width)
                for g in range(n_some):
                    one = np.uint64(task * _GROUPS + g) * size + np.uint64(n * LANES)
                    for i in range(lanes):
                        one_re[one + np.uint64(i)] = data[place + np.uint64(2 * i)]
                        one_im[one + np.uint64(i)] = data[place + np.uint64(2 * i + 1)]
                    place += np.uint64(2 * LANES)
            for g in range(n_some):
                one = np.uint64(task * _GROUPS + g) * size
                done, left = 1, length
                for p in range(len(radices)):
                    left //= radices[p]
                    _combine(radices[p], done, left, weights, first[p], one_re, one_im, other_re,
                             other_im, one, other)
                    done *= radices[p]
                    for n in range(size):
                        one_re[one + n] = other_re[other + n]
                        one_im[one + n] = other_im[other + n]
            for n in range(length):
                place = np.uint64(corner + 2 * n * row_step * width)
                power = np.uint64(2 * n * number * turn)
                re, im = turns[power], turns[power + np.uint64(1)]
                for g in range(n_some):
                    one = np.uint64(task * _GROUPS + g) * size + np.uint64(n * LANES)
                    for i in range(lanes):
                        x, y = one_re[one + np.uint64(i)], one_im[one + np.uint64(i)]
                        data[place + np.uint64(2 * i)] = x * re - y * im
                        data[place + np.uint64(2 * i + 1)] = x * im + y * re
                    place += np.uint64(2 * LANES)
