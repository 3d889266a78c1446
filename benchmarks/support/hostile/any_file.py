# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage a file of any kind."""

from __future__ import annotations

import os
import pathlib
import re
import socket
from collections.abc import Callable, Iterator

import numpy as np

CANARY, SECRET = 'executed', 'a-secret-of-the-machine'  # a file that appears; a text that is told

#: A way to damage a file: what is told of it, and what puts it in the place of the valid one.
Damage = tuple[str, Callable[[pathlib.Path], None]]


def puts(content: bytes | Callable[[], bytes]) -> Callable[[pathlib.Path], None]:
    """Put a content, or one that is made when it is wanted, in place of the valid one."""
    def put(path):
        path.write_bytes(content if isinstance(content, bytes) else content())
    return put


def _link(target: str) -> Callable[[pathlib.Path], None]:
    def put(path):
        path.unlink()
        path.symlink_to(target)
    return put


def _sparse(content: bytes, n_bytes: int) -> Callable[[pathlib.Path], None]:
    def put(path):
        with open(path, 'wb') as file:
            file.write(content)
            file.truncate(n_bytes)
    return put


def _pipe(path):
    path.unlink()
    os.mkfifo(path)


def _folder(path):
    path.unlink()
    path.mkdir()


def _socket(path):
    path.unlink()
    with socket.socket(socket.AF_UNIX) as made:
        here = os.getcwd()
        os.chdir(path.parent)  # names of sockets are short
        made.bind(path.name)
        os.chdir(here)


def _loop(path):
    path.unlink()
    path.symlink_to(path.name)


def common(content: bytes, seeds: range) -> Iterator[Damage]:
    """Ways to damage any file."""
    n = len(content)
    yield 'empty', puts(b'')
    yield 'one byte', puts(content[:1])
    for share in (0.1, 0.5, 0.9):
        yield f'cut off after {share:.0%}', puts(content[:int(n * share)])
    yield 'the last byte is missing', puts(content[:-1])
    yield 'the first byte is missing', puts(content[1:])
    yield 'zeros', puts(bytes(n))
    for place in (0.02, 0.3, 0.6):
        start, size = int(n * place), max(min(n // 3, 50_000), 1)
        yield f'zeros at {place:.0%}', puts(content[:start] + bytes(size) + content[start + size:])
    yield 'twice', puts(content + content)
    yield 'ones', puts(b'\xff' * n)
    yield 'text', puts(b'this is something else\n')
    yield 'UTF-16', puts(content.decode('latin-1').encode('utf-16'))
    yield 'line ends of Windows', puts(content.replace(b'\n', b'\r\n'))
    yield 'one line of 64 MB', puts(lambda: b'1,' * 2**25)
    yield 'a terabyte of nothing', _sparse(b'', 2**40)
    yield 'a terabyte behind it', _sparse(content, 2**40)
    yield 'a pipe', _pipe
    yield 'a folder', _folder
    yield 'a socket', _socket
    yield 'a device without end', _link('/dev/zero')
    yield 'a link to itself', _loop
    yield 'a link to nothing', _link('nothing')
    yield 'a link to memory', _link('/proc/self/mem')
    yield 'nothing', lambda path: path.unlink()
    starts = {'CPHD': b'CPHD/1.1.0\n\f\n', 'NITF': b'NITF02.10', 'TIFF': b'II*\0',
              'NumPy': b'\x93NUMPY\x01\0', 'HDF5': b'\x89HDF\r\n\x1a\n', 'zip': b'PK\3\4',
              'MCAP': b'\x89MCAP0\r\n', 'ROS 1': b'#ROSBAG V2.0\n',
              'SQLite': b'SQLite format 3\0', 'pickle': pickled()}
    for name, start in starts.items():
        yield f'begins as {name}', puts(start + content[len(start):])
    for seed in seeds:
        yield f'random {seed}', puts(_random(content, np.random.default_rng(seed)))


def _random(content: bytes, rng) -> bytes:
    """Bytes overwritten, removed, repeated; digits that became nines."""
    out = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        at, size = int(len(out) * rng.random() ** 2), int(rng.integers(1, 64))
        kind = rng.integers(5)
        if kind == 0:
            out[at:at + size] = rng.bytes(size)
        elif kind == 1:
            del out[at:at + size]
        elif kind == 2:
            out[at:at] = out[at:at + size]
        elif kind == 3:
            out[at:at + size] = re.sub(rb'\d', b'9', bytes(out[at:at + size]))
        else:
            out[at:at + 8] = rng.choice([0, 255, 127, 128]).astype(np.uint8).tobytes() * 8
    return bytes(out)


def pickled() -> bytes:
    import pickle

    class Executed:
        def __reduce__(self):
            return os.system, (f'touch {CANARY}',)

    return pickle.dumps(Executed())
