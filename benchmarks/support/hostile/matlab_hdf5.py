# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage files of MATLAB 5, and of HDF5, which those of MATLAB 7.3 are."""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator

import numpy as np

from .any_file import Damage, puts
from .valid import GIGA


def mat_file(content: bytes) -> Iterator[Damage]:
    from scipy.io import savemat

    def element(kind, body):
        return struct.pack('<II', kind, len(body)) + body.ljust(-len(body) % 8 + len(body), b'\0')

    head = content[:128]

    def matrix(cls=6, dims=(24, 128), name=b'echoes', data=None, flags=0x08):
        body = element(6, struct.pack('<II', flags << 8 | cls, 0)) + element(
            5, struct.pack(f'<{len(dims)}i', *dims)) + element(1, name)
        return element(14, body + (element(9, bytes(8 * 24 * 128)) * 2 if data is None else data))

    for dims in ((GIGA, GIGA), (-5, 3), (2**31 - 1, 2), (24,), (), (1,) * 200, (0, 0)):
        yield f'dimensions {str(dims)[:30]}', puts(head + matrix(dims=dims))
    for cls in (0, 1, 2, 3, 4, 5, 16, 17, 18, 99):
        yield f'class {cls}', puts(head + matrix(cls))
    yield 'name of a megabyte', puts(head + matrix(name=b'e' * 10**6))
    cell = matrix(9, (1, 1), b'', element(9, bytes(8)), 0)
    for _ in range(2000):
        cell = matrix(1, (1, 1), b'', cell, 0)
    yield 'cells in cells, 2,000 deep', puts(head + matrix(1, (1, 1), data=cell, flags=0))
    yield 'cells that claim a billion', puts(head + matrix(1, (GIGA, 1), data=cell, flags=0))
    yield 'structure of wrong fields', puts(head + matrix(
        2, (1, 1), data=element(5, struct.pack('<i', -1)) + element(1, b'a' * 32)))
    file = io.BytesIO()
    from scipy.sparse import csc_matrix
    savemat(file, {'echoes': csc_matrix(np.eye(24))})
    sparse = file.getvalue()
    yield 'sparse', puts(sparse)
    yield 'sparse of wild indices', puts(sparse.replace(struct.pack('<i', 5), b'\xff\xff\xff\x7f'))
    yield 'matrix that claims 4 GB', puts(head + struct.pack('<II', 14, 2**32 - 8) + matrix()[8:])
    yield 'data that claim 4 GB', puts(head + matrix(data=struct.pack('<II', 9, 2**32 - 8)))

    def bomb():
        packed = zlib.compress(matrix(dims=(8000, 8000), data=element(9, bytes(2**29))), 1)
        return head + struct.pack('<II', 15, len(packed)) + packed

    yield 'bomb', puts(bomb)
    yield 'compressed rubbish', puts(head + struct.pack('<II', 15, 64) + os.urandom(64))
    yield 'compressed in compressed', puts(head + element(15, zlib.compress(
        element(15, zlib.compress(matrix())))))
    yield 'big endian', puts(head[:124] + b'\1\0MI' + matrix())
    yield 'version 4', puts(struct.pack('<5i', 0, GIGA, GIGA, 0, 7) + b'echoes\0' + bytes(64))
    yield 'version 4, negative', puts(struct.pack('<5i', 0, -1, 5, 0, 7) + b'echoes\0' + bytes(64))
    yield 'samples are NaN', puts(head + matrix(data=element(
        9, np.full(24 * 128, np.nan).tobytes()) * 2))


def hdf5_file(content: bytes) -> Iterator[Damage]:
    def made(fill):
        def put(path):
            import h5py

            path.unlink()
            with h5py.File(path, 'w', userblock_size=512) as file:
                fill(file, h5py)
            if path.suffix == '.mat':
                with open(path, 'r+b') as file:
                    file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM')
        return put

    def data(**options):
        return made(lambda file, h5py: file.create_dataset('echoes', **options))

    yield 'claims 8 TB', data(shape=(10**6, 10**6), dtype='c8', chunks=(1000, 1000))
    yield 'bomb', data(data=np.zeros((10_000, 5_000), np.complex64), compression='gzip',
                       compression_opts=1)
    yield 'without a shape', made(lambda f, h: f.create_dataset('echoes', data=h.Empty('f8')))
    yield 'texts', data(data=np.array([b'a', b'b']))
    yield 'texts of any length', made(lambda f, h: f.create_dataset(
        'echoes', (3,), h.string_dtype()))
    yield 'references', made(lambda f, h: f.create_dataset('echoes', (3,), h.ref_dtype))
    yield 'structure of three', data(data=np.zeros(5, [('a', 'f8'), ('b', 'f8'), ('c', 'f8')]))
    yield 'structure of texts', data(data=np.zeros(5, [('real', 'S3'), ('imag', 'S3')]))
    yield 'group', made(lambda f, h: f.create_group('echoes'))
    yield 'group in itself', made(lambda f, h: f.__setitem__('echoes', f['/']))
    yield 'link to nothing', made(lambda f, h: f.__setitem__('echoes', h.SoftLink('/none')))
    yield 'link to itself', made(lambda f, h: f.__setitem__('echoes', h.SoftLink('/echoes')))
    yield 'link to another file', made(lambda f, h: f.__setitem__(
        'echoes', h.ExternalLink('secret.h5', 'echoes')))
    yield 'link to a pipe', made(lambda f, h: f.__setitem__(
        'echoes', h.ExternalLink('pipe', 'echoes')))
    for name in ('secret', 'pipe', '/dev/zero'):
        yield f'samples of {name}', data(shape=(24, 128), dtype='c8', external=[
            (name, 0, 8 * 24 * 128)])

    def virtual(file, h5py):
        layout = h5py.VirtualLayout((24, 128), 'c8')
        layout[:] = h5py.VirtualSource('pipe', 'echoes', (24, 128))
        file.create_virtual_dataset('echoes', layout)

    yield 'virtual', made(virtual)
    yield 'one-sided', data(data=np.zeros((24, 128, 2, 2)))
    yield 'samples are NaN', data(data=np.full((24, 128), np.nan, np.complex64))
    yield 'long doubles', data(data=np.zeros((24, 128), np.longdouble))
    yield 'deep groups', made(lambda f, h: f.create_dataset('a/' * 3000 + 'b', data=[1.0]))
