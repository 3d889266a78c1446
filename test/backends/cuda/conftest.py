"""Kernels of the CUDA backend: on a device, or in Numba's simulator of one.

The simulator must be asked for before Numba is imported: `test_cuda_simulator.py` runs these files
in processes of their own. `make gpu` runs them on a device.
"""

import os

from sar_imaging.backends.device import device_backend

SIMULATED = os.environ.get('NUMBA_ENABLE_CUDASIM') == '1'
collect_ignore_glob = [] if SIMULATED or device_backend() else ['test_*.py']
