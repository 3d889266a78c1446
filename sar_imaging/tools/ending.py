"""How commands end: exit status, one line for an error, quietly when nobody reads them any more.

A closed pipe (`sar-imaging info X | head -1`) is an OSError, which commands take for an error of a
file. Here it ends the program instead, as the signal of a closed pipe ends others.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import TextIO

from sar_imaging.files import printable, protecting_inputs, told

TRACEBACK = 'SAR_IMAGING_TRACEBACK'  # set in the environment: errors end with a traceback

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


def run_command(run: Callable[[], str | int], *,
                interrupted: str = 'interrupted; nothing was written') -> int:
    """Run the work of a command, print the text that it returns, or why there is none.

    Files that it reads are not replaced by those that it writes. SIGTERM cleans up as Ctrl-C does.
    Warnings of Python, such as of NumPy about numbers of damaged files, are not shown.

    Parameters
    ----------
    run : callable
        Returns a text to print, or the exit status.
    interrupted : str
        What is told then.

    Returns
    -------
    int
        Exit status: 0, or that of `run`; 1 after an error, which is one line of standard error;
        130 where it was interrupted.
    """
    try:
        with _terminate_as_interrupt(), protecting_inputs(), _without_warnings():
            result = run()
            if isinstance(result, int):
                return result
            print(printable(result))
            return 0
    except KeyboardInterrupt:
        print(interrupted, file=sys.stderr)
        return 130
    except Exception as error:  # files of others make libraries raise anything
        if TRACEBACK in os.environ:
            raise
        print(f'error: {told(error)}', file=sys.stderr)
        return 1


@contextlib.contextmanager
def _without_warnings() -> Iterator[None]:
    with warnings.catch_warnings():  # filters stay: tests make errors of warnings
        if TRACEBACK not in os.environ:
            warnings.showwarning = lambda *_, **__: None
        yield


@contextlib.contextmanager
def _terminate_as_interrupt() -> Iterator[None]:
    def interrupt(signum, frame):
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)
