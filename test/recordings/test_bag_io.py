# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: what is written comes back, half a bag never stays."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from sar_imaging.recordings import bag_io
from sar_imaging.recordings.bag_files import check_bag
from sar_imaging.recordings.bag_io import BagError
from sar_imaging.recordings.truth import radar_to_dict
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters
from sar_imaging.simulation.scenarios import SCENARIOS

TRUTH = {'version': 1, 'scenario': 'test', 'scatterers': [
    {'name': 'post', 'position_m': [0.1, -2e-9, 3.0], 'amplitude_db': -3.5}]}


@pytest.fixture(scope='module')
def blocks():
    return list(SCENARIOS['psf']().blocks(30))


@pytest.fixture
def bag(tmp_path, blocks):
    path = tmp_path / 'deep' / 'bag'
    assert bag_io.write_bag(path, blocks, TRUTH) == len(blocks)
    return path


def test_blocks_come_back(bag, blocks):
    read = list(bag_io.read_blocks(bag))
    assert [b.n_pulses for b in read] == [30] * 6 + [20]
    for got, sent in zip(read, blocks, strict=True):
        np.testing.assert_array_equal(got.samples, sent.samples)
        np.testing.assert_array_equal(got.stamp_ns, sent.stamp_ns)
        np.testing.assert_array_equal(got.counter, sent.counter)
        np.testing.assert_array_equal(got.tx_m, sent.tx_m)  # multiples of a micrometre: exact
        np.testing.assert_array_equal(got.rx_m, sent.rx_m)
        assert got.compressed == sent.compressed and got.matches(read[0])
        # Pairs of float32 hold 48 bits.
        assert got.radar.first_sample_delay_s == pytest.approx(
            sent.radar.first_sample_delay_s, rel=1e-14)


def test_truth_comes_back(bag):
    assert bag_io.read_truth(bag) == TRUTH


@pytest.mark.parametrize(('speed', 'written'), [(SPEED_OF_LIGHT, {}), (1e8, {1e8})])
def test_the_truth_names_a_speed_that_is_not_light_s(speed, written):
    radar = RadarParameters(1e9, 1e8, 2e8, 1e-8, propagation_speed_m_per_s=speed)
    fields = radar_to_dict(radar)
    assert {v for k, v in fields.items() if k == 'propagation_speed_m_per_s'} == set(written)


def test_message_time_is_that_of_the_last_pulse(bag, blocks):
    times = [time_ns for time_ns, _ in bag_io.raw_messages(bag)]
    assert times == [int(b.stamp_ns[-1]) for b in blocks]


def test_raw_messages_are_valid_cdr_for_ros(bag, blocks):
    serialization = pytest.importorskip('rclpy.serialization')
    message_class = pytest.importorskip('std_msgs.msg').Float32MultiArray
    pulse_block = pytest.importorskip('msg_conversions.pulse_block')
    for (_, cdr), sent in zip(bag_io.raw_messages(bag), blocks, strict=True):
        got = pulse_block.from_message(serialization.deserialize_message(cdr, message_class))
        np.testing.assert_array_equal(got.samples, sent.samples)


def test_same_blocks_give_the_same_bytes(tmp_path, blocks):
    files = []
    for folder in ('one', 'two'):
        bag_io.write_bag(tmp_path / folder / 'bag', blocks, TRUTH)
        files.append(sorted((tmp_path / folder / 'bag').iterdir()))
    assert [f.name for f in files[0]] == ['bag.mcap', 'metadata.yaml']
    for one, two in zip(*files, strict=True):
        assert one.read_bytes() == two.read_bytes()


def test_existing_bag_is_kept_unless_told(bag, blocks):
    before = (bag / 'bag.mcap').read_bytes()
    with pytest.raises(BagError, match='exists already'):
        bag_io.write_bag(bag, blocks[:1], TRUTH)
    assert (bag / 'bag.mcap').read_bytes() == before
    bag_io.write_bag(bag, blocks[:1], TRUTH, overwrite=True)
    assert len(list(bag_io.read_blocks(bag))) == 1


def test_folder_that_is_no_bag_is_never_removed(tmp_path, blocks):
    (tmp_path / 'notes.txt').write_text('precious')
    with pytest.raises(BagError, match='not a bag'):
        bag_io.write_bag(tmp_path, blocks, TRUTH, overwrite=True)
    assert (tmp_path / 'notes.txt').read_text() == 'precious'


@pytest.mark.parametrize('error', [KeyboardInterrupt, ValueError])
@pytest.mark.parametrize('exists', [False, True])
def test_interruption_leaves_nothing_or_the_old_bag(tmp_path, blocks, error, exists):
    path = tmp_path / 'bag'
    if exists:
        bag_io.write_bag(path, blocks[:2], TRUTH)

    def interrupted():
        yield from blocks[:3]
        raise error

    with pytest.raises(error):
        bag_io.write_bag(path, interrupted(), TRUTH, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == (['bag'] if exists else [])
    if exists:
        assert len(list(bag_io.read_blocks(path))) == 2


def test_no_blocks_make_no_bag(tmp_path):
    with pytest.raises(BagError, match='no pulse block'):
        bag_io.write_bag(tmp_path / 'bag', [], TRUTH)
    assert not list(tmp_path.iterdir())


def _write_foreign_bag(path, *, custom=None):
    store = get_typestore(Stores.ROS2_JAZZY)
    message = store.types['std_msgs/msg/Bool'](data=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        if custom:
            writer.set_custom_data(bag_io.TRUTH_KEY, custom)
        connection = writer.add_connection('/ready', 'std_msgs/msg/Bool', typestore=store)
        writer.write(connection, 1, store.serialize_cdr(message, 'std_msgs/msg/Bool'))


def test_bag_without_pulses_is_refused_with_its_topics(tmp_path):
    _write_foreign_bag(tmp_path / 'other')
    with pytest.raises(BagError, match=r'/pulses.*topics in it: /ready \(std_msgs/msg/Bool\)'):
        next(bag_io.raw_messages(tmp_path / 'other'))
    assert bag_io.read_truth(tmp_path / 'other') is None


def test_truth_of_another_version_is_refused(tmp_path):
    _write_foreign_bag(tmp_path / 'other', custom=json.dumps({'version': 7}))
    with pytest.raises(BagError, match='version 7.*reads version 1'):
        bag_io.read_truth(tmp_path / 'other')


def test_missing_or_damaged_bag_is_refused(tmp_path, bag):
    with pytest.raises(BagError, match=r'no metadata\.yaml'):
        next(bag_io.raw_messages(tmp_path / 'nowhere'))
    (bag / 'bag.mcap').unlink()
    with pytest.raises(BagError, match='cannot be read'):
        bag_io.read_truth(bag)


def test_a_database_whose_tables_are_queries_is_refused(tmp_path):
    """SQLite would look for the last message for ever."""
    import contextlib
    import sqlite3

    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        writer.add_connection(bag_io.TOPIC, bag_io.MESSAGE_TYPE, typestore=store)
    with contextlib.closing(sqlite3.connect(tmp_path / 'bag' / 'bag.db3')) as db:
        db.execute('DROP TABLE messages')
        db.execute('CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT '
                   'i + 1 FROM n) SELECT i AS id, i AS topic_id, i AS timestamp, i AS data FROM n')
        db.commit()
    with pytest.raises(BagError, match=r'bag\.db3 holds the view messages'):
        bag_io.read_truth(tmp_path / 'bag')


@pytest.mark.parametrize(('place', 'expected'), [
    (0.4, 'checksum'),  # in the middle of samples
    (0.995, 'checksum|is damaged')])  # in the summary
def test_bytes_that_changed_are_told(bag, place, expected):
    file = bag / 'bag.mcap'
    content = bytearray(file.read_bytes())
    at = int(place * len(content))
    content[at:at + 8] = bytes(255 - value for value in content[at:at + 8])
    file.write_bytes(content)
    with pytest.raises(BagError, match=expected):
        list(bag_io.read_blocks(bag))


def test_messages_that_were_compressed_one_by_one(tmp_path, blocks):
    store, kind = get_typestore(Stores.ROS2_JAZZY), bag_io.MESSAGE_TYPE

    def write(name, *contents):
        writer = Writer(tmp_path / name, version=9, storage_plugin=StoragePlugin.SQLITE3)
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection(bag_io.TOPIC, kind, typestore=store)
            for time_ns, content in enumerate(contents):
                writer.write(connection, time_ns, content)
        return tmp_path / name

    [block] = bag_io.read_blocks(write('right', bag_io.serialise(blocks[0])))
    np.testing.assert_array_equal(block.samples, blocks[0].samples)
    with pytest.raises(BagError, match='expands to more than'):
        list(bag_io.read_blocks(write('bomb', bytes(10**8))))


@pytest.mark.parametrize('compression', ['BZ2', 'LZ4'])
def test_chunks_of_ros1_bags_expand_as_they_claim(tmp_path, compression):
    from rosbags import rosbag1

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = rosbag1.Writer(tmp_path / 'one.bag')
    writer.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression))
    with writer:
        connection = writer.add_connection('/ready', 'std_msgs/msg/Bool', typestore=store)
        writer.write(connection, 1, b'\1')
    check_bag(tmp_path / 'one.bag')
    content = (tmp_path / 'one.bag').read_bytes()
    place = content.index(b'size=') + 5
    (tmp_path / 'one.bag').write_bytes(content[:place] + b'\1\0\0\0' + content[place + 4:])
    with pytest.raises(ValueError, match='sizes contradict each other'):
        check_bag(tmp_path / 'one.bag')
