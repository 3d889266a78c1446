"""Kernels of the CUDA backend: on a device, or in Numba's simulator of one.

The simulator must be asked for before Numba is imported: `test_cuda_simulator.py` runs these files
in processes of their own. `make gpu` runs them on a device.
"""

import importlib
import os

from sar_imaging.backends.device import device_backend

SIMULATED = os.environ.get('NUMBA_ENABLE_CUDASIM') == '1'
collect_ignore_glob = [] if SIMULATED or device_backend() else ['test_*.py']

# The simulator starts a thread of the host for each of a block, also where a small image has no
# pixel for it. Kernels whose blocks have any number of threads get fewer.
for name in ('profiles', 'polar_to_map', 'afbp.fusion') if SIMULATED else ():
    importlib.import_module(f'sar_imaging.backends.cuda.{name}')._THREADS = 16
