# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses of every format tell the same track, in the frame of the image."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from sar_imaging.recordings import BagError, DescriptionError
from sar_imaging.recordings.data_files import DataFiles
from sar_imaging.recordings.description import Section
from sar_imaging.recordings.poses import KEYS, read_poses
from sar_imaging.yaml_text import Value

TIME_S = 5.0 + 0.01 * np.arange(40)
POSITION_M = np.stack([TIME_S, 2 * TIME_S, 3 + 0.1 * TIME_S], axis=-1)  # z up
TURN = Rotation.from_euler('zyx', [[30.0, 5.0 + i, 10.0] for i in range(40)], degrees=True)
QUATERNION = TURN.as_quat()


def read(folder, text, data=()):
    files = DataFiles(list(data))
    section = Section(Value('mine.yaml', 'poses', yaml.safe_load(text), DescriptionError), KEYS,
                      files.same)
    return read_poses(section, folder, files)


def check(poses, turn=TURN):
    np.testing.assert_array_equal(poses.stamp_ns, np.rint(TIME_S * 1e9).astype(np.int64))
    np.testing.assert_allclose(poses.position_m, POSITION_M, atol=1e-9)
    away = (Rotation.from_quat(poses.quaternion) * turn.inv()).magnitude()
    assert away.max() < 1e-6


def rows(*columns):
    return np.column_stack(columns)


def table(path, values, header='', separator=','):
    lines = [separator.join(f'{v:.12f}' for v in row) for row in values]
    path.write_text('\n'.join([header, *lines] if header else lines) + '\n')


def test_tum_trajectories(tmp_path):
    table(tmp_path / 'track.tum', rows(TIME_S, POSITION_M, QUATERNION), '# t x y z q', ' ')
    check(read(tmp_path, '{file: track.tum}'))


@pytest.mark.parametrize('separator', [',', ';', '\t', ' '])
def test_csv_with_usual_names(tmp_path, separator):
    header = separator.join(['timestamp', 'pos_x', 'pos_y', 'pos_z', 'qx', 'qy', 'qz', 'qw'])
    table(tmp_path / 'a.csv', rows(1e3 * TIME_S, POSITION_M, QUATERNION), header, separator)
    check(read(tmp_path, '{file: a.csv, unit_s: 1.0e-3}'))
    check(read(tmp_path, '{file: a.csv, unit_s: 1.0e-3, level: true}'),
          Rotation.identity(40))


def test_csv_with_names_of_ones_own(tmp_path):
    table(tmp_path / 'a.csv', rows(POSITION_M, TIME_S), 'east,north,up,gps')
    check(read(tmp_path, '{file: a.csv, columns: {time: gps, x: east, y: north, z: up}}'),
          Rotation.identity(40))
    with pytest.raises(DescriptionError, match='a.csv has no column time or t or timestamp; it '
                       'has east, north, up, gps: name it in poses.columns.time'):
        read(tmp_path, '{file: a.csv}')


def test_positions_in_another_unit(tmp_path):
    table(tmp_path / 'a.csv', rows(TIME_S, 1e3 * POSITION_M), 'time,x,y,z')
    check(read(tmp_path, '{file: a.csv, unit_m: 0.001}'), Rotation.identity(40))
    with pytest.raises(DescriptionError, match='poses.unit_m: expected metres, such as 0.001'):
        read(tmp_path, '{file: a.csv, unit_m: 0}')


@pytest.mark.parametrize(('header', 'row', 'message'), [
    ('time,x,y,z,roll,pitch,yaw', '1,0,0,0,0,0,90', 'the attitude is in roll, pitch, yaw; '
     'expected a quaternion .* poses.level: true'),
    ('time,lat,lon,alt', '1,47.1,8.2,400', 'has no column x .* latitude and longitude are'),
    ('1,0,0,0', '2,0,0,0', "has no line of column names, its first line is '1,0,0,0'"),
    ('time;x;y;z', '1,5;0,1;0;0', "row 2 holds '1,5'; expected numbers: write decimals with a po"),
    ('time,x,y,z', '2025-11-13T10:00:00,0,0,0', 'expected numbers: write times in seconds'),
    ('time,x,y,z', '1.7e18,0,0,0', 'poses: a time of 1.7e.18 s; expected finite seconds.*unit_s'),
    ('time,x,y,z', 'nan,0,0,0', 'poses: a time of nan s; expected finite seconds')])
def test_tables_of_beginners_are_told_what_to_change(tmp_path, header, row, message):
    (tmp_path / 'a.csv').write_text(f'{header}\n{row}\n{row}\n')
    with pytest.raises(DescriptionError, match=message) as error:
        read(tmp_path, '{file: a.csv}')
    assert '\n' not in str(error.value)


def test_attitudes_in_degrees_may_be_ignored(tmp_path):
    angles = np.zeros((40, 3))
    table(tmp_path / 'a.csv', rows(TIME_S, POSITION_M, angles), 'time,x,y,z,roll,pitch,yaw')
    check(read(tmp_path, '{file: a.csv, level: true}'), Rotation.identity(40))


def test_ned_becomes_enu_with_axes_forward_left_up(tmp_path):
    ned_m = POSITION_M[:, [1, 0, 2]] * [1, 1, -1]
    to_ned = Rotation.from_matrix([[0, 1.0, 0], [1, 0, 0], [0, 0, -1]])
    frd = Rotation.from_matrix(np.diag([1.0, -1, -1]))
    table(tmp_path / 'a.tum', rows(TIME_S, ned_m, (to_ned * TURN * frd).as_quat()), '', ' ')
    check(read(tmp_path, '{file: a.tum, frame: ned}'))


def test_arrays_of_the_file_of_the_samples(tmp_path):
    np.savez(tmp_path / 'd.npz', t=TIME_S, p=POSITION_M, q=np.roll(QUATERNION, 1, axis=1))
    check(read(tmp_path, '{times: t, positions: p, quaternions: q, quaternion_order: wxyz}',
               [tmp_path / 'd.npz']))
    check(read(tmp_path, '{file: d.npz, times: t, positions: p}'), Rotation.identity(40))


def optitrack(path, units='Millimeters', scale=1e3):
    """A CSV export of Motive: y up, two bodies, markers, a row without a tracked body."""
    up = Rotation.from_matrix([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    position, quaternion = up.apply(POSITION_M) * scale, (up * TURN * up.inv()).as_quat()
    n = ['Rotation'] * 4 + ['Position'] * 3
    xyzw = ['X', 'Y', 'Z', 'W', 'X', 'Y', 'Z']
    lines = [f'Format Version,1.23,Take Name,a,Length Units,{units},Rotation Type,Quaternion', '',
             ',,' + ','.join(['Rigid Body'] * 14 + ['Rigid Body Marker'] * 3),
             ',,' + ','.join(['Wand'] * 7 + ['Radar'] * 7 + ['Radar:1'] * 3),
             ',,' + ','.join(['"1"'] * 17), ',,' + ','.join(n + n + ['Position'] * 3),
             'Frame,Time (Seconds),' + ','.join(xyzw + xyzw + ['X', 'Y', 'Z'])]
    for i, t in enumerate(TIME_S):
        body = [f'{v:.9f}' for v in (*quaternion[i], *position[i])]
        lines.append(f'{i},{t:.6f},' + ','.join(['0.5'] * 7 + body + ['9'] * 3))
    lines.insert(9, '99,5.015,' + ','.join(['0.5'] * 7 + [''] * 10))
    path.write_text('\n'.join(lines) + '\n')


def test_optitrack_exports_have_y_up_and_their_unit(tmp_path):
    optitrack(tmp_path / 'take.csv')
    check(read(tmp_path, '{file: take.csv, body: Radar}'))
    with pytest.raises(DescriptionError, match='one of the rigid bodies Wand, Radar of take.csv'):
        read(tmp_path, '{file: take.csv, body: Drone}')
    optitrack(tmp_path / 'take.csv', 'Feet')
    with pytest.raises(DescriptionError, match='export it from Motive so'):
        read(tmp_path, '{file: take.csv, body: Radar}')


@pytest.mark.parametrize(('content', 'message'), [
    ('1 2 3\n', 'row 1 has 3 columns; expected 8'), ('a b c d e f g h\n', 'expected numbers'),
    ('1 0 0 0 0 0 0 1\n', 'has 1 poses; expected two or more'),
    ('1 0 0 nan 0 0 0 1\n2 0 0 0 0 0 0 1\n', 'positions hold NaN'),
    ('1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 0\n', 'quaternion 1 has the norm 0; expected 1')])
def test_what_is_no_trajectory_is_told(tmp_path, content, message):
    (tmp_path / 'a.tum').write_text(content)
    with pytest.raises(DescriptionError, match='a.tum') as error:
        read(tmp_path, '{file: a.tum}')
    assert message in str(error.value)


def test_unknown_files_are_told(tmp_path):
    (tmp_path / 'a.xyz').write_text('')
    with pytest.raises(DescriptionError, match='add format: arrays, csv, tum, optitrack, bag'):
        read(tmp_path, '{file: a.xyz}')
    with pytest.raises(DescriptionError, match='poses.file: expected a file in'):
        read(tmp_path, '{file: b.csv}')
    with pytest.raises(BagError, match='a.xyz cannot be read as a whole ROS 1 bag'):
        read(tmp_path, '{file: a.xyz, format: bag}')


@pytest.mark.parametrize('kind', ['csv', 'tum', 'optitrack', 'bag'])
def test_a_format_of_files_needs_a_file(tmp_path, kind):
    with pytest.raises(DescriptionError, match=f'poses.file: expected .* format={kind} needs'):
        read(tmp_path, f'{{format: {kind}}}')
