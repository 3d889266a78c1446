# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Refuse what does not fit into memory before it is allocated."""

from __future__ import annotations

import contextlib
import contextvars
import functools
import os
import sys
from collections.abc import Iterator
from pathlib import Path

try:
    import resource
except ImportError:  # not a Unix system
    resource = None  # type: ignore[assignment]  # what is a module elsewhere

IMAGE_BYTES = 8  # of a pixel, complex64
PUBLISHED_BYTES = 3 * IMAGE_BYTES  # image, its message, the message serialised

# Where not even so much is left nothing runs; to ask the system takes as long as a small image.
_LITTLE_BYTES = 4 << 20

_granted: contextvars.ContextVar[int] = contextvars.ContextVar('granted', default=0)
_UNLIMITED = 1 << 60  # what version 1 of control groups writes for no limit is more
_MEMINFO = Path('/proc/meminfo')
_STATM = Path('/proc/self/statm')
# Limit, use and reclaimable memory (of the page cache) of a control group, of version 2 and 1.
_GROUP_FILES = {'': ('memory.max', 'memory.current', 'inactive_file'),
                'memory': ('memory.limit_in_bytes', 'memory.usage_in_bytes',
                           'total_inactive_file')}


def available_bytes() -> int:
    """Memory that this process can have without swapping, bytes.

    The least that the machine, the control groups of the process (those of a container, say) and
    its own limit (``ulimit -v``) leave, or what `granting` grants; `sys.maxsize` if nobody tells.
    """
    return granted_bytes() or max(0, min(_machine_bytes(), container_bytes(), _process_bytes()))


def granted_bytes() -> int:
    """What `granting` grants, bytes, of a device's memory as well; 0 beyond its blocks."""
    return _granted.get()


@contextlib.contextmanager
def granting(n_bytes: float) -> Iterator[None]:
    """Make plans within a ``with`` block as if so many bytes were available, whatever machine."""
    token = _granted.set(max(1, int(n_bytes)))
    try:
        yield
    finally:
        _granted.reset(token)


def check_memory(n_bytes: int, what: str, remedy: str) -> None:
    """Check that something fits into memory.

    Allocating more than there is often succeeds, and the program is killed later on. Up to 4 MiB
    are checked only against what `granting` grants.

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
    if n_bytes <= _LITTLE_BYTES and not granted_bytes():
        return
    free = available_bytes()
    if n_bytes > free:
        raise MemoryError(f'{what} needs {n_bytes / 1e6:.0f} MB, {free / 1e6:.0f} MB are '
                          f'available; {remedy}')


def container_bytes(membership: Path = Path('/proc/self/cgroup'),
                    mount: Path = Path('/sys/fs/cgroup')) -> int:
    """Memory that the control groups of this process leave, bytes; `sys.maxsize` without a limit.

    Parameters
    ----------
    membership : Path
        Lists the groups, as ``/proc/self/cgroup`` does.
    mount : Path
        Where their files are.
    """
    return min((_group_bytes(*group) for group in _groups(membership, mount)),
               default=sys.maxsize)


@functools.lru_cache(maxsize=8)
def _groups(membership: Path, mount: Path) -> list[tuple[Path, Path, Path, str]]:
    """Files of the groups that may limit memory, and of those that they are in."""
    try:
        lines = membership.read_text().splitlines()
    except OSError:
        return []
    groups = []
    for line in lines:
        _, controllers, path = line.split(':', 2)
        for controller, names in _GROUP_FILES.items():
            if controller in controllers.split(','):
                # A container sees its own group at the mount, whatever the path says.
                above = Path(path.lstrip('/')).parts
                for n in range(len(above) + 1):
                    group = mount.joinpath(controller, *above[:n])
                    if (group / names[0]).exists():
                        groups.append((group / names[0], group / names[1],
                                       group / 'memory.stat', names[2]))
    return groups


def _group_bytes(limit: Path, use: Path, statistics: Path, reclaimable: str) -> int:
    try:
        most = int(limit.read_text())
        return most if most > _UNLIMITED else (most - int(use.read_text())
                                               + _number(statistics, reclaimable))
    except (OSError, ValueError):  # no such group, or 'max'
        return sys.maxsize


def _number(path: Path, name: str) -> int:
    """Number of a file that names one in each line."""
    with open(path) as file:
        for line in file:
            if line.startswith(name):
                return int(line[len(name):].strip(': ').split()[0])
    raise ValueError(f'{path} names no {name}')


def _machine_bytes() -> int:
    try:
        return 1024 * _number(_MEMINFO, 'MemAvailable')
    except (OSError, ValueError):  # another system
        pass
    try:
        return os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES')
    except (AttributeError, ValueError, OSError):
        return sys.maxsize


def _process_bytes() -> int:
    if resource is None or not _STATM.exists():
        return sys.maxsize
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return sys.maxsize
    return limit - int(_STATM.read_text().split()[0]) * resource.getpagesize()
