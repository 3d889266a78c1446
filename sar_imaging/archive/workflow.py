# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""An archive from its job to its products: recordings scanned, work divided, pieces computed."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import sar_imaging

from .catalogue import write_archive_report, write_catalogue
from .cluster import open_cluster
from .division import PROCESS_BYTES, ArchivePlan, divide
from .files import write_rasters, write_sicd_image
from .images import form_image, sum_images
from .job import Job
from .pieces import Piece, PieceResult, ProductPiece, ScanPiece
from .recordings import find_recordings, scan_piece, with_datum
from .records import claim, held
from .runner import Loss, RunSummary, run_pieces
from .scans import (
    RecordingScan,
    ScanLoss,
    load_job,
    load_scan,
    remove_parts,
    write_scan,
    write_text,
)
from .tiles import coherence_tile, looks_tile

SUMMARY_FILE, PLAN_FILE = 'summary.json', 'plan.txt'
SCAN_SECONDS, SCAN_SECONDS_PER_BYTE = 0.04, 2e-9


@dataclasses.dataclass(frozen=True)
class _Opened:
    """A job whose output folder is held and whose workers are there."""

    job: Job
    client: object
    recordings: dict[str, Path]


def run_archive(job: Job, *, workers: int | None = None, scheduler: str | None = None,
                tell: Callable[[str], None] = print) -> RunSummary:
    """Image the recordings of an archive: all products of a job that are not there yet.

    Parameters
    ----------
    job : Job
        See `read_job`.
    workers : int, optional
        Processes of this machine; one for each core unless told.
    scheduler : str, optional
        Address of a running Dask cluster in their place, such as ``tcp://10.0.0.1:8786``.
    tell : callable
        Gets the plan and where the dashboard is, for people.

    Returns
    -------
    RunSummary
        Also written to ``summary.json``; its `exit_status` tells whether anything is lost.

    Raises
    ------
    JobError, ArchiveTooLargeError
        The job is wrong, or does not fit.
    OutputInUseError, OtherJobError
        The output folder is in use, or belongs to another job.
    ClusterError, MissingExtraError
        There are no workers that can do it.
    OSError
        The output folder cannot be written.

    Examples
    --------
    >>> from sar_imaging.archive import read_job, run_archive
    >>> with open('survey.yaml', 'w') as file:
    ...     _ = file.write('''
    ... recordings: bags/psf
    ... output: survey
    ... spacing_m: 0.5
    ... ''')
    >>> summary = run_archive(read_job('survey.yaml'), workers=1, tell=lambda text: None)
    >>> summary.exit_status, summary.losses
    (0, ())
    """
    with _opened(job, workers, scheduler, tell) as opened:
        summary, scans = _scan(opened)
        if summary.exit_status not in (0, 3):
            return _written(job.output, summary)
        plan = _divide(opened.job, scans, tell)
        summary += _run(opened, plan.pieces)
        if summary.exit_status in (0, 3):  # no piece is left at work
            remove_parts(job.output)
        return _written(job.output, summary)


def plan_archive(job: Job, *, workers: int | None = None, scheduler: str | None = None,
                 tell: Callable[[str], None] = print) -> tuple[ArchivePlan | None, RunSummary]:
    """Scan the recordings and tell what the job takes, without doing it.

    Parameters and errors are those of `run_archive`, which finds the scans again.

    Returns
    -------
    ArchivePlan or None
        None if the scans were stopped.
    RunSummary
        Of the scans.
    """
    with _opened(job, workers, scheduler, tell) as opened:
        summary, scans = _scan(opened)
        if summary.exit_status not in (0, 3):
            return None, summary
        return _divide(opened.job, scans, tell), summary


@contextlib.contextmanager
def _opened(job: Job, workers: int | None, scheduler: str | None, tell: Callable[[str], None]
            ) -> Iterator[_Opened]:
    recordings = find_recordings(job)
    job = with_datum(job, recordings)
    job.output.mkdir(parents=True, exist_ok=True)
    with held(job.output):
        claim(job)
        with open_cluster(job.output, scheduler=scheduler, workers=workers,
                          memory_bytes=int(job.memory_bytes)) as client:
            if client.dashboard_link:
                tell(f'dashboard: {client.dashboard_link}')
            yield _Opened(job, client, recordings)


def _run(opened: _Opened, pieces: Sequence[Piece]) -> RunSummary:
    return run_pieces(pieces, compute, opened.client, opened.job.output,
                      retries=opened.job.retries, memory_bytes=int(opened.job.memory_bytes),
                      may_lack=may_lack)


def _scan(opened: _Opened) -> tuple[RunSummary, list[RecordingScan]]:
    """Scan all recordings; what is lost of one is among the summary's losses."""
    output = opened.job.output
    names = {f'scan {name}': name for name in opened.recordings}
    pieces = [_scan_piece(key, name, opened.recordings[name]) for key, name in names.items()]
    summary = _run(opened, pieces)
    for loss in summary.losses:  # the report tells them
        name = names[loss.key]
        write_scan(output, RecordingScan(name, losses=(
            ScanLoss(name, opened.recordings[name], loss.reason),)))
    if summary.exit_status not in (0, 3):
        return summary, []
    scans = [load_scan(output, name) for name in opened.recordings]
    lost = {loss.key for loss in summary.losses}
    losses = [Loss(loss.name, loss.reason) for scan in scans if f'scan {scan.name}' not in lost
              for loss in scan.losses]
    return dataclasses.replace(summary, losses=(*summary.losses, *losses)), scans


def _scan_piece(key: str, name: str, path: Path) -> ScanPiece:
    files = [path] if path.is_file() else sorted(p for p in path.glob('*') if p.is_file())
    stats = [(file.name, os.stat(file)) for file in files]
    size = sum(stat.st_size for _, stat in stats)
    return ScanPiece(
        key=key, path=path.absolute(), recording=name,
        files=tuple((file, stat.st_size, stat.st_mtime_ns) for file, stat in stats),
        seconds=SCAN_SECONDS + SCAN_SECONDS_PER_BYTE * size, memory_bytes=int(PROCESS_BYTES),
        reads_bytes=size)


def _divide(job: Job, scans: list[RecordingScan], tell: Callable[[str], None]) -> ArchivePlan:
    plan = divide(job, [aperture for scan in scans for aperture in scan.apertures])
    write_text(job.output / PLAN_FILE, f'{plan}\n')
    tell(str(plan))
    return plan


def _written(output: Path, summary: RunSummary) -> RunSummary:
    told = {'version': sar_imaging.__version__, **summary.as_json()}
    write_text(output / SUMMARY_FILE, json.dumps(told, indent=1) + '\n')
    return summary


def _product(piece: ProductPiece, job: Job, output: Path) -> PieceResult:
    if piece.product == 'image sicd':
        return write_sicd_image(piece, job, output)
    if piece.product != 'catalogue':
        return write_rasters(piece, job, output)
    files = write_archive_report(output, job)
    told = write_catalogue(job, output)
    return dataclasses.replace(told, files=(*files, *told.files))


_WORK: dict[str, Callable[[Any, Job, Path], PieceResult]] = {
    'scan': scan_piece, 'image': form_image, 'sum': sum_images, 'strip': looks_tile,
    'mosaic': looks_tile, 'coherence': coherence_tile, 'product': _product}


def compute(piece: Piece, output: Path) -> PieceResult:
    """Compute a piece and write what it makes.

    Parameters
    ----------
    piece : Piece
        Piece of any kind.
    output : Path
        Folder of the job, with ``job.json`` and the scans.

    Returns
    -------
    PieceResult

    Raises
    ------
    ArchiveDataError
        The data are bad; trying again does not help.
    MemoryError
        The piece does not fit.
    OSError
        The disk is full, or something cannot be read.
    """
    return _WORK[piece.KIND](piece, load_job(output), output)


def may_lack(piece: Piece, lost: Sequence[str]) -> bool:
    """Whether a piece is computed without some of what it needs.

    Strips, mosaics and their files are made of what is there; the catalogue and the report tell
    what is not. An image, its files and a coherence need all their parts.
    """
    if isinstance(piece, ProductPiece):
        if piece.product == 'catalogue':
            return True
        return not piece.product.startswith('image ') and len(lost) < len(set(piece.needs))
    return piece.KIND in ('strip', 'mosaic') and len(lost) < len(set(piece.needs))
