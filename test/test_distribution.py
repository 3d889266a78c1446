# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is published for pip: the wheel and the source distribution, built, checked and installed.

They need minutes and the package index: `make release-check` runs them.
"""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import tarfile
import venv
import zipfile

import pytest

import sar_imaging

pytestmark = pytest.mark.release
ROOT = pathlib.Path(__file__).parent.parent
MOST_BYTES = 2e6  # of the wheel, which is 1.4 MB


@pytest.fixture(scope='module')
def built(tmp_path_factory):
    """Folder of wheel and source distribution of what git has, the wheel made from the latter."""
    pytest.importorskip('build', reason='the extra release of pyproject.toml is not installed')
    source, made = (tmp_path_factory.mktemp(name) for name in ('source', 'dist'))
    tree = subprocess.run(['git', 'stash', 'create'], cwd=ROOT, capture_output=True, text=True,
                          check=True).stdout.strip() or 'HEAD'  # with what is not committed yet
    archive = subprocess.run(['git', 'archive', tree], cwd=ROOT, capture_output=True, check=True)
    subprocess.run(['tar', 'x', '-C', source], input=archive.stdout, check=True)
    subprocess.run([sys.executable, '-m', 'build', '--outdir', made, source], check=True,
                   capture_output=True)
    return made


@pytest.fixture(scope='module')
def sources(built, tmp_path_factory):
    """The source distribution, unpacked."""
    [path] = built.glob('*.tar.gz')
    folder = tmp_path_factory.mktemp('unpacked')
    with tarfile.open(path) as archive:
        archive.extractall(folder)
    [top] = folder.iterdir()
    return top


@pytest.fixture(scope='module')
def installed(built, tmp_path_factory):
    """An environment with the wheel and what it requires, no extra."""
    folder = tmp_path_factory.mktemp('installed')
    venv.create(folder, with_pip=True)
    [wheel] = built.glob('*.whl')
    subprocess.run([folder / 'bin' / 'pip', 'install', '--quiet', wheel], check=True)
    return folder


def _run(*words, cwd, **options):
    kept = {k: v for k, v in os.environ.items() if k != 'PYTHONPATH'}
    return subprocess.run(words, cwd=cwd, env=kept, text=True, capture_output=True, **options)


def test_the_index_takes_them(built):
    pytest.importorskip('twine', reason='the extra release of pyproject.toml is not installed')
    run = _run(sys.executable, '-m', 'twine', 'check', '--strict', *built.iterdir(), cwd=built)
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_sources_are_what_git_has(sources):
    tracked = _run('git', 'ls-files', cwd=ROOT, check=True).stdout.split('\n')[:-1]
    there = {path.relative_to(sources).as_posix() for path in sources.rglob('*')}
    assert {path for path in tracked if (ROOT / path).exists()} <= there


def test_the_wheel_has_the_package_and_nothing_else(built):
    [path] = built.glob('*.whl')
    names = zipfile.ZipFile(path).namelist()
    about = f'sar_imaging-{sar_imaging.__version__}'
    assert {name.split('/')[0] for name in names} == {
        'sar_imaging', 'msg_conversions', f'{about}.data', f'{about}.dist-info'}
    assert {'sar_imaging/py.typed', 'msg_conversions/py.typed'} <= set(names)
    data = [n for n in names if n.endswith(('.mcap', '.db3', '.npy', '.npz', '.png', '.lock'))]
    assert data == []
    assert path.stat().st_size < MOST_BYTES


def test_the_wheel_works_alone(installed, tmp_path):
    program = installed / 'bin' / 'sar-imaging'
    assert 'simulate' in _run(program, '--help', cwd=tmp_path, check=True).stdout
    # what no node needs is not there, and is told in a line
    run = _run(program, 'image', 'nowhere', cwd=tmp_path)
    assert run.returncode == 1 and "pip install 'sar_imaging[tools]'" in run.stderr
    assert 'Traceback' not in run.stderr
    run = _run(installed / 'bin' / 'python', '-c', 'import sar_imaging.imaging.imager, '
               'sar_imaging.streaming.aperture, msg_conversions', cwd=tmp_path)
    assert run.returncode == 0, run.stderr


def test_the_sources_pass_their_tests(sources):
    """A quick part of them, with the libraries of this environment."""
    run = _run(sys.executable, '-m', 'pytest', '-x', '-q', '-p', 'no:cacheprovider',
               'test/test_package.py', 'test/msg_conversions', 'test/signal/test_pulses.py',
               'test/recordings/test_bag_io.py', 'test/tools/test_completion.py', cwd=sources)
    assert run.returncode == 0, run.stdout[-3000:]


def test_the_conda_recipe_is_one():
    """Parsed and rendered by rattler-build; building it needs a channel of conda."""
    rattler_build = pytest.importorskip(
        'rattler_build', reason='the extra release of pyproject.toml is not installed')
    recipe = rattler_build.Stage0Recipe.from_yaml((ROOT / 'conda' / 'recipe.yaml').read_text())
    [variant] = recipe.render()
    assert f"package='sar_imaging', version='{sar_imaging.__version__}'" in repr(variant)
