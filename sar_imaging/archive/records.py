# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is finished, whose the output folder is, and that one process at a time works there.

Dask knows nothing of an earlier run. A piece that is finished has a small file, its record,
written after the piece's own files.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import os
import socket
import stat
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from ..files import told
from .job import Job
from .scans import JOB_FILE, bring_to_disk, write_job, write_text

LOCK_FILE, RECORDS = 'job.lock', 'records'


def fingerprint(piece: Any, needs: Mapping[str, str | None]) -> str:
    """Digest of all that decides what a piece computes.

    Parameters
    ----------
    piece : Piece
        Its `fingerprint` tells all of it but the predictions.
    needs : mapping of str to str
        Fingerprints of the pieces that it needs by their keys; None for one that is lost.

    Returns
    -------
    str
        Changes when the piece does, when one of its needs is computed anew, and when one that
        was lost is there now.
    """
    text = json.dumps([piece.fingerprint(), sorted(needs.items())])
    return hashlib.sha256(text.encode()).hexdigest()


def _sync_files(paths: Iterable[Path]) -> None:
    """Bring files to the disk, and their names; folders and what is missing are passed over."""
    files = [path for path in paths if path.is_file()]
    for path in (*files, *sorted({path.parent for path in files})):
        bring_to_disk(path)


@dataclasses.dataclass(frozen=True)
class Records:
    """Records of finished pieces in an output folder.

    Attributes
    ----------
    output : path
        Output folder of the job.
    """

    output: Path

    def path(self, key: str) -> Path:
        """File of a piece, in one of 256 folders, for a million in one are slow to look up."""
        name = hashlib.sha256(key.encode()).hexdigest()[:32]
        return self.output / RECORDS / name[:2] / f'{name}.json'

    def read(self, key: str, mark: str) -> dict[str, Any] | None:
        """Record of a finished piece.

        Parameters
        ----------
        key : str
            Key of the piece.
        mark : str
            Its fingerprint.

        Returns
        -------
        dict or None
            What `write` wrote; None where the piece must be computed: there is no record, or one
            of something else, or a file of the piece has gone.
        """
        try:
            record = json.loads(self.path(key).read_text())
        except (FileNotFoundError, ValueError):
            return None
        if not isinstance(record, dict) or record.get('fingerprint') != mark:
            return None
        files = (record.get('result') or {}).get('files') or ()
        return record if all((self.output / name).exists() for name in files) else None

    def write(self, key: str, mark: str, *, result: dict[str, Any], **told: object
              ) -> dict[str, Any]:
        """Record that a piece is finished, after its own files are on the disk; returns it.

        Parameters
        ----------
        key, mark : str
            Key and fingerprint of the piece.
        result : dict
            What it returned, for JSON; `files`, where given, are names relative to the output.
        **told
            More for the record: seconds, memory, worker.
        """
        _sync_files(self.output / name for name in result.get('files') or ())
        record = {'key': key, 'fingerprint': mark, 'result': result, **told}
        write_text(self.path(key), json.dumps(record))
        bring_to_disk(self.path(key).parent)
        return record

    def forget(self, key: str) -> None:
        """Remove the record of a piece, whose files will change."""
        self.path(key).unlink(missing_ok=True)


class OutputInUseError(RuntimeError):
    """Another job writes into this output folder; the text says which and since when."""


@contextlib.contextmanager
def held(output: Path) -> Iterator[None]:
    """Hold an output folder while a job runs.

    The operating system drops the lock when its process ends, however it ends: the file that
    stays behind holds nobody up.

    Parameters
    ----------
    output : path
        Output folder of the job; it exists.

    Raises
    ------
    OutputInUseError
        Another process holds the folder.
    FileExistsError
        What stands in the place of the file is none, or is another file as well.
    """
    path = output / LOCK_FILE
    if os.path.lexists(path):  # nothing is written through links
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
            raise FileExistsError(f'{path} is no file of an archive; choose another output')
    with path.open('a+') as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.seek(0)
            raise OutputInUseError(
                f'{output} is being written by {_holder(file.read())}; wait until that job ends, '
                'stop it, or choose another output') from error
        file.truncate(0)
        file.write(json.dumps({
            'host': socket.gethostname(), 'pid': os.getpid(),
            'since': datetime.now(timezone.utc).isoformat(timespec='seconds')}))
        file.flush()
        yield


def _holder(text: str) -> str:
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
                          if name not in (JOB_FILE, LOCK_FILE) and not name.startswith('.')):
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
