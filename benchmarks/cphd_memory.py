# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A CPHD file larger than the memory: written as a stream, imaged under a limit of memory.

Run from the repository root: ``python -m benchmarks.cphd_memory``. It writes a file of 4 GB with
the simulator, images it in a process whose address space is limited to 2 GB, and once more with
all samples in memory, from the same blocks. Both images are compared to the bit.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

import numpy as np

from sar_imaging.formats.cphd import CphdReader, write_cphd
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.magnitudes import SPEED_OF_LIGHT
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'cphd_memory.json'
DATUM = Datum(47.0, 8.0, 450.0)
N_SAMPLES = 8192
RANGE_M, HEIGHT_M, APERTURE_M = 8000.0, 4000.0, 600.0
BLOCK_BYTES = 2**26  # of memory that a block may take
PULSES_PER_BLOCK = 64
POINTS_M = np.array([[0.0, 0.0, 0.0], [40.0, -25.0, 0.0], [-60.0, 55.0, 0.0]])
SPACING_M = 0.5


def scene(spacing_m: float = SPACING_M) -> MapGrid:
    """Map of the reflectors."""
    return MapGrid.from_size((0.0, 0.0, 0.0), 160.0, 160.0, spacing_m)


def flight(n_pulses: int, n_samples: int = N_SAMPLES) -> Iterator[PulseBlock]:
    """Blocks of a straight flight past three reflectors, simulated one after the other."""
    away = np.hypot(RANGE_M, HEIGHT_M)
    radar = RadarParameters(9.6e9, 300e6, 300e6, 2 * away / SPEED_OF_LIGHT,
                            waveform=Waveform.STEPPED_FREQUENCY)
    simulate = EchoSimulator(radar, n_samples, compressed=False, points_m=POINTS_M,
                             amplitudes=np.ones(len(POINTS_M)))
    for first in range(0, n_pulses, PULSES_PER_BLOCK):
        counter = np.arange(first, min(first + PULSES_PER_BLOCK, n_pulses))
        along = (counter / max(n_pulses - 1, 1) - 0.5) * APERTURE_M
        centres = np.stack([along, np.full(along.shape, -RANGE_M),
                            np.full(along.shape, HEIGHT_M)], axis=-1)[:, None]
        yield PulseBlock(radar, False, 1_700_000_000_000_000_000 + counter * 100_000, counter,
                         simulate(centres, centres), centres, centres, 'map')


def form_image(path: pathlib.Path, *, in_memory: bool, headroom: int | None = None,
               limit: int | None = None, block_bytes: int = BLOCK_BYTES,
               spacing_m: float = SPACING_M) -> dict:
    """Image a file; returns seconds, pulses, largest resident memory and a hash of the image.

    Parameters
    ----------
    path : Path
        CPHD file.
    in_memory : bool
        Read all blocks first.
    headroom : int, optional
        Bytes of address space beyond what is in use once kernels are compiled.
    limit : int, optional
        Bytes of address space altogether, from the beginning.
    block_bytes : int
        Memory that a block may take.
    spacing_m : float
        Of the pixels.
    """
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    with CphdReader(path, datum=DATUM) as reader:
        imager = plan_image(scene(spacing_m), reader.radar, reader.n_samples,
                            method='exact', compressed=reader.compressed)
        blocks = reader.blocks(memory_bytes=block_bytes)
        imager(next(blocks))  # compiles kernels
        if headroom is not None:
            used = int(pathlib.Path('/proc/self/statm').read_text().split()[0])
            most = used * resource.getpagesize() + headroom
            resource.setrlimit(resource.RLIMIT_AS, (most, most))
        blocks = reader.blocks(memory_bytes=block_bytes)
        if in_memory:
            blocks = list(blocks)
        image = imager.new_image()
        start = time.perf_counter()
        for block in blocks:
            imager.accumulate(block, image)
        seconds = time.perf_counter() - start
        return {'seconds': seconds, 'pulses': image.n_pulses,
                'resident_bytes': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
                'image': hashlib.sha256(image.samples.tobytes()).hexdigest(),
                'brightest': float(np.abs(image.samples).max())}


def run_apart(path: pathlib.Path, **options) -> dict:
    """`form_image` in a process of its own; raises `MemoryError` where it had too little."""
    words = [sys.executable, '-m', 'benchmarks.cphd_memory', 'image', str(path)]
    words += itertools.chain.from_iterable((f'--{name.replace("_", "-")}', str(value))
                                           for name, value in options.items())
    done = subprocess.run(words, capture_output=True, text=True, check=False,
                          cwd=pathlib.Path(__file__).parents[1])
    if 'MemoryError' in done.stderr:
        raise MemoryError(done.stderr.strip().splitlines()[-1])
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


def measure(folder: pathlib.Path, n_bytes: int, limit: int) -> dict:
    """Write a file, image it both ways, and compare."""
    n_pulses = n_bytes // (8 * N_SAMPLES)
    with tempfile.TemporaryDirectory(prefix='.cphd_memory.', dir=folder) as own:
        path = pathlib.Path(own) / 'scene.cphd'
        start = time.perf_counter()
        write_cphd(path, flight(n_pulses), DATUM, scene())
        written_s = time.perf_counter() - start
        size = path.stat().st_size
        print(f'{size / 1e9:.2f} GB written in {written_s:.0f} s', file=sys.stderr)
        streamed = run_apart(path, limit=limit)
        print(f'streamed: {streamed}', file=sys.stderr)
        in_memory = run_apart(path, in_memory=1)
        print(f'in memory: {in_memory}', file=sys.stderr)
    return {'machine': machine(), 'file_bytes': size, 'pulses': n_pulses,
            'samples': N_SAMPLES, 'pixels': list(scene().shape), 'limit_bytes': limit,
            'written_and_simulated_s': written_s,
            'equal_to_the_bit': streamed.pop('image') == in_memory.pop('image'),
            'streamed': streamed, 'in_memory': in_memory}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    commands = parser.add_subparsers(dest='command')
    image = commands.add_parser('image')
    image.add_argument('file', type=pathlib.Path)
    image.add_argument('--limit', type=int)
    image.add_argument('--headroom', type=int)
    image.add_argument('--in-memory', type=int, default=0)
    image.add_argument('--block-bytes', type=int, default=BLOCK_BYTES)
    image.add_argument('--spacing-m', type=float, default=SPACING_M)
    parser.add_argument('--bytes', type=float, default=4e9)
    parser.add_argument('--limit', type=float, default=2e9)
    parser.add_argument('--folder', type=pathlib.Path, default=pathlib.Path('out'),
                        help='for the file, which is removed at the end')
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    if arguments.command == 'image':
        print(json.dumps(form_image(
            arguments.file, in_memory=bool(arguments.in_memory), headroom=arguments.headroom,
            limit=arguments.limit, block_bytes=arguments.block_bytes,
            spacing_m=arguments.spacing_m)))
        return
    arguments.folder.mkdir(parents=True, exist_ok=True)
    results = measure(arguments.folder, int(arguments.bytes), int(arguments.limit))
    arguments.results.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
