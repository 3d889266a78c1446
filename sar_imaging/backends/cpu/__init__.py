# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The compiled backend: vectors, threads, own Fourier transforms and memory of their own.

Its entries (`backends.protocol`) are imported when they are used first, so
that exact backprojection does not load the beams and transforms of AFBP.
"""

import importlib
from typing import Any

ILLUMINATION = True  # of plans is followed
GROUPS = True  # of echoes are imaged one by one

_MODULES = {'Backprojection': 'backprojection', 'SubapertureImager': 'beams',
            'SpectrumFusion': 'fusion', 'form_map': 'fusion',
            'compile_kernels': 'beforehand',
            'correlate_spectra': 'correlation',
            'correlate_profiles': 'correlation',
            'TrialImages': 'points', 'VARIABLE': 'costs',
            'measured_costs': 'costs'}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'.{_MODULES[name]}', __name__), name)
