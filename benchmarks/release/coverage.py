# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines and branches that the tests execute, published in benchmarks/results/coverage.json.

Run by ``make coverage``, or ``python -m benchmarks.release.coverage [TEST ...]`` for a part, whose
figures are printed and not kept. Loops that Numba compiles are no lines that Python executes:
functions that it decorates are left out. Processes that tests start are counted, forks as well.
A run that was stopped goes on at the folder of tests where it was; what it has measured lies in
build/coverage until it ends.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / 'benchmarks' / 'results' / 'coverage.json'
WORK = ROOT / 'build' / 'coverage'
COUNTED = 'covered_lines', 'num_statements', 'covered_branches', 'num_branches'
SETTINGS = """\
[run]
branch = true
parallel = true
source = sar_imaging, msg_conversions
patch = subprocess, _exit
[report]
exclude_also =
    ^@.*jit
    ^@cfunc
    if TYPE_CHECKING:
    raise NotImplementedError
    \\.\\.\\.$
"""


def coverage(*words: object) -> int:
    """Run coverage on its data in build/coverage; returns its exit status."""
    environment = os.environ | {'COVERAGE_FILE': str(WORK / 'data'),
                                'COVERAGE_RCFILE': str(WORK / 'settings')}
    return subprocess.run([sys.executable, '-m', 'coverage', *words], cwd=ROOT,
                          env=environment).returncode


def execute(tests: list[str]) -> list[str]:
    """Run tests one by one, those left out that an earlier run has done; returns what failed."""
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / 'settings').write_text(SETTINGS)
    failed = []
    for test in tests:
        if not (done := WORK / f'done.{test.replace("/", ".")}').exists():
            print(f'{test} ...', flush=True)
            status = coverage('run', '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-n', '2',
                              '--dist', 'loadfile', test)
            coverage('combine', '--quiet', '--append')
            done.write_text(str(status))
        if done.read_text() not in ('0', '5'):  # 5: nothing to run
            failed.append(test)
    return failed


def shares(summary: dict) -> dict[str, float]:
    """Per cent of lines and of branches that were executed."""
    found = {'lines': (summary['covered_lines'], summary['num_statements']),
             'branches': (summary['covered_branches'], summary['num_branches'])}
    return {what: round(100 * done / of, 1) if of else 100.0 for what, (done, of) in found.items()}


def report() -> dict[str, dict[str, float]]:
    """Shares of all, and of each package."""
    coverage('json', '--quiet', '-o', WORK / 'report')
    found = json.loads((WORK / 'report').read_text())
    packages = defaultdict(lambda: defaultdict(int))
    for file, module in found['files'].items():
        parts = Path(file).parts[:-1]
        for what in COUNTED:
            packages['.'.join(parts[:2])][what] += module['summary'][what]
    return {'all': shares(found['totals'])} | {
        name: shares(summary) for name, summary in sorted(packages.items())}


def main() -> int:
    """Measure; fails with a test, and where all of them execute a point less than was reached."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('tests', nargs='*', help='files and folders; all by default')
    tests = parser.parse_args().tests
    every = sorted(f'test/{path.name}' for path in (ROOT / 'test').iterdir()
                   if path.name.startswith('test_') or any(path.glob('**/test_*')))
    failed = execute(tests or every)
    found = report()
    for name, share in found.items():
        print(f'{name:30} {share["lines"]:5} % of lines, {share["branches"]:5} % of branches')
    if failed:
        print('FAILED:', *failed)
    if tests:
        return len(failed)
    reached = json.loads(RESULTS.read_text()).get('all', {}) if RESULTS.exists() else {}
    RESULTS.write_text(json.dumps(found, indent=2) + '\n')
    shutil.rmtree(WORK)
    return len(failed) + any(share < reached.get(what, 0.0) - 1.0
                             for what, share in found['all'].items())


if __name__ == '__main__':
    raise SystemExit(main())
