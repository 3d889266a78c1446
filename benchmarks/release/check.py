# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The parts of `make release-check` that are no tests: types, keys, Debian package, container.

Run from the repository root: ``python -m benchmarks.release.check [--rosdistro CHECKOUT]``. What
this machine cannot run is listed with what it would need.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

TYPED_NUMPY = '2.4'  # as of the Makefile
ROOT = Path(__file__).resolve().parents[2]


def _docker_works() -> bool:
    return shutil.which('docker') is not None and subprocess.run(
        ['docker', 'info'], capture_output=True).returncode == 0


def main() -> int:
    """Run what this machine can; the exit status tells of failures alone."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--rosdistro', type=Path, help='checkout of github.com/ros/rosdistro')
    database = parser.parse_args().rosdistro
    module = [sys.executable, '-m']
    parts = {
        'types': (
            importlib.util.find_spec('mypy') and np.__version__.startswith(TYPED_NUMPY)
            and [*module, 'benchmarks.release.stated_types'],
            f'mypy (make lint-libraries) and NumPy {TYPED_NUMPY}'),
        'keys of package.xml': (
            database and [*module, 'benchmarks.release.rosdep_keys', database],
            'a checkout of github.com/ros/rosdistro: make release-check ROSDISTRO=folder'),
        'Debian package, installed and started': (
            shutil.which('dpkg-deb') and [*module, 'benchmarks.release.debian'],
            'dpkg: a Debian or Ubuntu machine'),
        'container': (
            _docker_works() and ['docker', 'build', '-f', 'benchmarks/release/Dockerfile', '.'],
            'a Docker daemon and the network')}
    failed, missing = [], []
    for name, (command, needs) in parts.items():
        if not command:
            missing.append(f'not run: {name}; it needs {needs}')
            continue
        print(f'{name} ...', flush=True)
        if subprocess.run(command, cwd=ROOT).returncode:
            failed.append(f'FAILED: {name}')
    print('\n'.join([*missing, *failed]))
    return len(failed)


if __name__ == '__main__':
    raise SystemExit(main())
