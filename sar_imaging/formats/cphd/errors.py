"""The one exception of files that cannot be read or written as CPHD."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path


class CphdError(ValueError):
    """A file is no CPHD, is damaged, or holds what cannot be imaged; or pulses are no CPHD.

    Examples
    --------
    >>> from sar_imaging.formats.cphd import CphdError, CphdReader
    >>> with open('notes.cphd', 'w') as file:
    ...     _ = file.write('no phase histories')
    >>> try:
    ...     CphdReader('notes.cphd')
    ... except CphdError as error:
    ...     print(error)
    notes.cphd is no CPHD: it begins with b'no phase histori', not with b'CPHD/1.1.0'
    """


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
