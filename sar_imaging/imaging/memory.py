"""Refuse what does not fit into memory before it is allocated."""

from __future__ import annotations

import os
import pathlib

_MEMINFO = pathlib.Path('/proc/meminfo')


def available_bytes() -> int:
    """Memory that can be had without swapping, bytes; all of it where the system does not say."""
    if _MEMINFO.exists():
        for line in _MEMINFO.read_text().splitlines():
            name, _, rest = line.partition(':')
            if name == 'MemAvailable':
                return 1024 * int(rest.split()[0])
    return os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES')


def check_memory(n_bytes: int, what: str, remedy: str) -> None:
    """Check that something fits into memory.

    Allocating more than there is often succeeds, and the program is killed later on.

    Parameters
    ----------
    n_bytes : int
        Size of it, bytes.
    what : str
        What it is, for the message.
    remedy : str
        What to do about it, for the message.

    Raises
    ------
    MemoryError
        It is larger than the memory that is available.
    """
    free = available_bytes()
    if n_bytes > free:
        raise MemoryError(f'{what} needs {n_bytes} bytes, {free} are available; {remedy}')
