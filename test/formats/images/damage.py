# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are damaged at random, for tests of readers."""

import re

from hypothesis import HealthCheck, strategies as st

PROPERTY = dict(suppress_health_check=list(HealthCheck), deadline=None)


class Content(bytes):
    """Bytes of a file, which failed tests need not print."""

    def __repr__(self):
        return f'<{len(self)} bytes>'


def mutations():
    """How to damage a file: bytes overwritten, removed, repeated; digits made large."""
    return st.lists(st.tuples(
        st.sampled_from(['set', 'flip', 'cut', 'double', 'nines', 'zeros']),
        st.floats(0, 1, exclude_max=True), st.integers(1, 16), st.binary(min_size=1, max_size=16)),
        min_size=1, max_size=4)


def damaged(content, changes, headers):
    """The file with these changes, half of which fall into its headers and its XML."""
    out = bytearray(content)
    for i, (kind, where, n, new) in enumerate(changes):
        inside = headers if i % 2 == 0 else [(0, len(out))]
        low, high = inside[int(where * 997) % len(inside)]
        at = min(low + int(where * (high - low)), max(len(out) - 1, 0))
        if kind == 'set':
            out[at:at + len(new)] = new
        elif kind == 'flip':
            out[at:at + 1] = bytes(255 - b for b in out[at:at + 1])
        elif kind == 'cut':
            del out[at:at + n * 7]
        elif kind == 'double':
            out[at:at] = out[at:at + n * 5]
        else:
            digit = b'9' if kind == 'nines' else b'0'
            out[at:at + n] = re.sub(rb'\d', digit, bytes(out[at:at + n]))
    return Content(out)
