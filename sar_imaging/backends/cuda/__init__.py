# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The backend for CUDA devices: Numba's kernels, CuPy's arrays and Fourier transforms.

It computes the plans of the processor's backend, with the same windows, grids and interpolators.
Its entries are imported when they are used first; nothing of CUDA is imported before.
"""

import importlib
from typing import Any

DEVICE_ARRAYS = True  # of CuPy are taken as well

_MODULES = {'Backprojection': 'backprojection', 'SubapertureImager': 'subapertures',
            'SpectrumFusion': 'fusion', 'ApertureFusion': 'subapertures',
            'form_map': 'fusion', 'seconds': 'costs', 'device_costs': 'costs',
            'compress': 'transfers', 'to_device': 'transfers',
            'to_host': 'transfers', 'synchronise': 'arrays', 'device_name': 'arrays',
            'DEFAULT': 'costs', 'VARIABLE': 'costs', 'TrialImages': 'points'}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'.{_MODULES[name]}', __name__), name)
