# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Check the imaging core on aarch64, emulated: images and predictions beside the pinned ones.

Run from the repository root, on Debian; nothing is installed and no rights are needed::

    python -m benchmarks.aarch64

Into `build/aarch64` come Debian's Python and libraries for arm64, its emulator where
`qemu-aarch64-static` is not installed, and the aarch64 wheels of this environment's NumPy, SciPy
and Numba, all by apt and pip as they are configured here. Then the emulated Python forms some of
the images of `benchmarks.support.golden_cases`. That takes half an hour, most of it compiling, and
times say nothing.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import json
import logging
import os
import pathlib
import platform
import shutil
import subprocess
import sys
import time
import warnings
import zipfile

ROOT = pathlib.Path(__file__).parents[1]
FOLDER = ROOT / 'build' / 'aarch64'
RESULTS = pathlib.Path(__file__).parent / 'results' / 'aarch64.json'
PACKAGES = ('python3-minimal', 'libpython3-stdlib', 'libstdc++6', 'libgomp1')
WHEELS = ('numpy', 'scipy', 'numba', 'llvmlite', 'tqdm', 'pyyaml')
PLATFORMS = ('manylinux2014_aarch64', 'manylinux_2_27_aarch64', 'manylinux_2_28_aarch64')
EMULATOR = 'qemu-aarch64-static'
# Between processors, whose roundings differ; -120 dB is what a change may do on one of them.
MOST_DB, MOST_PREDICTION_DB = -100.0, 0.01
CASES = ('exact_100m', 'exact_1km_5_channels', 'exact_50km_5_channels', 'exact_curved',
         'exact_near', 'exact_phase_history', 'afbp_1km', 'afbp_10km_5_channels',
         'afbp_phase_history', 'ffbp', 'terrain')


def fetch_python(folder: pathlib.Path) -> pathlib.Path:
    """Debian's Python for arm64 with what it needs, below `root`; apt keeps its state here.

    Raises
    ------
    FileNotFoundError
        There is no apt.
    """
    if shutil.which('apt-get') is None:
        raise FileNotFoundError('apt-get and dpkg-deb are needed, on Debian, whose sources have '
                                'arm64, too')
    state, root = folder / 'apt', folder / 'root'
    for name in ('lists/partial', 'archives/partial'):
        (state / name).mkdir(parents=True, exist_ok=True)
    (state / 'status').touch()
    settings = state / 'apt.conf'
    settings.write_text(
        'APT::Architecture "arm64";\nAPT::Architectures { "arm64"; };\n'
        f'Dir::State "{state}";\nDir::State::status "{state}/status";\nDir::Cache "{state}";\n'
        'APT::Sandbox::User "";\n')
    environment = os.environ | {'APT_CONFIG': str(settings)}
    subprocess.run(['apt-get', '-qq', 'update'], env=environment, check=True)
    subprocess.run(['apt-get', '-qq', '--yes', '--no-install-recommends', '--download-only',
                    'install', *PACKAGES], env=environment, check=True)
    _unpack((state / 'archives').glob('*.deb'), root)
    return root / 'usr' / 'bin' / 'python3'


def fetch_emulator(folder: pathlib.Path) -> str:
    """The emulator that is installed, or Debian's, unpacked."""
    if found := shutil.which(EMULATOR):
        return found
    place = folder / 'emulator'
    place.mkdir(exist_ok=True)
    subprocess.run(['apt-get', '-qq', 'download', 'qemu-user-static'], cwd=place, check=True)
    _unpack(place.glob('*.deb'), place)
    return str(place / 'usr' / 'bin' / EMULATOR)


def _unpack(packages, target: pathlib.Path) -> None:
    for package in packages:
        subprocess.run(['dpkg-deb', '--extract', package, target], check=True)


def fetch_wheels(folder: pathlib.Path, version: str) -> pathlib.Path:
    """Wheels for aarch64 of the packages here, in the versions here, unpacked into one folder."""
    wheels, site = folder / 'wheels', folder / 'site'
    subprocess.run(
        [sys.executable, '-m', 'pip', 'download', '--quiet', '--disable-pip-version-check',
         '--no-deps', '--only-binary=:all:', '--python-version', version, '--dest', wheels,
         *(f'--platform={name}' for name in PLATFORMS),
         *(f'{name}=={importlib.metadata.version(name)}' for name in WHEELS)], check=True)
    for wheel in wheels.glob('*.whl'):
        zipfile.ZipFile(wheel).extractall(site)
    return site


def check(output: pathlib.Path) -> bool:
    """Form the images in this process and write how they differ; False where by too much."""
    from sar_imaging.backends.cpu.fft import LANES

    from . import goldens

    rows, fine = {}, True
    for name in CASES:
        golden, facts = goldens.load(goldens.FOLDER, name)
        begin = time.perf_counter()
        found = goldens.form(goldens.CASES[name])
        image_db = goldens.difference_db(found.image, golden)
        off_db = (found.predicted_error_db or 0.0) - (facts['predicted_error_db'] or 0.0)
        same = found.plan == facts['plan']
        fine &= image_db <= MOST_DB and abs(off_db) <= MOST_PREDICTION_DB and same
        rows[name] = {'difference_db': round(max(image_db, -999.0), 1), 'predicted_error_db': (
            found.predicted_error_db), 'prediction_off_db': off_db, 'same_plan': same}
        print(f'{name:24s} {image_db:7.1f} dB  prediction {off_db:+.1e} dB  '
              f'{"same" if same else "other"} plan  {time.perf_counter() - begin:6.0f} s',
              flush=True)
        output.write_text(json.dumps({
            'date': datetime.date.today().isoformat(), 'machine': platform.machine(),
            'python': platform.python_version(), 'lanes': LANES, 'agrees': fine,
            **{name: importlib.metadata.version(name) for name in WHEELS[:4]},
            'cases': rows}, indent=1) + '\n')
    return fine


def main() -> int:
    """Fetch, then check under emulation; 1 where something differs by too much."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--here', action='store_true', help='check this Python, emulated or not')
    arguments = parser.parse_args()
    if arguments.here:
        logging.disable(logging.WARNING)
        warnings.simplefilter('ignore')
        return 0 if check(arguments.output) else 1
    FOLDER.mkdir(parents=True, exist_ok=True)
    python, emulator = fetch_python(FOLDER), fetch_emulator(FOLDER)
    root, version = FOLDER / 'root', python.resolve().name.removeprefix('python')
    site = fetch_wheels(FOLDER, version)
    environment = {'PYTHONHOME': str(root / 'usr'), 'PYTHONPATH': f'{site}:{ROOT}',
                   'NUMBA_CACHE_DIR': str(FOLDER / 'cache'), 'HOME': str(FOLDER),
                   'NUMBA_NUM_THREADS': '1'}
    return subprocess.run([emulator, '-L', root, python.resolve(), '-m', 'benchmarks.aarch64',
                           '--here', '--output', arguments.output.resolve()], cwd=ROOT,
                          env=environment).returncode


if __name__ == '__main__':
    sys.exit(main())
