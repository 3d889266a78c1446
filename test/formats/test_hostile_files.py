# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile files and places: a sample of the campaigns of `benchmarks`, or all of them."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parent.parent.parent


def run(*words):
    """A program of benchmarks, which forks: threads of this process would not follow."""
    for library in ('sarkit', 'rasterio', 'h5py', 'rosbags'):
        pytest.importorskip(library, reason=f'{library} reads some of the files')
    ended = subprocess.run([sys.executable, '-m', *words], cwd=ROOT, text=True,
                           env=os.environ | {'OMP_NUM_THREADS': '1', 'NUMBA_NUM_THREADS': '1'},
                           capture_output=True)
    assert ended.returncode == 0, ended.stdout[-5000:] + ended.stderr[-2000:]


def test_a_sample_of_hostile_files():
    run('benchmarks.hostile_files', '--most', '3', '--readers', 'NumPy .npz', 'HDF5',
        'description', 'bag, MCAP', 'bag, SQLite')


def test_a_sample_of_hostile_places():
    run('benchmarks.hostile_places', '--outputs', 'layouts', 'CPHD to CPHD', '--places',
        'links to an input', 'hard links of other files', 'pipes', 'files of at most 100 bytes',
        'Ctrl-C after 0.15 s')


@pytest.mark.campaign
@pytest.mark.parametrize('program', ['hostile_files', 'hostile_places'])
def test_every_reader_and_every_output(program):
    run(f'benchmarks.{program}', '--output', f'benchmarks/results/{program}.json')
