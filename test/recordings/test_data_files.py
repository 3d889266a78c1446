# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Variables of NumPy, MATLAB and HDF5 files."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.io import savemat

from sar_imaging import numpy_files
from sar_imaging.formats.extras import MissingExtraError
from sar_imaging.recordings import DescriptionError, data_files
from sar_imaging.recordings.data_files import DataFiles, read_variable

GENERATOR = np.random.default_rng(3)
VALUES = GENERATOR.standard_normal((5, 3, 2)) + 1j * GENERATOR.standard_normal((5, 3, 2))


def matlab_73(path, h5py):
    """A file as MATLAB 7.3 writes it: 512 bytes of header, axes reversed, complex compounds."""
    with h5py.File(path, 'w', userblock_size=512) as file:
        parts = np.empty(VALUES.T.shape, [('real', 'f8'), ('imag', 'f8')])
        parts['real'], parts['imag'] = VALUES.T.real, VALUES.T.imag
        file['radar/samples'] = parts
        file['time'] = np.arange(5.0)[:, None]
    with path.open('r+b') as file:
        file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\x00\x02IM')


def write(path):
    if path.suffix == '.npz':
        np.savez(path, **{'radar.samples': VALUES, 'time': np.arange(5.0)})
    elif path.stem == 'old':
        savemat(path, {'radar': {'samples': VALUES}, 'time': np.arange(5.0)})
    else:
        h5py = pytest.importorskip('h5py', reason='the extra hdf5 is not installed')
        if path.suffix == '.mat':
            matlab_73(path, h5py)
        else:
            with h5py.File(path, 'w') as file:
                file['radar/samples'], file['time'] = VALUES, np.arange(5.0)


@pytest.mark.parametrize('name', ['a.npz', 'old.mat', 'new.mat', 'a.h5', 'a.hdf5'])
def test_variables_are_read_alike_from_every_format(tmp_path, name):
    path = tmp_path / name
    write(path)
    np.testing.assert_array_equal(read_variable(path, 'radar.samples'), VALUES)
    np.testing.assert_array_equal(read_variable(path, 'time'), np.arange(5.0))
    with pytest.raises(DescriptionError, match=f'{name} has no variable radar.sample; it has '
                       '.*radar.samples'):
        read_variable(path, 'radar.sample')
    with pytest.raises(DescriptionError, match='has no variable nothing; it has .*time'):
        read_variable(path, 'nothing')


def test_columns_of_a_csv_file_are_variables(tmp_path):
    (tmp_path / 'a.csv').write_text('t,x\n1.5,2\n2.5,3\n')
    np.testing.assert_array_equal(read_variable(tmp_path / 'a.csv', 't'), [1.5, 2.5])
    with pytest.raises(DescriptionError, match='has no variable y; it has t, x'):
        read_variable(tmp_path / 'a.csv', 'y')


def test_a_single_array_needs_no_name(tmp_path):
    np.save(tmp_path / 'a.npy', VALUES)
    np.testing.assert_array_equal(read_variable(tmp_path / 'a.npy', 'x'), VALUES)


def test_without_h5py_one_line_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / 'a.h5').write_bytes(b'')
    monkeypatch.setitem(sys.modules, 'h5py', None)
    with pytest.raises(MissingExtraError, match=r'reading a\.h5 needs h5py.*pip install '
                       r'sar_imaging\[hdf5\]'):
        read_variable(tmp_path / 'a.h5', 'x')


@pytest.mark.parametrize('name', ['a.npz', 'a.npy', 'a.mat', 'a.h5'])
@pytest.mark.parametrize('content', [b'', b'no data at all' * 100])
def test_damaged_files_are_told(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DescriptionError, match=name):
        read_variable(tmp_path / name, 'x')


def test_texts_and_objects_are_refused(tmp_path):
    np.savez(tmp_path / 'a.npz', text=np.array('fast'), thing=np.array([{}], object))
    with pytest.raises(DescriptionError, match='text of a.npz holds <U4; expected numbers'):
        read_variable(tmp_path / 'a.npz', 'text')
    with pytest.raises(DescriptionError, match='thing of a.npz holds Python objects'):
        read_variable(tmp_path / 'a.npz', 'thing')
    (tmp_path / 'a.bin').write_bytes(b'')
    with pytest.raises(DescriptionError, match=r'samples need samples\.dtype'):
        read_variable(tmp_path / 'a.bin', 'x')


@pytest.mark.parametrize('name', ['a.npz', 'a.npy', 'old.mat', 'a.h5'])
def test_what_does_not_fit_into_memory_is_refused_before_it_is_read(tmp_path, name, monkeypatch):
    path = tmp_path / name
    if path.suffix == '.npy':
        np.save(path, VALUES)
    else:
        write(path)
    monkeypatch.setattr(numpy_files, 'available_bytes', lambda: 300)

    def fail(*arguments, **options):
        raise AssertionError('read before its size was checked')

    monkeypatch.setattr(data_files, 'loadmat', fail)
    monkeypatch.setattr(np, 'array', fail)
    with pytest.raises(DescriptionError, match='of memory are free'):
        read_variable(path, 'radar.samples')


def test_files_that_continue_each_other_are_joined(tmp_path):
    for i, part in enumerate((VALUES[:2], VALUES[2:])):
        np.savez(tmp_path / f'{i}.npz', samples=part, rate=1.0, other=float(i), odd=part[:, i:])
    files = DataFiles([tmp_path / '0.npz', tmp_path / '1.npz'])
    np.testing.assert_array_equal(files.joined('samples'), VALUES)
    assert files.same('rate') == 1.0
    with pytest.raises(DescriptionError, match=r'1\.npz: other differs from that of 0\.npz'):
        files.same('other')
    with pytest.raises(DescriptionError, match=r'1\.npz: odd.shape=.* does not continue'):
        files.joined('odd')


@pytest.mark.parametrize(('name', 'text'), [
    ('soft', 'soft is a link to /right'), ('external', 'external is a link to x'),
    ('elsewhere', 'elsewhere is stored in other files'), ('none', 'it has elsewhere, right')])
def test_hdf5_reads_no_other_file(tmp_path, name, text):
    """A pipe in their place would never end."""
    h5py = pytest.importorskip('h5py', reason='the extra hdf5 is not installed')
    with h5py.File(tmp_path / 'a.h5', 'w') as file:
        file['right'] = VALUES
        file['soft'], file['external'] = h5py.SoftLink('/right'), h5py.ExternalLink('pipe', 'x')
        file.create_dataset('elsewhere', (3,), 'f8', external=[('secret', 0, 24)])
    with pytest.raises(DescriptionError, match=text):
        read_variable(tmp_path / 'a.h5', name)
