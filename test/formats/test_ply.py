# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""PLY files, read by the format's definition: a header of lines, then the vertices."""

import numpy as np
import pytest

from sar_imaging.formats import write_ply

POINTS = np.array([[1e6 + 1e-3, -2.0, 3.0], [0.0, np.pi, -1e-4]])
TYPES = {'double': '<f8', 'float': '<f4'}


def read(path):
    """Comment and vertices of a binary little-endian PLY file."""
    head, _, body = path.read_bytes().partition(b'end_header\n')
    lines = head.decode('ascii').splitlines()
    assert lines[:2] == ['ply', 'format binary_little_endian 1.0']
    [count] = [int(line.split()[2]) for line in lines if line.startswith('element vertex')]
    fields = [(line.split()[2], TYPES[line.split()[1]]) for line in lines
              if line.startswith('property')]
    return ([line for line in lines if line.startswith('comment')],
            np.frombuffer(body, fields, count), len(body))


def test_points_and_properties_come_back(tmp_path):
    path = tmp_path / 'cloud.ply'
    write_ply(path, POINTS, {'intensity': [30.5, -3.0]}, 'dB above the median')
    comments, vertices, size = read(path)
    assert comments == ['comment dB above the median'] and size == vertices.nbytes
    np.testing.assert_array_equal(np.stack([vertices[a] for a in 'xyz'], axis=-1), POINTS)
    np.testing.assert_array_equal(vertices['intensity'], np.float32([30.5, -3.0]))
    assert [p.name for p in tmp_path.iterdir()] == ['cloud.ply']


def test_no_points_are_a_file_too(tmp_path):
    write_ply(tmp_path / 'none.ply', np.zeros((0, 3)))
    comments, vertices, size = read(tmp_path / 'none.ply')
    assert (comments, len(vertices), size) == ([], 0, 0)


@pytest.mark.parametrize(('change', 'message'), [
    ({'path': 'cloud.pcd'}, r'cloud.pcd: expected a name that ends in \.ply'),
    ({'points_m': np.zeros((2, 2))}, r'points_m.shape=\(2, 2\); expected \(n, 3\)'),
    ({'properties': {'intensity': [1.0]}}, r'intensity.shape=\(1,\); expected \(2,\)'),
    ({'properties': {'in dB': [1.0, 2.0]}}, "'in dB' names no property"),
    ({'comment': 'two\nlines'}, 'expected one line of ASCII')])
def test_what_no_file_can_hold_is_refused(tmp_path, change, message):
    arguments = {'path': 'cloud.ply', 'points_m': POINTS} | change
    with pytest.raises(ValueError, match=message):
        write_ply(tmp_path / arguments.pop('path'), **arguments)
    assert not list(tmp_path.iterdir())
