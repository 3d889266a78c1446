# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage lines of text, as of CSV, logs and poses."""

from __future__ import annotations

import re
from collections.abc import Iterator

from .any_file import Damage, puts


def text_file(content: bytes) -> Iterator[Damage]:
    lines = content.decode().splitlines()
    middle = len(lines) // 2
    fields = re.split(r'[,\s]+', lines[middle].strip())
    for place in range(len(fields)):
        for value in ('', 'nan', 'inf', '-1', '1e999', '1e30', 'x', '9' * 5000, '1,5', '"', '1_0',
                      '\0', '٣', '0x1F', '99999999999999999999', '-inf'):
            if place > 20:
                break
            parts = lines[middle].split(',' if ',' in lines[middle] else None)
            parts[place] = value
            changed = [*lines[:middle], (',' if ',' in lines[middle] else ' ').join(parts),
                       *lines[middle + 1:]]
            yield f'field {place} is {value[:20]!r}', puts('\n'.join(changed).encode())
    yield 'lines reversed', puts('\n'.join(lines[:1] + lines[:0:-1]).encode())
    yield 'one line', puts((lines[0] + '\n').encode())
    yield 'heads twice', puts('\n'.join([lines[0]] + lines).encode())
    yield 'no heads', puts('\n'.join(lines[1:]).encode())
    yield 'quote without end', puts(('"' + '\n'.join(lines)).encode())
    yield 'a field of 10 MB', puts(
        lambda: '\n'.join([*lines[:2], '1' * 10**7, *lines[2:]]).encode())
    yield 'a million columns', puts(lambda: (
        ','.join(['a'] * 10**6) + '\n' + ','.join(['1'] * 10**6)).encode())
    yield 'ten million empty lines', puts(lambda: b'\n' * 10**7 + content)
    yield 'old line ends', puts(content.replace(b'\n', b'\r'))
    yield 'semicolons', puts(content.replace(b',', b';'))
    yield 'mark of bytes', puts(b'\xef\xbb\xbf' + content)
    yield 'latin', puts(b'\xe9' + content)
