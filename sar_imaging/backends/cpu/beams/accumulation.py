"""Sums of beams and of their pixels, written as instructions.

Left to its vectoriser, LLVM keeps too few sums in registers. Arrays are flat float32, places in
them uint64.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from ....planning.afbp.beam_gain import BEAM_TAPS, STEP_BINS
from ....planning.afbp.beams import CELL_TAPS
from ..fft.processor import float_lanes
from ..instructions import FLOAT, INT, LINE_BYTES, Vector, instructions, order

LANES = STEP_BINS  # float32 that lie together
ECHOES = 4  # phasors multiplied at once
STORED = 16  # taps of a table of weights
TILE = 2 * LANES  # cells or pixels that are summed in whole multiples of

_WIDTH = float_lanes()  # float32 of a vector
_VECTOR = ir.VectorType(FLOAT, _WIDTH)
_VECTORS = range(0, 2 * _WIDTH, _WIDTH)  # whose sums stay in registers
_u = types.uint64


@instructions(None, _u, _u, _u, None, _u, _u)
def sum_beams(b, beams, source, apart, size, work, weights, target):
    """Sums of the beams that begin at `source` and so much apart, for some cells in whole tiles.

    Weights of the three orders lie in `work`, which `target` is in, too: real and imaginary parts
    of the sum of each order, so many numbers apart.
    """
    with cgutils.for_range_slice(b, INT(0), size, INT(2 * _WIDTH), inc=True) as (cell, _):
        place = b.add(source, b.mul(cell, INT(2)))
        sums = [[None] * 3 for _ in range(2 * len(_VECTORS))]
        for tap in range(BEAM_TAPS):
            w = _weights(b, work, weights, tap)
            for i, orders in enumerate(sums):
                x = _load(b, beams, place, i * _WIDTH)
                orders[:] = [_plus(v, x * w[n]) for n, v in enumerate(orders)]
            place = b.add(place, apart)
        for i, at in enumerate(_VECTORS):
            parts = [Vector(b, b.shuffle_vector(x.value, y.value,
                                                order(range(part, 2 * _WIDTH, 2))))
                     for x, y in zip(sums[2 * i], sums[2 * i + 1], strict=True)
                     for part in (0, 1)]
            _store(b, work, b.add(target, b.add(cell, INT(at))), size, parts)


@instructions(None, _u, None, None, None, _u, _u, _u, _u)
def sum_cells(b, index, size, along, across, work, weights, source, target, apart):
    """Sums of the cells from each of some pixels on, in whole tiles.

    Source and target are in `work`: what `sum_beams` left, and real and imaginary part, so much
    apart each. `along` holds the coefficients, from that of degree 1, of the drift between cells
    as a polynomial of the index; `across` first the two of the drift between beams, then, from
    degree 0, the two of that by how much of the second order the sum is turned.
    """
    _sum_cells(b, index, size, along, across, work, weights, source, target, apart)


@instructions(None, _u, None, None, None, _u, _u, _u, _u, None)
def sum_lit_cells(b, index, size, along, across, work, weights, source, target, apart, lit):
    """As `sum_cells`, of echoes whose amplitude is a parabola of their phase from beam to beam.

    `lit` holds, from degree 0, the two coefficients by index of A, of B and of C: the sum is A
    times the beams', less j B times their first derivative, less C times their second one.
    """
    _sum_cells(b, index, size, along, across, work, weights, source, target, apart, lit)


def _sum_cells(b, index, size, along, across, work, weights, source, target, apart, lit=None):
    v1, v2, v3 = (b.spread(b.extract_value(along, i), _WIDTH) for i in range(3))
    u1, u2, bend, bend1 = (b.spread(b.extract_value(across, i), _WIDTH) for i in range(4))
    if lit is not None:
        lit = [b.spread(b.extract_value(lit, i), _WIDTH) for i in range(6)]
    with cgutils.for_range_slice(b, INT(0), size, INT(2 * _WIDTH), inc=True) as (pixel, _):
        numbers = [_load(b, index, pixel, at) for at in _VECTORS]
        drifts = [f * (v1 + f * (v2 + f * v3)) for f in numbers]
        sums = [[None] * 6 for _ in drifts]
        places = [b.add(source, pixel)]
        for _ in range(5):
            places.append(b.add(places[-1], apart))
        for tap in range(CELL_TAPS):
            w0, w1, w2 = _weights(b, work, weights, tap)
            for i, (at, t) in enumerate(zip(_VECTORS, drifts, strict=True)):
                w = w0 + t * (w1 + t * w2)
                sums[i] = [_plus(v, _load(b, work, place, at + tap) * w)
                           for v, place in zip(sums[i], places, strict=True)]
        for at, f, (re0, im0, re1, im1, re2, im2) in zip(_VECTORS, numbers, sums, strict=True):
            t, c = f * (u1 + f * u2), bend + f * bend1
            re = re0 + t * (re1 + t * re2) + -c * im2
            im = im0 + t * (im1 + t * im2) + c * re2
            if lit is not None:
                # of the second derivative the weights hold half
                one, two = lit[2] + f * lit[3], (lit[4] + f * lit[5]) * -2.0
                whole, twice = lit[0] + f * lit[1], t + t
                re, im = (whole * re + one * (im1 + twice * im2) + two * re2,
                          whole * im + -one * (re1 + twice * re2) + two * im2)
            _store(b, work, b.add(target, b.add(pixel, INT(at))), apart, (re, im))


@instructions(None, _u, None, None, _u, _u, None, _u)
def add_echoes(b, echoes, echo, phasor_re, phasor_im, phasor, half, sums, total):
    """Add `ECHOES` echoes, times their phasors, to each couple of beams, for one vector.

    Four vectors of each echo stay in registers: what the phasor's real part counts, real and
    imaginary part, then what its imaginary part counts. Likewise the sums of each couple.
    """
    for at in range(0, LANES, _WIDTH):
        parts = [[_load(b, echoes, echo, (4 * k + n) * LANES + at) for n in range(4)]
                 for k in range(ECHOES)]
        with cgutils.for_range(b, half) as loop:
            first = b.add(phasor, b.mul(loop.index, INT(ECHOES)))
            to = b.add(total, b.mul(loop.index, INT(4 * LANES)))
            for n, factor in zip((0, 2), (phasor_re, phasor_im), strict=True):
                values = [_load(b, sums, to, (n + i) * LANES + at) for i in range(2)]
                for k in range(ECHOES):
                    w = _load_spread(b, factor, b.add(first, INT(k)))
                    values = [v + parts[k][n + i] * w for i, v in enumerate(values)]
                _store(b, sums, b.add(to, INT(n * LANES + at)), INT(LANES), values)


@instructions(None, _u, _u)
def fetch(b, data, place, size):
    """Bring some numbers into the cache."""
    with cgutils.for_range_slice(b, INT(0), size, INT(LINE_BYTES // 4), inc=True) as (i, _):
        b.fetch_line(b.gep(data, [b.add(place, i)]))


def _load(b, data, place, shift):
    return Vector(b, b.load(b.element(data, place, _VECTOR, shift), align=4))


def _store(b, data, place, apart, parts):
    for part in parts:
        b.store(part.value, b.element(data, place, _VECTOR), align=4)
        place = b.add(place, apart)


def _load_spread(b, data, place):
    return b.spread(b.load(b.gep(data, [place]), align=4), _WIDTH)


def _weights(b, data, weights, tap):
    return [_load_spread(b, data, b.add(weights, INT(n * STORED + tap))) for n in range(3)]


def _plus(total, product):
    return product if total is None else total + product
