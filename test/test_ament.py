# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""ament's linters, where a ROS installation has them; ruff checks the same rules everywhere.

Rules of docstrings, imports and continued lines that this project answers otherwise are named,
with the reason, in `ament_flake8.ini` and here.
"""

import pathlib
import shutil

import pytest

ROOT = pathlib.Path(__file__).parent.parent
FOLDERS = 'sar_imaging', 'msg_conversions'
REASON = 'comes with a ROS installation: sudo apt install ros-$ROS_DISTRO-ament-lint'
# numpydoc: see ament_flake8.ini
DOCSTRINGS = 'D205', 'D213', 'D400', 'D401', 'D402', 'D403', 'D406', 'D407', 'D413'


@pytest.fixture(autouse=True)
def _in_the_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def test_ament_copyright(monkeypatch, capfd):
    """It knows no licence that is named by SPDX in one line, and is told of this one."""
    main = pytest.importorskip('ament_copyright.main', reason=f'ament_copyright {REASON}')
    from ament_copyright import licenses, parser

    line = licenses.LicenseEntryPoint(
        'Apache-2.0', 'Apache-2.0', ['{copyright}\nSPDX-License-Identifier: Apache-2.0'], [], [])
    known = parser.get_licenses()
    monkeypatch.setattr(parser, 'get_licenses', lambda: {**known, 'spdx': line})
    assert main.main([*FOLDERS, 'LICENSE', 'CONTRIBUTING.md']) == 0, capfd.readouterr().err


def test_ament_flake8(capfd):
    main = pytest.importorskip('ament_flake8.main', reason=f'ament_flake8 {REASON}')
    status = main.main(['--config', 'test/ament_flake8.ini', *FOLDERS, 'setup.py'])
    assert status == 0, capfd.readouterr().out


def test_ament_pep257(capfd):
    main = pytest.importorskip('ament_pep257.main', reason=f'ament_pep257 {REASON}')
    assert main.main(['--add-ignore', *DOCSTRINGS, '--', *FOLDERS]) == 0, capfd.readouterr()


def test_ament_xmllint(capfd):
    main = pytest.importorskip('ament_xmllint.main', reason=f'ament_xmllint {REASON}')
    if shutil.which('xmllint') is None:
        pytest.skip('no xmllint: sudo apt install libxml2-utils')
    assert main.main(['package.xml', 'sar_imaging/config']) == 0, capfd.readouterr().err
