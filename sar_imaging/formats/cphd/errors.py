"""The one exception of files that cannot be read or written as CPHD."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path


class CphdError(ValueError):
    """A file is no CPHD, is damaged, or holds what cannot be imaged; or pulses are no CPHD."""


@contextlib.contextmanager
def reported(path: Path, what: str) -> Iterator[None]:
    """Raise `CphdError`, with the file's name, for whatever damaged metadata raise.

    Parameters
    ----------
    path : Path
        File that is read.
    what : str
        What is read of it, for the message.
    """
    try:
        yield
    except CphdError as error:
        if str(path) in str(error):
            raise
        raise CphdError(f'{path}: {error}') from error
    except (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError,
            SyntaxError, TypeError, ValueError) as error:
        raise CphdError(f'{path}: {what}: {type(error).__name__}: {error}') from error
