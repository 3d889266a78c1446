# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage files of NumPy, ``.npy`` and ``.npz``."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Iterator

import numpy as np

from .any_file import CANARY, Damage, pickled, puts


def _header(shape='(24, 128)', descr="'<c8'", order='False', version=1) -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n".encode()
    size = struct.pack('<H' if version == 1 else '<I', len(text))
    return b'\x93NUMPY' + bytes([version, 0]) + size + text


def _arrays() -> Iterator[tuple[str, bytes]]:
    rest = bytes(8 * 24 * 128)
    for shape in ('(1000000, 1000000)', '(-5, 3)', '(' * 4000, '(2**62, 4)',
                  '(4611686018427387904, 4)', '()', '(0,)', '(24, 128,' + '1,' * 100 + ')',
                  '(True, 24)', '(24.0, 128)',
                  '[24, 128]', "('a',)", '24', 'None', '(0, 9223372036854775807)'):
        yield f'shape {shape[:30]}', _header(shape) + rest
    for descr in ("'|O'", "'<c99999999'", "'<U3'", "'|V8'", "[('a', '<f8')]", "'<M8[s]'", "'x'",
                  "''", 'None', "'<f2'", "'>c8'", "'<c32'", "'|S8'", "('<c8', (2,))",
                  f"__import__('os').system('touch {CANARY}')", "'b1'"):
        yield f'type {descr[:30]}', _header(descr=descr) + rest
    yield 'order of neither', _header(order='7') + rest
    for version in (2, 3, 9):
        yield f'version {version}', _header(version=version) + rest
    yield 'header of 4 GB', b'\x93NUMPY\x02\0' + b'\xff' * 4 + rest
    yield 'Python objects', _header('(1,)', "'|O'") + pickled()
    for value in (np.nan, np.inf, 3e38):
        yield f'samples are {value}', _header() + np.full((24, 128), value, '<c8').tobytes()


def npy_file(content: bytes) -> Iterator[Damage]:
    for told, array in _arrays():
        yield told, puts(array)


def npz_file(content: bytes) -> Iterator[Damage]:
    def packed(members, **options):
        file = io.BytesIO()
        with zipfile.ZipFile(file, 'w', **options) as archive:
            for name, text in members:
                archive.writestr(name, text)
        return file.getvalue()

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        times = ('t.npy', archive.read('t.npy'))
        own = ('echoes.npy', archive.read('echoes.npy'))
    for told, array in _arrays():
        yield f'member: {told}', puts(packed([('echoes.npy', array), times]))
    for name, method in (('deflate', zipfile.ZIP_DEFLATED), ('bzip2', zipfile.ZIP_BZIP2)):
        yield f'bomb of {name}', puts(lambda method=method: packed(
            [('echoes.npy', _header('(8000, 8000)') + bytes(8 * 8000**2))], compression=method,
            compresslevel=1))
    yield 'no members', puts(packed([]))
    yield 'other names', puts(packed([('../../../etc/passwd', own[1]), ('/x.npy', own[1])]))
    yield 'names without end', puts(packed([('echoes', own[1]), times]))
    yield 'members twice', puts(packed([own, ('echoes.npy', b'x'), times]))
    whole = packed([own, times])
    place = whole.index(b'PK\1\2')
    for field, at in (('compressed size', 20), ('size', 24), ('method', 10), ('encryption', 8),
                      ('offset', 42), ('checksum', 16)):
        wrong = bytearray(whole)
        wrong[place + at:place + at + 2] = b'\xfe\xff' if field != 'encryption' else b'\1\0'
        yield f'wrong {field}', puts(bytes(wrong))
    wrong = bytearray(whole)
    wrong[place + 20:place + 28] = b'\xff' * 8
    yield 'sizes of 4 GB', puts(bytes(wrong))
