# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""No compiled loop writes beside its arrays, and guards notice one that does."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from benchmarks.guarded_kernels import overwritten
from benchmarks.support.guarded_memory import Guards, guarded
from sar_imaging.backends.cpu import groups, memory


@pytest.mark.parametrize(('seed', 'route'), [(1330050, 'groups'), (1330001, 'points'),
                                             (1330018, 'lines')])
def test_images_write_within_their_arrays(seed, route):
    found, methods = overwritten(seed, ('exact', 'afbp'))
    assert not found and methods[0] == route


def test_weights_behind_their_array_are_found(monkeypatch):
    """As where lines of parts lay closer than those of their sum: rows were too few."""
    whole = groups.quad_width
    monkeypatch.setattr(groups, 'quad_width', lambda *given: whole(*given) - 2)
    found, _ = overwritten(1330000, ('exact',))
    assert found and all('groups' in line and line.endswith('behind') for line in found)


@pytest.mark.parametrize('make', [lambda: memory.aligned_empty((3,), 'f4'),
                                  lambda: memory.WorkSpace()('work', (5,), np.float32)])
def test_one_byte_beside_an_array_is_found(make):
    for place, side in ((-1, 'before'), (0, 'behind')):
        with guarded() as guards:
            array = make()
            array[:] = 1.0
            ctypes.memset(array.ctypes.data + (place if place else array.nbytes), 1, 1)
            [found] = guards.broken()
        assert found.endswith(side)
    assert not isinstance(memory.aligned_empty.__globals__['np'], Guards)  # all is as before
