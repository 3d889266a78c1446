# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Quick tests with every Python and NumPy that the package supports and that is here.

Run from the repository root: ``python -m benchmarks.release.matrix [TEST ...]``. Each pair has an
environment of its own in build/matrix, made on first use; results go to
benchmarks/results/matrix.json. What is not here is listed.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / 'benchmarks' / 'results' / 'matrix.json'
PYTHONS = '3.10', '3.11', '3.12', '3.13', '3.14'
#: The NumPy of Ubuntu 24.04, which no Python after 3.12 has, and the newest.
NUMPYS = {'1.26': 'numpy==1.26.4', '2': 'numpy>=2,<3'}
TESTS = ('test/msg_conversions', 'test/geometry', 'test/imaging/test_goldens.py',
         'test/test_package.py')


def interpreter(version: str) -> str | None:
    """Command of a Python that starts and has venv; None where there is none."""
    found = shutil.which(f'python{version}')
    if found is None:
        return None
    run = subprocess.run([found, '-c', 'import sys, venv, ensurepip; print(sys.version)'],
                         capture_output=True, text=True)
    return found if run.stdout.startswith(f'{version}.') else None


def environment(python: str, version: str, numpy: str) -> Path:
    """Python of an environment with the package's requirements and one NumPy."""
    folder = ROOT / 'build' / 'matrix' / f'{version}-numpy{numpy}'
    made = folder / 'bin' / 'python'
    if not (folder / 'ready').exists():
        subprocess.run([python, '-m', 'venv', '--clear', folder], check=True)
        subprocess.run([made, '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check',
                        '-r', ROOT / 'requirements.txt', NUMPYS[numpy]], check=True)
        (folder / 'ready').touch()
    return made


def main() -> int:
    """Test each pair; the exit status tells of failures, not of what is missing."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('tests', nargs='*', default=TESTS, help='files and folders')
    tests, results, failures = parser.parse_args().tests, {}, 0
    for version in PYTHONS:
        python = interpreter(version)
        for numpy in NUMPYS:
            name = f'Python {version}, NumPy {numpy}'
            if python is None:
                results[name] = 'not here'
            elif numpy == '1.26' and version in ('3.13', '3.14'):
                continue
            else:
                try:
                    made = environment(python, version, numpy)
                except subprocess.CalledProcessError as error:
                    results[name], failures = f'not installed: {error}', failures + 1
                else:
                    run = subprocess.run(  # -v takes back the -q of pyproject.toml
                        [made, '-m', 'pytest', '-v', '-p', 'no:cacheprovider', *tests],
                        cwd=ROOT, text=True, capture_output=True)
                    last = (run.stdout or run.stderr).strip().splitlines()[-1].strip('= ')
                    results[name] = last.split(' in ')[0]
                    failures += run.returncode != 0
            print(f'{name}: {results[name]}', flush=True)
            RESULTS.write_text(json.dumps(results, indent=2) + '\n')
    return failures


if __name__ == '__main__':
    raise SystemExit(main())
