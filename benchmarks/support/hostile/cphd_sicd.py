# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage files with XML and a header: CPHD and SICD."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

import numpy as np

from .any_file import Damage, puts
from .valid import N_PULSES


def xml_file(start: bytes):
    """Ways to damage the XML within a file, and the texts of its headers."""
    def special(content: bytes) -> Iterator[Damage]:
        place, end = content.index(start), content.rindex(b'>') + 1
        text = content[place:end]
        found = list(re.finditer(rb'>([^<>]+)</', text))
        values = [b'', b'-1', b'0', b'1e300', b'nan', b'inf', b'18446744073709551615', b'x',
                  b'999999999', b'2147483647', b'0001-01-01T00:00:00Z', b'\xff']
        for i, match in enumerate(found):
            for new in values[i % 3::3]:
                room = match.end(1) - match.start(1)
                name = re.findall(rb'<([A-Za-z0-9]+)[^<>]*$', text[:match.start(1) + 0][:-1])
                told = f'{(name or [b"?"])[-1].decode()} {i} is {new.decode("latin-1")[:20]!r}'
                if len(new) > room:
                    spare = text[:match.start(1)] + new + text[match.end(1):]
                    yield told + ', all moved', puts(content[:place] + spare + content[end:])
                else:
                    new = new.ljust(room)
                    yield told, puts(content[:place + match.start(1)] + new
                                     + content[place + match.end(1):])
        size = len(text)
        bomb = b''.join([b'<!DOCTYPE x [<!ENTITY a "', b'a' * 40, b'">', *(
            b'<!ENTITY %c "%s">' % (c, b'&%c;' % (c - 1) * 9) for c in range(98, 108)), b']>'])
        for told, inside in {
                'bomb of entities': bomb + b'<x>&k;</x>',
                'entity of a file': b'<!DOCTYPE x [<!ENTITY f SYSTEM "secret">]><x>&f;</x>',
                'entity of a pipe': b'<!DOCTYPE x [<!ENTITY f SYSTEM "pipe">]><x>&f;</x>',
                'entity of the net': b'<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x"><x/>',
                'nested deep': b'<x>' * (size // 4), 'no XML': b'x' * size,
                'attributes': b'<x ' + b' '.join(b'a%d=""' % i for i in range(size // 9)) + b'/>',
                'other root': b'<SICD/>', 'empty root': text[:text.index(b'>')] + b'/>',
        }.items():
            yield f'XML: {told}', puts(content[:place] + inside[:size].ljust(size) + content[end:])
            inside = inside.replace(b'<x>', text[:text.index(b'>') + 1]).replace(b'</x>', b'')
            yield f'XML of its kind: {told}', puts(
                content[:place] + inside[:size].ljust(size) + content[end:])
        header = content[:place]
        digits = [m for m in re.finditer(rb'\d{2,}', header)][:60]
        for i, match in enumerate(digits):
            n = match.end() - match.start()
            new = [b'9' * n, b'0' * n, b'-' + b'1' * (n - 1)][i % 3]
            yield f'number {i} of the header is {new.decode()}', puts(
                content[:match.start()] + new + content[match.end():])
    return special


def cphd_file(content: bytes) -> Iterator[Damage]:
    yield from xml_file(b'<CPHD')(content)
    first = int(re.search(rb'PVP_BLOCK_BYTE_OFFSET := (\d+)', content)[1])
    words = int(re.search(rb'PVP_BLOCK_SIZE := (\d+)', content)[1]) // 8
    per = words // N_PULSES
    for word in range(per):
        for value in (np.nan, np.inf, 0.0, -1.0, 1e300, 1e-300, 1e10)[word % 2::2]:
            for rows, told in (([N_PULSES // 2], 'one vector'), (range(N_PULSES), 'every vector')):
                out = bytearray(content)
                for row in rows:
                    at = first + 8 * (row * per + word)
                    out[at:at + 8] = struct.pack('>d', value)
                yield f'word {word} of {told} is {value}', puts(bytes(out))
