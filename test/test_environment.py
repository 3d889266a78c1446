# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`make environment`: the package is importable from anywhere, wherever its checkout goes."""

from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
import sys
import sysconfig
import venv

import pytest

import sar_imaging

pytest.importorskip('rclpy', reason='make environment installs it, here without a network')

ROOT = pathlib.Path(__file__).parents[1]
WHERE = 'import msg_conversions, sar_imaging; print(sar_imaging.__file__)'
needs_make = pytest.mark.skipif(shutil.which('make') is None, reason='needs make')


def clean_environment(distribution):
    """Variables without a sourced ROS installation, or with the name of one."""
    kept = {k: v for k, v in os.environ.items()
            if k not in ('PYTHONPATH', 'ROS_DISTRO', 'VENV', 'MAKEFLAGS', 'MAKELEVEL')}
    return kept | ({'ROS_DISTRO': distribution} if distribution else {})


@needs_make
@pytest.mark.parametrize('distribution', ['', 'jazzy'])
def test_the_package_is_importable_from_anywhere(tmp_path, distribution):
    checkout = tmp_path / 'checkout'
    checkout.mkdir()
    for name in ('Makefile', 'requirements.txt'):
        shutil.copy(ROOT / name, checkout)
    for name in ('sar_imaging', 'msg_conversions'):
        (checkout / name).symlink_to(ROOT / name)
    # An environment as an earlier version left it: installed, and without the way to the package.
    folder = checkout / (f'.venv-{distribution}' if distribution else '.venv')
    venv.create(folder, with_pip=False)
    version = f'python{sys.version_info.major}.{sys.version_info.minor}'
    site = folder / 'lib' / version / 'site-packages'
    (site / 'installed.pth').write_text(sysconfig.get_path('purelib') + '\n')
    lines = (ROOT / 'requirements.txt').read_text().splitlines(keepends=True)
    (folder / 'installed-requirements.txt').write_text(
        ''.join(line for line in lines if not (distribution and line.startswith('ros-'))))

    def make():
        done = subprocess.run(['make', 'environment'], cwd=checkout, text=True,
                              env=clean_environment(distribution), capture_output=True)
        assert (done.returncode, done.stdout, done.stderr) == (0, '', '')
        return (site / 'sar_imaging.pth').read_bytes()

    def program_version(folder):
        # links to Python are not followed: the program's is that of its folder
        done = subprocess.run([folder / 'bin' / 'sar-imaging', '--version'], cwd=tmp_path,
                              text=True, env=clean_environment(distribution), capture_output=True)
        return done.stdout.strip() or done.stderr

    def found(folder):
        done = subprocess.run([folder / 'bin' / 'python', '-P' if sys.version_info >= (3, 11)
                               else '-s', '-c', WHERE], cwd=tmp_path, text=True,
                              env=clean_environment(distribution), capture_output=True)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    written = make()
    assert found(folder) == str(checkout / 'sar_imaging' / '__init__.py')
    assert make() == written
    assert program_version(folder) == sar_imaging.__version__
    moved = checkout.rename(tmp_path / 'moved')
    assert found(moved / folder.name) == str(moved / 'sar_imaging' / '__init__.py')
    assert program_version(moved / folder.name) == sar_imaging.__version__
