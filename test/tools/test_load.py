# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The command: description and data become a recording that the house's tools image."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from sar_imaging.recordings import DescriptionError, load
from sar_imaging.recordings.bag_io import BagError, read_blocks, read_poses, read_truth
from sar_imaging.recordings.driver_bags import read_bag_poses
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import concatenate
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.tools import command
from sar_imaging.tools.load import main

FMCW = {'start_frequency_hz': 24e9, 'slope_hz_per_s': 20e12, 'sample_rate_hz': 2e6}
POINT, N, P = (1.5, 8.0, 0.0), 128, 150
SENT_S = 4.0 + 0.02 * np.arange(P)
POSE_S = np.arange(0.0, 12.0, 0.02)
OFFSET_S, ARM_M = 1.25, np.array([0.2, 0.0, 0.1])


def flight(time_s):
    t = np.asarray(time_s) - 5.5
    position = np.stack([0.6 * t, 0.02 * np.sin(2 * t), 1.5 + 0.01 * t], axis=-1)
    return position, Rotation.from_rotvec(np.outer(0.05 * t, [0, 0, 1]))


@pytest.fixture
def folder(tmp_path):
    """Samples of one reflector with poses as a TUM trajectory, and their description."""
    radar = fmcw_parameters(n_samples=N, **FMCW)
    position, attitude = flight(SENT_S)
    centre = (position + attitude.apply(ARM_M))[:, None]
    beat = EchoSimulator(radar, N, compressed=False, points_m=[POINT],
                         amplitudes=[1.0])(centre, centre).conj()
    np.savez(tmp_path / 'radar.npz', beat=beat, t=SENT_S)
    position, attitude = flight(POSE_S)
    np.savetxt(tmp_path / 'poses.tum',
               np.column_stack([POSE_S + OFFSET_S, position, attitude.as_quat()]), fmt='%.9f')
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump({
        'samples': {'file': 'radar.npz', 'variable': 'beat', 'axes': ['pulse', 'channel',
                                                                      'sample'],
                    'conjugate': True},
        'radar': {'waveform': 'fmcw', **FMCW}, 'times': {'variable': 't'},
        'poses': {'file': 'poses.tum'},
        'alignment': {'time_offset_s': OFFSET_S, 'lever_arm_m': ARM_M.tolist()},
        'scene': {'centre_m': [1, 8, 0], 'size_m': [4, 4], 'spacing_m': 0.05,
                  'scatterers': {'corner': list(POINT)}}}))
    return tmp_path


def peak(folder, out):
    """Where `sar-imaging image` has the brightest pixel."""
    arguments = ['image', str(folder), '--output', str(out), '--target-db', '-40']
    assert command.main(arguments) == 0
    grid = read_truth(folder)['grid']
    image = np.abs(np.load(out / 'image.npy'))
    row, column = np.unravel_index(image.argmax(), image.shape)
    n = np.array([grid['n_x'], grid['n_y']])
    return ((np.array([column, n[1] - 1 - row]) - (n - 1) / 2) * grid['spacing_m']
            + grid['centre_m'][:2])


def test_a_reflector_comes_out_where_it_stands(folder, capsys):
    assert main([str(folder / 'mine.yaml'), '--output', str(folder / 'bag')]) == 0
    assert '150 pulses in 5 messages, ' in capsys.readouterr().out
    assert not concatenate(list(read_blocks(folder / 'bag'))).has_positions
    assert read_truth(folder / 'bag')['alignment']['time_offset_s'] == OFFSET_S
    assert np.abs(peak(folder / 'bag', folder / 'out') - POINT[:2]).max() <= 0.05  # one pixel


def test_wrong_values_displace_it(folder):
    wrong = ['--set', 'alignment.time_offset_s=0.25', '--set', 'alignment.range_bias_m=0.1']
    assert main([str(folder / 'mine.yaml'), '--output', str(folder / 'bag'), *wrong]) == 0
    assert np.abs(peak(folder / 'bag', folder / 'out') - POINT[:2]).max() > 0.2


def test_the_data_may_lie_elsewhere(folder, tmp_path_factory, capsys):
    other = tmp_path_factory.mktemp('description')
    (folder / 'mine.yaml').rename(other / 'mine.yaml')
    assert main([str(other / 'mine.yaml'), '--output', str(folder / 'bag')]) == 1
    assert 'holds no file radar.npz; name the folder with the data' in capsys.readouterr().err
    for i, data in enumerate((folder, folder / 'radar.npz')):
        assert main([str(other / 'mine.yaml'), str(data), '--output', str(folder / f'{i}')]) == 0


def bag_of_poses(path, kind, topics=('/pose',)):
    """A ROS 2 bag of poses."""
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_JAZZY)
    t = store.types
    place, turn = t['geometry_msgs/msg/Point'], t['geometry_msgs/msg/Quaternion']
    position, attitude = flight(POSE_S)
    with rosbag2.Writer(path, version=9) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, kind, typestore=store)
            for s, p, q in zip(POSE_S + OFFSET_S, position, attitude.as_quat(), strict=True):
                ns = round(s * 1e9)
                stamp = t['builtin_interfaces/msg/Time'](sec=ns // 10**9, nanosec=ns % 10**9)
                header = t['std_msgs/msg/Header'](stamp=stamp, frame_id='map')
                if kind.endswith('TransformStamped'):
                    message = t[kind](header=header, child_frame_id='b', transform=t[
                        'geometry_msgs/msg/Transform'](translation=t[
                            'geometry_msgs/msg/Vector3'](*p.tolist()), rotation=turn(*q.tolist())))
                else:
                    message = t[kind](header=header, pose=t['geometry_msgs/msg/Pose'](
                        position=place(*p.tolist()), orientation=turn(*q.tolist())))
                writer.write(connection, ns, store.serialize_cdr(message, kind))


@pytest.mark.parametrize('kind', ['PoseStamped', 'TransformStamped'])
def test_poses_from_a_ros_bag(folder, kind):
    bag_of_poses(folder / 'poses', f'geometry_msgs/msg/{kind}')
    path = str(folder / 'mine.yaml')
    assert main([path, '--output', str(folder / 'bag'), '--set', 'poses.file=poses']) == 0
    assert main([path, '--output', str(folder / 'tum')]) == 0
    from_bag, from_file = read_poses(folder / 'bag'), read_poses(folder / 'tum')
    np.testing.assert_array_equal(from_bag.stamp_ns, from_file.stamp_ns)
    np.testing.assert_allclose(from_bag.position_m, from_file.position_m, atol=1e-8)
    np.testing.assert_allclose(from_bag.quaternion, from_file.quaternion, atol=1e-8)


def test_bags_without_one_topic_of_poses_are_told(tmp_path, folder):
    bag_of_poses(tmp_path / 'two', 'geometry_msgs/msg/PoseStamped', ('/a', '/b'))
    with pytest.raises(DescriptionError, match=r'expected one topic .*/a \(geometry_msgs.*name '
                       r'one in poses\.topic'):
        read_bag_poses(tmp_path / 'two')
    assert len(read_bag_poses(tmp_path / 'two', '/b').stamp_ns) == len(POSE_S)
    with pytest.raises(DescriptionError, match='expected /c with poses'):
        read_bag_poses(tmp_path / 'two', '/c')
    with pytest.raises(BagError, match='does not exist'):
        read_bag_poses(tmp_path / 'none')
    (tmp_path / 'text.bag').write_text('no bag')
    with pytest.raises(BagError, match='does not begin as ROS 1 bags'):
        read_bag_poses(tmp_path / 'text.bag')


@pytest.mark.parametrize(('arguments', 'message'), [
    (['nothing.yaml'], 'nothing.yaml does not exist; expected a YAML file or one of arcsar'),
    (['MINE', '--set', 'a'], '--set a: expected KEY=VALUE'),
    (['MINE', '--set', 'radar.slope=1'], 'unknown key radar.slope; did you mean slope_hz_per_s'),
    (['MINE', '--set', 'samples.file=a.h5'], 'holds no file a.h5'),
    (['MINE', 'nowhere'], 'nowhere does not exist; expected the folder with the data')])
def test_what_is_wrong_is_one_line(folder, arguments, message, capsys):
    arguments = [str(folder / 'mine.yaml') if a == 'MINE' else a for a in arguments]
    assert main([*arguments, '--output', str(folder / 'bag')]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert message in line
    assert not (folder / 'bag').exists()


def test_a_description_names_no_folder_elsewhere(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(['mine.yaml', '--set', 'name=../elsewhere']) == 1
    assert "name: '../elsewhere' is no name of a folder" in capsys.readouterr().err
    assert not (folder / 'out').exists()


def test_nothing_is_estimated_of_positions(folder, capsys):
    path = str(folder / 'mine.yaml')
    line = 'positions={line: {first_m: [0, 0, 1], last_m: [1, 0, 1]}}'
    text = (folder / 'mine.yaml').read_text()
    tree = yaml.safe_load(text)
    del tree['poses'], tree['alignment']['time_offset_s']
    (folder / 'mine.yaml').write_text(yaml.safe_dump(tree))
    arguments = [path, '--output', str(folder / 'bag'), '--set', line]
    assert main([*arguments, '--estimate-alignment']) == 1
    assert 'expected poses on a clock of their own' in capsys.readouterr().err
    assert main(arguments) == 0
    assert load(path, changes={'positions': {'line': {'first_m': [0, 0, 1], 'last_m': [1, 0, 1]}}}
                ).block.has_positions
