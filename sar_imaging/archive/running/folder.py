"""An output folder belongs to one job, and one process works on it at a time.

Another job is refused, and told what differs. The lock is the operating system's, gone with its
process.
"""

from __future__ import annotations

import fcntl
import json
import os
import socket
import stat
from datetime import datetime, timezone
from pathlib import Path

from ...files import told
from ..jobs.job import Job
from ..jobs.stored import JOB_FILE, write_job

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


class OtherJobError(RuntimeError):
    """The output folder holds another job's results; the text names what differs."""


def claim(job: Job) -> None:
    """Take the job's output folder, or refuse to mix its results with those of another job.

    Parameters
    ----------
    job : Job
        Its `output` exists; ``job.json`` is written there.

    Raises
    ------
    OtherJobError
        The folder was made by a job that makes other bits, or by something else.
    """
    path = job.output / JOB_FILE
    if path.is_file():
        changes = _changes(path, job)
        if changes:
            raise OtherJobError(
                f'{job.output} was made by another job: {changes}; choose another output, remove '
                'that folder, or give the job as it was')
    elif others := sorted(name for name in os.listdir(job.output)
                          if name not in (JOB_FILE, NAME) and not name.startswith('.')):
        raise OtherJobError(f'{job.output} holds {others[0]} and no {JOB_FILE}, so it was not '
                            'made by an archive; choose a new folder')
    write_job(job)


def _changes(path: Path, job: Job) -> str:
    """What differs from the job of a file, as people would say it; '' for nothing."""
    try:
        stored = json.loads(path.read_text())
        digest, before = stored['digest'], dict(stored['job'])
    except (ValueError, KeyError, TypeError) as error:
        raise OtherJobError(f'{path} cannot be read ({told(error)}); it should say which job made '
                            'the folder: choose another output, or remove that folder') from error
    if digest == job.digest():
        return ''
    now = json.loads(json.dumps(job.deciding(), default=str))
    changed = [name for name, value in now.items() if before.get(name) != value]
    if not changed:
        return f'of version {stored.get("version")} of sar_imaging'
    return ', '.join(f'{name} was {json.dumps(before.get(name))}, now {json.dumps(now[name])}'
                     for name in changed)
