# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Configuration, launch and documentation say the same as the nodes' parameter tables."""

import re
import signal
import subprocess
import sys

import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import MapMetaData
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float32MultiArray, UInt8MultiArray

from msg_conversions.images import map_metadata_from_message
from sar_imaging.nodes import (
    afbp_fusion,
    backprojection,
    moving_targets,
    pulse_buffer,
    range_compression,
)
from sar_imaging.nodes.runtime.managed import AUTOSTART
from sar_imaging.nodes.runtime.stage import COMMON_PARAMETERS
from sar_imaging.nodes.sar_pipeline import SarPipelineNode
from sar_imaging.signal.windows import WINDOW_NAMES, parse_window
from sar_imaging.tools.launching import CONFIG

from .conftest import flatten

MODULES = {'pulse_buffer': pulse_buffer, 'range_compression': range_compression,
           'backprojection': backprojection, 'afbp_fusion': afbp_fusion,
           'moving_targets': moving_targets}
TYPES = {float: 'double', int: 'int', str: 'string', bool: 'bool', list: 'double[]'}


def table(name):
    return {p.name: p for p in (*MODULES[name].PARAMETERS, *COMMON_PARAMETERS, AUTOSTART)}


@pytest.fixture(scope='module')
def config_file(pytestconfig):
    return pytestconfig.rootpath / 'sar_imaging' / 'config' / 'sar_imaging.yaml'


@pytest.mark.parametrize('name', MODULES)
def test_the_configuration_file_lists_every_parameter_with_its_default(config_file, name):
    sections = yaml.safe_load(config_file.read_text())
    listed = {**dict(flatten(sections['/**']['ros__parameters'])),
              **dict(flatten(sections[f'/**/{name}']['ros__parameters']))}
    defaults = {p.name: p.default for p in table(name).values()}
    assert listed == defaults
    assert {k: type(v) for k, v in listed.items()} == {k: type(v) for k, v in defaults.items()}


def test_every_line_of_the_configuration_file_has_a_sentence(config_file):
    lines = config_file.read_text().splitlines()
    for before, line in zip(lines, lines[1:], strict=False):
        if re.match(r'\s*\w+: \S', line):
            assert re.match(r'\s*# [A-Z].*\.$', before), f'{line!r} has no sentence above it'


@pytest.mark.parametrize('name', MODULES)
def test_the_page_of_a_node_describes_every_parameter(pytestconfig, name):
    page = (pytestconfig.rootpath / 'docs' / 'nodes' / f'{name}.md').read_text()
    rows = {}
    for row in re.findall(
            r'^\| `[^`]+` \| [\w\[\]]+ \|.* (?:start|configure|any time) \|.*$', page,
            re.MULTILINE):
        cells = [c.strip() for c in row.strip('|').split('|')]
        rows[cells[0].strip('`')] = cells[1:6]
    expected = {}
    for p in table(name).values():
        limits = '' if p.minimum is None else (
            f'{type(p.default)(p.minimum)} to {type(p.default)(p.maximum)}')
        if p.check is parse_window:
            limits = (', '.join(WINDOW_NAMES) if name == 'range_compression'
                      else 'as of range_compression')  # which lists them for all
        limits = ', '.join(getattr(p.check, 'choices', ())) or limits
        default = str(p.default).lower() if isinstance(p.default, bool) else str(p.default)
        expected[p.name] = [TYPES[type(p.default)], default, limits, p.unit, p.changes]
    assert rows == expected


@pytest.fixture(scope='module')
def documented(pytestconfig):
    """Keys of the diagnostics on the page of a node."""
    folder = pytestconfig.rootpath / 'docs' / 'nodes'

    def keys(name):
        section = (folder / f'{name}.md').read_text().split('## Diagnostics')[1].split('## Log')[0]
        # Texts are absent until there is something to say.
        return re.findall(r'^\| `(\w+)`(?: \*)? \| (?!text:)', section, re.MULTILINE)

    return keys


def test_diagnostics_have_the_keys_of_the_pages(start_node, make_observer, documented):
    for name in (*MODULES, 'sar_pipeline'):
        start_node(name, {'stall_timeout_s': 3600.0})  # some are ready long before others
    observer = make_observer()
    for name in (*MODULES, 'sar_pipeline'):
        observer.wait(lambda n=name: observer.status(n) is not None
                      and observer.status(n).message == 'waiting for input',
                      f'diagnostics of {name}')
        assert observer.status(name).level == DiagnosticStatus.OK
        assert sorted(documented(name)) == sorted(observer.counters(name))
    # Each status belongs to one group of the aggregator.
    groups = yaml.safe_load((CONFIG / 'diagnostic_aggregator.yml').read_text())['analyzers'][
        'ros__parameters']
    words = [word for g in groups.values() if isinstance(g, dict) for word in g['contains']]
    for name in {s.name for array in observer.messages['/diagnostics'] for s in array.status}:
        assert sum(word in name for word in words) == 1, name
    # In the pipeline each stage has those that are its own.
    for name in MODULES.keys() - {'moving_targets'}:  # which stands beside the pipeline
        keys = [key for key in documented(name) if key not in documented('sar_pipeline')]
        assert sorted(keys) == sorted(observer.counters('sar_pipeline', name))


def test_parameters_of_several_stages_are_the_same_in_each():
    # In sar_pipeline they are one; moving_targets stands beside it.
    assert [step.NAME for step in SarPipelineNode.STEPS] == [
        name for name in MODULES if name != 'moving_targets']
    common = {p.name: p for p in (*COMMON_PARAMETERS, AUTOSTART)}
    for step in SarPipelineNode.STEPS:
        for parameter in step.PARAMETERS:
            assert common.setdefault(parameter.name, parameter) is parameter


def test_parameters_are_checked_and_used_while_the_node_runs(start_node, make_observer):
    start_node('range_compression')
    observer = make_observer()

    def set_parameter(name, value):
        return observer.set_parameter('range_compression', name, value)

    assert set_parameter('window', 'hamming') == (True, '')
    assert set_parameter('windw', 'hann') == (
        False, 'unknown parameters, without effect: windw (did you mean window?)')
    successful, reason = set_parameter('window', 'box')
    assert not successful
    assert "window='box' is unknown; use one of none" in reason
    assert set_parameter('oversampling', 2.5) == (True, '')
    successful, reason = set_parameter('oversampling', 3)  # which at the start would be taken
    assert not successful and 'DOUBLE' in reason
    successful, reason = set_parameter('oversampling', 100.0)
    assert not successful
    successful, reason = set_parameter('queue_depth', 7)
    assert not successful
    assert 'queue_depth is read when the node is configured; deactivate it and clean' in reason
    assert set_parameter('queue_depth', 50) == (True, '')  # which it is already
    successful, reason = set_parameter('autostart', False)
    assert not successful
    assert 'read-only' in reason


def test_map_metadata_is_there_before_any_image_for_who_asks_for_the_past(start_node,
                                                                         make_observer):
    start_node('backprojection').wait_for_log('backprojection', 'ready: ')
    observer = make_observer()  # which subscribes transient local
    volatile = []
    subscription = observer.node.create_subscription(MapMetaData, 'map_metadata', volatile.append,
                                                     10)
    observer.wait(subscription.get_publisher_count, 'the publisher of map_metadata')
    [message] = observer.wait_for('map_metadata', 1)
    assert map_metadata_from_message(message).shape == (401, 401)
    assert observer.node.get_publishers_info_by_topic('map_metadata')[0].qos_profile.durability \
        == DurabilityPolicy.TRANSIENT_LOCAL
    assert not volatile


def test_an_incompatible_publisher_is_reported(start_node, make_observer):
    node = start_node('pulse_buffer')
    observer = make_observer()
    observer.node.create_publisher(
        Float32MultiArray, 'pulses', QoSProfile(depth=1,
                                                reliability=ReliabilityPolicy.BEST_EFFORT))
    node.wait_for_log('pulse_buffer', 'no messages flow on /pulses: a publisher offers another '
                      'reliability than the subscription of this node; make both the same, here '
                      'by the parameter qos_overrides./pulses.subscription.reliability')
    observer.wait_for_counters('pulse_buffer', qos_incompatible=1)
    assert observer.status('pulse_buffer').level > DiagnosticStatus.OK


def test_an_incompatible_subscriber_is_reported(start_node, make_observer):
    node = start_node('range_compression')
    make_observer().node.create_subscription(
        Float32MultiArray, 'range_profiles', lambda message: None,
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    node.wait_for_log('range_compression', 'no messages flow on /range_profiles: a subscriber '
                      'asks for another durability than the publisher of this node; make both '
                      'the same, here by the parameter '
                      'qos_overrides./range_profiles.publisher.durability')


def test_messages_of_another_type_are_reported(start_node, ros_environment):
    node = start_node('pulse_buffer')
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        driver = rclpy.create_node('driver', context=context)
        driver.create_publisher(UInt8MultiArray, 'pulses', 1)
        node.wait_for_log('pulse_buffer', r'/pulses carries std_msgs/msg/UInt8MultiArray; '
                          r'expected std_msgs/msg/Float32MultiArray \(docs/wire_format.md\)')
        driver.destroy_node()
    finally:
        rclpy.shutdown(context=context)


@pytest.mark.parametrize('first', ['file', 'argument'])
def test_the_command_line_counts_whatever_the_file_says(ros_environment, tmp_path, first):
    path = tmp_path / 'radar.yaml'
    path.write_text('/**:\n  ros__parameters: {window: hann, windw: hann, grid.spacing: 1.0}\n'
                    '/**/range_compression:\n  ros__parameters: {window: taylor}\n')
    options = [['--params-file', str(path)], ['-p', 'window:=hamming']]
    if first == 'argument':
        options.reverse()
    with subprocess.Popen(
            [sys.executable, '-m', 'sar_imaging.nodes.range_compression', '--ros-args',
             *options[0], *options[1]], env=ros_environment, stderr=subprocess.PIPE, text=True,
            start_new_session=True) as process:
        lines = []
        for line in process.stderr:
            lines.append(line)
            if 'ready' in line:
                break
        process.send_signal(signal.SIGINT)
    assert 'hamming' in lines[-1]
    [told] = [line for line in lines if 'unknown parameters' in line]
    assert 'windw (did you mean window?)' in told
    assert 'grid.spacing' not in told  # of other nodes


def test_a_flood_of_bad_messages_is_counted_and_summed_up_in_the_log(start_node, make_observer):
    node = start_node('pulse_buffer')
    observer = make_observer()
    observer.wait(lambda: observer.joined, 'a subscriber of the pulses')
    message = Float32MultiArray()
    message.data.frombytes(bytes(4))
    observer.send_messages([message] * 45)  # fewer than the middleware keeps
    observer.wait_for_counters('pulse_buffer', blocks_rejected=45)
    node.wait_for_log('pulse_buffer', r'\d+ more messages were not logged; see /diagnostics')
    assert node.log('pulse_buffer').count('rejected a message') < 45
