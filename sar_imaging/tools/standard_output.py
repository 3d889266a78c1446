"""Let a command end quietly when nobody reads its output any more: `sar-imaging info X | head -1`.

A closed pipe is an OSError, which commands take for an error of a file. Here it ends the program
instead, as the signal of a closed pipe ends others.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from typing import TextIO

UNREAD_STATUS = 128 + signal.SIGPIPE  # what a shell says of programs that the signal ended


class _Read:
    """A stream that ends the program when it has no reader."""

    def __init__(self, stream: TextIO):
        self._stream = stream

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return self._kept(self._stream.write, text)

    def writelines(self, lines) -> None:
        self._kept(self._stream.writelines, lines)

    def flush(self) -> None:
        self._kept(self._stream.flush)

    def _kept(self, call, *arguments):
        try:
            return call(*arguments)
        except BrokenPipeError:
            # what is still in the buffer goes nowhere when the interpreter ends
            with open(os.devnull, 'w') as nowhere:
                os.dup2(nowhere.fileno(), self._stream.fileno())
            raise SystemExit(UNREAD_STATUS) from None


@contextlib.contextmanager
def ending_with_the_reader() -> Iterator[None]:
    """Inside, a closed pipe of standard output or standard error ends the program, status 141."""
    streams = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = map(_Read, streams)
    try:
        yield
    finally:
        try:
            sys.stdout.flush()
        finally:
            sys.stdout, sys.stderr = streams
