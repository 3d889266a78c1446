# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels compiled for other processors than this one, which runs their code, too.

Each runs tests of this suite in a process of its own. `make processors` takes all kernel tests and
all pinned images, which compile everything for each processor; the suite takes a part.
"""

import concurrent.futures
import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import aarch64, goldens

ROOT = Path(__file__).parents[2]
# With AVX2, which is 8 lanes; and without any extension. NUMBA_CPU_FEATURES is empty, since
# Numba would use what this processor has beyond the named one.
PROCESSORS = {'haswell': 8, 'generic': 8}
TRANSFORMS = ('test/backends/test_row_transform.py', 'test/backends/test_column_transform.py')
IMAGES = tuple(f'test/imaging/test_goldens.py::test_image_is_the_pinned_one[{name}]'
               for name in ('exact_100m', 'afbp_1km'))
# Vectors are written out in the transforms; the loops of images are the compiler's.
PARTS = {'haswell': (*TRANSFORMS, *IMAGES), 'generic': TRANSFORMS}
WHOLE = ('test/backends', 'test/imaging/test_goldens.py',
         f'--ignore={Path(__file__).relative_to(ROOT)}')


def _run(processor, folder, *arguments):
    if processor != 'generic' and platform.machine() != 'x86_64':
        pytest.skip(f'{processor} is an x86-64 processor')
    environment = os.environ | {
        'NUMBA_CPU_NAME': processor, 'NUMBA_CPU_FEATURES': '', 'NUMBA_CACHE_DIR': str(folder)}
    result = subprocess.run([sys.executable, *arguments], cwd=ROOT, env=environment,
                            capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.mark.parametrize(('processor', 'lanes'), [*PROCESSORS.items(), ('skylake-avx512', 16)])
def test_vectors_are_as_long_as_those_of_the_processor(processor, lanes, tmp_path):
    code = 'from sar_imaging.backends.cpu.fft import LANES; print(LANES)'
    assert int(_run(processor, tmp_path, '-c', code)) == lanes


@pytest.fixture(name='parts', scope='module')
def parts_fixture(tmp_path_factory):
    """The part of the suite on each processor, at the same time: compiling takes one thread."""
    def start(processor):
        return pool.submit(_run, processor, tmp_path_factory.mktemp(processor), '-m', 'pytest',
                           '-p', 'no:cacheprovider', *PARTS[processor])

    with concurrent.futures.ThreadPoolExecutor() as pool:
        yield {processor: start(processor) for processor in PROCESSORS}


@pytest.mark.parametrize('processor', PROCESSORS)
def test_kernels_of_another_processor(parts, processor):
    assert '[100%]' in parts[processor].result()


@pytest.mark.campaign
@pytest.mark.parametrize('processor', PROCESSORS)
def test_all_kernels_of_another_processor(processor, tmp_path):
    assert '[100%]' in _run(processor, tmp_path, '-m', 'pytest', '-p', 'no:cacheprovider', *WHOLE)


def test_what_was_found_on_aarch64_is_whole():
    """`make aarch64` wrote it."""
    found = json.loads(aarch64.RESULTS.read_text())
    assert found['machine'] == 'aarch64' and found['agrees']
    assert set(found['cases']) == set(aarch64.CASES)


def test_check_of_aarch64_notices_another_image(tmp_path, monkeypatch):
    """On this processor, which forms the pinned image."""
    monkeypatch.setattr(aarch64, 'CASES', ('exact_100m',))
    assert aarch64.check(tmp_path / 'here.json')
    golden, facts = goldens.load(goldens.FOLDER, 'exact_100m')
    monkeypatch.setattr(goldens, 'load', lambda *_: (1.001 * golden, facts))  # -60 dB
    assert not aarch64.check(tmp_path / 'here.json')
    assert not json.loads((tmp_path / 'here.json').read_text())['agrees']
