# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Functions of kernels that write their instructions themselves, in the language of LLVM.

Numba, whose compiler LLVM is, has no vectors, prefetches or atomic additions. LLVM translates
these functions for any processor, and divides vectors where a processor's are shorter. Numba's
cache only notices changes of the file of a function that it compiled: empty it after a change of
what such a function writes.

Tasks of a parallel loop take its jobs in turn, each the next one that is left (`take_job`): shares
that are dealt out beforehand make all wait for the processor that something else keeps busy.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from llvmlite import binding, ir
from numba.core import config, types
from numba.core.codegen import get_host_cpu_features, initialize_llvm
from numba.extending import intrinsic

if TYPE_CHECKING:
    _Operand: TypeAlias = 'Vector | float | np.float32'

INT, INT32, FLOAT, DOUBLE = ir.IntType(64), ir.IntType(32), ir.FloatType(), ir.DoubleType()
LINE_BYTES = 64  # of the cache
_MOST_LANES = 16  # float32 of a vector
_ADDITION = re.compile(r'^\s*v?addps\s.*zmm', re.MULTILINE)


@functools.cache
def float_lanes() -> int:
    """Numbers of float32 that kernels written in vectors take together: 16, or 8.

    16 where a vector of the processor holds them, which is AVX-512. Otherwise 8: with 16 values
    would not stay in registers (335 of 1,348 instructions of a transform of 16 move some, with 8
    lanes 92 of 639), and with 4, where vectors hold 4, more time goes into all else.

    LLVM is asked how it adds vectors on the processor that Numba compiles for: this one, or what
    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES name.
    """
    initialize_llvm()
    module = ir.Module()
    module.triple = binding.get_process_triple()
    vector = ir.VectorType(ir.FloatType(), _MOST_LANES)
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [vector.as_pointer()]), 'add')
    builder = ir.IRBuilder(function.append_basic_block())
    value = builder.load(function.args[0], align=4)
    builder.store(builder.fadd(value, value), function.args[0], align=4)
    builder.ret_void()
    name, features = config.CPU_NAME, config.CPU_FEATURES
    machine = binding.Target.from_triple(module.triple).create_target_machine(
        cpu=binding.get_host_cpu_name() if name is None else name,
        features=get_host_cpu_features() if features is None else features)
    code = machine.emit_assembly(binding.parse_assembly(str(module)))
    return _MOST_LANES if _ADDITION.search(code) else _MOST_LANES // 2


LANES = float_lanes()  # transformed together: a vector of the processor
SAMPLE_BYTES, VECTOR_BYTES = 8, 4 * LANES
GROUP_BYTES = LANES * SAMPLE_BYTES
BLOCK = LANES // 2  # rows and columns of a transposition: samples of a vector


def instructions(*kinds: types.Type | None, returns: types.Type = types.void
                 ) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make ``write(b, *values)``, which writes instructions with a `Writer`, a function.

    Kernels call it with as many arguments. `kinds` are Numba's types of the arguments, None for
    any; arrays are given to `write` as pointers to their first element. What `write` returns is
    the value of the function.
    """
    def decorate(write: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(write)
        def typed(typing_context: Any, *given: types.Type) -> tuple[Any, Callable[..., Any]]:
            def generate(context: Any, b: ir.IRBuilder, signature: Any, args: Sequence[ir.Value]
                         ) -> ir.Value:
                value = write(Writer(b), *(
                    context.make_array(kind)(context, b, arg).data
                    if isinstance(kind, types.Array) else arg
                    for kind, arg in zip(signature.args, args, strict=True)))
                return context.get_dummy_value() if value is None else value

            wanted = (kind or found for kind, found in zip(kinds, given, strict=True))
            return returns(*wanted), generate

        return intrinsic(typed)

    return decorate


class Vector:
    """Vector whose operators write instructions; other operands may be numbers."""

    def __init__(self, b: Writer, value: ir.Value):
        self.b, self.value = b, value

    def _with(self, write: Callable[[ir.Value, ir.Value], ir.Value], other: _Operand) -> Vector:
        return Vector(self.b, write(self.value, self._of(other)))

    def _of(self, other: _Operand) -> ir.Value:
        if isinstance(other, Vector):
            return other.value
        return self.value.type([float(other)] * self.value.type.count)

    def __add__(self, other: _Operand) -> Vector:
        return self._with(self.b.fadd, other)

    def __sub__(self, other: _Operand) -> Vector:
        return self._with(self.b.fsub, other)

    def __mul__(self, other: _Operand) -> Vector:
        return self._with(self.b.fmul, other)

    def __neg__(self) -> Vector:
        return Vector(self.b, self.b.fneg(self.value))

    def where(self, relation: str, other: _Operand, a: _Operand, b: _Operand) -> Vector:
        """``a`` where the relation holds, else ``b``."""
        chosen = self.b.fcmp_ordered(relation, self.value, self._of(other))
        return Vector(self.b, self.b.select(chosen, self._of(a), self._of(b)))

    def call(self, name: str) -> Vector:
        """Of an intrinsic function of LLVM."""
        kind = self.value.type
        suffix = f'v{kind.count}{"f64" if kind.element == DOUBLE else "f32"}'
        function = self.b.module.declare_intrinsic(f'llvm.{name}.{suffix}', (),
                                                   ir.FunctionType(kind, [kind]))
        return Vector(self.b, self.b.call(function, [self.value]))

    def rounded(self) -> Vector:
        """As float32."""
        kind = ir.VectorType(FLOAT, self.value.type.count)
        return Vector(self.b, self.b.fptrunc(self.value, kind))


def order(lanes: Iterable[int]) -> ir.Constant:
    """Constant that shuffles take."""
    lanes = list(lanes)
    return ir.VectorType(INT32, len(lanes))(lanes)


class Writer:
    """LLVM's builder, with what it lacks."""

    def __init__(self, builder: ir.IRBuilder):
        self._builder = builder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._builder, name)

    def spread(self, number: ir.Value, lanes: int) -> Vector:
        """The same number in all lanes."""
        kind = ir.VectorType(number.type, lanes)
        one = self.insert_element(kind(ir.Undefined), number, INT32(0))
        return Vector(self, self.shuffle_vector(one, one, order([0] * lanes)))

    def parts_of(self, samples: ir.Value) -> list[Vector]:
        """Real and imaginary parts of complex numbers that lie in a vector in turn."""
        return [Vector(self, self.shuffle_vector(samples, samples, order(range(
            part, samples.type.count, 2)))) for part in (0, 1)]

    def interleaved(self, re: Vector, im: Vector) -> ir.Value:
        """The opposite of `parts_of`."""
        n = re.value.type.count
        return self.shuffle_vector(re.value, im.value, order(
            i // 2 + i % 2 * n for i in range(2 * n)))

    def transposed(self, rows: Iterable[ir.Value]) -> list[ir.Value]:
        """Vectors in which the elements of as many vectors lie transposed."""
        rows, n = list(rows), len(rows)
        step = 1
        while step < n:  # exchange blocks of 1, 2, 4 and so on beside the diagonal
            for i in (i for i in range(n) if not i & step):
                pair = rows[i], rows[i + step]
                rows[i] = self.shuffle_vector(*pair, order(
                    n + j - step if j & step else j for j in range(n)))
                rows[i + step] = self.shuffle_vector(*pair, order(
                    n + j if j & step else j + step for j in range(n)))
            step *= 2
        return rows

    def pointer(self, address: ir.Value, kind: ir.Type, shift: int = 0) -> ir.Value:
        """What lies so many bytes from an address."""
        return self.inttoptr(self.add(address, INT(shift)), kind.as_pointer())

    def element(self, data: ir.Value, place: ir.Value, kind: ir.Type, shift: int = 0) -> ir.Value:
        """Pointer to a vector, or number, from an element of an array on."""
        place = self.gep(data, [self.add(place, place.type(shift))])
        return self.bitcast(place, kind.as_pointer())

    def fetch_line(self, place: ir.Value, locality: int = 3) -> None:
        """Bring a line of the cache into the first cache (locality 3), or the second one (2)."""
        kind = ir.IntType(8).as_pointer()
        prefetch = self.module.declare_intrinsic('llvm.prefetch', [kind], ir.FunctionType(
            ir.VoidType(), [kind, INT32, INT32, INT32]))
        self.call(prefetch, [self.bitcast(place, kind), INT32(0), INT32(locality), INT32(1)])


def job_counter() -> np.ndarray:
    """(1,) int64 counter for one run through the jobs of a loop, to be kept until its end."""
    return np.zeros(1, np.int64)


@instructions(types.int64, returns=types.int64)
def take_job(b, counter):
    """Number of the next job, from 0, by the address of a `job_counter`; also beyond the last."""
    return b.atomic_rmw('add', b.pointer(counter, INT), INT(1), 'monotonic')


@instructions(*[types.int64] * 4)
def transpose(b, source, source_step, target, target_step):
    """Transpose `BLOCK` x `BLOCK` samples; steps are the bytes from a row to the next."""
    kind = ir.VectorType(DOUBLE, BLOCK)  # complex64 that are only moved

    def row(place, step, i):
        return b.pointer(b.add(place, b.mul(step, INT(i))), kind)

    rows = [b.load(row(source, source_step, i), align=4) for i in range(BLOCK)]
    for i, samples in enumerate(b.transposed(rows)):
        b.store(samples, row(target, target_step, i), align=4)


@instructions(types.int64, returns=types.int64)
def integer_at(b, address):
    """The int64 at an address."""
    return b.load(b.pointer(address, INT))
