# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pieces that compute little and misbehave on demand; workers import them by this name."""

import errno
import hashlib
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sar_imaging.archive.pieces import Piece, PieceResult


@dataclass(frozen=True, kw_only=True)
class Toy(Piece):
    """A piece whose file is a digest of its value and of the files of what it needs."""

    KIND = 'toy'

    value: int = 0
    does: str = ''
    rounds: int = 200


def name_of(key):
    return hashlib.md5(key.encode()).hexdigest() + '.bin'


def compute(piece, output):
    """Every call leaves a line in `calls`, so that tests can count them."""
    with (output / 'calls').open('a') as file:
        file.write(piece.key + '\n')
    while piece.needs and (output / 'hold').exists():  # no job ends before a test wants it to
        time.sleep(0.01)
    misbehave(piece, output)
    digest = hashlib.sha256(str(piece.value).encode())
    for key in piece.needs:
        path = output / name_of(key)
        digest.update(path.read_bytes() if path.exists() else b'lost')
    rng = np.random.default_rng(int.from_bytes(digest.digest()[:8], 'big'))
    total = np.zeros((64, 64))
    for _ in range(piece.rounds):
        total = np.tanh(total @ rng.standard_normal((64, 64)) + 1e-3)
    part = output / f'{name_of(piece.key)}.{os.getpid()}.part'
    part.write_bytes(total.tobytes())
    part.replace(output / name_of(piece.key))
    return PieceResult(files=(name_of(piece.key),))


def misbehave(piece, output):
    if piece.does == 'corrupt':
        raise ValueError('the recording ends after 3 of 10 pulses')
    if piece.does == 'die' or piece.does == 'die once' and first_call(piece, output):
        os.kill(os.getpid(), signal.SIGKILL)
    if piece.does == 'full':
        raise RuntimeError('writing failed') from OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    if piece.does == 'trouble' or piece.does == 'trouble once' and first_call(piece, output):
        raise OSError(errno.EIO, os.strerror(errno.EIO), 'flight.cphd')
    if piece.does == 'hog':
        np.ones(piece.memory_bytes // 8)
    if piece.does == 'write':
        (output / f'{name_of(piece.key)}.large').write_bytes(bytes(piece.memory_bytes))


def first_call(piece, output):
    return calls(output).count(piece.key) == 1


def calls(output):
    path = Path(output) / 'calls'
    return path.read_text().splitlines() if path.exists() else []


def tree(leaves, **options):
    """Leaves, sums of neighbours, sums of sums, down to one: a strip fused as a binary tree."""
    pieces = [Toy(key=f'image flight-{i:03d} aperture 0', value=i, **options)
              for i in range(leaves)]
    level, stage = [p.key for p in pieces], 0
    while len(level) > 1:
        stage += 1
        sums = [Toy(key=f'sum {stage}.{i}', needs=tuple(level[2 * i:2 * i + 2]), **options)
                for i in range((len(level) + 1) // 2)]
        pieces += sums
        level = [p.key for p in sums]
    return pieces


def bits(output):
    """All files of results, by name."""
    return {path.name: path.read_bytes() for path in Path(output).glob('*.bin')}
