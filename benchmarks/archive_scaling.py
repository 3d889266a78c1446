# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Archives on more workers: overhead of a piece, one and two workers, and up to 64 simulated ones.

Run from the repository root: ``python -m benchmarks.archive_scaling``. A simulated archive is
imaged by one worker and by two. The times of its pieces, repeated for many such archives, are
then slept by workers in one process, so that Dask's own scheduler and this package's runner have
as much to do as with 64 cores.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import pathlib
import shutil
import sys
import time

from sar_imaging.archive.cluster import dask, open_cluster
from sar_imaging.archive.division import divide
from sar_imaging.archive.job import Job, Products
from sar_imaging.archive.pieces import Piece
from sar_imaging.archive.records import Records
from sar_imaging.archive.runner import run_pieces
from sar_imaging.archive.scans import load_scans
from sar_imaging.archive.workflow import run_archive
from sar_imaging.tools import simulate_archive

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'archive_scaling.json'
SIMULATED = (8, 16, 32, 64)
OVERHEAD_PIECES, OVERHEAD_SECONDS = 30, 1.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sleeper(Piece):
    """A piece that takes its time without a core."""

    KIND = 'sleep'


@dataclasses.dataclass(frozen=True, kw_only=True)
class Worker(Sleeper):
    """A piece that keeps a core busy for its seconds."""

    KIND = 'work'


def sleep(piece: Piece, output: pathlib.Path) -> dict:
    """What a `Sleeper` and a `Worker` do."""
    end = time.perf_counter() + piece.seconds
    if isinstance(piece, Worker):
        while time.perf_counter() < end:
            pass
    else:
        time.sleep(piece.seconds)
    return {}


def simulated_archive(folder: pathlib.Path, recordings: int, pixels: int, *, passes: int = 1,
                      channels: int = 1) -> pathlib.Path:
    """Folder of recordings, simulated unless it is there."""
    if not folder.exists():
        simulate_archive.main([
            '--output', str(folder), '--recordings', str(recordings), '--pixels', str(pixels),
            '--passes', str(passes), '--channels', str(channels), '--broken', '0',
            '--clutter', '0', '--reflectors', '2'])
    return folder


def overhead(folder: pathlib.Path) -> dict:
    """Seconds that a piece costs beside its work, of one worker."""
    pieces = [Worker(key=f'work {i}', seconds=OVERHEAD_SECONDS) for i in range(OVERHEAD_PIECES)]
    with open_cluster(folder, workers=1) as client:
        run_pieces([Worker(key='first')], sleep, client, folder)
        summary = run_pieces(pieces, sleep, client, folder)
    beside = (summary.seconds - summary.computing_seconds) / OVERHEAD_PIECES
    return {'pieces': OVERHEAD_PIECES, 'seconds_of_a_piece': OVERHEAD_SECONDS,
            'overhead_s': round(beside, 5), 'share': round(beside / OVERHEAD_SECONDS, 5)}


def real(flights: pathlib.Path, folder: pathlib.Path, workers: int) -> dict:
    """Image the archive with some workers; the pieces' times come from their records."""
    shutil.rmtree(folder, ignore_errors=True)
    job = Job(recordings=(str(flights),), output=folder, spacing_m=0.25, tile=1024,
              method='exact', products=Products(mosaic=True), checked_pixels=0)
    with contextlib.redirect_stdout(sys.stderr):
        summary = run_archive(job, workers=workers)
    if summary.exit_status:
        raise SystemExit(summary.told(folder))
    return {'workers': workers, 'pieces': summary.n_pieces, 'seconds': round(summary.seconds, 2),
            'core_seconds': round(summary.computing_seconds, 2),
            'busy': round(summary.computing_seconds / (workers * summary.seconds), 4),
            'peak_gb': round(summary.peak_bytes / 1e9, 3)}


def measured_pieces(folder: pathlib.Path, copies: int) -> list[Sleeper]:
    """The pieces of an archive that was imaged, with their measured times, some times over."""
    from sar_imaging.archive.scans import load_job
    job, records = load_job(folder), Records(folder)
    plan = divide(job, [a for scan in load_scans(folder) for a in scan.apertures])
    seconds = {p.key: json.loads(records.path(p.key).read_text())['seconds'] for p in plan.pieces}
    return [Sleeper(key=f'{piece.key} of {copy}', seconds=seconds[piece.key],
                    needs=tuple(f'{key} of {copy}' for key in piece.needs),
                    reads_bytes=piece.reads_bytes, writes_bytes=piece.writes_bytes)
            for copy in range(copies) for piece in plan.pieces]


def simulated(pieces: list[Sleeper], workers: int, folder: pathlib.Path) -> dict:
    """Run the pieces on workers that share this process and only wait."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    distributed = dask()
    with distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=False, memory_limit=0,
            dashboard_address=None, silence_logs=50) as cluster, \
            distributed.Client(cluster, set_as_default=False) as client:
        summary = run_pieces(pieces, sleep, client, folder)
    total = sum(piece.seconds for piece in pieces)
    traffic = sum(piece.reads_bytes + piece.writes_bytes for piece in pieces)
    return {'workers': workers, 'pieces': len(pieces), 'seconds': round(summary.seconds, 2),
            'core_seconds': round(total, 2),
            'efficiency': round(total / workers / summary.seconds, 4),
            'pieces_per_second': round(len(pieces) / summary.seconds, 1),
            'disk_mb_per_s': round(traffic / summary.seconds / 1e6, 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--folder', type=pathlib.Path, default=pathlib.Path('out/archive_scaling'))
    parser.add_argument('--recordings', type=int, default=48, help='of all passes')
    parser.add_argument('--pixels', type=int, default=1600)
    # several channels and passes: the file of the mosaic, one piece, is then a small part
    parser.add_argument('--passes', type=int, default=8)
    parser.add_argument('--channels', type=int, default=8)
    parser.add_argument('--copies', type=int, default=3)
    arguments = parser.parse_args()
    folder = arguments.folder.absolute()
    folder.mkdir(exist_ok=True, parents=True)
    flights = simulated_archive(folder / 'flights', arguments.recordings, arguments.pixels,
                                passes=arguments.passes, channels=arguments.channels)
    few = simulated_archive(folder / 'few', 4, 400)
    results = {'machine': machine(), 'load_before': os.getloadavg()[0]}
    results['overhead'] = overhead(folder)
    real(few, folder / 'of-few', 2)  # compiles the kernels
    results['real'] = [real(flights, folder / f'with-{n}', n) for n in (1, 2)]
    one, two = (run['seconds'] for run in results['real'])
    results['efficiency_of_two'] = round(one / (2 * two), 4)
    results['load_after'] = os.getloadavg()[0]
    pieces = measured_pieces(folder / 'with-1', arguments.copies)
    results['simulated'] = [simulated(pieces, n, folder / f'simulated-{n}') for n in SIMULATED]
    RESULTS.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
