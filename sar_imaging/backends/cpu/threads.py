"""Jobs of a parallel loop that its tasks take in turn, each the next one that is left.

Shares that are dealt out beforehand make all wait for the processor that something else keeps
busy. Numba's cache only notices changes of the file of a function that it compiled: empty it after
a change of this one.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_INT = ir.IntType(64)


def job_counter() -> np.ndarray:
    """(1,) int64 counter for one run through the jobs of a loop, to be kept until its end."""
    return np.zeros(1, np.int64)


@intrinsic
def take_job(typing_context, counter):
    """Number of the next job, from 0, by the address of a `job_counter`; also beyond the last."""
    def generate(context, b, signature, args):
        return b.atomic_rmw('add', b.inttoptr(args[0], _INT.as_pointer()), _INT(1), 'monotonic')

    return types.int64(types.int64), generate
