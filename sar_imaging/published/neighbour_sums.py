"""Two-dimensional interpolation of one complex pixel, the neighbours of a line in one register.

A compiler that meets this sum in a loop over pixels reads the same neighbour of many pixels with
gathers, which many processors execute an element at a time. The functions here are given to LLVM
as vectors along a line instead; LLVM translates them for any processor.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .neighbour_weights import DEGREE

_FAST = ('contract', 'reassoc', 'nsz')
_FLOAT = ir.FloatType()


def _make(taps):
    kind = ir.VectorType(_FLOAT, taps)

    @intrinsic
    def interpolate(typing_context, image, place, line_step, imag, table_range, table_alpha,
                    x_range, x_alpha):
        def generate(context, builder, signature, arguments):
            def data(number):
                array = context.make_array(signature.args[number])
                return array(context, builder, arguments[number]).data

            def load(base, position):
                pointer = builder.bitcast(builder.gep(base, [position]), kind.as_pointer())
                values = builder.load(pointer)
                values.align = 4
                return values

            def add_product(a, b, c):
                return builder.fadd(builder.fmul(a, b, flags=_FAST), c, flags=_FAST)

            def splat(value):
                vector = builder.insert_element(ir.Constant(kind, ir.Undefined), value,
                                                _number(0))
                return builder.shuffle_vector(vector, vector, _lanes([0] * taps))

            def weights(table, x):
                x = splat(x)
                total = load(table, ir.Constant(ir.IntType(64), DEGREE * taps))
                for power in reversed(range(DEGREE)):
                    total = add_product(
                        total, x, load(table, ir.Constant(ir.IntType(64), power * taps)))
                return total

            def total(vector, width):
                while width > 1:
                    width //= 2
                    parts = [builder.shuffle_vector(vector, vector, _lanes(list(lanes)))
                             for lanes in (range(width), range(width, 2 * width))]
                    vector = builder.fadd(*parts, flags=_FAST)
                return builder.extract_element(vector, _number(0))

            along_range = weights(data(4), arguments[6])
            along_alpha = weights(data(5), arguments[7])
            each = [builder.shuffle_vector(along_alpha, along_alpha, _lanes([k] * taps))
                    for k in range(taps)]
            base, sums = data(0), []
            for part in (arguments[1], builder.add(arguments[1], arguments[3])):
                lines, where = ir.Constant(kind, [0.0] * taps), part
                for weight in each:
                    lines = add_product(weight, load(base, where), lines)
                    where = builder.add(where, arguments[2])
                sums.append(total(builder.fmul(lines, along_range, flags=_FAST), taps))
            return cgutils.pack_array(builder, sums)

        whole = types.int64
        return (types.UniTuple(types.float32, 2)(
            image, whole, whole, whole, table_range, table_alpha, types.float32, types.float32),
            generate)

    interpolate.__doc__ = f"""Real and imaginary part between {taps} x {taps} neighbours.

    Parameters
    ----------
    image : (N,) float32
        Real, then imaginary parts.
    place : int64
        First neighbour; not checked against the size of the image.
    line_step, imag : int64
        From line to line, and from a real part to its imaginary part.
    table_range, table_alpha : ({(DEGREE + 1) * taps},) float32
        Coefficients of the weights of all neighbours, by ascending power.
    x_range, x_alpha : float32
        Where to evaluate them.
    """
    return interpolate


def _number(value):
    return ir.Constant(ir.IntType(32), value)


def _lanes(lanes):
    return ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)


interpolate2, interpolate4, interpolate8 = (_make(taps) for taps in (2, 4, 8))
