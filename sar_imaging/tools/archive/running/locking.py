"""One job at a time on an output folder: a lock of the operating system, gone with its process."""

from __future__ import annotations

import fcntl
import json
import os
import socket
import stat
from datetime import datetime, timezone
from pathlib import Path

NAME = 'job.lock'


class OutputInUseError(RuntimeError):
    """Another job writes into this output folder; the text says which and since when."""


class OutputLock:
    """Holds an output folder while a job runs; use it in a `with` statement.

    The operating system drops the lock when its process ends, however it ends: the file that
    stays behind holds nobody up.

    Parameters
    ----------
    output : path
        Output folder of the job; it exists.

    Raises
    ------
    OutputInUseError
        On entering: another process holds the folder.
    FileExistsError
        What stands in the place of the file is none, or is another file as well.
    """

    def __init__(self, output: Path):
        self.path = output / NAME

    def __enter__(self) -> OutputLock:
        if os.path.lexists(self.path):  # nothing is written through links
            status = self.path.lstat()
            if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
                raise FileExistsError(f'{self.path} is no file of an archive; choose another '
                                      'output')
        self._file = self.path.open('a+')
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.seek(0)
            holder = _describe(self._file.read())
            self._file.close()
            raise OutputInUseError(
                f'{self.path.parent} is being written by {holder}; wait until that job ends, '
                'stop it, or choose another output') from error
        self._file.truncate(0)
        self._file.write(json.dumps({
            'host': socket.gethostname(), 'pid': os.getpid(),
            'since': datetime.now(timezone.utc).isoformat(timespec='seconds')}))
        self._file.flush()
        return self

    def __exit__(self, *exception) -> None:
        self._file.close()


def _describe(text: str) -> str:
    """Who wrote this into the lock file."""
    try:
        holder = json.loads(text)
        return (f'another job (process {holder["pid"]} on {holder["host"]}, since '
                f'{holder["since"]})')
    except (ValueError, KeyError, TypeError):
        return 'another job'
