# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How commands begin and end: arguments, exit status, one line for an error.

They end quietly when nobody reads them any more: a closed pipe (`sar-imaging info X | head -1`) is
an OSError, which commands take for an error of a file. Here it ends the program instead, as the
signal of a closed pipe ends others.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import FrameType
from typing import Any, TextIO

from sar_imaging.files import printable, protecting_inputs, told

TRACEBACK = 'SAR_IMAGING_TRACEBACK'  # set in the environment: errors end with a traceback

UNREAD_STATUS = 128 + signal.SIGPIPE  # what a shell says of programs that the signal ended


class _Read:
    """A stream that ends the program when it has no reader."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return self._kept(self._stream.write, text)

    def writelines(self, lines: Iterable[str]) -> None:
        self._kept(self._stream.writelines, lines)

    def flush(self) -> None:
        self._kept(self._stream.flush)

    def _kept(self, call: Callable[..., Any], *arguments: object) -> Any:
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


_INTERRUPTED = 'interrupted; nothing was written'


def command_parser(prog: str | None, description: str, epilog: str | None = None
                   ) -> argparse.ArgumentParser:
    """Parser of a command, whose texts keep their lines."""
    return argparse.ArgumentParser(prog=prog, description=description, epilog=epilog,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)


def main_of(parser: Callable[[], argparse.ArgumentParser],
            run: Callable[[argparse.Namespace], str | int], *, interrupted: str = _INTERRUPTED,
            quiet: bool = False) -> Callable[..., int]:
    """The `main` of a command, which parses its arguments and runs it by `run_command`.

    Parameters
    ----------
    parser : callable
        Makes the parser.
    run : callable
        Does the work that the arguments ask for.
    interrupted : str
        As of `run_command`.
    quiet : bool
        Logged warnings are not shown: the command tells them itself.
    """
    def main(argv: Sequence[str] | None = None) -> int:
        """Run the program; returns its exit status."""
        arguments = parser().parse_args(argv)
        if quiet:
            logging.basicConfig(level=logging.ERROR)
        return run_command(lambda: run(arguments), interrupted=interrupted)

    return main


def run_command(run: Callable[[], str | int], *, interrupted: str = _INTERRUPTED) -> int:
    """Run the work of a command, print the text that it returns, or why there is none.

    Files that it reads are not replaced by those that it writes. SIGTERM cleans up as Ctrl-C does;
    both wait until LLVM has returned.
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
        with _interruptible(), protecting_inputs(), _without_warnings():
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
def _interruptible() -> Iterator[None]:
    """Ctrl-C, unless the shell ignores it for a job in the background, and SIGTERM interrupt."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    unraisable = sys.unraisablehook

    def not_lost(raised: sys.UnraisableHookArgs) -> None:
        if raised.exc_type is KeyboardInterrupt:  # of a destructor, or what else cannot raise
            _interrupt_at_next_line(sys._getframe(1))
        else:
            unraisable(raised)

    try:
        sys.unraisablehook = not_lost
        for number, handler in handlers.items():
            if number == signal.SIGTERM or handler != signal.SIG_IGN:
                signal.signal(number, _interrupt)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        sys.unraisablehook = unraisable


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but not while LLVM compiles or loads a kernel.

    LLVM calls back into Python and holds a lock meanwhile. An exception there is swallowed, or
    ends the process by a segmentation fault. Whoever called LLVM is interrupted at its next line.
    """
    caller = None
    while frame is not None:
        if frame.f_globals.get('__name__', '').startswith('llvmlite'):
            caller = frame.f_back
        frame = frame.f_back
    if caller is None:
        raise KeyboardInterrupt
    _interrupt_at_next_line(caller)


def _interrupt_at_next_line(frame: FrameType) -> None:
    frame.f_trace = _interrupt_traced
    sys.settrace(lambda *_: None)  # without one, Python does not look at those of frames


def _interrupt_traced(frame: FrameType, event: str, argument: object) -> None:
    sys.settrace(None)
    frame.f_trace = None
    raise KeyboardInterrupt
