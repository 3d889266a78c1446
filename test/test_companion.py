# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A package of another project that is called msg_conversions is an error with both places."""

import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parent.parent


def run(folder, code, *path):
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(map(str, path))}
    return subprocess.run([sys.executable, '-c', code], cwd=folder, env=environment, text=True,
                          capture_output=True)


@pytest.fixture
def other(tmp_path):
    """Folder of a workspace with a package of the same name."""
    package = tmp_path / 'other' / 'msg_conversions'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text('')
    (package / 'point_cloud.py').write_text('')  # as ours has one
    return package.parent


@pytest.mark.parametrize('code', [
    'import sar_imaging', 'import sar_imaging.geometry.grids',
    'import msg_conversions, sar_imaging'])
def test_a_clash_names_both_packages(other, tmp_path, code):
    result = run(tmp_path, code, other, ROOT)
    assert result.returncode == 1
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith('ImportError: Python finds the package msg_conversions of another '
                           f'project, {other / "msg_conversions"}; sar_imaging needs its own, '
                           f'{ROOT / "msg_conversions"}.')
    assert 'put its folder first in PYTHONPATH' in last


def test_the_advice_helps(other, tmp_path):
    result = run(tmp_path, 'import sar_imaging, msg_conversions.wire', ROOT, other)
    assert result.returncode == 0, result.stderr


def test_the_package_must_be_there(tmp_path):
    (tmp_path / 'sar_imaging').symlink_to(ROOT / 'sar_imaging')
    # `make environment` puts the checkout on the path, too
    code = (f"import sys; sys.path = [p for p in sys.path if 'site-packages' not in p "
            f'and p != {str(ROOT)!r}]; import sar_imaging')
    result = run(tmp_path, code, tmp_path)
    assert 'no package msg_conversions is on the path of Python; it belongs to' in result.stderr
