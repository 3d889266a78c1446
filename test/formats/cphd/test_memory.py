# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A file larger than the memory there is, in a process of its own."""

import pytest

from benchmarks import cphd_memory

from .conftest import DATUM

FILE_BYTES = 64 * 2**20
HEADROOM = 40 * 2**20  # beyond what is in use once everything is loaded and compiled
SMALL = {'block_bytes': 4 * 2**20, 'spacing_m': 4.0}


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    pytest.importorskip('sarkit', reason='sarkit needs Python 3.11 and the extra "formats"')
    path = tmp_path_factory.mktemp('memory') / 'scene.cphd'
    n_pulses = FILE_BYTES // (8 * 1024)
    cphd_memory.write_cphd(path, cphd_memory.flight(n_pulses, 1024), DATUM, cphd_memory.scene())
    assert path.stat().st_size > FILE_BYTES
    yield path
    path.unlink()


def test_a_file_larger_than_memory_is_imaged(file):
    limited = cphd_memory.run_apart(file, headroom=HEADROOM, **SMALL)
    free = cphd_memory.run_apart(file, in_memory=1, **SMALL)
    assert limited['pulses'] == FILE_BYTES // (8 * 1024)
    assert limited['image'] == free['image']  # to the bit: the same blocks in the same order


def test_all_of_it_does_not_fit(file):
    with pytest.raises(MemoryError):
        cphd_memory.run_apart(file, headroom=HEADROOM, in_memory=1, **SMALL)
