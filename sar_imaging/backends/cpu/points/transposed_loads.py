"""Reads of short runs of floats from many places of a table, turned into columns.

Neighbouring pixels of an arbitrary image read eight consecutive coefficients each, at positions
that only the geometry knows. A compiler turns such reads into one gather per coefficient, which
many processors execute an element at a time; one load of four floats per pixel followed by a
transposition in registers is several times as fast.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types

from ..instructions import FLOAT, INT, INT32, instructions, order

RUN = 8  # floats per pixel
PIXELS = 16  # pixels read together

_QUAD, _COLUMN = ir.VectorType(FLOAT, 4), ir.VectorType(FLOAT, PIXELS)
_i = types.int64


@instructions(None, _i, None, _i, None, _i, _i)
def load_columns(b, table, offset, index, first, out, to, stride):
    """``out[to + stride i + j] = table[offset + index[first + j] + i]``, i below 8, j below 16.

    `table` and `out`, float32, and `index`, int32, are contiguous. Starts are not checked against
    the size of the table.
    """
    runs = [b.add(offset, b.sext(b.load(b.element(index, first, INT32, pixel)), INT))
            for pixel in range(PIXELS)]
    for half in (0, 4):
        quads = [b.load(b.element(table, run, _QUAD, half), align=4) for run in runs]
        for column, values in enumerate(_transposed(b, quads)):
            place = b.add(to, b.mul(stride, INT(half + column)))
            b.store(values, b.element(out, place, _COLUMN), align=4)


def _transposed(b, quads):
    """Four vectors of 16 from sixteen vectors of four."""
    def pick(x, y, lanes):  # the same of every four floats; 4 to 7 are those of y
        return b.shuffle_vector(x, y, order(lane % 4 + quad + PIXELS * (lane // 4) for quad in
                                            range(0, PIXELS, 4) for lane in lanes))

    rows = []
    for j in range(4):  # pixels j, 4 + j, 8 + j, 12 + j side by side
        halves = [b.shuffle_vector(quads[k + j], quads[k + 4 + j], order(range(8)))
                  for k in (0, 8)]
        rows.append(b.shuffle_vector(*halves, order(range(PIXELS))))
    low = [pick(rows[k], rows[k + 1], (0, 4, 1, 5)) for k in (0, 2)]
    high = [pick(rows[k], rows[k + 1], (2, 6, 3, 7)) for k in (0, 2)]
    return [pick(*pair, lanes) for pair in (low, high) for lanes in ((0, 1, 4, 5), (2, 3, 6, 7))]
