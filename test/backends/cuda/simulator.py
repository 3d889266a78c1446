# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Numba's simulator of a device with threads that take turns.

Numba starts a thread of the host for each thread of each block, and looks at all of them in a
loop until they wait for each other or have ended: most of the time goes into that loop. Here the
threads of the host stay, and one of them runs at a time, from one barrier to the next. The order
is drawn anew each time, so that a kernel that lacks a barrier reads what is not yet there.
"""

import operator
import random
import sys
import threading

import numpy as np
from numba.core import types
from numba.cuda.simulator import kernel, kernelapi
from numba.np.numpy_support import as_dtype


class _Thread(threading.Thread):
    """A thread of a block."""

    def __init__(self):
        super().__init__(daemon=True)
        self._turn, self._pause = threading.Lock(), threading.Lock()
        self._turn.acquire()
        self._pause.acquire()
        self.start()

    def begin(self, work, arguments, block, index):
        """Take this thread's part, which `go_on` computes."""
        self._work, self._arguments = work, arguments
        self.blockIdx, self.threadIdx = block, kernelapi.Dim3(*index)
        self.at_work, self.error = True, None

    def go_on(self):
        """Compute until the next barrier or the end; whether it is a barrier."""
        self._turn.release()
        self._pause.acquire()
        if self.error:
            raise self.error
        return self.at_work

    def run(self):
        while True:
            self._turn.acquire()
            try:
                self._work(*self._arguments)
            except Exception as error:  # raised where the kernel was launched
                self.error = error
            self.at_work = False
            self._pause.release()

    def syncthreads(self):
        self._pause.release()
        self._turn.acquire()


class _Block:
    """What `FakeCUDAKernel` runs each block with."""

    _threads = []
    _order = random.Random(1)

    def __init__(self, work, grid_dim, block_dim, debug):
        self._work, self._indices = work, list(np.ndindex(*block_dim))

    def run(self, block, *arguments):
        threads = self._threads
        threads.extend(_Thread() for _ in range(len(self._indices) - len(threads)))
        waiting = threads[:len(self._indices)]
        for thread, index in zip(waiting, self._indices, strict=True):
            thread.begin(self._work, arguments, kernelapi.Dim3(*block), index)
        try:
            while waiting:
                self._order.shuffle(waiting)
                waiting = [thread for thread in waiting if thread.go_on()]
        except Exception:
            threads.clear()  # the others wait within the kernel
            raise


def _shared_array(self, shape, dtype):
    """An array for each line that asks for one; the source of all callers is not read for it.

    Each block finds what no kernel can compute with: what the block before it left may be right.
    """
    caller, place = sys._getframe(1), threading.current_thread().blockIdx
    line, block = (caller.f_code, caller.f_lineno), (place.x, place.y, place.z)
    last, array = self._allocations.get(line, (None, None))
    if last != block:
        kind = as_dtype(dtype) if isinstance(dtype, types.Type) else np.dtype(dtype)
        array = np.full(shape, np.nan if kind.kind == 'f' else np.iinfo(kind).max, kind)
        self._allocations[line] = block, array
    return array


def take_turns():
    """Run all kernels so, on arrays of NumPy."""
    kernel.BlockManager = _Block
    kernel.FakeWithinKernelCUDAArray = operator.attrgetter('_ary')
    kernelapi.FakeCUDAShared.array = _shared_array
