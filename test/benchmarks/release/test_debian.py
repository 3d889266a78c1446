# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the Debian package says of itself; `make release-check` builds, installs and starts it."""

import pathlib
import xml.etree.ElementTree as ElementTree

from benchmarks.release.debian import NODES, control

ROOT = pathlib.Path(__file__).resolve().parents[3]


def test_keys_become_packages():
    manifest = ElementTree.fromstring("""<package><name>sar_imaging</name>
      <version>1.2.3</version><description>Images: of
        radar.</description><maintainer email="a@b.org">A</maintainer>
      <depend>std_msgs</depend><exec_depend>python3-numpy</exec_depend>
      <test_depend>python3-pytest</test_depend></package>""")
    lines = control(manifest, 'kilted').splitlines()
    assert 'Package: ros-kilted-sar-imaging' in lines and 'Version: 1.2.3-0' in lines
    assert 'Depends: python3, python3-numpy, ros-kilted-std-msgs' in lines
    assert lines[-2:] == ['Description: Images', ' Images: of radar.']


def test_the_nodes_that_are_started_are_all():
    assert set(NODES) == {path.stem for path in (ROOT / 'sar_imaging' / 'nodes').glob('*.py')
                          if 'def main' in path.read_text()}
