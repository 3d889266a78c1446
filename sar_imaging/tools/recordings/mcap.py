"""MCAP files and metadata of bags, looked through before a library reads them.

A reader of MCAP (https://mcap.dev/spec) believes the sizes that records claim. Here the chain of
records is followed through the file, and through chunks that are not compressed, so that whatever
does not fit is told as damage, with its place, and nothing is allocated for it.
"""

from __future__ import annotations

import functools
import struct
from pathlib import Path
from typing import BinaryIO

import yaml

from sar_imaging.files import check_file
from sar_imaging.memory import available_bytes
from sar_imaging.yaml_text import load_yaml, trouble

_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')
_CHUNK = struct.Struct('<QQQII')  # times, unpacked size, checksum, length of compression's name
_CHUNK_KIND, _OPCODES = 0x06, (*range(0x01, 0x10), *range(0x80, 0x100))
_SHARE = 0.25  # of the free memory that a chunk may take when it is unpacked
_MOST_METADATA_BYTES = 2**24
_COMPRESSED_RATIO = 255  # of lz4, at most


def check_bag(path: Path) -> None:
    """Refuse the folder of a bag whose metadata or MCAP files are damaged.

    Raises
    ------
    ValueError
        They are; the text says which file and where.
    """
    metadata = path / 'metadata.yaml'
    check_file(metadata, _MOST_METADATA_BYTES)
    try:
        told = load_yaml(metadata.read_text(encoding='utf-8'))
    except yaml.YAMLError as error:
        raise ValueError(f'{metadata} is no YAML: {trouble(error)}') from error
    except UnicodeDecodeError as error:
        raise ValueError(f'{metadata} is no text; expected that of a rosbag2 recording') from error
    if not isinstance(told, dict) or not isinstance(
            told.get('rosbag2_bagfile_information'), dict):
        raise ValueError(f'{metadata} has no rosbag2_bagfile_information; expected that of a '
                         'rosbag2 recording')
    for file in path.iterdir():
        if file.name != metadata.name and not file.is_dir():
            check_file(file)
            if file.suffix == '.mcap':
                check_mcap(file)


def check_mcap(path: Path) -> None:
    """Refuse an MCAP file whose records do not follow each other to its end.

    Raises
    ------
    ValueError
        It is damaged or truncated; the text says at which byte.
    """
    check_file(path)
    status = path.stat()
    _check(path, status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=64)  # a command opens a bag several times
def _check(path: Path, n_bytes: int, _: int) -> None:
    with open(path, 'rb') as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError(f'{path} does not begin as MCAP files do; it is none or damaged')
        end = n_bytes - len(_MAGIC)
        file.seek(end)
        if n_bytes < 2 * len(_MAGIC) or file.read() != _MAGIC:
            raise ValueError(f'{path} does not end as MCAP files do: it is truncated, or its '
                             'recorder was killed (`mcap recover` mends that)')
        _follow(path, file, len(_MAGIC), end)


def _follow(path: Path, file: BinaryIO, place: int, end: int) -> None:
    """Go from record to record, and through chunks that are not compressed."""
    while place < end:
        file.seek(place)
        head = file.read(_RECORD.size)
        kind, size = _RECORD.unpack(head.ljust(_RECORD.size, b'\0'))
        start = place + _RECORD.size
        if kind not in _OPCODES or size > end - start:
            raise ValueError(f'{path} is damaged at byte {place}: a record of kind {kind} that '
                             f'claims {size} bytes, where {max(end - start, 0)} are left')
        if kind == _CHUNK_KIND:
            _check_chunk(path, file, start, size)
        place = start + size


def _check_chunk(path: Path, file: BinaryIO, start: int, size: int) -> None:
    """Compare what a chunk claims with its record and with memory."""
    head = file.read(min(size, _CHUNK.size))
    if len(head) == _CHUNK.size:
        _, _, unpacked, _, n_name = _CHUNK.unpack(head)
        tail = file.read(min(n_name, 64) + 8)
        name, stored = tail[:-8], int.from_bytes(tail[-8:], 'little')
        first = start + _CHUNK.size + n_name + 8
        limit = max(_SHARE * available_bytes(), _COMPRESSED_RATIO)
        if stored == size - (first - start) and unpacked <= limit and (name or unpacked == stored):
            if not name:
                _follow(path, file, first, first + stored)
            return
    raise ValueError(f'{path} is damaged at byte {start}: a chunk of {size} bytes whose sizes '
                     'contradict each other, or do not fit into memory')
