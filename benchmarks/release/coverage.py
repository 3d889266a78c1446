# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines and branches that the tests execute, published in benchmarks/results/coverage.json.

Run by ``make coverage``, or ``python -m benchmarks.release.coverage [TEST ...]`` for a part, whose
figures are printed and not kept. Loops that Numba compiles are no lines that Python executes:
functions that it decorates are left out. Processes that tests start are counted.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / 'benchmarks' / 'results' / 'coverage.json'
SETTINGS = """\
[run]
branch = true
parallel = true
source = sar_imaging, msg_conversions
patch = subprocess
[report]
exclude_also =
    ^@.*jit
    ^@cfunc
    if TYPE_CHECKING:
    raise NotImplementedError
    \\.\\.\\.$
"""


def measure(tests: list[str], folder: Path) -> dict[str, float]:
    """Shares of lines and of branches that tests execute, in per cent."""
    settings = folder / 'settings'
    settings.write_text(SETTINGS)
    environment = os.environ | {'COVERAGE_FILE': str(folder / 'data'),
                                'COVERAGE_RCFILE': str(settings)}

    def coverage(*words):
        return subprocess.run([sys.executable, '-m', 'coverage', *words], cwd=ROOT,
                              env=environment)

    coverage('run', '-m', 'pytest', '-q', '-p', 'no:cacheprovider', *tests)
    coverage('combine', '--quiet')
    coverage('json', '--quiet', '-o', str(folder / 'report'))
    totals = json.loads((folder / 'report').read_text())['totals']
    return {'lines': 100 * totals['covered_lines'] / totals['num_statements'],
            'branches': 100 * totals['covered_branches'] / totals['num_branches']}


def main() -> int:
    """Measure; fails where all tests execute a point less than what was reached."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('tests', nargs='*', help='files and folders; all by default')
    tests = parser.parse_args().tests
    with tempfile.TemporaryDirectory() as folder:
        found = measure(tests, Path(folder))
    print(', '.join(f'{share:.1f} % of {what}' for what, share in found.items()))
    if tests:
        return 0
    reached = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    RESULTS.write_text(json.dumps({what: round(share, 1) for what, share in found.items()},
                                  indent=2) + '\n')
    return any(share < reached.get(what, 0.0) - 1.0 for what, share in found.items())


if __name__ == '__main__':
    raise SystemExit(main())
