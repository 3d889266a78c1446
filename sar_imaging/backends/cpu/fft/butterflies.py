"""Small Fourier transforms of vectors, written as instructions.

Vectors hold `LANES` numbers, real and imaginary parts apart. All functions take addresses as
int64, and samples in memory are complex64.
"""

from __future__ import annotations

import cmath
import functools
import math
import operator

from llvmlite import ir
from numba.core import cgutils, types

from ....planning.afbp.row_length import RADICES
from ..instructions import DOUBLE, FLOAT, INT, LINE_BYTES, Vector, instructions
from .processor import float_lanes

LANES = float_lanes()  # transformed together: a vector of the processor
SAMPLE_BYTES, VECTOR_BYTES = 8, 4 * LANES
GROUP_BYTES = LANES * SAMPLE_BYTES
BLOCK = LANES // 2  # rows and columns of a transposition: samples of a vector

_VECTOR, _PAIRS = ir.VectorType(FLOAT, LANES), ir.VectorType(FLOAT, 2 * LANES)
_SAMPLES = ir.VectorType(DOUBLE, BLOCK)  # complex64 that are only moved
_i = types.int64


@instructions(*[_i] * 6)
def butterfly(b, radix, source, sources, target, targets, turns):
    """Transform as many groups of `LANES` as the radix says, each turned by one number before.

    Groups are read where `source` plus an entry of the int64 table `sources` says, and written
    likewise; `turns` are complex64.
    """
    _for_each_radix(b, radix, source, sources, target, targets, lambda i: [
        b.spread(b.load(_entry(b, turns, FLOAT, 2 * i + part)), LANES) for part in (0, 1)])


@instructions(*[_i] * 6)
def butterfly_of_turned(b, radix, source, sources, target, targets, turns):
    """As `butterfly`, each lane turned by its own number: LANES real, LANES imaginary parts."""
    _for_each_radix(b, radix, source, sources, target, targets, lambda i: [
        Vector(b, b.load(_entry(b, turns, _VECTOR, 2 * i + part), align=4)) for part in (0, 1)])


@instructions(*[_i] * 4)
def transpose(b, source, source_step, target, target_step):
    """Transpose `BLOCK` x `BLOCK` samples; steps are the bytes from a row to the next."""
    def row(place, step, i):
        return b.pointer(b.add(place, b.mul(step, INT(i))), _SAMPLES)

    rows = [b.load(row(source, source_step, i), align=4) for i in range(BLOCK)]
    for i, samples in enumerate(b.transposed(rows)):
        b.store(samples, row(target, target_step, i), align=4)


@instructions(*[_i] * 3)
def fetch(b, place, places, number):
    """Bring groups into the cache: `place` plus some entries of the int64 table `places`."""
    with cgutils.for_range(b, number) as loop:
        group = _group(b, place, places, loop.index)
        for at in range(0, GROUP_BYTES, LINE_BYTES):
            b.fetch_line(b.pointer(group, ir.IntType(8), at))


@instructions(_i, returns=_i)
def integer_at(b, address):
    """The int64 at an address."""
    return b.load(b.pointer(address, INT))


@instructions(_i, None, returns=_i)
def call(b, function, arguments):
    """Call the C function at an address with a tuple of int64; it returns another."""
    values = [b.extract_value(arguments, i) for i in range(arguments.type.count)]
    return b.call(b.pointer(function, ir.FunctionType(INT, [INT] * len(values))), values)


def _for_each_radix(b, radix, source, sources, target, targets, turn_of):
    end = b.append_basic_block()
    switch = b.switch(radix, end)
    for r in RADICES:
        block = b.append_basic_block()
        switch.add_case(INT(r), block)
        b.position_at_end(block)
        places = (b.pointer(_group(b, source, sources, i), _PAIRS) for i in range(r))
        groups = [_product(b.parts_of(b.load(place, align=4)), turn_of(i))
                  for i, place in enumerate(places)]
        for i, pair in _dft(groups):
            b.store(b.in_turn(*pair), b.pointer(_group(b, target, targets, i), _PAIRS), align=4)
        b.branch(end)
    b.position_at_end(end)


def _entry(b, table, kind, i):
    return b.element(b.pointer(table, kind), INT(i) if isinstance(i, int) else i, kind)


def _group(b, place, table, i):
    """Address of a group."""
    return b.add(place, b.load(_entry(b, table, INT, i)))


def _dft(z):
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
        for m, pair in _dft([_turned(inner[i][k], i * k / n) for i in range(far)]):
            yield k + near * m, pair


def _dft_prime(z):
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


def _turned(z, cycles):
    """Times ``exp(-j 2 pi cycles)``."""
    for _ in range(int(4 * cycles)):
        z = z[1], -z[0]
    if not (rest := 4 * cycles % 1):
        return z
    w = cmath.exp(-0.5j * math.pi * rest)
    return _product(z, (w.real, w.imag))


def _product(z, w):
    return z[0] * w[0] - z[1] * w[1], z[0] * w[1] + z[1] * w[0]


def _scaled(z, factor):
    return tuple(part * factor for part in z)


def _sum(u, v):
    return tuple(map(operator.add, u, v))


def _difference(u, v):
    return tuple(map(operator.sub, u, v))
