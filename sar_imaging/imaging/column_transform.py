"""Fourier transforms down the columns of an array, in place.

Libraries transform one column after the other, or a few together. Where many columns lie side by
side, `LANES` neighbours fill the vectors of the processor, whatever the length: rows are read as
they lie, nothing is transposed, and each pass combines as many as the registers hold. Numba has no
vectors, so that these small transforms are written in the language of its compiler (LLVM).
"""

from __future__ import annotations

import cmath
import functools
import math

import numpy as np
import scipy.fft
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from ..compilation import REPEATABLE, njit, numba

LANES = 16  # columns transformed together: one vector of float32
_RADICES = (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15, 16)
_LONGEST = 512  # rows that stay in a core's cache
_MOST_GROUPS, _WORK_ROWS = 8, 2560  # of LANES together: longer runs of each row, also in cache
_TASKS_PER_THREAD = 4
_SAMPLE_BYTES, _VECTOR_BYTES = 8, 64
_GROUP_BYTES = LANES * _SAMPLE_BYTES

_INT, _FLOAT = ir.IntType(64), ir.FloatType()
_VECTOR, _PAIRS = ir.VectorType(_FLOAT, LANES), ir.VectorType(_FLOAT, 2 * LANES)


def rows_to_transform(n: int) -> np.ndarray:
    """(n,) int64 row in which `transform_columns` wants each element of a column of n."""
    near = _near_factor(n)
    m = np.arange(n)
    return m % near * (n // near) + m // near


def aligned_empty(*shape: int) -> np.ndarray:
    """Complex64 memory that begins where a vector does, which makes transforms quicker."""
    size, spare = math.prod(shape), _VECTOR_BYTES // _SAMPLE_BYTES
    memory = np.empty(size + spare, np.complex64)
    first = -memory.ctypes.data // _SAMPLE_BYTES % spare
    return memory[first:first + size].reshape(shape)


def transform_columns(data: np.ndarray, n_columns: int, *, inverse: bool = False) -> None:
    """Transform the first columns of an array in place.

    Parameters
    ----------
    data : (n, width) complex64
        Contiguous in C order, `width` a multiple of `LANES`, rows in the order of
        `rows_to_transform`; frequencies 0 to n - 1 replace them in theirs. The columns that
        complete a multiple of `LANES` are transformed, too. Quickest in `aligned_empty` memory.
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
    near, row_bytes = _near_factor(n), width * _SAMPLE_BYTES
    far, n_groups = n // near, -(-n_columns // LANES)
    longest = max(near, far)
    groups = min(_MOST_GROUPS, max(1, _WORK_ROWS // longest))
    # one more, since rows at multiples of 4 KiB would displace each other from the cache
    work_bytes = (groups + 1) * _GROUP_BYTES
    work = aligned_empty(_TASKS_PER_THREAD * numba.get_num_threads(),
                         longest * work_bytes // _SAMPLE_BYTES)
    # element m1 + near m2 lies in row m1 far + m2: over m2, then over m1
    for length, row_step, n_sets, set_step, n_turned in ((far, 1, near, far, 1),
                                                         (near, far, far, 1, far)):
        if length > 1:
            _transform(data, n_groups, groups, n_sets, set_step * row_bytes, work,
                       *_plan(length, n_turned, inverse, row_step * row_bytes, work_bytes))


@functools.lru_cache(maxsize=4096)
def _radices(n: int) -> tuple[int, ...] | None:
    """Of the fewest passes; None where a factor of the length is too large for this way."""
    if n == 1:
        return ()
    choices = [(*others, radix) for radix in _RADICES if n % radix == 0
               if (others := _radices(n // radix)) is not None]
    return min(choices, key=lambda radices: (len(radices), sum(radices)), default=None)


@functools.lru_cache(maxsize=4096)
def _near_factor(n: int) -> int:
    """Factor so that a column is transformed in one or two parts that stay in cache."""
    if n <= _LONGEST or _radices(n) is None:
        return n

    def cost(near):
        n_passes = len(_radices(near)) + len(_radices(n // near))
        return max(near, n // near) > _LONGEST, n_passes, near + n // near

    return min((f for f in range(1, n + 1) if n % f == 0), key=cost)


@functools.lru_cache(maxsize=32)
def _plan(length: int, n_turned: int, inverse: bool, row_bytes: int, work_bytes: int) -> tuple:
    """Radices of the passes, where they find and leave rows, and the turns before them.

    Elements are taken digit by digit, each digit of the radix of a pass, which replaces it by
    that of a frequency. Turns differ between sets where the transform is the second part.
    """
    radices = _radices(length)
    element, digits = np.arange(length).reshape(radices), np.indices(radices)
    number = np.arange(n_turned).reshape(-1, *[1] * len(radices))
    frequency, done = np.zeros(radices, np.int64), 1
    cycles = number * element / (n_turned * length)
    sources, targets, turns = [], [], []
    for i, radix in enumerate(radices):
        cycles = cycles + digits[i] * frequency / (done * radix)
        source = element * (work_bytes if i else row_bytes)
        frequency = frequency + done * digits[i]
        done *= radix
        target = frequency * row_bytes if done == length else element * work_bytes
        turn = np.exp((2j if inverse else -2j) * np.pi * cycles).astype(np.complex64)
        sources.append(np.moveaxis(source, i, -1).ravel())
        # forwards, frequency -k is that of the inverse
        order = -np.arange(radix) % radix if inverse else np.arange(radix)
        targets.append(np.moveaxis(target, i, -1)[..., order].ravel())
        turns.append(np.moveaxis(turn, i + 1, -1).reshape(n_turned, length))
        cycles = np.zeros_like(cycles)
    # beyond the end rows are fetched, too, before they are needed
    sources.append(np.zeros(max(_RADICES), np.int64))
    return (np.array(radices), np.concatenate(sources), np.concatenate(targets),
            np.stack(turns, axis=1))


@njit(parallel=True, fastmath=REPEATABLE)
def _transform(data, n_groups, most, n_sets, set_bytes, work, radices, sources, targets, turns):
    """All sets of rows, at most so many groups of a set at a time."""
    n_tasks, n_panels = len(work), (n_groups + most - 1) // most
    n_jobs = n_sets * n_panels
    for task in numba.prange(n_tasks):
        for job in range(task * n_jobs // n_tasks, (task + 1) * n_jobs // n_tasks):
            number, group = job // n_panels, job % n_panels * most
            corner = _address(data) + number * set_bytes + group * _GROUP_BYTES
            _transform_groups(corner, min(most, n_groups - group), number % len(turns),
                              _address(work) + task * work.strides[0], radices, sources, targets,
                              turns)


@njit(fastmath=REPEATABLE)
def _transform_groups(corner, n_groups, number, work, radices, sources, targets, turns):
    n_passes, length = turns.shape[1:]
    for p in range(n_passes):
        radix = radices[p]
        source, target = work if p else corner, work if p < n_passes - 1 else corner
        for entry in range(p * length, (p + 1) * length, radix):
            turn = _address(turns) + _SAMPLE_BYTES * (number * n_passes * length + entry)
            for g in range(n_groups):
                shift = g * _GROUP_BYTES
                _butterfly(radix, source + shift, _address(sources) + 8 * entry,
                           target + shift, _address(targets) + 8 * entry, turn)


@njit
def _address(array):
    return np.int64(array.ctypes.data)  # sums of signed and unsigned integers would be floats


@intrinsic
def _butterfly(typing_context, radix, source, sources, target, targets, turns):
    """Turn rows, and transform them: addresses of two places, rows from there, and the turns."""
    def generate(context, b, signature, args):
        radix, *addresses = args
        end = b.append_basic_block()
        switch = b.switch(radix, end)
        for r in _RADICES:
            block = b.append_basic_block()
            switch.add_case(_INT(r), block)
            b.position_at_end(block)
            _write_butterfly(b, r, *addresses)
            b.branch(end)
        b.position_at_end(end)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 6), generate


def _write_butterfly(b, radix, source, sources, target, targets, turns):
    def entry(table, kind, i):
        return b.load(b.gep(b.inttoptr(table, kind.as_pointer()), [_INT(i)]))

    def row(place, table, i):
        return b.inttoptr(b.add(place, entry(table, _INT, i)), _PAIRS.as_pointer())

    def spread(i):
        one = b.insert_element(_VECTOR(ir.Undefined), entry(turns, _FLOAT, i), ir.IntType(32)(0))
        return b.shuffle_vector(one, one, _order([0] * LANES))

    rows = []
    for i in range(radix):
        _write_prefetch(b, row(source, sources, i + radix))
        pairs = b.load(row(source, sources, i), align=4)
        parts = [b.shuffle_vector(pairs, pairs, _order(range(part, 2 * LANES, 2)))
                 for part in (0, 1)]
        rows.append(_product(b, parts, (spread(2 * i), spread(2 * i + 1))))
    together = _order(n // 2 + n % 2 * LANES for n in range(2 * LANES))
    for i, (re, im) in enumerate(_dft(b, rows)):
        b.store(b.shuffle_vector(re, im, together), row(target, targets, i), align=4)


def _write_prefetch(b, place):
    kind, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
    fetch = b.module.declare_intrinsic('llvm.prefetch', [kind], ir.FunctionType(
        ir.VoidType(), [kind, flag, flag, flag]))
    for at in range(0, _GROUP_BYTES, _VECTOR_BYTES):
        b.call(fetch, [b.gep(b.bitcast(place, kind), [_INT(at)]), flag(0), flag(3), flag(1)])


def _order(lanes):
    lanes = list(lanes)
    return ir.VectorType(ir.IntType(32), len(lanes))(lanes)


def _dft(b, z):
    """Fourier transform of pairs of vectors: by factors near the root, or of a prime length."""
    n = len(z)
    near = max(f for f in range(1, n) if n % f == 0 and f * f <= n)
    if near == 1:
        return _dft_prime(b, z)
    far = n // near
    inner = [_dft(b, z[i::far]) for i in range(far)]
    outer = [_dft(b, [_turned(b, inner[i][k], i * k / n) for i in range(far)])
             for k in range(near)]
    return [outer[k % near][k // near] for k in range(n)]


def _dft_prime(b, z):
    """Frequencies k and n - k share the sums and the differences of elements j and n - j."""
    n = len(z)
    if n == 2:
        return [_sum(b, *z), _difference(b, *z)]
    pairs = [(j, _sum(b, z[j], z[-j]), _difference(b, z[j], z[-j])) for j in range(1, n // 2 + 1)]
    out = [functools.reduce(functools.partial(_sum, b), [even for _, even, _ in pairs], z[0])]
    out += [None] * (n - 1)
    for k in range(1, n // 2 + 1):
        x, u = z[0], None
        for j, even, odd in pairs:
            w = cmath.exp(2j * math.pi * (j * k % n) / n)
            x = _sum(b, x, _scaled(b, even, w.real))
            v = _scaled(b, odd, w.imag)
            u = v if u is None else _sum(b, u, v)
        u = u[1], b.fneg(u[0])  # times -j
        out[k], out[n - k] = _sum(b, x, u), _difference(b, x, u)
    return out


def _turned(b, z, cycles):
    """Times ``exp(-j 2 pi cycles)``."""
    for _ in range(int(4 * cycles)):
        z = z[1], b.fneg(z[0])
    if not (rest := 4 * cycles % 1):
        return z
    w = cmath.exp(-0.5j * math.pi * rest)
    return _product(b, z, (_constant(w.real), _constant(w.imag)))


def _product(b, z, w):
    return (b.fsub(b.fmul(z[0], w[0]), b.fmul(z[1], w[1])),
            b.fadd(b.fmul(z[0], w[1]), b.fmul(z[1], w[0])))


def _scaled(b, z, factor):
    return tuple(b.fmul(_constant(factor), part) for part in z)


def _constant(value):
    return _VECTOR([value] * LANES)


def _sum(b, u, v):
    return tuple(map(b.fadd, u, v))


def _difference(b, u, v):
    return tuple(map(b.fsub, u, v))
