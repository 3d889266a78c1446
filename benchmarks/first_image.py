# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time from starting Python to the first image, with an empty cache of compiled kernels and after.

Each run is a process of its own, with a cache of its own; its second image is formed by another
process with the same cache. Run from the repository root; another checkout is measured in turn
with this one, such as a worktree of the version before::

    python -m benchmarks.first_image
    python -m benchmarks.first_image --before ../other_checkout
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'first_image.json'
METHODS = 'exact', 'afbp'
_PROGRAM = """
import sys
from sar_imaging import RangeCompressor, concatenate, plan_image
from sar_imaging.simulation.scenarios import SCENARIOS
scenario = SCENARIOS['spotlight']()
raw = concatenate(list(scenario.blocks())).select(slice(0, scenario.pulses_per_aperture))
profiles = RangeCompressor.for_block(raw)(raw)
plan_image(scenario.grid, profiles.radar, profiles.n_samples, profiles.tx_m, profiles.rx_m,
           method=sys.argv[1])(profiles)
"""


def timed(root: pathlib.Path, method: str, cache: str) -> tuple[float, float]:
    """Seconds of the clock and of the processors of one process that forms an image."""
    environment = os.environ | {'NUMBA_CACHE_DIR': cache, 'PYTHONPATH': str(root)}
    used, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([sys.executable, '-c', _PROGRAM, method], cwd=root, env=environment,
                   check=True, stderr=subprocess.DEVNULL)
    seconds, after = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime


def measured(roots: dict[str, pathlib.Path], runs: int) -> dict:
    """Medians and extremes of each version and method, one version after the other in each run."""
    times: dict[tuple[str, str, str], list] = {}
    for number in range(runs):
        for method in METHODS:
            for version, root in roots.items():
                with tempfile.TemporaryDirectory() as cache:
                    for which in ('first', 'cached'):
                        times.setdefault((version, method, which), []).append(
                            timed(root, method, cache))
                print(number, method, version, times[version, method, 'first'][-1], flush=True)
    return {version: {method: {which: {
        name: {'median': round(statistics.median(v), 2), 'least': round(min(v), 2),
               'most': round(max(v), 2)}
        for name, v in zip(('wall_s', 'processor_s'),
                           zip(*times[version, method, which], strict=True), strict=True)}
        for which in ('first', 'cached')} for method in METHODS} for version in roots}


def main() -> None:
    """Measure this checkout and perhaps another one, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--before', type=pathlib.Path, help='checkout of another version')
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    roots = {} if arguments.before is None else {'before': arguments.before.resolve()}
    roots['now'] = pathlib.Path(__file__).resolve().parents[1]
    load = round(os.getloadavg()[0], 1)
    results = {'machine': machine(), 'load_at_begin': load, 'runs': arguments.runs,
               **measured(roots, arguments.runs)}
    arguments.results.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
