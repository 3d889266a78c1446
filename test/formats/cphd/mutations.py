# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Damage of CPHD files: truncated, overwritten, absurd metadata and absurd vectors."""

import re

import numpy as np

ABSURD_TEXTS = [b'', b'0', b'-1', b'1e300', b'-1e300', b'nan', b'inf', b'18446744073709551615',
                b'9223372036854775807', b'99999999999999999999999', b'1000000000', b'x', b'FX',
                b'TOA', b'CI2', b'CI4', b'CF8', b'+1', b'0.5', b'\xff\xfe', b'a=F8;b=F8;',
                b'0001-01-01T00:00:00Z', b'9999-12-31T23:59:59Z', b"' or '1'='1"]
ABSURD_NUMBERS = [np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1.0, 1e-300, 1e300, 1e10, -1e10, 6.4e6,
                  1e-9]


def mutated(source: bytes, rng) -> bytes:
    """A copy of a file with one or two kinds of damage."""
    for _ in range(rng.integers(1, 3)):
        source = KINDS[rng.integers(len(KINDS))](source, rng)
    return source


def _truncate(source, rng):
    return source[:rng.integers(len(source) + 1)]


def _flip(source, rng):
    """Overwrite some bytes, more often near the beginning, where sizes and metadata are."""
    out = bytearray(source)
    for _ in range(rng.integers(1, 20)):
        if out:
            out[int(len(out) * rng.random() ** 3)] = rng.integers(256)
    return bytes(out)


def _remove(source, rng):
    first = rng.integers(len(source) + 1)
    return source[:first] + source[first + rng.integers(1, 200):]


def _repeat(source, rng):
    first = rng.integers(len(source) + 1)
    return source[:first] + source[first:first + rng.integers(1, 5000)] + source[first:]


def _header(source, rng):
    return _replace(source, rb':= ([^\n]*)\n', rng)


def _metadata(source, rng):
    return _replace(source, rb'>([^<>]+)</', rng)


def _replace(source, pattern, rng):
    """One of the texts that match becomes an absurd one; the file keeps its size if it can."""
    found = list(re.finditer(pattern, source[:100_000]))
    if not found:
        return source
    match = found[rng.integers(len(found))]
    text = ABSURD_TEXTS[rng.integers(len(ABSURD_TEXTS))]
    room = match.end(1) - match.start(1)
    if len(text) <= room and rng.random() < 0.7:
        text = text.ljust(room)  # so that nothing behind it moves
    return source[:match.start(1)] + text + source[match.end(1):]


def _element(source, rng):
    """An element is gone, or another one has its name."""
    names = list(set(re.findall(rb'<([A-Z]\w+)', source[:100_000])))
    if not names:
        return source
    one, other = (names[i] for i in rng.integers(len(names), size=2))
    return source.replace(b'<' + one + b'>', b'<' + other + b'>').replace(
        b'</' + one + b'>', b'</' + other + b'>')


def _vectors(source, rng):
    """Words of the vectors' parameters become absurd numbers."""
    found = re.search(rb'PVP_BLOCK_BYTE_OFFSET := (\d{1,8})\n', source)
    size = re.search(rb'PVP_BLOCK_SIZE := (\d{1,8})\n', source)
    if not (found and size):
        return source
    first, words = int(found[1]), int(size[1]) // 8
    out = bytearray(source)
    stride = rng.choice([1, 7, 30])  # one word of many vectors, or words here and there
    start = rng.integers(max(words, 1))
    number = np.array(ABSURD_NUMBERS[rng.integers(len(ABSURD_NUMBERS))], '>f8').tobytes()
    for word in range(start, min(words, start + stride * rng.integers(1, 20)), stride):
        place = first + 8 * word
        if place + 8 <= len(out):
            out[place:place + 8] = number
    return bytes(out)


def _entities(source, rng):
    """A document type that would grow, in place of the first bytes of the metadata."""
    bomb = (b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa">'
            + b''.join(b'<!ENTITY %c "&%c;&%c;&%c;&%c;&%c;&%c;&%c;&%c;">'
                       % (c, *[c - 1] * 8) for c in range(ord('b'), ord('k')))
            + b'<!ENTITY f SYSTEM "file:///etc/passwd">]>')
    return source.replace(b'<CPHD', bomb + b'<CPHD', 1).replace(b'UNKNOWN', b'&j;&f;', 1)


KINDS = [_truncate, _flip, _remove, _repeat, _header, _metadata, _metadata, _element, _vectors,
         _vectors, _entities]
