# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every kernel of the CUDA backend compiles for a device: the simulator takes more than it does.

No device is needed, but the extra `cuda`; `make gpu` runs this first.
"""

import re

import pytest

from benchmarks.support.gpu_kernels import TYPES, compiled

pytest.importorskip('cupy', reason="the extra 'cuda' is not installed")
pytest.importorskip('numba_cuda', reason="the extra 'cuda' is not installed")

# Kernels whose float64 stays outside the loops over echoes, and those without any.
WITHOUT_FLOAT64 = {'profiles.farrow_coefficients', 'backprojection.merge_parts',
                   'fusion.taper_images'}


@pytest.mark.parametrize(('name', 'signature'), [
    (name, signature) for name, signatures in TYPES.items() for signature in signatures])
def test_kernels_compile(name, signature):
    ptx, _ = compiled(name, signature)
    assert ptx.count('.visible .entry') == 1
    assert 'target sm_90' in ptx
    # a constant without a type makes arithmetic float64, which costs half the rate or far more
    if name in WITHOUT_FLOAT64:
        assert not re.findall(r'\.f64', ptx)
