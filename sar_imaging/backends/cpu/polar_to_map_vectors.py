"""Vector code of `polar_to_map`, written as instructions.

`LANES` neighbours are interpolated together from samples that begin at different places, without
gathers: two places in a row take their turn at once, each lane selecting its own samples. All
functions take addresses as int64; `taps` is a tuple as long as there are neighbours to interpolate
from, since that much of it is known when code is written.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from . import line_kernels
from .fft.butterflies import LANES, VECTOR_BYTES
from .instructions import DOUBLE, FLOAT, INT, INT32, Vector, instructions, order

POSITION_BYTES = 5 * VECTOR_BYTES
# of a position: the first of the starts, and of each lane what it is from the middle between two
# samples, its start relative to the first, and the phasor of its carrier
FIRST, _T, _START, _COSINE, _SINE = range(0, POSITION_BYTES, VECTOR_BYTES)

_FLOATS, _DOUBLES = ir.VectorType(FLOAT, LANES), ir.VectorType(DOUBLE, LANES)
_SAMPLES = ir.VectorType(FLOAT, 2 * LANES)
_SINES = [getattr(line_kernels, f'_S{i}') for i in (9, 7, 5, 3, 1)]
_COSINES = [getattr(line_kernels, f'_C{i}') for i in (10, 8, 6, 4, 2, 0)]
_i, _d = types.int64, types.float64


@instructions(_i, _i, _d, _d, _d, _d, _d, _i)
def locate_directions(b, squares, inverses, beside2, scale, along, zero, last, to):
    """Where LANES ranges meet a row: ``(scale sqrt(r^2 - beside2) + along) / r - zero``.

    Positions are stored at `to` for `interpolate`; ``r^2`` and ``1 / r`` are float64 at
    addresses, and starts lie between 1 and `last`.
    """
    beside2, scale, along, zero, last = (b.spread(v, LANES) for v in (
        beside2, scale, along, zero, last))
    ahead2 = _load(b, squares, _DOUBLES) - beside2
    ahead = ahead2.where('>', 0.0, ahead2, 0.0).call('sqrt')
    v = (ahead * scale + along) * _load(b, inverses, _DOUBLES) - zero
    _store_positions(b, v, 1.0, last, to)


@instructions(_d, _i, _i, _d, _d, _d, _d, _i)
def locate_ranges(b, ahead2, beside2, shifts, start, inverse, cycles_per_m, last, to):
    """Where LANES rows have a pixel: ``(r - start) inverse + shift``, r^2 = ahead2 + beside2.

    Positions and the phasors of the carrier are stored at `to` for `interpolate`; `beside2` and
    `shifts` are float64 at addresses, and starts lie between 0 and `last`.
    """
    ahead2, start, inverse, cycles_per_m, last = (b.spread(v, LANES) for v in (
        ahead2, start, inverse, cycles_per_m, last))
    r = (_load(b, beside2, _DOUBLES) + ahead2).call('sqrt') - start
    _store_positions(b, r * inverse + _load(b, shifts, _DOUBLES), 0.0, last, to)
    cycles = r * cycles_per_m
    c = (cycles - cycles.call('rint')).rounded()
    _store(b, _polynomial(_COSINES, c * c), to, _COSINE)
    _store(b, c * _polynomial(_SINES, c * c), to, _SINE)


@instructions(_i, _i, _i, _i, None, _i, _i, _i)
def interpolate(b, real, imag, step, weights, taps, positions, to_real, to_imag):
    """Interpolate LANES samples; `step` is the bytes from a tap's samples to the next one's.

    `weights` are those of half the taps, by powers of the distance from the middle.
    """
    _interpolate(b, (real, imag), step, weights, taps.type.count, positions, (to_real, to_imag))


@instructions(_i, _i, _i, _i, None, _i, _i)
def interpolate_carrier(b, real, imag, step, weights, taps, positions, to):
    """As `interpolate`, times the phasors; real and imaginary parts are stored in turn."""
    cosine, sine = (_load(b, positions, _FLOATS, part) for part in (_COSINE, _SINE))
    parts = to, b.add(to, INT(VECTOR_BYTES))
    _interpolate(b, (real, imag), step, weights, taps.type.count, positions, parts)
    re, im = (_load(b, part, _FLOATS) for part in parts)
    samples = b.in_turn(re * cosine - im * sine, re * sine + im * cosine)
    b.store(samples, b.pointer(to, _SAMPLES), align=4)


@instructions(_i, _i)
def transpose_floats(b, source, target):
    """Transpose LANES x LANES float32 that lie side by side."""
    rows = [_load(b, source, _FLOATS, i * VECTOR_BYTES).value for i in range(LANES)]
    for i, row in enumerate(b.transposed(rows)):
        _store(b, Vector(b, row), target, i * VECTOR_BYTES)


@instructions(_i, _i, _i)
def fetch_lines(b, place, step, number):
    """Bring a line of the cache from each of some lines of an image into the second cache."""
    with cgutils.for_range(b, number) as loop:
        line = b.add(place, b.mul(step, loop.index))
        b.fetch_line(b.pointer(line, ir.IntType(8)), locality=2)


@instructions(_i, _i, _i, _i)
def put_samples(b, source, target, number, add):
    """Store `number` complex64, or add them if `add` is not 0; quickest for LANES."""
    add = b.icmp_signed('!=', add, INT(0))

    def put(kind, shift):
        places = [b.pointer(b.add(place, shift), kind) for place in (source, target)]
        sample = b.load(places[0], align=4)
        with b.if_else(add) as (added, stored):
            with added:
                b.store(b.fadd(sample, b.load(places[1], align=4)), places[1], align=4)
            with stored:
                b.store(sample, places[1], align=4)

    with b.if_else(b.icmp_signed('==', number, INT(LANES))) as (whole, part):
        with whole:
            put(_SAMPLES, INT(0))
        with part, cgutils.for_range(b, b.mul(number, INT(2))) as loop:
            put(FLOAT, b.mul(loop.index, INT(4)))


def _store_positions(b, v, least, last, to):
    """Lowest start, and relative to it the starts of all lanes and what is left."""
    v = v.where('>', least, v, least)
    v = v.where('<', last, v, last)
    low = v
    step = LANES // 2
    while step:
        other = Vector(b, b.shuffle_vector(low.value, low.value, order(
            i ^ step for i in range(LANES))))
        low = low.where('<', other, low, other)
        step //= 2
    low = low.call('floor')
    v = (v - low).rounded()
    start = v.call('floor')
    _store(b, v - start - 0.5, to, _T)
    _store(b, start, to, _START)
    b.store(b.fptosi(b.extract_element(low.value, INT32(0)), INT),
            b.pointer(to, INT, FIRST))


def _interpolate(b, sources, step, weights, taps, positions, targets):
    """Two starts at a time, until no lane starts later; most simply where all start alike.

    Targets change with each turn, so that LLVM does not keep all weights from turn to turn: there
    are more than registers, and most vectors need one turn.
    """
    def sums(place, later):
        t = _load(b, positions, _FLOATS, _T)
        return _weighted_sums(b, [b.add(source, place) for source in sources], step, weights,
                              taps, t, later)

    def branch(turn, where_any, where_none):
        reached = b.bitcast(b.fcmp_ordered('>=', start.value, turn.value), ir.IntType(LANES))
        b.cbranch(b.icmp_unsigned('!=', reached, ir.IntType(LANES)(0)), where_any, where_none)

    first = b.mul(b.load(b.pointer(positions, INT, FIRST)), step)
    start = _load(b, positions, _FLOATS, _START)
    before, (alike, loop, end) = b.block, (b.append_basic_block() for _ in range(3))
    branch(Vector(b, _FLOATS([1.0] * LANES)), loop, alike)
    b.position_at_end(alike)
    for total, to in zip(sums(first, None), targets, strict=True):
        _store(b, total, to)
    b.branch(end)
    b.position_at_end(loop)
    place, turn = b.phi(INT), Vector(b, b.phi(_FLOATS))
    later = b.fcmp_ordered('>', start.value, turn.value)
    for total, to in zip(sums(place, later), targets, strict=True):
        _store(b, start.where('>=', turn, total, _load(b, to, _FLOATS)), to)
    following = turn + 2.0
    place.add_incoming(first, before)
    place.add_incoming(b.add(place, b.mul(step, INT(2))), b.block)
    turn.value.add_incoming(_FLOATS([0.0] * LANES), before)
    turn.value.add_incoming(following.value, b.block)
    branch(following, loop, end)
    b.position_at_end(end)


def _weighted_sums(b, places, step, weights, taps, t, later):
    """Of the samples from a place on, or of those from the next on where `later`, if given."""
    def sample(place, k):
        here = _load(b, b.add(place, b.mul(step, INT(k))), _FLOATS)
        if later is None:
            return here
        following = _load(b, b.add(place, b.mul(step, INT(k + 1))), _FLOATS)
        return Vector(b, b.select(later, following.value, here.value))

    def weight(k, power):
        return b.spread(b.load(b.pointer(weights, FLOAT, 4 * (power * half + k))), LANES)

    t2, half, sums = t * t, taps // 2, [None] * len(places)
    for k in range(half):
        even, odd = (weight(k, i) + t2 * (weight(k, i + 2) + t2 * weight(k, i + 4))
                     for i in range(2))
        pair = even + t * odd, even - t * odd
        for i, place in enumerate(places):
            for n, w in zip((k, taps - 1 - k), pair, strict=True):
                term = w * sample(place, n)
                sums[i] = term if sums[i] is None else sums[i] + term
    return sums


def _polynomial(coefficients, x):
    value = x * coefficients[0] + coefficients[1]
    for coefficient in coefficients[2:]:
        value = value * x + coefficient
    return value


def _load(b, address, kind, shift=0):
    return Vector(b, b.load(b.pointer(address, kind, shift), align=4))


def _store(b, vector, address, shift=0):
    b.store(vector.value, b.pointer(address, vector.value.type, shift), align=4)
