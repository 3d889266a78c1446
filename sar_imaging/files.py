"""Files that a parameter names: whoever may set it must not make a node read just anything."""

from __future__ import annotations

import stat
from pathlib import Path


def check_file(path: Path | str, most_bytes: int) -> None:
    """Refuse what is no regular file of a sensible size: devices and pipes never end.

    Parameters
    ----------
    path : path
        File that is to be read.
    most_bytes : int
        Largest size.

    Raises
    ------
    ValueError
        It does not exist, cannot be looked at, is no regular file, or is larger.
    """
    try:
        status = Path(path).stat()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise ValueError(f'{path!s} cannot be read: {getattr(error, "strerror", error)}'
                         ) from error
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f'{path!s} is no regular file')
    if status.st_size > most_bytes:
        raise ValueError(f'{path!s} has {status.st_size / 1e6:.3g} MB; expected at most '
                         f'{most_bytes / 1e6:.3g} MB')
