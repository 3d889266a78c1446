"""Files of bags, looked through before a library reads them.

A reader of MCAP (https://mcap.dev/spec) believes the sizes that records claim. Here the chain of
records is followed through the file, and through its chunks, so that whatever does not fit is told
as damage, with its place, and nothing is allocated for it. A database may hold queries that never
end (views), which take the place of its tables: only tables are let through.
"""

from __future__ import annotations

import contextlib
import functools
import sqlite3
import struct
import urllib.parse
from pathlib import Path
from typing import BinaryIO

from sar_imaging.files import check_file
from sar_imaging.formats.extras import require
from sar_imaging.memory import available_bytes
from sar_imaging.numpy_files import check_expansion
from sar_imaging.yaml_text import read_yaml

_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')
_CHUNK = struct.Struct('<QQQII')  # times, unpacked size, checksum, length of compression's name
_CHUNK_KIND, _OPCODES = 0x06, (*range(0x01, 0x10), *range(0x80, 0x100))
_SHARE = 0.25  # of the free memory that a chunk may take when it is unpacked
_MOST_METADATA_BYTES = 2**24
_ROS1 = b'#ROSBAG V2.0\n'
_PIECE = 2**24


def check_bag(path: Path) -> None:
    """Refuse a bag, a folder or a file, that is damaged or would not end.

    Raises
    ------
    ValueError
        It is; the text says which file and where.
    """
    if not path.is_dir():
        check_file(path)
        if path.suffix in _CHECKS:
            status = path.stat()
            _CHECKS[path.suffix](path, status.st_size, status.st_mtime_ns)
        return
    metadata = path / 'metadata.yaml'
    told = read_yaml(metadata, most_bytes=_MOST_METADATA_BYTES)
    if not isinstance(told, dict) or not isinstance(
            told.get('rosbag2_bagfile_information'), dict):
        raise ValueError(f'{metadata} has no rosbag2_bagfile_information; expected that of a '
                         'rosbag2 recording')
    for file in path.iterdir():
        if file.name != metadata.name and not file.is_dir():
            check_bag(file)


@functools.lru_cache(maxsize=64)  # a command opens a bag several times
def _check_mcap(path: Path, n_bytes: int, _: int) -> None:
    """Refuse an MCAP file whose records do not follow each other to its end."""
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
    """Compare what a chunk claims with its record, its content and memory."""
    head = file.read(min(size, _CHUNK.size))
    if len(head) == _CHUNK.size:
        _, _, unpacked, _, n_name = _CHUNK.unpack(head)
        tail = file.read(min(n_name, 64) + 8)
        name, stored = tail[:-8], int.from_bytes(tail[-8:], 'little')
        first = start + _CHUNK.size + n_name + 8
        if stored == size - (first - start) and max(stored, unpacked) <= (
                _SHARE * available_bytes()):
            if name and _expanded(name, file.read(stored), unpacked) == unpacked:
                return
            if not name and unpacked == stored:
                _follow(path, file, first, first + stored)
                return
    raise ValueError(f'{path} is damaged at byte {start}: a chunk of {size} bytes whose sizes '
                     'contradict each other, or do not fit into memory')


def _expanded(compression: bytes, data: bytes, most: int) -> int:
    """Bytes that a chunk expands to; more than `most` where it would be more."""
    from rosbags.rosbag2.storage_mcap import zstd

    if compression == b'lz4':  # rosbags depends on it
        decompressor = require('lz4.frame', 'reading this bag').LZ4FrameDecompressor()
    elif compression == b'zstd':
        decompressor = zstd.ZstdDecompressor()
    else:
        raise ValueError(f'compression {compression!r}; expected lz4 or zstd')
    out = decompressor.decompress(data, max_length=most + 1)
    return len(out) + len(decompressor.unused_data or b'')


def _check_sqlite(path: Path, *_: int) -> None:
    """Refuse a database that holds anything but tables and their indices."""
    name = f'file:{urllib.parse.quote(str(path))}?immutable=1&mode=ro'
    with contextlib.closing(sqlite3.connect(name, uri=True)) as db:
        odd = db.execute("SELECT type, name FROM sqlite_master WHERE type NOT IN ('table', "
                         "'index') OR type = 'table' AND NOT rootpage > 0").fetchone()
    if odd is not None:
        raise ValueError(f'{path} holds the {odd[0]} {odd[1]}; expected the tables of a bag')


@functools.lru_cache(maxsize=64)
def _check_packed(path: Path, n_bytes: int, _: int) -> None:
    """Refuse a file of a bag that expands without measure."""
    from rosbags.rosbag2.storage_mcap import zstd

    expanded = 0
    with zstd.open(path, 'rb') as file:
        while piece := file.read(_PIECE):
            expanded += len(piece)
            check_expansion(path.name, expanded, n_bytes)


def _check_ros1(path: Path, *_: int) -> None:
    """Refuse what is no ROS 1 bag, whose first line a library reads to its end, wherever it is."""
    with open(path, 'rb') as file:
        if file.read(len(_ROS1)) != _ROS1:
            raise ValueError(f'{path} does not begin as ROS 1 bags of version 2.0 do')


_CHECKS = {'.bag': _check_ros1, '.mcap': _check_mcap, '.db3': _check_sqlite,
           '.zstd': _check_packed}
