# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Times, growth laws and peak memory, measured alike by all benchmarks."""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import json
import pathlib
import subprocess
import sys
import time
from collections.abc import Callable, Mapping

import numba
import numpy as np

from .scenes import Case

ENOUGH_SECONDS = 4.0


def best_seconds(calls: Mapping[str, Callable[[], object]], *, rounds: int) -> dict[str, float]:
    """Shortest time of each call; the calls take turns.

    Other work on the machine can only slow a call down. Short calls get more than `rounds`
    turns, as long as all turns together stay below some seconds.
    """
    best = dict.fromkeys(calls, np.inf)
    begun = time.perf_counter()
    while rounds > 0 or time.perf_counter() - begun < ENOUGH_SECONDS:
        rounds -= 1
        for name, call in calls.items():
            started = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - started)
    return best


def fitted_exponent(work, seconds) -> float:
    """Slope of the straight line through the logarithms: b of ``seconds = a work^b``."""
    return round(float(np.polyfit(np.log(work), np.log(seconds), 1)[0]), 3)


def peak_memory(module: str, case: Case) -> dict:
    """What `report_peak` prints in a fresh process that runs ``python -m module --memory``."""
    run = subprocess.run([sys.executable, '-m', module, '--memory',
                          json.dumps(dataclasses.asdict(case))], check=True,
                         stdout=subprocess.PIPE)
    return json.loads(run.stdout)


def report_peak(call: Callable[[], np.ndarray], extra: Mapping[str, float]) -> None:
    """Print as JSON what a second call needs beyond the memory in use before it, MiB (Linux).

    The first call compiles, loads and caches. The output of the call counts as needed.
    """
    call()
    ctypes.CDLL(None).malloc_trim(0)  # freed memory that lingers would hide what is needed
    pathlib.Path('/proc/self/clear_refs').write_text('5')  # forget the peak so far
    before = _status_mib('VmRSS')
    image = call()
    print(json.dumps({'peak_mib': round(_status_mib('VmHWM') - before, 1),
                      'output_mib': round(np.asarray(image).nbytes / 2**20, 1), **extra}))


def _status_mib(field: str) -> float:
    for line in pathlib.Path('/proc/self/status').read_text().splitlines():
        if line.startswith(field + ':'):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f'/proc/self/status has no {field}; memory is measured on Linux only')


def parse_arguments(description: str, results: pathlib.Path, threads: int) -> argparse.Namespace:
    """Command line shared by the benchmarks of imagers; also sets Numba's number of threads."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--output', type=pathlib.Path, default=results)
    parser.add_argument('--largest', type=int, default=10**9, metavar='N',
                        help='leave out images of more than N x N pixels')
    parser.add_argument('--memory', type=lambda text: Case(**json.loads(text)), metavar='CASE',
                        help='print the peak memory of one case, used in a process of its own')
    numba.set_num_threads(threads)
    return parser.parse_args()
