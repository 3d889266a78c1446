"""The processor that Numba compiles for."""

from __future__ import annotations

import functools
import re

from llvmlite import binding, ir
from numba.core import config
from numba.core.codegen import get_host_cpu_features, initialize_llvm

_LONGEST = 16  # float32 of a vector
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
    vector = ir.VectorType(ir.FloatType(), _LONGEST)
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
    return _LONGEST if _ADDITION.search(code) else _LONGEST // 2
