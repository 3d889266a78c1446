"""Reads of short runs of floats from many places of a table, turned into columns.

Neighbouring pixels of an arbitrary image read eight consecutive coefficients each, at positions
that only the geometry knows. A compiler turns such reads into one gather per coefficient, which
many processors execute an element at a time; one load of four floats per pixel followed by a
transposition in registers is several times as fast. Numba has no loop that becomes these
instructions, so the function is given to LLVM directly; LLVM translates it for any processor.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

RUN = 8  # floats per pixel
PIXELS = 16  # pixels read together

_QUAD = ir.VectorType(ir.FloatType(), 4)
_COLUMN = ir.VectorType(ir.FloatType(), PIXELS)


@intrinsic
def load_columns(_, table, offset, index, first, out, to, stride):
    """``out[to + stride i + j] = table[offset + index[first + j] + i]``, i below 8, j below 16.

    Parameters
    ----------
    table : (T,) float32
        Contiguous.
    offset : int64
        Where the runs of this call start.
    index : (N,) int32
        Start of each pixel's run; not checked against the size of the table.
    first : int64
        First of the 16 pixels.
    out : (M,) float32
        Written to, contiguous.
    to, stride : int64
        Where to write, and the distance of the columns.
    """
    def generate(context, builder, signature, arguments):
        def data(number):
            array = context.make_array(signature.args[number])
            return array(context, builder, arguments[number]).data

        def at(base, position, shift, kind):
            where = builder.add(position, ir.Constant(position.type, shift))
            return builder.bitcast(builder.gep(base, [where]), kind.as_pointer())

        table_data, index_data, out_data = data(0), data(2), data(4)
        runs = []
        for pixel in range(PIXELS):
            number = builder.load(at(index_data, arguments[3], pixel, ir.IntType(32)))
            runs.append(builder.add(arguments[1], builder.sext(number, ir.IntType(64))))
        for half in (0, 4):
            quads = []
            for run in runs:
                quads.append(builder.load(at(table_data, run, half, _QUAD)))
                quads[-1].align = 4
            for column, values in enumerate(_transposed(builder, quads)):
                shift = builder.mul(arguments[6], ir.Constant(ir.IntType(64), half + column))
                where = at(out_data, builder.add(arguments[5], shift), 0, _COLUMN)
                builder.store(values, where).align = 4
        return context.get_dummy_value()

    whole = types.int64
    return types.void(table, whole, index, whole, out, whole, whole), generate


def _transposed(builder, quads):
    """Four vectors of 16 from sixteen vectors of four."""
    def shuffle(a, b, lanes):
        kind = ir.VectorType(ir.IntType(32), len(lanes))
        return builder.shuffle_vector(a, b, ir.Constant(kind, lanes))

    def pick(a, b, lanes):  # the same of every four floats; 4 to 7 are those of b
        return shuffle(a, b, [lane % 4 + quad + PIXELS * (lane // 4)
                              for quad in range(0, PIXELS, 4) for lane in lanes])

    rows = []
    for j in range(4):  # pixels j, 4 + j, 8 + j, 12 + j side by side
        halves = [shuffle(quads[k + j], quads[k + 4 + j], list(range(8))) for k in (0, 8)]
        rows.append(shuffle(*halves, list(range(PIXELS))))
    low = [pick(rows[k], rows[k + 1], (0, 4, 1, 5)) for k in (0, 2)]
    high = [pick(rows[k], rows[k + 1], (2, 6, 3, 7)) for k in (0, 2)]
    return [pick(*pair, lanes) for pair in (low, high) for lanes in ((0, 1, 4, 5), (2, 3, 6, 7))]
