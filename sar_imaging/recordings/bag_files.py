# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of bags, looked through before a library reads them.

A reader of MCAP (https://mcap.dev/spec) believes the sizes that records claim, and one of ROS 1
bags (http://wiki.ros.org/Bags/Format/2.0) whatever its chunks expand to. Here the chain of records
is followed through the file, and through its chunks, so that whatever does not fit is told as
damage, with its place, and nothing is allocated for it. The library compares the checksums of
chunks when it reads them; the others are compared here. A database may hold queries that never end
(views), which take the place of its tables: only tables are let through.
"""

from __future__ import annotations

import bz2
import contextlib
import functools
import os
import sqlite3
import struct
import urllib.parse
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from ..files import check_file
from ..formats.extras import require
from ..memory import available_bytes
from ..numpy_files import check_expansion, most_expanded
from ..yaml_text import read_yaml

_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')
_CHUNK = struct.Struct('<QQQII')  # times, unpacked size, checksum, length of compression's name
_FOOTER = struct.Struct('<QQI')  # begin of the summary and of its offsets, checksum
_MESSAGE, _CHUNK_KIND, _DATA_END, _FOOTER_KIND = 0x05, 0x06, 0x0F, 0x02
_OPCODES = (*range(0x01, 0x10), *range(0x80, 0x100))
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
    bag = told.get('rosbag2_bagfile_information') if isinstance(told, dict) else None
    if not isinstance(bag, dict):
        raise ValueError(f'{metadata} has no rosbag2_bagfile_information; expected that of a '
                         'rosbag2 recording')
    for file in path.iterdir():
        if file.name != metadata.name and not file.is_dir():
            check_bag(file)
            if f'{bag.get("compression_mode")}'.lower() == 'message' and file.suffix in _CHECKS:
                status = file.stat()
                _check_packed_messages(file, status.st_size, status.st_mtime_ns)


def checked(messages: Iterable[tuple[Any, ...]]) -> Iterator[tuple[Any, ...]]:
    """Messages of a library's reader, which a damaged database may give other times and contents.

    Raises
    ------
    ValueError
        It does.
    """
    for connection, time_ns, raw in messages:
        if not isinstance(time_ns, int) or not -2**63 <= time_ns < 2**63 or not isinstance(
                raw, bytes | memoryview):
            raise ValueError(f'a message is {type(raw).__name__} of the time {time_ns!r}; '
                             'expected bytes, and nanoseconds')
        yield connection, time_ns, raw


def add_checksums(path: Path) -> None:
    """Put the checksums of its chunks and its summary into an MCAP file that has none."""
    with open(path, 'r+b') as file:
        n_bytes = path.stat().st_size
        for kind, start, size in _records(path, file, len(_MAGIC), n_bytes - len(_MAGIC)):
            if kind == _CHUNK_KIND:
                first = start + _CHUNK.size + 8  # without the name of a compression
                file.seek(first)
                checksum = zlib.crc32(file.read(size - (first - start)))
                file.seek(start + 24)
            elif kind == _FOOTER_KIND:
                file.seek(start)
                begin, *_ = _FOOTER.unpack(file.read(size))
                checksum = _checksum(file, begin, start + 16)
                file.seek(start + 16)
            else:
                continue
            file.write(struct.pack('<I', checksum))


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
        whole = True  # all messages are in chunks with checksums
        for kind, start, size in _records(path, file, len(_MAGIC), end):
            begin, checksum = 0, 0
            if kind == _CHUNK_KIND:
                whole &= _check_chunk(path, file, start, size)
            elif kind == _MESSAGE:
                whole = False
            elif kind == _DATA_END and size >= 4 and not whole:
                checksum, stop = int.from_bytes(file.read(4), 'little'), start - _RECORD.size
            elif kind == _FOOTER_KIND and size >= _FOOTER.size:
                begin, _, checksum = _FOOTER.unpack(file.read(_FOOTER.size))
                begin, stop = begin or start - _RECORD.size, start + 16
            if checksum and checksum != _checksum(file, begin, stop):
                raise ValueError(f'{path} is damaged between the bytes {begin} and {stop}: they '
                                 'have another checksum')


def _checksum(file: BinaryIO, start: int, stop: int) -> int:
    """CRC-32 of some bytes."""
    checksum = 0
    file.seek(start)
    while start < stop and (piece := file.read(min(_PIECE, stop - start))):
        checksum = zlib.crc32(piece, checksum)
        start += len(piece)
    return checksum


def _records(path: Path, file: BinaryIO, place: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Kind, first byte and size of each record; the file stands at that byte."""
    while place < end:
        file.seek(place)
        head = file.read(_RECORD.size)
        kind, size = _RECORD.unpack(head.ljust(_RECORD.size, b'\0'))
        start = place + _RECORD.size
        if kind not in _OPCODES or size > end - start:
            raise ValueError(f'{path} is damaged at byte {place}: a record of kind {kind} that '
                             f'claims {size} bytes, where {max(end - start, 0)} are left')
        yield kind, start, size
        place = start + size


def _check_chunk(path: Path, file: BinaryIO, start: int, size: int) -> bool:
    """Compare what a chunk claims with its record, its content and memory; has it a checksum?"""
    head = file.read(min(size, _CHUNK.size))
    if len(head) == _CHUNK.size:
        _, _, unpacked, checksum, n_name = _CHUNK.unpack(head)
        tail = file.read(min(n_name, 64) + 8)
        name, stored = tail[:-8], int.from_bytes(tail[-8:], 'little')
        first = start + _CHUNK.size + n_name + 8
        if stored == size - (first - start) and _fits(stored, unpacked):
            if name and _expanded(name, file.read(stored), unpacked) == unpacked:
                return checksum != 0
            if not name and unpacked == stored:
                for _ in _records(path, file, first, first + stored):
                    pass
                return checksum != 0
    raise _damaged_chunk(path, start, size)


def _fits(*sizes: int) -> bool:
    return max(sizes) <= _SHARE * available_bytes()


def _damaged_chunk(path: Path, start: int, size: int) -> ValueError:
    return ValueError(f'{path} is damaged at byte {start}: a chunk of {size} bytes whose sizes '
                      'contradict each other, or do not fit into memory')


def _expanded(compression: bytes, data: bytes, most: int) -> int:
    """Bytes that some expand to; more than `most` where it would be more, or others follow."""
    from rosbags.rosbag2.storage_mcap import zstd  # type: ignore[attr-defined]

    if compression == b'lz4':  # rosbags depends on it
        decompressor = require('lz4.frame', 'reading this bag').LZ4FrameDecompressor()
    elif compression == b'zstd':
        decompressor = zstd.ZstdDecompressor()
    elif compression == b'bz2':
        decompressor = bz2.BZ2Decompressor()
    else:
        raise ValueError(f'compression {compression!r}; expected lz4, zstd or bz2')
    out = decompressor.decompress(data, max_length=most + 1)
    return most + 1 if decompressor.unused_data else len(out)


def _check_sqlite(path: Path, *_: int) -> None:
    """Refuse a database that holds anything but tables and their indices."""
    name = f'file:{urllib.parse.quote(os.fsencode(path))}?immutable=1&mode=ro'
    with contextlib.closing(sqlite3.connect(name, uri=True)) as db:
        odd = db.execute("SELECT type, name FROM sqlite_master WHERE type NOT IN ('table', "
                         "'index') OR type = 'table' AND NOT rootpage > 0").fetchone()
    if odd is not None:
        raise ValueError(f'{path} holds the {odd[0]} {odd[1]}; expected the tables of a bag')


@functools.lru_cache(maxsize=64)
def _check_packed(path: Path, n_bytes: int, _: int) -> None:
    """Refuse a file of a bag that expands without measure."""
    from rosbags.rosbag2.storage_mcap import zstd  # type: ignore[attr-defined]

    expanded = 0
    with zstd.open(path, 'rb') as file:
        while piece := file.read(_PIECE):
            expanded += len(piece)
            check_expansion(path.name, expanded, n_bytes)


@functools.lru_cache(maxsize=64)
def _check_packed_messages(path: Path, n_bytes: int, _: int) -> None:
    """Refuse a file whose messages, compressed one by one, expand without measure."""
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:  # of a file alone: messages as they are stored
        for _, _, raw in checked(reader.messages(reader.connections)):
            most = min(most_expanded(len(raw)), int(_SHARE * available_bytes()))
            if _expanded(b'zstd', raw, most) > most:
                raise ValueError(f'{path.name} holds a message of {len(raw)} bytes that expands '
                                 f'to more than {most}')


@functools.lru_cache(maxsize=64)
def _check_ros1(path: Path, n_bytes: int, _: int) -> None:
    """Refuse a ROS 1 bag whose records do not follow each other to its end."""
    with open(path, 'rb') as file:
        if file.read(len(_ROS1)) != _ROS1:
            raise ValueError(f'{path} does not begin as ROS 1 bags of version 2.0 do')
        place = len(_ROS1)
        while place < n_bytes:
            header, start = _ros1_part(path, file, place, n_bytes)
            fields = _fields(file.read(header))
            if b'op' not in fields:
                raise ValueError(f'{path} is damaged at byte {place}: a record that is of no kind')
            size, first = _ros1_part(path, file, start + header, n_bytes)
            compression = fields.get(b'compression', b'none')
            if fields.get(b'op') == b'\5' and compression != b'none':
                unpacked = int.from_bytes(fields.get(b'size', b''), 'little')
                if not _fits(size, unpacked) or unpacked != _expanded(
                        compression, file.read(size), unpacked):
                    raise _damaged_chunk(path, place, size)
            place = first + size


def _ros1_part(path: Path, file: BinaryIO, place: int, end: int) -> tuple[int, int]:
    """Size and first byte of half a record, which lies within the file."""
    file.seek(place)
    size, start = int.from_bytes(file.read(4), 'little'), place + 4
    if size > end - start:
        raise ValueError(f'{path} is damaged at byte {place}: {size} bytes are claimed, where '
                         f'{max(end - start, 0)} are left')
    return size, start


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Fields of a record's header."""
    fields, place = {}, 0
    while place < len(header):
        start = place + 4
        place = start + int.from_bytes(header[place:start], 'little')
        name, _, value = header[start:place].partition(b'=')
        fields[name] = value
    return fields


_CHECKS: dict[str, Callable[[Path, int, int], None]] = {
    '.bag': _check_ros1, '.mcap': _check_mcap, '.db3': _check_sqlite,
    '.zstd': _check_packed}
