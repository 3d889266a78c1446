"""Vector code of `resampling`, written in the language of Numba's compiler (LLVM).

`LANES` neighbours are interpolated together from samples that begin at different places, without
gathers: two places in a row take their turn at once, each lane selecting its own samples. All
functions take addresses as int64; `taps` is a tuple as long as there are neighbours to interpolate
from, since that much of it is known when code is written. Numba's cache only notices changes of
the file of a function that it compiled: empty it after a change of this one.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from . import line_kernels
from .fft.butterflies import LANES, VECTOR_BYTES, fetch_line, transposed

POSITION_BYTES = 5 * VECTOR_BYTES
# of a position: the first of the starts, and of each lane what it is from the middle between two
# samples, its start relative to the first, and the phasor of its carrier
FIRST, _T, _START, _COSINE, _SINE = range(0, POSITION_BYTES, VECTOR_BYTES)

_INT, _DOUBLE = ir.IntType(64), ir.DoubleType()
_FLOATS, _DOUBLES = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(_DOUBLE, LANES)
_SAMPLES = ir.VectorType(ir.FloatType(), 2 * LANES)
_SINES = [getattr(line_kernels, f'_S{i}') for i in (9, 7, 5, 3, 1)]
_COSINES = [getattr(line_kernels, f'_C{i}') for i in (10, 8, 6, 4, 2, 0)]


class _Vector:
    """Vector whose operators write instructions."""

    def __init__(self, b, value):
        self.b, self.value = b, value

    def _of(self, other):
        if isinstance(other, _Vector):
            return other.value
        return self.value.type([float(other)] * LANES)

    def __add__(self, other):
        return _Vector(self.b, self.b.fadd(self.value, self._of(other)))

    def __sub__(self, other):
        return _Vector(self.b, self.b.fsub(self.value, self._of(other)))

    def __mul__(self, other):
        return _Vector(self.b, self.b.fmul(self.value, self._of(other)))

    def where(self, order, other, a, b):
        """``a`` where the order holds, else ``b``."""
        chosen = self.b.fcmp_ordered(order, self.value, self._of(other))
        return _Vector(self.b, self.b.select(chosen, self._of(a), self._of(b)))

    def call(self, name):
        """Of an intrinsic function."""
        kind = self.value.type
        suffix = f'v{LANES}{"f64" if kind == _DOUBLES else "f32"}'
        function = self.b.module.declare_intrinsic(f'llvm.{name}.{suffix}', (),
                                                   ir.FunctionType(kind, [kind]))
        return _Vector(self.b, self.b.call(function, [self.value]))

    def rounded(self):
        """As float32."""
        return _Vector(self.b, self.b.fptrunc(self.value, _FLOATS))


@intrinsic
def locate_directions(typing_context, squares, inverses, beside2, scale, along, zero, last, to):
    """Where LANES ranges meet a row: ``(scale sqrt(r^2 - beside2) + along) / r - zero``.

    Positions are stored at `to` for `interpolate`; ``r^2`` and ``1 / r`` are float64 at
    addresses, and starts lie between 1 and `last`.
    """
    def generate(context, b, signature, args):
        squares, inverses, beside2, scale, along, zero, last, to = args
        ahead2 = _load(b, squares, _DOUBLES) - _spread(b, beside2)
        ahead = ahead2.where('>', 0.0, ahead2, 0.0).call('sqrt')
        v = ((ahead * _spread(b, scale) + _spread(b, along)) * _load(b, inverses, _DOUBLES)
             - _spread(b, zero))
        _store_positions(b, v, 1.0, _spread(b, last), to)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 2, *[types.float64] * 5, types.int64), generate


@intrinsic
def locate_ranges(typing_context, ahead2, beside2, shifts, start, inverse, cycles_per_m, last,
                  to):
    """Where LANES rows have a pixel: ``(r - start) inverse + shift``, r^2 = ahead2 + beside2.

    Positions and the phasors of the carrier are stored at `to` for `interpolate`; `beside2` and
    `shifts` are float64 at addresses, and starts lie between 0 and `last`.
    """
    def generate(context, b, signature, args):
        ahead2, beside2, shifts, start, inverse, cycles_per_m, last, to = args
        r = (_load(b, beside2, _DOUBLES) + _spread(b, ahead2)).call('sqrt') - _spread(b, start)
        v = r * _spread(b, inverse) + _load(b, shifts, _DOUBLES)
        _store_positions(b, v, 0.0, _spread(b, last), to)
        cycles = r * _spread(b, cycles_per_m)
        c = (cycles - cycles.call('rint')).rounded()
        _store(b, _polynomial(_COSINES, c * c), to, _COSINE)
        _store(b, c * _polynomial(_SINES, c * c), to, _SINE)
        return context.get_dummy_value()

    return types.void(types.float64, *[types.int64] * 2, *[types.float64] * 4,
                      types.int64), generate


@intrinsic
def interpolate(typing_context, real, imag, step, weights, taps, positions, to_real, to_imag):
    """Interpolate LANES samples; `step` is the bytes from a tap's samples to the next one's.

    `weights` are those of half the taps, by powers of the distance from the middle.
    """
    def generate(context, b, signature, args):
        real, imag, step, weights, _, positions, to_real, to_imag = args
        _interpolate(b, (real, imag), step, weights, len(taps), positions, (to_real, to_imag))
        return context.get_dummy_value()

    return types.void(*[types.int64] * 4, taps, *[types.int64] * 3), generate


@intrinsic
def interpolate_carrier(typing_context, real, imag, step, weights, taps, positions, to):
    """As `interpolate`, times the phasors; real and imaginary parts are stored in turn."""
    def generate(context, b, signature, args):
        real, imag, step, weights, _, positions, to = args
        cosine, sine = (_load(b, positions, _FLOATS, part) for part in (_COSINE, _SINE))
        parts = to, b.add(to, _INT(VECTOR_BYTES))
        _interpolate(b, (real, imag), step, weights, len(taps), positions, parts)
        re, im = (_load(b, part, _FLOATS) for part in parts)
        parts = (re * cosine - im * sine).value, (re * sine + im * cosine).value
        together = [n // 2 + n % 2 * LANES for n in range(2 * LANES)]
        samples = b.shuffle_vector(*parts, ir.VectorType(ir.IntType(32), 2 * LANES)(together))
        b.store(samples, _pointer(b, to, _SAMPLES), align=4)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 4, taps, *[types.int64] * 2), generate


@intrinsic
def transpose_floats(typing_context, source, target):
    """Transpose LANES x LANES float32 that lie side by side."""
    def generate(context, b, signature, args):
        rows = [_load(b, args[0], _FLOATS, i * VECTOR_BYTES).value for i in range(LANES)]
        for i, row in enumerate(transposed(b, rows)):
            b.store(row, _pointer(b, args[1], _FLOATS, i * VECTOR_BYTES), align=4)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 2), generate


@intrinsic
def fetch_lines(typing_context, place, step, number):
    """Bring a line of the cache from each of some lines of an image into the second cache."""
    def generate(context, b, signature, args):
        place, step, number = args
        with cgutils.for_range(b, number) as loop:
            line = _pointer(b, b.add(place, b.mul(step, loop.index)), ir.IntType(8))
            fetch_line(b, line, locality=2)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 3), generate


@intrinsic
def put_samples(typing_context, source, target, number, add):
    """Store `number` complex64, or add them if `add` is not 0; quickest for LANES."""
    def generate(context, b, signature, args):
        source, target, number, add = args
        add = b.icmp_signed('!=', add, _INT(0))

        def put(kind, shift):
            places = [_pointer(b, b.add(place, shift), kind) for place in (source, target)]
            sample = b.load(places[0], align=4)
            with b.if_else(add) as (added, stored):
                with added:
                    b.store(b.fadd(sample, b.load(places[1], align=4)), places[1], align=4)
                with stored:
                    b.store(sample, places[1], align=4)

        with b.if_else(b.icmp_signed('==', number, _INT(LANES))) as (whole, part):
            with whole:
                put(_SAMPLES, _INT(0))
            with part, cgutils.for_range(b, b.mul(number, _INT(2))) as loop:
                put(ir.FloatType(), b.mul(loop.index, _INT(4)))
        return context.get_dummy_value()

    return types.void(*[types.int64] * 4), generate


def _store_positions(b, v, least, last, to):
    """Lowest start, and relative to it the starts of all lanes and what is left."""
    v = v.where('>', least, v, least)
    v = v.where('<', last, v, last)
    low = v
    step = LANES // 2
    while step:
        order = ir.VectorType(ir.IntType(32), LANES)([i ^ step for i in range(LANES)])
        other = _Vector(b, b.shuffle_vector(low.value, low.value, order))
        low = low.where('<', other, low, other)
        step //= 2
    low = low.call('floor')
    v = (v - low).rounded()
    start = v.call('floor')
    _store(b, v - start - 0.5, to, _T)
    _store(b, start, to, _START)
    b.store(b.fptosi(b.extract_element(low.value, ir.IntType(32)(0)), _INT),
            _pointer(b, to, _INT, FIRST))


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

    first = b.mul(b.load(_pointer(b, positions, _INT, FIRST)), step)
    start = _load(b, positions, _FLOATS, _START)
    before, (alike, loop, end) = b.block, (b.append_basic_block() for _ in range(3))
    branch(_Vector(b, _FLOATS([1.0] * LANES)), loop, alike)
    b.position_at_end(alike)
    for total, to in zip(sums(first, None), targets, strict=True):
        _store(b, total, to)
    b.branch(end)
    b.position_at_end(loop)
    place, turn = b.phi(_INT), _Vector(b, b.phi(_FLOATS))
    later = b.fcmp_ordered('>', start.value, turn.value)
    for total, to in zip(sums(place, later), targets, strict=True):
        _store(b, start.where('>=', turn, total, _load(b, to, _FLOATS)), to)
    following = turn + 2.0
    place.add_incoming(first, before)
    place.add_incoming(b.add(place, b.mul(step, _INT(2))), b.block)
    turn.value.add_incoming(_FLOATS([0.0] * LANES), before)
    turn.value.add_incoming(following.value, b.block)
    branch(following, loop, end)
    b.position_at_end(end)


def _weighted_sums(b, places, step, weights, taps, t, later):
    """Of the samples from a place on, or of those from the next on where `later`, if given."""
    def sample(place, k):
        here = _load(b, b.add(place, b.mul(step, _INT(k))), _FLOATS)
        if later is None:
            return here
        following = _load(b, b.add(place, b.mul(step, _INT(k + 1))), _FLOATS)
        return _Vector(b, b.select(later, following.value, here.value))

    def weight(k, power):
        return _spread(b, b.load(_pointer(b, weights, ir.FloatType(), 4 * (power * half + k))))

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


def _pointer(b, address, kind, shift=0):
    return b.inttoptr(b.add(address, _INT(shift)), kind.as_pointer())


def _load(b, address, kind, shift=0):
    return _Vector(b, b.load(_pointer(b, address, kind, shift), align=4))


def _store(b, vector, address, shift=0):
    b.store(vector.value, _pointer(b, address, vector.value.type, shift), align=4)


def _spread(b, number):
    """The same number in all lanes."""
    kind, first = ir.VectorType(number.type, LANES), ir.IntType(32)
    one = b.insert_element(kind(ir.Undefined), number, first(0))
    return _Vector(b, b.shuffle_vector(one, one, ir.VectorType(first, LANES)([0] * LANES)))
