# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A mosaic of a gigapixel from an archive larger than the memory of a worker.

Run from the repository root: ``python -m benchmarks.archive``. It simulates an archive of 4 GB of
samples, images it to a mosaic of 1.1 Gpixel with two workers of 2 GB (`sar-imaging archive`), and
compares random pixels of the mosaic with correlation from the recordings. Fifteen minutes on two
cores; ``--recordings 4 --lines 2 --pixels 1024`` for a minute.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys
import time

import numpy as np

from sar_imaging.archive.provenance import check_mosaic
from sar_imaging.archive.scans import load_scans
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.simulate_archive import TRUTH_FILE, write_archive

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'archive.json'
TARGET_DB = -50.0


def simulate(folder: pathlib.Path, survey: Survey) -> dict:
    """Write the recordings, unless they are there already."""
    start = time.perf_counter()
    if not (folder / TRUTH_FILE).exists():
        write_archive(survey, folder, progress=True)
    size = sum(path.stat().st_size for path in folder.rglob('*') if path.is_file())
    return {'recordings': survey.n_recordings, 'samples_bytes': survey.n_bytes,
            'files_bytes': size, 'pulses': survey.pulses_per_aperture * survey.n_recordings,
            'pixels_of_an_image': survey.pixels**2,
            'simulated_s': round(time.perf_counter() - start, 1)}


def image_archive(folder: pathlib.Path, output: pathlib.Path, spacing_m: float, *,
                  memory_gb: float, workers: int, tile: int) -> dict:
    """Run `sar-imaging archive`, and what its summary says."""
    job = output.with_suffix('.yaml')
    job.write_text(f'recordings: {folder.resolve()}\noutput: {output.resolve()}\n'
                   f'spacing_m: {spacing_m}\ntarget_db: {TARGET_DB}\ntile: {tile}\n'
                   f'memory_gb: {memory_gb}\nproducts:\n  mosaic: true\n')
    shutil.rmtree(output, ignore_errors=True)
    start = time.perf_counter()
    subprocess.run([sys.executable, '-m', 'sar_imaging.tools.command', 'archive', str(job),
                    '--workers', str(workers)], check=True)
    seconds = time.perf_counter() - start
    summary = json.loads((output / 'summary.json').read_text())
    kinds: dict[str, list[float]] = {}
    for path in (output / 'records').rglob('*.json'):
        record = json.loads(path.read_text())
        kind = re.match(r'\w+', record['key']).group()
        kinds.setdefault(kind, []).append(record['seconds'])
    return {'seconds': round(seconds, 1), 'workers': workers, 'memory_bytes': memory_gb * 1e9,
            'pieces': summary['n_pieces'], 'lost': len(summary['losses']),
            'computing_s': round(summary['computing_seconds'], 1),
            'peak_bytes': summary['peak_bytes'], 'peak_piece': summary['peak_key'],
            'pieces_s': {kind: {'n': len(values), 'total': round(sum(values), 1),
                                'longest': round(max(values), 2)}
                         for kind, values in sorted(kinds.items())}}


def check(output: pathlib.Path, n_pixels: int) -> dict:
    """Random pixels of the mosaic against correlation."""
    start = time.perf_counter()
    found = check_mosaic(output, n_pixels)
    scans = [scan for recording in load_scans(output) for scan in recording.apertures]
    with np.load(output / scans[0].centres) as file:
        pulses = len(file['counter'])
    return {'pixels': len(found.row), 'error_db': round(found.error_db, 2),
            'looks_agree': bool((found.looks == found.reference_looks).all()),
            'wanted_db': TARGET_DB, 'pulses_of_an_aperture': pulses,
            'seconds': round(time.perf_counter() - start, 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--recordings', type=int, default=64)
    parser.add_argument('--lines', type=int, default=8)
    parser.add_argument('--pixels', type=int, default=4608)
    parser.add_argument('--memory', type=float, default=2.0, help='of a worker, GB')
    parser.add_argument('--workers', type=int, default=2)
    parser.add_argument('--tile', type=int, default=2048)
    parser.add_argument('--checked', type=int, default=100, help='pixels of the mosaic')
    parser.add_argument('--folder', type=pathlib.Path, default=pathlib.Path('out/archive'))
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--only-simulate', action='store_true')
    a = parser.parse_args()
    survey = Survey(n_recordings=a.recordings, lines=a.lines, pixels=a.pixels, overlap=0.1,
                    reflectors=20, clutter=0)
    a.folder.mkdir(parents=True, exist_ok=True)
    recordings, output = a.folder / 'recordings', a.folder / 'results'
    found = {'machine': machine(), 'archive': simulate(recordings, survey)}
    if a.only_simulate:
        return
    spacing = survey.spacing_m
    found['archive_run'] = run = image_archive(recordings, output, spacing, memory_gb=a.memory,
                                               workers=a.workers, tile=a.tile)
    work = survey.n_recordings * survey.pixels**2 * survey.pulses_per_aperture
    run['gigapixel_pulses_per_s'] = round(work / run['seconds'] / 1e9, 1)
    found['plan'] = (output / 'plan.txt').read_text().splitlines()
    _write(a.results, found)
    found['mosaic'] = check(output, a.checked)
    _write(a.results, found)
    print(json.dumps(found, indent=1))


def _write(path: pathlib.Path, found: dict) -> None:
    path.write_text(json.dumps(found, indent=1) + '\n')


if __name__ == '__main__':
    main()
