# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files of the separate nodes as those of one node."""

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.nodes.runtime.parameters import ConfigurationError, merged_arguments

FILE = """
/**:
  ros__parameters:
    buffer_size: 64
/**/buffer:
  ros__parameters:
    window: 1e-3
"/radar1/imager" :  # quoted
  ros__parameters:
    target_db: -60.0
radar2:
  imager:
    ros__parameters:
      target_db: -50.0
/**/other_imager:
  ros__parameters:
    window: 4
"""


def merge(folder, *arguments):
    return merged_arguments(['node', '--ros-args', *arguments], 'all', ['buffer', 'imager'],
                            folder)


def test_sections_of_the_stages_become_those_of_the_node(tmp_path):
    file = tmp_path / 'radar.yaml'
    file.write_text(FILE)
    arguments = merge(tmp_path, '-r', '__ns:=/radar1', '--params-file', str(file), '-p', 'a:=1')
    assert arguments[:5] == ['node', '--ros-args', '-r', '__ns:=/radar1', '--params-file']
    assert arguments[6:] == ['-p', 'a:=1']
    with open(arguments[5]) as merged:
        changed = [(a, b) for a, b in zip(FILE.splitlines(), merged.read().splitlines(),
                                          strict=True) if a != b]
    assert changed == [('/**/buffer:', '/**/all:'),
                       ('"/radar1/imager" :  # quoted', '"/radar1/all" :  # quoted'),
                       ('  imager:', '  all:')]
    assert file.read_text() == FILE


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    file = tmp_path / 'radar.yaml'
    file.write_bytes(b'\xff\xfe\x00')
    for path, reason in ((file, 'invalid start byte'), (tmp_path / 'none.yaml', 'No such file')):
        with pytest.raises(ConfigurationError, match=reason):
            merge(tmp_path, '--params-file', str(path))
