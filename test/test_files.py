# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is read and written through the door: inputs stay, nothing goes through a link."""

from __future__ import annotations

import os

import numpy as np
import pytest

from sar_imaging.files import (
    check_file,
    filling,
    one_line,
    protecting_inputs,
    reading,
    replacing,
)
from sar_imaging.numpy_files import open_npz, read_npy

SAME = {'itself': lambda there, link: there, 'symlink': lambda there, link: link.symlink_to(there),
        'hard link': lambda there, link: link.hardlink_to(there)}


@pytest.mark.parametrize('kind', SAME)
@pytest.mark.parametrize('way', ['replacing', 'filling'])
def test_an_input_is_never_replaced(tmp_path, kind, way):
    there, link = tmp_path / 'input', tmp_path / 'link'
    there.write_text('precious')
    target = SAME[kind](there, link) or link
    with protecting_inputs():
        check_file(there)
        with pytest.raises(FileExistsError, match='would replace the input'):
            if way == 'replacing':
                with replacing(target) as part:
                    part.write_text('new')
            else:
                with filling(tmp_path) as folder:
                    (folder / target.name).write_text('new')
    assert there.read_text() == target.read_text() == 'precious'


def test_links_are_replaced_and_not_followed(tmp_path):
    other, link = tmp_path / 'other', tmp_path / 'image.npy'
    other.write_text('of somebody else')
    link.symlink_to(other)
    with filling(tmp_path) as folder:
        (folder / 'image.npy').write_text('new')
    assert other.read_text() == 'of somebody else' and link.read_text() == 'new'
    assert not link.is_symlink() and sorted(os.listdir(tmp_path)) == ['image.npy', 'other']


def test_half_of_a_folder_leaves_the_old_one(tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'old').touch()
    with pytest.raises(RuntimeError), replacing(tmp_path / 'bag', folder=True) as part:
        part.mkdir()
        raise RuntimeError
    assert os.listdir(tmp_path) == ['bag'] and os.listdir(tmp_path / 'bag') == ['old']


def test_a_folder_that_holds_an_input_is_not_replaced(tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'data').touch()
    with protecting_inputs():
        check_file(tmp_path / 'bag' / 'data')
        with pytest.raises(FileExistsError), replacing(tmp_path / 'bag', folder=True):
            pass


def test_texts_of_other_libraries_are_for_people():
    assert one_line('malformed: <ast.BinOp object at 0x7f5a>,\n no KeyError("version")\x1b') == (
        'malformed: BinOp, no "version"\\x1b')


def test_a_disk_that_is_full_is_told_of_the_place_that_was_named(tmp_path):
    with pytest.raises(OSError, match='out cannot be written: No space') as full, \
            filling(tmp_path / 'out') as folder, replacing(folder / 'cloud.ply'):
        raise OSError(28, 'No space left on device')
    assert '.sar_imaging.' not in str(full.value)


def test_pipes_are_told_and_not_opened(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(ValueError, match='pipe is no regular file'), \
            reading(tmp_path / 'pipe', 'a table'):
        pass
    with pytest.raises(FileExistsError, match='no regular file'), replacing(tmp_path / 'pipe'):
        pass


HEADERS = {'8 TB': '(1000000, 1000000)', 'negative': '(-5, 3)', 'parentheses': '(' * 4000,
           'longer than the file': '(100,)'}


@pytest.mark.parametrize('name', HEADERS)
def test_headers_that_claim_more_than_there_is(tmp_path, name):
    import struct
    import zipfile

    header = f"{{'descr': '<c8', 'fortran_order': False, 'shape': {HEADERS[name]}, }}\n".encode()
    content = b'\x93NUMPY\x01\x00' + struct.pack('<H', len(header)) + header + bytes(80)
    (tmp_path / 'a.npy').write_bytes(content)
    with zipfile.ZipFile(tmp_path / 'a.npz', 'w') as archive:
        archive.writestr('x.npy', content)
    with pytest.raises(ValueError, match=r'a\.npy'), reading(tmp_path / 'a.npy', 'NumPy'):
        read_npy(tmp_path / 'a.npy')
    with pytest.raises(ValueError, match=r'a\.npz'), reading(tmp_path / 'a.npz', 'NumPy'), \
            open_npz(tmp_path / 'a.npz') as arrays:
        arrays['x']


def test_arrays_come_back(tmp_path):
    values = np.asfortranarray(np.arange(12.0).reshape(3, 4))
    np.savez_compressed(tmp_path / 'a.npz', x=values, none=np.zeros((0, 3)))
    with open_npz(tmp_path / 'a.npz') as arrays:
        assert arrays.names == ['x', 'none'] and arrays['none'].shape == (0, 3)
        np.testing.assert_array_equal(arrays['x'], values)
