# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""radar_driver with the messages of real drivers, built from their definitions, over DDS."""

from __future__ import annotations

import importlib
import os
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float32MultiArray

from benchmarks.support import driver_messages, message_packages
from benchmarks.support.driver_recordings import DRIVERS, FRAMES, POINT
from benchmarks.support.references import exact_image
from msg_conversions import pulse_block
from msg_conversions.radar_frames import FRAME_TYPES, LATCHED_INFO, short_name
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.range_compression import RangeCompressor

from .conftest import Nodes

pytestmark = [pytest.mark.compiler, pytest.mark.skipif(
    bool(message_packages.why_not()), reason=message_packages.why_not() or 'it can')]
ROOT = pathlib.Path(__file__).parents[2]


@pytest.fixture(scope='module')
def packages(tmp_path_factory, ros_environment):
    """Environment of nodes that know the messages; this process knows them, too."""
    folder = tmp_path_factory.mktemp('messages')
    path = os.pathsep.join([str(message_packages.PREFIX / 'bin'), os.environ['PATH']])
    built = subprocess.run(
        [sys.executable, '-m', 'benchmarks.support.message_packages', str(folder)], cwd=ROOT,
        capture_output=True, text=True,
        env={**os.environ, 'PATH': path, 'AMENT_PREFIX_PATH': str(message_packages.PREFIX)})
    assert built.returncode == 0, built.stderr
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield {**ros_environment, 'PYTHONPATH': os.pathsep.join(
            [str(folder), ros_environment.get('PYTHONPATH', '')])}


def message_class(name):
    package, _, short = name.partition('/msg/')
    return getattr(importlib.import_module(f'{package}.msg'), short)


def fields_of(name):
    for field, kind in message_class(name).get_fields_and_field_types().items():
        inner = re.fullmatch(r'(?:sequence<)?(\w+)/(\w+)>?', kind)
        yield field, inner and f'{inner[1]}/msg/{inner[2]}', kind.startswith('sequence<')


def plain(name):
    """Maker of messages that takes the numbers of NumPy."""
    def make(**values):
        empty = message_class(name)()
        return message_class(name)(**{
            field: value.tolist() if isinstance(value, np.ndarray)
            else type(getattr(empty, field))(value) if isinstance(value, (int, float)) else value
            for field, value in values.items()})

    return make


@pytest.fixture
def start(packages, make_observer, tmp_path):
    """Start the node for a driver; returns its observer and publishers by the types' names."""
    running = []

    def begin(sent):
        (tmp_path / 'radar.yaml').write_text(yaml.safe_dump(sent.description))
        kinds = list(dict.fromkeys(name for name, *_ in sent.messages))
        frames = next(name for name in kinds if short_name(name) in FRAME_TYPES)
        info = next((name for name in kinds if name != frames), '')
        node = Nodes(tmp_path / 'node', packages, {'radar_driver': {
            'description_file': str(tmp_path / 'radar.yaml'), 'message_type': frames,
            'info_type': info}})
        running.append(node)
        observer = make_observer('unused')
        observer.subscribe(Float32MultiArray, 'pulses')
        node.start('radar_driver')
        node.wait_for_log('radar_driver', 'subscriber on .*/pulses joined')
        publishers = {}
        for name in kinds:
            qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
            if short_name(name) in LATCHED_INFO:
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            publishers[name] = observer.node.create_publisher(
                message_class(name), 'radar_info' if name == info else 'radar_frames', qos)
        observer.wait(lambda: all(p.get_subscription_count() for p in publishers.values()),
                      'the subscriptions')
        return node, observer, publishers

    yield begin
    for node in running:
        assert node.stop('radar_driver') == 0, node.log('radar_driver')
        assert 'Traceback' not in node.log('radar_driver')


@pytest.mark.parametrize('name', DRIVERS)
def test_the_reflector_is_where_it_belongs(start, name):
    sent = DRIVERS[name]()
    node, observer, publishers = start(sent)
    n_frames = 0
    for kind, _, _, fields in sent.messages:
        publishers[kind].publish(driver_messages.fill(plain, fields, kind, fields_of))
        if short_name(kind) in FRAME_TYPES:
            n_frames += 1
            observer.wait_for('pulses', n_frames)
        else:
            node.wait_for_log('radar_driver', 'radar_info: waveform=')
    block = concatenate([pulse_block.from_message(m) for m in observer.messages['pulses']])
    np.testing.assert_array_equal(block.counter, np.arange(len(sent.samples)))
    # Whole numbers: half a step in each part; the factors of a driver magnify it by 1.2.
    np.testing.assert_allclose(block.samples, sent.samples, rtol=0, atol=0.9)
    if name not in ('xwr_raw', 'p440'):  # whose messages have no time
        away_s = (block.stamp_ns[::len(block.counter) // FRAMES] - sent.frame_ns) * 1e-9
        # Later frames cannot tell of earlier ones here: the first waits are longer, by chance
        # 0 to 8 ms, until the first short one.
        assert np.abs(away_s).max() <= (0.009 if sent.late_s else 0.0)
        assert np.abs(away_s[20:]).max() <= sent.late_s
    placed = PulseBlock(block.radar, False, block.stamp_ns, block.counter, block.samples,
                        *sent.centres)
    profiles = RangeCompressor.for_block(placed)(placed)
    grid = MapGrid.from_size(POINT, 0.6, 0.6, 0.01)
    image = np.abs(exact_image(grid, profiles))
    row, column = np.unravel_index(image.argmax(), image.shape)
    found = np.array([grid.x_m[column], grid.y_m[row]])
    assert np.abs(found - POINT[:2]).max() <= 0.011 + (0.07 if name == 'xwr_raw' else 0.0)


def test_incomplete_frames_are_counted_and_named(start):
    sent = DRIVERS['xwr']()
    sent.messages[3][3]['complete'] = False
    node, observer, publishers = start(sent)
    for kind, _, _, fields in sent.messages[:6]:
        publishers[kind].publish(driver_messages.fill(plain, fields, kind, fields_of))
        if short_name(kind) == 'ChirpInfo':
            node.wait_for_log('radar_driver', 'radar_info: waveform=')
    observer.wait_for('pulses', 4)
    observer.wait_for_counters('radar_driver', frames_received=5, frames_incomplete=1,
                               frames_converted=4)
    node.wait_for_log('radar_driver', 'left out the frame of 1763000000.04.* the driver lost')
