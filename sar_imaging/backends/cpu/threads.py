"""Jobs of a parallel loop that its tasks take in turn, each the next one that is left.

Shares that are dealt out beforehand make all wait for the processor that something else keeps
busy.
"""

from __future__ import annotations

import numpy as np
from numba.core import types

from .instructions import INT, instructions


def job_counter() -> np.ndarray:
    """(1,) int64 counter for one run through the jobs of a loop, to be kept until its end."""
    return np.zeros(1, np.int64)


@instructions(types.int64, returns=types.int64)
def take_job(b, counter):
    """Number of the next job, from 0, by the address of a `job_counter`; also beyond the last."""
    return b.atomic_rmw('add', b.pointer(counter, INT), INT(1), 'monotonic')
