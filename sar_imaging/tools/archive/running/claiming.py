"""An output folder belongs to one job: another one is refused, and told what differs."""

from __future__ import annotations

import json
import os
from pathlib import Path

from sar_imaging.files import told

from ..jobs.job import Job
from ..jobs.stored import JOB_FILE, write_job
from .locking import NAME as LOCK_FILE


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
