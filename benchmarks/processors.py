# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP with the code of several processors, and with SciPy's Fourier transforms for its own.

Run from the repository root::

    python -m benchmarks.processors
    python -m benchmarks.processors --rounding

With ``--rounding`` images by either transforms are compared with the same image by transforms in
float64. One thread, time of the process, from the phase history to the map; 10 GHz, 600 MHz,
10 km, as many pulses as the side of the map has pixels. Code for another processor runs on this
one, whose caches and pipelines it has: read what vectors and registers do, not how quick that
processor is.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
import scipy.fft
from tqdm import tqdm

from sar_imaging.backends.cpu import fft
from sar_imaging.backends.cpu.fft import LANES, OWN, SCIPY, VARIABLE
from sar_imaging.imaging.imager import Imager, plan_image
from sar_imaging.signal.pulses import PulseBlock

from .goldens import difference_db
from .support.machine import machine
from .support.scenes import Case, phase_history

RESULTS = pathlib.Path(__file__).parent / 'results' / 'processors.json'
TARGET_DB = -56.0
ROUNDS = 9
SIDES = (2048, 4096)
# Empty features: Numba would use what this processor has beyond the named one.
PROCESSORS = {'this': {}, 'haswell': {'NUMBA_CPU_NAME': 'haswell', 'NUMBA_CPU_FEATURES': ''},
              'generic': {'NUMBA_CPU_NAME': 'generic', 'NUMBA_CPU_FEATURES': ''}}


def planned(side: int) -> tuple[Imager, PulseBlock]:
    """Imager of the case, and its phase history."""
    case = Case(10e3, side, side, 1, 0.125)
    block = phase_history(case)
    return plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                      method='afbp', compressed=False, target_db=TARGET_DB), block


def transform_in_float64(data: np.ndarray, axis: int, *, inverse: bool) -> None:
    """As `fft.choice.transform_by_scipy`, rounded once."""
    transform, norm = (scipy.fft.ifft, 'forward') if inverse else (scipy.fft.fft, 'backward')
    for some in np.array_split(np.moveaxis(data, axis, 0), 16, axis=1):  # views of the data
        some[:] = transform(some.astype(np.complex128), axis=0, norm=norm)


def measure_rounding() -> None:
    """Print how far images by either transforms are from one by transforms in float64."""
    float32 = fft.transform_by_scipy
    for side in SIDES:
        images = {}
        for name in (OWN, SCIPY, 'float64'):
            os.environ[VARIABLE] = OWN if name == OWN else SCIPY
            transform = transform_in_float64 if name == 'float64' else float32
            fft.transform_by_scipy = transform
            imager, block = planned(side)
            images[name] = imager(block).samples
        print(side, {name: round(difference_db(images[name], images['float64']), 1)
                     for name in (OWN, SCIPY)},
              'apart', round(difference_db(images[SCIPY], images[OWN]), 1))


def measure(side: int, image: str) -> None:
    """Form an image in this process, keep it, and print its time as JSON."""
    plan, block = planned(side)
    np.save(image, plan(block).samples)  # compiles
    seconds = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        plan(block)
        seconds.append(time.process_time() - begin)
    print(json.dumps({'seconds': round(min(seconds), 4), 'lanes': LANES}))


def main() -> None:
    """Measure all processors, or one in this process."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--measure', nargs=2, metavar=('SIDE', 'IMAGE'), help=argparse.SUPPRESS)
    parser.add_argument('--rounding', action='store_true')
    arguments = parser.parse_args()
    if arguments.rounding:
        measure_rounding()
        return
    if arguments.measure:
        measure(int(arguments.measure[0]), arguments.measure[1])
        return
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        image, first = f'{folder}/image.npy', {}
        variants = [(side, processor, transforms) for side in SIDES
                    for processor in PROCESSORS for transforms in (OWN, SCIPY)]
        for side, processor, transforms in tqdm(variants):
            run = subprocess.run(
                [sys.executable, '-m', 'benchmarks.processors', '--measure', str(side), image],
                env=os.environ | PROCESSORS[processor] | {VARIABLE: transforms,
                                                          'NUMBA_NUM_THREADS': '1'},
                check=True, stdout=subprocess.PIPE)
            found = np.load(image)
            difference = difference_db(found, first.setdefault(side, found))
            rows.append({'side': side, 'processor': processor, 'transforms': transforms}
                        | json.loads(run.stdout)
                        | {'difference_db': round(difference, 1) if difference > -1e3 else None})
            print(rows[-1])
    arguments.output.write_text(json.dumps({'machine': machine(), 'rows': rows}, indent=1) + '\n')


if __name__ == '__main__':
    main()
