# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Truncated, damaged and absurd files: one kind of error, no memory beyond the file's, no hang."""

import dataclasses
import os
import signal
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from sar_imaging.formats.cphd import CphdError, CphdReader, write_cphd
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing

from .conftest import DATUM, GRID, pulses
from .mutations import mutated

KINDS = {'phase histories': (False, {'sign': 1}), 'profiles': (True, {'sample_type': 'CI4'}),
         'antenna': (True, {'antenna': AntennaPattern(PatternCut.sinc(0.02))})}
MEMORY = 10**6  # for blocks; the files have 100 kB
LIMIT = 4 * 10**6  # measured over 10,000 files: 2.1 MB, of which the metadata take 1.4 MB
HANGING_S = 60


class Made:
    """Files to damage; its repr is short, for failures print it."""

    def __init__(self, files, folder):
        self.files, self.folder = files, folder

    def check(self, seed):
        return check(self.files[seed % len(self.files)], self.folder / 'damaged.cphd', seed)


def sources(folder):
    out = []
    for name, (compressed, options) in KINDS.items():
        block = pulses(compressed, 2, 20)
        looks = Pointing.steered(block.phase_centre_m, (0.0, 0.0, 0.0))
        write_cphd(folder / name, [dataclasses.replace(block, pointing=looks)], DATUM, GRID,
                   **options)
        out.append((folder / name).read_bytes())
    return out


def read(path):
    """Everything that a reader tells; True when the file was read."""
    try:
        with CphdReader(path) as reader:
            assert np.isfinite(reader.area_m).all()
            assert reader.map_grid().n_x > 0
            assert reader.container.n_bytes == path.stat().st_size
            for block in reader.blocks(memory_bytes=MEMORY):
                assert np.isfinite(block.samples).all() and np.isfinite(block.tx_m).all()
    except CphdError as error:
        assert str(path) in str(error)  # says which file
        return False
    return True


def check(source, path, seed):
    """Damage by the random numbers of a seed is told, or does no harm; True when it was read."""
    path.write_bytes(mutated(source, np.random.default_rng(seed)))
    tracemalloc.reset_peak()
    before, _ = tracemalloc.get_traced_memory()
    signal.alarm(HANGING_S)
    try:
        was_read = read(path)
    finally:
        signal.alarm(0)
    _, peak = tracemalloc.get_traced_memory()
    assert peak - before < LIMIT, f'seed {seed}: {peak - before} bytes'
    return was_read


@pytest.fixture(scope='module')
def traced(tmp_path_factory):
    pytest.importorskip('sarkit', reason='sarkit needs Python 3.11 and the extra "formats"')
    folder = tmp_path_factory.mktemp('damaged')
    made = sources(folder)
    assert all(read(folder / name) for name in KINDS)  # and everything is imported
    tracemalloc.start()
    yield Made(made, folder)
    tracemalloc.stop()


@settings(max_examples=300, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**40))
def test_damage_is_told(traced, seed):
    traced.check(seed)


@pytest.mark.campaign
def test_damage_is_told_ten_thousand_times(traced):
    first, count = (int(os.environ.get(f'CPHD_{name}', default)) for name, default in
                    (('SEED', 0), ('MUTATIONS', 10_000)))
    n_read = sum(map(traced.check, range(first, first + count)))
    print(f'{count} damaged files: {n_read} read all the same, {count - n_read} refused')
    assert count / 50 < n_read < count / 2  # damage of samples does no harm, most other does


def test_sizes_beyond_the_file(tmp_path, traced):
    """A header that declares terabytes is held against the file before anything is allocated."""
    source = traced.files[0]
    for old, new in ((b'NumVectors>20<', b'NumVectors>20000000000<'),
                     (b'NumSamples>256<', b'NumSamples>99999999999<'),
                     (b'NumSamples>256<', b'NumSamples>900<'),  # beyond the block by little
                     (b'NumBytesPVP>', b'NumBytesPVP>80000000000'),
                     (b'SIGNAL_BLOCK_SIZE := ', b'SIGNAL_BLOCK_SIZE := 99999999'),
                     (b'XML_BLOCK_SIZE := ', b'XML_BLOCK_SIZE := 9999999')):
        assert old in source
        (tmp_path / 'a').write_bytes(source.replace(old, new))
        with pytest.raises(CphdError):
            CphdReader(tmp_path / 'a')


@pytest.mark.parametrize(('content', 'text'), [
    (b'', 'is no CPHD'), (b'NITF02.10', 'is no CPHD'), (b'CPHD/0.3\n\f\n', '1.0.1 and 1.1.0'),
    (b'CPHD/1.1.0\n' + b'x' * 10**6, 'no end of the header'),
    (b'CPHD/1.1.0\nnothing\n\f\n', 'NAME := VALUE'), (b'CPHD/1.1.0\n\f\n', 'BLOCK_BYTE_OFFSET'),
    (b'CPHD/1.1.0\n\xff\f\n', 'no text')])
def test_what_is_no_cphd(tmp_path, content, text):
    (tmp_path / 'a').write_bytes(content)
    with pytest.raises(CphdError, match=text):
        CphdReader(tmp_path / 'a')


def test_a_file_that_shrinks_while_it_is_read(tmp_path):
    write_cphd(tmp_path / 'a', [pulses()], DATUM, GRID)
    with CphdReader(tmp_path / 'a') as reader:
        with open(tmp_path / 'a', 'r+b') as file:
            file.truncate(reader.container.n_bytes - 1)
        with pytest.raises(CphdError, match='truncated while it was read'):
            list(reader.blocks())


def test_samples_that_are_no_numbers(tmp_path):
    write_cphd(tmp_path / 'a', [pulses()], DATUM, GRID)
    content = bytearray((tmp_path / 'a').read_bytes())
    content[-8 * 256 * 3:-8 * 256 * 3 + 4] = b'\x7f\xc0\x00\x00'
    (tmp_path / 'a').write_bytes(content)
    with CphdReader(tmp_path / 'a') as reader:
        with pytest.raises(CphdError, match='1 vectors are NaN or infinite, first of number 37'):
            list(reader.blocks())


def test_no_such_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        CphdReader(tmp_path / 'nothing')
