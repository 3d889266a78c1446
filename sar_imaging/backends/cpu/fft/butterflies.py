"""Small Fourier transforms of vectors, written in the language of Numba's compiler (LLVM).

Numba has no vectors. Each function here is a few lines that write LLVM instructions on vectors of
`LANES` numbers, real and imaginary parts apart; LLVM divides them where a processor's are shorter.
All take addresses as int64, and samples in memory are complex64. Numba's cache only notices
changes of the file of a function that it compiled: empty it after a change of this one.
"""

from __future__ import annotations

import cmath
import functools
import math

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ....planning.afbp.row_length import RADICES
from .processor import float_lanes

LANES = float_lanes()  # transformed together: a vector of the processor
SAMPLE_BYTES, VECTOR_BYTES, LINE_BYTES = 8, 4 * LANES, 64
GROUP_BYTES = LANES * SAMPLE_BYTES
BLOCK = LANES // 2  # rows and columns of a transposition: samples of a vector

_INT, _FLOAT = ir.IntType(64), ir.FloatType()
_VECTOR, _PAIRS = ir.VectorType(_FLOAT, LANES), ir.VectorType(_FLOAT, 2 * LANES)
_SAMPLES = ir.VectorType(ir.DoubleType(), BLOCK)  # complex64 that are only moved


@intrinsic
def butterfly(typing_context, radix, source, sources, target, targets, turns):
    """Transform as many groups of `LANES` as the radix says, each turned by one number before.

    Groups are read where `source` plus an entry of the int64 table `sources` says, and written
    likewise; `turns` are complex64.
    """
    return _for_each_radix(_write_turned_alike)


@intrinsic
def butterfly_of_turned(typing_context, radix, source, sources, target, targets, turns):
    """As `butterfly`, each lane turned by its own number: LANES real, LANES imaginary parts."""
    return _for_each_radix(_write_turned_apart)


@intrinsic
def transpose(typing_context, source, source_step, target, target_step):
    """Transpose `BLOCK` x `BLOCK` samples; steps are the bytes from a row to the next."""
    def generate(context, b, signature, args):
        source, source_step, target, target_step = args

        def row(place, step, i):
            return b.inttoptr(b.add(place, b.mul(step, _INT(i))), _SAMPLES.as_pointer())

        rows = [b.load(row(source, source_step, i), align=4) for i in range(BLOCK)]
        for i, samples in enumerate(transposed(b, rows)):
            b.store(samples, row(target, target_step, i), align=4)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 4), generate


@intrinsic
def fetch(typing_context, place, places, number):
    """Bring groups into the cache: `place` plus some entries of the int64 table `places`."""
    def generate(context, b, signature, args):
        place, places, number = args
        with cgutils.for_range(b, number) as loop:
            group = b.bitcast(_group(b, place, places, loop.index), ir.IntType(8).as_pointer())
            for at in range(0, GROUP_BYTES, LINE_BYTES):
                fetch_line(b, b.gep(group, [_INT(at)]))
        return context.get_dummy_value()

    return types.void(*[types.int64] * 3), generate


@intrinsic
def integer_at(typing_context, address):
    """The int64 at an address."""
    def generate(context, b, signature, args):
        return b.load(b.inttoptr(args[0], _INT.as_pointer()))

    return types.int64(types.int64), generate


@intrinsic
def call(typing_context, function, arguments):
    """Call the C function at an address with a tuple of int64; it returns another."""
    def generate(context, b, signature, args):
        values = [b.extract_value(args[1], i) for i in range(len(arguments))]
        kind = ir.FunctionType(_INT, [_INT] * len(values))
        return b.call(b.inttoptr(args[0], kind.as_pointer()), values)

    return types.int64(types.int64, arguments), generate


def fetch_line(b, pointer, locality=3):
    """Bring a line of the cache into the first cache (locality 3), or the second one (2)."""
    kind, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
    prefetch = b.module.declare_intrinsic('llvm.prefetch', [kind], ir.FunctionType(
        ir.VoidType(), [kind, flag, flag, flag]))
    b.call(prefetch, [b.bitcast(pointer, kind), flag(0), flag(locality), flag(1)])


def transposed(b, rows):
    """Vectors in which the elements of as many vectors lie transposed."""
    rows, n = list(rows), len(rows)
    step = 1
    while step < n:  # exchange blocks of 1, 2, 4 and so on beside the diagonal
        for i in (i for i in range(n) if not i & step):
            pair = rows[i], rows[i + step]
            rows[i] = b.shuffle_vector(*pair, _order(
                n + j - step if j & step else j for j in range(n)))
            rows[i + step] = b.shuffle_vector(*pair, _order(
                n + j if j & step else j + step for j in range(n)))
        step *= 2
    return rows


def _for_each_radix(write):
    def generate(context, b, signature, args):
        radix, *addresses = args
        end = b.append_basic_block()
        switch = b.switch(radix, end)
        for r in RADICES:
            block = b.append_basic_block()
            switch.add_case(_INT(r), block)
            b.position_at_end(block)
            write(b, r, *addresses)
            b.branch(end)
        b.position_at_end(end)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 6), generate


def _write_turned_alike(b, radix, source, sources, target, targets, turns):
    def spread(i):
        turn = _entry(b, turns, _FLOAT, i)
        one = b.insert_element(_VECTOR(ir.Undefined), turn, ir.IntType(32)(0))
        return b.shuffle_vector(one, one, _order([0] * LANES))

    groups = [_product(b, _load(b, _group(b, source, sources, i)),
                       (spread(2 * i), spread(2 * i + 1))) for i in range(radix)]
    _write_stores(b, _dft(b, groups), target, targets)


def _write_turned_apart(b, radix, source, sources, target, targets, turns):
    groups = [_product(b, _load(b, _group(b, source, sources, i)),
                       [_entry(b, turns, _VECTOR, 2 * i + part, 4) for part in (0, 1)])
              for i in range(radix)]
    _write_stores(b, _dft(b, groups), target, targets)


def _write_stores(b, groups, target, targets):
    together = _order(n // 2 + n % 2 * LANES for n in range(2 * LANES))
    for i, (re, im) in groups:
        b.store(b.shuffle_vector(re, im, together), _group(b, target, targets, i), align=4)


def _entry(b, table, kind, i, align=None):
    i = _INT(i) if isinstance(i, int) else i
    return b.load(b.gep(b.inttoptr(table, kind.as_pointer()), [i]), align=align)


def _group(b, place, table, i):
    return b.inttoptr(b.add(place, _entry(b, table, _INT, i)), _PAIRS.as_pointer())


def _load(b, group):
    pairs = b.load(group, align=4)
    return [b.shuffle_vector(pairs, pairs, _order(range(part, 2 * LANES, 2))) for part in (0, 1)]


def _order(lanes):
    lanes = list(lanes)
    return ir.VectorType(ir.IntType(32), len(lanes))(lanes)


def _dft(b, z):
    """Fourier transform of pairs of vectors: by factors near the root, or of a prime length.

    Yields each frequency's number and pair as soon as it is known, so that registers are free.
    """
    n = len(z)
    near = max(f for f in range(1, n) if n % f == 0 and f * f <= n)
    if near == 1:
        yield from _dft_prime(b, z)
        return
    far = n // near
    inner = [dict(_dft(b, z[i::far])) for i in range(far)]
    for k in range(near):
        turned = [_turned(b, inner[i][k], i * k / n) for i in range(far)]
        for m, pair in _dft(b, turned):
            yield k + near * m, pair


def _dft_prime(b, z):
    """Frequencies k and n - k share the sums and the differences of elements j and n - j."""
    n = len(z)
    if n == 2:
        yield 0, _sum(b, *z)
        yield 1, _difference(b, *z)
        return
    pairs = [(j, _sum(b, z[j], z[-j]), _difference(b, z[j], z[-j])) for j in range(1, n // 2 + 1)]
    yield 0, functools.reduce(functools.partial(_sum, b), [even for _, even, _ in pairs], z[0])
    for k in range(1, n // 2 + 1):
        x, u = z[0], None
        for j, even, odd in pairs:
            w = cmath.exp(2j * math.pi * (j * k % n) / n)
            x = _sum(b, x, _scaled(b, even, w.real))
            v = _scaled(b, odd, w.imag)
            u = v if u is None else _sum(b, u, v)
        u = u[1], b.fneg(u[0])  # times -j
        yield k, _sum(b, x, u)
        yield n - k, _difference(b, x, u)


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
