# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the CUDA backend: on a device, or in Numba's simulator of one.

The simulator must be asked for before Numba is imported: `test_cuda_simulator.py` runs these files
in processes of their own. `make gpu` runs them on a device.
"""

import importlib
import os

import numba
import pytest

from benchmarks.support.gpu_kernels import PAIRS, TYPES
from sar_imaging.backends.device import device_backend

from .simulator import take_turns

SIMULATED = os.environ.get('NUMBA_ENABLE_CUDASIM') == '1'
collect_ignore_glob = [] if SIMULATED or device_backend() else ['test_*.py']

if SIMULATED:
    take_turns()

# The simulator takes a thread of the host for each of a block, also where a small image has no
# pixel for it. Kernels whose blocks have any number of threads get fewer.
for name in ('profiles', 'polar_to_map', 'illumination', 'beams', 'fusion',
             'subapertures') if SIMULATED else ():
    importlib.import_module(f'sar_imaging.backends.cuda.{name}')._THREADS = 16


@pytest.fixture(autouse=SIMULATED)
def launched_types(monkeypatch):
    """Kernels are launched with the types for which `test_cuda_compiles.py` compiles them."""
    from numba.cuda.simulator import kernel

    call = kernel.FakeCUDAKernel.__call__

    def checked(self, *arguments):
        name = f'{self.fn.__module__}.{self.fn.__name__}'.split('.cuda.')[1]
        given = [numba.typeof(argument) for argument in arguments]
        assert any(len(given) == len(wanted) and all(map(_same, given, wanted))
                   for wanted in TYPES[name]), (name, given)
        return call(self, *arguments)

    monkeypatch.setattr(kernel.FakeCUDAKernel, '__call__', checked)


def _same(given, wanted):
    if wanted == PAIRS and given.dtype == numba.types.complex64:  # in the simulator
        return given.ndim == 1 and given.layout == 'C'
    return given == wanted
