# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage bags: MCAP, SQLite, ROS 1, and what their metadata tell."""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
import struct
import sys
from collections.abc import Iterator

import yaml

from .any_file import Damage, puts
from .yaml_json import bombs, dumped, values_of


def mcap_file(content: bytes) -> Iterator[Damage]:
    place, first = 8, {}
    while place < len(content) - 8:  # where each kind of record begins
        kind, size = struct.unpack('<BQ', content[place:place + 9])
        first.setdefault(kind, place)
        place += 9 + size
    for kind, at in first.items():
        for told, size in (('2**62 bytes', 2**62), ('2**64 - 1 bytes', 2**64 - 1), ('no bytes', 0),
                           ('2 GB', 2**31)):
            out = bytearray(content)
            out[at + 1:at + 9] = struct.pack('<Q', size)
            yield f'record {kind} claims {told}', puts(bytes(out))
        out = bytearray(content)
        out[at] = 0
        yield f'record {kind} is of kind 0', puts(bytes(out))
        body = range(at + 9, min(at + 9 + 64, len(content) - 4), 4)
        for j in body:
            out = bytearray(content)
            out[j:j + 4] = b'\xff' * 4
            yield f'record {kind}, bytes {j - at} of it', puts(bytes(out))
    chunk = first.get(6)
    if chunk is not None:
        inside = chunk + 9 + 32
        for name in (b'zstd', b'lz4', b'rot13'):
            yield f'compression {name.decode()}', puts(_rechunked(content, chunk, name, None))
        import lz4.frame

        for claimed in (1000, 2**29):
            yield f'bomb of lz4 that claims {claimed} bytes', puts(lambda n=claimed: _rechunked(
                content, chunk, b'lz4', lz4.frame.compress(bytes(2**29)), n))
        if sys.version_info < (3, 14):
            from backports import zstd
            for claimed in (1000, 2**29):
                yield f'bomb of zstd that claims {claimed} bytes', puts(lambda n=claimed: (
                    _rechunked(content, chunk, b'zstd', zstd.compress(bytes(2**29)), n)))
        cdr = content.index(b'\0\1\0\0', inside)
        for j in range(cdr, cdr + 160, 4):
            for value in (2**32 - 1, 2**31, 0):
                out = bytearray(content)
                out[j:j + 4] = struct.pack('<I', value)
                yield f'message, bytes {j - cdr} are {value}', puts(bytes(out))


def _rechunked(content, chunk, name, data, unpacked=None):
    """A file whose first chunk has another compression, and what follows it as it was."""
    (size,) = struct.unpack('<Q', content[chunk + 1:chunk + 9])
    head = content[chunk + 9:chunk + 9 + 28]
    data = content[chunk + 9 + 40:chunk + 9 + size] if data is None else data
    if unpacked is not None:
        head = head[:16] + struct.pack('<Q', unpacked) + head[24:]
    body = head + struct.pack('<I', len(name)) + name + struct.pack('<Q', len(data)) + data
    return (content[:chunk] + struct.pack('<BQ', 6, len(body)) + body
            + content[chunk + 9 + size:])


def ros1_file(content: bytes) -> Iterator[Damage]:
    import bz2

    import lz4.frame

    def size_at(place):
        return int.from_bytes(content[place:place + 4], 'little')

    place, records = 13, []
    while place < len(content):  # first byte of header and data of each record
        data = place + 4 + size_at(place)
        records.append((place, data))
        place = data + 4 + size_at(data)
    for i, (header, data) in enumerate(records[:8]):
        for told, at in (('header', header), ('data', data)):
            for size in (0, 2**31, 2**32 - 1):
                yield f'{told} of record {i} claim {size} bytes', puts(
                    content[:at] + size.to_bytes(4, 'little') + content[at + 4:])
        for j in range(header + 4, min(header + 84, data), 4):
            yield f'header of record {i}, bytes {j - header}', puts(
                content[:j] + b'\xff' * 4 + content[j + 4:])
    chunk = next((h, d) for h, d in records if b'compression=none' in content[h:d])

    def packed(name, stored, claimed):
        field = b'compression=' + name
        head = (struct.pack('<I', 4) + b'op=\5' + struct.pack('<I', len(field)) + field
                + struct.pack('<I', 9) + b'size=' + struct.pack('<I', claimed))
        stop = chunk[1] + 4 + size_at(chunk[1])
        return (content[:chunk[0]] + struct.pack('<I', len(head)) + head
                + struct.pack('<I', len(stored)) + stored + content[stop:])

    for name, pack in ((b'bz2', bz2.compress), (b'lz4', lz4.frame.compress)):
        for claimed in (0, 1000, 2**28, 2**32 - 1):
            yield f'bomb of {name.decode()} that claims {claimed} bytes', puts(
                lambda name=name, pack=pack, n=claimed: packed(name, pack(bytes(2**28)), n))
        yield f'{name.decode()} that is none', puts(packed(name, b'rubbish', 1000))
        yield f'{name.decode()} twice', puts(packed(name, pack(b'a' * 1000) + pack(
            b'b' * 1000), 2000))
    yield 'compression of nobody', puts(packed(b'rot13', b'rubbish', 7))


def packed_file(content: bytes) -> Iterator[Damage]:
    """Messages that were compressed one by one."""
    if sys.version_info < (3, 14):
        from backports import zstd
    else:
        from compression import zstd

    def messages(make):
        def put(path):
            with contextlib.closing(sqlite3.connect(path)) as db:
                db.execute('UPDATE messages SET data = ?', (make(),))
                db.commit()
        return put

    yield 'bombs', messages(lambda: zstd.compress(bytes(2**29)))
    yield 'two frames', messages(lambda: zstd.compress(b'a') + zstd.compress(bytes(2**29)))
    yield 'no frames', messages(lambda: b'rubbish')
    yield 'half a frame', messages(lambda: zstd.compress(os.urandom(1000))[:500])
    yield 'nothing', messages(lambda: b'')
    yield from sqlite_file(content)


def sqlite_file(content: bytes) -> Iterator[Damage]:
    def changed(*statements):
        def put(path):
            with sqlite3.connect(path) as db:
                db.execute('PRAGMA writable_schema=1')
                for statement in statements:
                    with contextlib.suppress(sqlite3.Error):  # what the schema forbids
                        db.execute(statement)
            db.close()
        return put

    forever = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    for table in ('messages', 'topics', 'metadata', 'schema', 'message_definitions'):
        yield f'no table {table}', changed(f'DROP TABLE IF EXISTS {table}')
        yield f'{table} that never ends', changed(
            f'DROP TABLE IF EXISTS {table}', f'CREATE VIEW {table} AS {forever}SELECT i AS id, '
            'i AS topic_id, i AS timestamp, i AS data, i AS name, i AS type, i AS '
            'serialization_format, i AS offered_qos_profiles, i AS schema_version, i AS '
            'ros_distro, i AS metadata_version, i AS metadata, i AS topic_type, i AS encoding, '
            'i AS encoded_message_definition, i AS type_description_hash FROM n')
        yield f'{table} without rows', changed(f'DELETE FROM {table}')
    for column, value in (('data', "'x'"), ('data', 'NULL'), ('data', '7'), ('timestamp', "'x'"),
                          ('timestamp', 'NULL'), ('timestamp', '9223372036854775807'),
                          ('topic_id', '99'), ('data', 'zeroblob(1000000)'),
                          ('timestamp', '1e300')):
        yield f'{column} is {value}', changed(f'UPDATE messages SET {column} = {value}')
    for column in ('name', 'type', 'serialization_format', 'offered_qos_profiles'):
        for value in ("'x'", 'NULL', '7', "x'ff'", "'[[[['"):
            yield f'topic: {column} is {value}', changed(f'UPDATE topics SET {column} = {value}')
    yield 'a trigger', changed('CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM '
                               'messages; END')
    for at in (16, 18, 20, 28, 32, 44, 52, 56, 100, 105):
        out = bytearray(content)
        out[at:at + 2] = b'\xff\xff'
        yield f'header byte {at}', puts(bytes(out))

    def beside(name, text):
        def put(path):
            path.with_name(path.name + name).write_bytes(text)
        return put

    yield 'log beside it', beside('-wal', b'7\x7f\x06\x82' + bytes(4096))
    yield 'journal beside it', beside('-journal', b'\xd9\xd5\x05\xf9 \xa1c\xd7' + bytes(4096))


def truth_file(content: bytes) -> Iterator[Damage]:
    """The truth within the metadata of a bag."""
    from sar_imaging.recordings.bag_io import TRUTH_KEY

    tree = yaml.safe_load(content)
    custom = tree['rosbag2_bagfile_information']['custom_data']
    truth = json.loads(custom[TRUTH_KEY])

    def put(text):
        custom = {TRUTH_KEY: text}
        return puts(dumped({'rosbag2_bagfile_information': {
            **tree['rosbag2_bagfile_information'], 'custom_data': custom}}))

    for told, text in (('no JSON', 'x'), ('nothing', ''), ('nested deep', '[' * 100_000),
                       ('nested objects', '{"a":' * 100_000), ('digits', '9' * 100_000),
                       ('version 99', json.dumps({**truth, 'version': 99})),
                       ('a list', '[]'), ('NaN', 'NaN'), ('a key twice', '{"a": 1, "a": 2}')):
        yield told, put(text)
    for told, other in values_of(truth):
        if not told.startswith(('scenario', 'description', 'notes')):
            yield told, put(json.dumps(other))
    for name, fields in {'alignment': {'time_offset_s': 0.0, 'range_bias_m': 0.0,
                                       'lever_arm_m': [0.0, 0.0, 0.0]},
                         'antenna': {'pattern': 'sinc', 'azimuth_width_deg': 3.0},
                         'mount': {'kind': 'track', 'side': 'left'},
                         'collection': {'collector_name': 'a', 'channels': ['1']}}.items():
        for told, other in values_of({name: fields}):
            yield told, put(json.dumps({**truth, **(other if isinstance(other, dict) else {})}))


def metadata_file(content: bytes) -> Iterator[Damage]:
    for told, text in bombs():
        yield told, puts(text)
        yield f'within: {told}', puts(b'rosbag2_bagfile_information:\n  ' + text)
    for told, tree in values_of(yaml.safe_load(content)):
        if 'custom_data' not in told:
            yield told, puts(dumped(tree))
