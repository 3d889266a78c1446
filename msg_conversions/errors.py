"""The error that a malformed message raises."""

from __future__ import annotations


class WireFormatError(ValueError):
    """A message does not follow the wire format, or an array does not fit into it.

    The text names what was expected, what was received and what to do about it.
    """
