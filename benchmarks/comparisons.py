# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Six cases beside FastSAR 0.1.8, in minutes: the table of docs/comparisons.md on this machine.

Run from the repository root in an environment that has FastSAR
(`benchmarks.support.fastsar_imagers` shows how to make one)::

    build/fastsar/bin/python -m benchmarks.comparisons exact
    build/fastsar/bin/python -m benchmarks.comparisons fast

Exact images take one thread, fast ones two. The campaigns with all cases are
`benchmarks.backprojection` and `benchmarks.afbp`.
"""

from __future__ import annotations

import datetime
import importlib
import json
import pathlib
import sys

import numba

from .support.machine import machine
from .support.scenes import Case

RESULTS = pathlib.Path(__file__).parent / 'results' / 'comparisons.json'
CASES = {'exact': (Case(1e4, 1024, 256, 1, 0.25), Case(1e4, 1024, 52, 5, 0.25),
                   Case(1e4, 1024, 2048, 1, 0.25), Case(100, 1024, 256, 1, 0.05)),
         'fast': (Case(1e3, 1024, 1024, 1, 0.125), Case(1e4, 4096, 4096, 1, 0.25))}


def main() -> None:
    """Measure one kind of images; those of the other kind are kept."""
    kind = sys.argv[1]
    # each sets the threads of FastSAR before it loads it
    module, name, threads = {'exact': ('backprojection', 'measure', 1),
                             'fast': ('afbp', 'compare_fastsar', 2)}[kind]
    measure = getattr(importlib.import_module(f'.{module}', __package__), name)
    numba.set_num_threads(threads)
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    results[kind] = {'machine': machine(), 'threads': threads,
                     'date': str(datetime.date.today()), 'cases': []}
    for case in CASES[kind]:
        results[kind]['cases'].append(measure(case))
        print(json.dumps(results[kind]['cases'][-1]), flush=True)
        RESULTS.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
