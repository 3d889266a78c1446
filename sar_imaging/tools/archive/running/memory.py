"""Memory of a worker: a bound that the operating system keeps, and the peak of a piece."""

from __future__ import annotations

import contextlib
import resource
import threading
from collections.abc import Iterator
from pathlib import Path

_LOCK = threading.Lock()
_RUNNING = [0]  # pieces in this process, and the limit before the first
_BEFORE: list[tuple[int, int]] = []


@contextlib.contextmanager
def bounded(n_bytes: int | None) -> Iterator[None]:
    """Let allocations beyond a bound fail with MemoryError.

    Dask's nanny looks at the memory of a worker ten times a second and kills it. Until then a
    single large array may pass the bound; and the piece would be tried again, in vain. Here the
    operating system refuses the allocation (RLIMIT_DATA), and the piece can say so.

    Parameters
    ----------
    n_bytes : int or None
        Bound on the private writable memory of this process; None leaves it as it is.
    """
    if n_bytes is None:
        yield
        return
    with _LOCK:
        if not _RUNNING[0]:
            soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
            _BEFORE[:] = [(soft, hard)]
            known = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
            resource.setrlimit(resource.RLIMIT_DATA, (min([n_bytes, *known]), hard))
        _RUNNING[0] += 1
    try:
        yield
    finally:
        with _LOCK:
            _RUNNING[0] -= 1
            if not _RUNNING[0]:
                resource.setrlimit(resource.RLIMIT_DATA, _BEFORE.pop())


class Peak:
    """Largest resident memory of this process while the `with` statement lasts.

    Attributes
    ----------
    n_bytes : int
        After the statement. Where the kernel cannot forget an earlier peak (Linux alone can), the
        largest since the process began.
    """

    n_bytes = 0

    def __enter__(self) -> Peak:
        with contextlib.suppress(OSError):
            Path('/proc/self/clear_refs').write_text('5')
        return self

    def __exit__(self, *exception) -> None:
        self.n_bytes = _peak_bytes()


def _peak_bytes() -> int:
    try:
        lines = Path('/proc/self/status').read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith('VmHWM'))
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
