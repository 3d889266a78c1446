"""Sums of beams and of their pixels, written in the language of Numba's compiler (LLVM).

Left to its vectoriser, LLVM keeps too few sums in registers. Arrays are flat float32, places in
them uint64. Numba's cache only notices changes of the file of a function that it compiled: empty
it after a change of this one.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ....planning.afbp.beam_gain import BEAM_TAPS, STEP_BINS
from ....planning.afbp.beams import CELL_TAPS
from ..fft.butterflies import LINE_BYTES, fetch_line
from ..fft.processor import float_lanes

LANES = STEP_BINS  # float32 that lie together
ROWS = 4  # phasors multiplied at once
STORED = 16  # taps of a table of weights
TILE = 2 * LANES  # cells or pixels that are summed in whole multiples of

_INT, _FLOAT = ir.IntType(64), ir.FloatType()
_WIDTH = float_lanes()  # float32 of a vector
_VECTOR = ir.VectorType(_FLOAT, _WIDTH)
_VECTORS = range(0, 2 * _WIDTH, _WIDTH)  # whose sums stay in registers
_u = types.uint64


@intrinsic
def sum_beams(typing_context, beams, source, apart, size, work, weights, target):
    """Sums of the beams that begin at `source` and so much apart, for some cells in whole tiles.

    Weights of the three orders lie in `work`, which `target` is in, too: real and imaginary parts
    of the sum of each order, so many numbers apart.
    """
    def generate(context, b, signature, args):
        beams, source, apart, size, work, weights, target = _pointers(context, b, signature, args)
        with cgutils.for_range_slice(b, _INT(0), size, _INT(2 * _WIDTH), inc=True) as (cell, _):
            place = b.add(source, b.mul(cell, _INT(2)))
            sums = [[None] * 3 for _ in range(2 * len(_VECTORS))]
            for tap in range(BEAM_TAPS):
                w = _weights(b, work, weights, tap)
                for i, orders in enumerate(sums):
                    x = _load(b, beams, place, i * _WIDTH)
                    orders[:] = [_plus(b, v, x, w[order]) for order, v in enumerate(orders)]
                place = b.add(place, apart)
            for i, at in enumerate(_VECTORS):
                parts = [b.shuffle_vector(x, y, _order(range(part, 2 * _WIDTH, 2)))
                         for x, y in zip(sums[2 * i], sums[2 * i + 1], strict=True)
                         for part in (0, 1)]
                _store(b, work, target, b.add(cell, _INT(at)), size, parts)
        return context.get_dummy_value()

    return types.void(beams, _u, _u, _u, work, _u, _u), generate


@intrinsic
def sum_cells(typing_context, index, size, along, across, work, weights, source, target, apart):
    """Sums of the cells from each of some pixels on, in whole tiles.

    Source and target are in `work`: what `sum_beams` left, and real and imaginary part, so much
    apart each. `along` holds the coefficients, from that of degree 1, of the drift between cells
    as a polynomial of the index; `across` first the two of the drift between beams, then, from
    degree 0, the two of that by how much of the second order the sum is turned.
    """
    def generate(context, b, signature, args):
        index, size, along, across, work, weights, source, target, apart = _pointers(
            context, b, signature, args)
        v1, v2, v3 = (_spread(b, b.extract_value(along, i)) for i in range(3))
        u1, u2, bend, bend1 = (_spread(b, b.extract_value(across, i)) for i in range(4))
        with cgutils.for_range_slice(b, _INT(0), size, _INT(2 * _WIDTH), inc=True) as (pixel, _):
            numbers = [_load(b, index, pixel, at) for at in _VECTORS]
            drifts = [b.fmul(f, _plus(b, v1, f, _plus(b, v2, f, v3))) for f in numbers]
            sums = [[None] * 6 for _ in drifts]
            places = [b.add(source, pixel)]
            for _ in range(5):
                places.append(b.add(places[-1], apart))
            for tap in range(CELL_TAPS):
                w0, w1, w2 = _weights(b, work, weights, tap)
                for i, (at, t) in enumerate(zip(_VECTORS, drifts, strict=True)):
                    w = _plus(b, w0, t, _plus(b, w1, t, w2))
                    sums[i] = [_plus(b, v, _load(b, work, place, at + tap), w)
                               for v, place in zip(sums[i], places, strict=True)]
            for at, f, (re0, im0, re1, im1, re2, im2) in zip(_VECTORS, numbers, sums, strict=True):
                t, c = b.fmul(f, _plus(b, u1, f, u2)), _plus(b, bend, f, bend1)
                re = _plus(b, _plus(b, re0, t, _plus(b, re1, t, re2)), b.fneg(c), im2)
                im = _plus(b, _plus(b, im0, t, _plus(b, im1, t, im2)), c, re2)
                _store(b, work, target, b.add(pixel, _INT(at)), apart, (re, im))
        return context.get_dummy_value()

    return types.void(index, _u, along, across, work, _u, _u, _u, _u), generate


@intrinsic
def add_rows(typing_context, rows, row, phasor_re, phasor_im, phasor, half, sums, total):
    """Add a block of `ROWS` rows, times their phasors, to each couple of beams, for one vector.

    Of each row four vectors, which stay in registers: what the phasor's real part counts, real and
    imaginary part, then what its imaginary part counts. Likewise the sums of each couple.
    """
    def generate(context, b, signature, args):
        rows, row, *factors, phasor, half, sums, total = _pointers(context, b, signature, args)
        for at in range(0, LANES, _WIDTH):
            parts = [[_load(b, rows, row, (4 * k + n) * LANES + at) for n in range(4)]
                     for k in range(ROWS)]
            with cgutils.for_range(b, half) as loop:
                first = b.add(phasor, b.mul(loop.index, _INT(ROWS)))
                to = b.add(total, b.mul(loop.index, _INT(4 * LANES)))
                for n, factor in zip((0, 2), factors, strict=True):
                    values = [_load(b, sums, to, (n + i) * LANES + at) for i in range(2)]
                    for k in range(ROWS):
                        w = _spread(b, b.load(b.gep(factor, [b.add(first, _INT(k))]), align=4))
                        values = [_plus(b, v, parts[k][n + i], w) for i, v in enumerate(values)]
                    _store(b, sums, to, _INT(n * LANES + at), _INT(LANES), values)
        return context.get_dummy_value()

    return types.void(rows, _u, phasor_re, phasor_im, _u, _u, sums, _u), generate


@intrinsic
def fetch(typing_context, data, place, size):
    """Bring some numbers into the cache."""
    def generate(context, b, signature, args):
        data, place, size = _pointers(context, b, signature, args)
        with cgutils.for_range_slice(b, _INT(0), size, _INT(LINE_BYTES // 4), inc=True) as (i, _):
            fetch_line(b, b.gep(data, [b.add(place, i)]))
        return context.get_dummy_value()

    return types.void(data, _u, _u), generate


def _pointers(context, b, signature, args):
    """The arguments, arrays as pointers to their first element."""
    return [context.make_array(kind)(context, b, value).data if isinstance(kind, types.Array)
            else value for kind, value in zip(signature.args, args, strict=True)]


def _load(b, data, place, more):
    place = b.gep(data, [b.add(place, _INT(more))])
    return b.load(b.bitcast(place, _VECTOR.as_pointer()), align=4)


def _store(b, data, target, number, apart, parts):
    place = b.add(target, number)
    for part in parts:
        b.store(part, b.bitcast(b.gep(data, [place]), _VECTOR.as_pointer()), align=4)
        place = b.add(place, apart)


def _weights(b, data, weights, tap):
    return [_spread(b, b.load(b.gep(data, [b.add(weights, _INT(order * STORED + tap))]), align=4))
            for order in range(3)]


def _spread(b, value):
    one = b.insert_element(_VECTOR(ir.Undefined), value, ir.IntType(32)(0))
    return b.shuffle_vector(one, one, _order([0] * _WIDTH))


def _order(lanes):
    lanes = list(lanes)
    return ir.VectorType(ir.IntType(32), len(lanes))(lanes)


def _plus(b, total, x, y):
    product = b.fmul(x, y)
    return product if total is None else b.fadd(total, product)
