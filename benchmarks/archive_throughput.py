# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""An archive beside its recordings imaged one after the other, and beside FastSAR in a `dask.bag`.

Run from the repository root: ``python -m benchmarks.archive_throughput``, with the Python of
`support.fastsar_imagers` for FastSAR, which needs JAX for its factorised images. Each way runs as
a program of its own, in turns. Times of processes say more than those of the clock where a
machine has other work.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import pathlib
import resource
import shutil
import statistics
import subprocess
import sys
import time

import numpy as np

from sar_imaging.configuration.scene_grid import GridChoice
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import open_pulses
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.products import forming
from sar_imaging.tools.simulate_archive import TRUTH_FILE, write_archive

from .support import fastsar_archive
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'archive_throughput.json'
TARGET_DB = -50.0
WORKERS = 2


def recordings(folder: pathlib.Path) -> list[str]:
    """Paths of the recordings of an archive."""
    return sorted(str(path) for path in folder.iterdir() if path.is_dir())


def in_turn(folder: pathlib.Path, output: pathlib.Path, spacing_m: float) -> None:
    """Image recordings one after the other in this process, images kept in files.

    As `sar-imaging image` does it, with all cores.
    """
    for path in recordings(folder):
        source = open_pulses(pathlib.Path(path))
        size = np.ptp(source.area_m, axis=0)
        grid = MapGrid.from_size(tuple(source.area_m.mean(axis=0)), size[0], size[1], spacing_m)
        image, _ = forming.form(source, GridChoice(grid, 'ground', 0, 0, ()), TARGET_DB, 2e9)
        np.save(output / f'{pathlib.Path(path).name}.npy', image.samples)


def archive(folder: pathlib.Path, output: pathlib.Path, spacing_m: float) -> None:
    """The same images by `sar-imaging archive`, without anything made of them."""
    job = output.with_suffix('.yaml')
    job.write_text(f'recordings: {folder.resolve()}\noutput: {output.resolve()}\n'
                   f'spacing_m: {spacing_m}\ntarget_db: {TARGET_DB}\nchecked_pixels: 0\n'
                   'products: {mosaic: false}\n')
    subprocess.run([sys.executable, '-m', 'sar_imaging.tools.command', 'archive', str(job),
                    '--workers', str(WORKERS)], check=True, stdout=sys.stderr)


def fastsar(kind: str):
    """FastSAR's images of one kind."""
    def run(folder: pathlib.Path, output: pathlib.Path, spacing_m: float) -> None:
        fastsar_archive.image_in_bag(recordings(folder), output, spacing_m, WORKERS, kind)
    return run


WAYS = {'archive': archive, 'in_turn': in_turn,
        **{f'fastsar_{kind}': fastsar(kind) for kind in fastsar_archive.KINDS}}


def timed(way: str, folder: pathlib.Path, output: pathlib.Path, spacing_m: float) -> dict:
    """Seconds on the clock and of all processes, of a way in a process of its own."""
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    load, before, start = os.getloadavg()[0], _children_s(), time.perf_counter()
    subprocess.run([sys.executable, '-m', 'benchmarks.archive_throughput', '--call', way,
                    str(folder), str(output), str(spacing_m)], check=True, stdout=sys.stderr)
    return {'seconds': round(time.perf_counter() - start, 1),
            'process_seconds': round(_children_s() - before, 1), 'load_before': round(load, 1)}


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(arguments: argparse.Namespace) -> dict:
    """All ways in turns, several times."""
    survey = Survey(n_recordings=arguments.recordings, pixels=arguments.pixels, clutter=0,
                    reflectors=20, overlap=0.1)
    folder = arguments.folder / 'recordings'
    if not (folder / TRUTH_FILE).exists():
        write_archive(survey, folder, progress=True)
    ways = [way for way in WAYS if not way.startswith('fastsar')
            or importlib.util.find_spec('fastsar')]
    found = {'machine': machine(), 'recordings': survey.n_recordings,
             'pixels': survey.pixels**2, 'pulses': survey.pulses_per_aperture,
             'samples_bytes': survey.n_bytes, 'workers': WORKERS, 'target_db': TARGET_DB,
             'runs': {way: [] for way in ways}}
    for _ in range(arguments.rounds):
        for way in ways:
            found['runs'][way].append(timed(way, folder, arguments.folder / way,
                                            survey.spacing_m))
            print(way, found['runs'][way][-1], file=sys.stderr, flush=True)
            compare(found)
            arguments.results.write_text(json.dumps(found, indent=1) + '\n')
    found['fastsar_error_db'] = {
        kind: round(fastsar_archive.error_db(recordings(folder)[0], survey.spacing_m, kind), 1)
        for kind in fastsar_archive.KINDS if f'fastsar_{kind}' in ways}
    return found


def compare(found: dict) -> None:
    """Add medians and what they are beside those of the archive."""
    work = found['recordings'] * found['pixels'] * found['pulses'] / 1e9
    middle = {way: {name: statistics.median(run[name] for run in runs)
                    for name in ('seconds', 'process_seconds')}
              for way, runs in found['runs'].items() if runs}
    found['median'] = {way: times | {'gigapixel_pulses_per_s': round(work / times['seconds'], 2)}
                       for way, times in middle.items()}
    found['archive_beside'] = {
        way: {name: round(times[name] / middle['archive'][name], 2) for name in times}
        for way, times in middle.items() if way != 'archive'}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--recordings', type=int, default=16)
    parser.add_argument('--pixels', type=int, default=4096)
    parser.add_argument('--rounds', type=int, default=2)
    parser.add_argument('--folder', type=pathlib.Path,
                        default=pathlib.Path('out/archive_throughput'))
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--call', nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.call:
        way, folder, output, spacing = arguments.call
        WAYS[way](pathlib.Path(folder), pathlib.Path(output), float(spacing))
        return
    arguments.folder.mkdir(parents=True, exist_ok=True)
    found = measure(arguments)
    arguments.results.write_text(json.dumps(found, indent=1) + '\n')
    print(json.dumps(found, indent=1))


if __name__ == '__main__':
    main()
