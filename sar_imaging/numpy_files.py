# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of NumPy's files, whose headers are compared with the file before anything is allocated.

NumPy allocates what a header asks for. Here a header that claims more than its file holds, or than
memory has room for, is an error; Python objects are never loaded, since they may run any program.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from .memory import available_bytes

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0}
_SHARE = 0.5  # of the free memory that one array may take
_SMALL_BYTES = 2**26  # that may be compressed as well as it can be
_BOMB = 500  # times that what is larger may be compressed; numbers that were measured: twice
_PIECE = 2**24


def check_memory(name: str, n_bytes: int) -> None:
    """Refuse what would take more than half of the free memory.

    Raises
    ------
    ValueError
        It would.
    """
    free = available_bytes()
    if n_bytes > _SHARE * free:
        raise ValueError(
            f'{name} takes {n_bytes / 1e9:.3g} GB, and {free / 1e9:.3g} GB of memory are free; '
            'expected at most half of that: cut the file into shorter ones')


def check_expansion(name: str, n_bytes: int, stored_bytes: int) -> None:
    """Refuse what is large and stored in next to nothing, as nothing that was measured is.

    Raises
    ------
    ValueError
        `stored_bytes` would expand to `n_bytes`, more than 500 times as many.
    """
    if n_bytes > most_expanded(stored_bytes):
        raise ValueError(f'{name} claims {n_bytes:.4g} bytes, which the file holds in '
                         f'{stored_bytes}; expected samples that were measured: store them '
                         'without compression if they are right')


def most_expanded(stored_bytes: int) -> int:
    """Bytes that so many may expand to, see `check_expansion`."""
    return max(_SMALL_BYTES, _BOMB * stored_bytes)


def read_npy(path: Path) -> np.ndarray:
    """Array of a ``.npy`` file.

    Raises
    ------
    ValueError
        It holds no numbers, or less than it claims, or they do not fit into memory.
    """
    with open(path, 'rb') as file:
        return _read(file, os.fstat(file.fileno()).st_size, Path(path).name)


@contextlib.contextmanager
def open_npz(path: Path) -> Iterator[Npz]:
    """Arrays of an ``.npz`` file, each read when it is asked for.

    Raises
    ------
    ValueError
        It is no such file.
    """
    if not zipfile.is_zipfile(path):
        raise ValueError(f'{path!s} is no NumPy file, whatever its name says; expected what '
                         'numpy.savez wrote')
    with zipfile.ZipFile(path) as archive:
        yield Npz(archive, Path(path).name)


class Npz:
    """Arrays of an open ``.npz`` file; made by `open_npz`."""

    def __init__(self, archive: zipfile.ZipFile, file_name: str):
        self._archive, self._name = archive, file_name
        self.names = [name.removesuffix('.npy') for name in archive.namelist()]

    def __getitem__(self, name: str) -> np.ndarray:
        """Array of a name; raises as `read_npy`."""
        member = self._archive.getinfo(f'{name}.npy')
        told = f'{name} of {self._name}'
        check_expansion(told, member.file_size, member.compress_size)
        with self._archive.open(member) as file:
            return _read(file, member.file_size, told)


def _read(file: IO[bytes], n_bytes: int, name: str) -> np.ndarray:
    start = file.read(np.lib.format.MAGIC_LEN)
    if not start.startswith(np.lib.format.MAGIC_PREFIX):
        raise ValueError(f'{name} is no NumPy file, whatever its name says; expected what '
                         'numpy.save wrote')
    version = np.lib.format.read_magic(io.BytesIO(start))
    if version not in _HEADERS:
        raise ValueError(f'{name} has a header of version {version}; expected numbers, whose '
                         f'versions are {", ".join(map(str, _HEADERS))}')
    shape, by_columns, dtype = _HEADERS[version](file)
    if dtype.kind not in 'iufcb':
        what = 'Python objects' if dtype.hasobject else str(dtype)
        raise ValueError(f'{name} holds {what}; expected numbers: store it as an array of one '
                         'type, such as complex64')
    count, left = math.prod(shape), n_bytes - file.tell()
    if min(shape, default=1) < 0 or count * dtype.itemsize > left:
        raise ValueError(f'{name} claims the shape {shape} of {dtype} but holds {left} bytes of '
                         'it; it is truncated or damaged')
    check_memory(name, count * dtype.itemsize)
    out = np.empty(count, dtype)
    view = out.view(np.uint8)
    for first in range(0, len(view), _PIECE):
        piece = view[first:first + _PIECE]
        if file.readinto(piece) != len(piece):  # type: ignore[attr-defined]  # as files have it
            raise ValueError(f'{name} ends early; it is truncated or damaged')
    return out.reshape(shape, order='F' if by_columns else 'C')
