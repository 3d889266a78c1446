# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What a report of a fault tells of a machine."""

import platform
import sys

import numpy as np
import pytest

from sar_imaging.tools import environment


def test_versions_and_variables_are_told(monkeypatch, capsys):
    monkeypatch.setenv('NUMBA_NUM_THREADS', '2')
    monkeypatch.setenv('SECRET', 'of nobody')
    assert environment.main([]) == 0
    told = capsys.readouterr().out
    assert platform.python_version() in told and f'numpy {np.__version__}' in told
    assert 'NUMBA_NUM_THREADS=2' in told and 'SECRET' not in told


def test_what_is_not_installed_is_told(monkeypatch, capsys):
    monkeypatch.setattr(environment, 'OPTIONAL', ('no-such-distribution',))
    monkeypatch.setattr(environment.importlib.util, 'find_spec', lambda name: None)
    assert environment.main([]) == 0
    told = capsys.readouterr().out
    assert 'no-such-distribution not installed' in told and 'rclpy is not installed' in told


@pytest.mark.parametrize('missing', [(), ('omppool', 'tbbpool')])
def test_a_machine_without_openmp_is_told(missing, monkeypatch, capsys):
    """As Debian is without libgomp1; Numba's own threads end a process with two callers."""
    for pool in ('omppool', 'tbbpool'):
        available = None if pool in missing else sys  # any module serves
        monkeypatch.setitem(sys.modules, f'numba.np.ufunc.{pool}', available)
    assert environment.main([]) == 0
    assert ('libgomp1' in capsys.readouterr().out) == bool(missing)
