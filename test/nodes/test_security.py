# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Access control of SROS 2: the policy names what the nodes really have, and who may do what."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='the nodes need ROS')

import rclpy

import sar_imaging
from sar_imaging.nodes.afbp_fusion import FusionNode
from sar_imaging.nodes.backprojection import BackprojectionNode
from sar_imaging.nodes.localization import LocalizationNode
from sar_imaging.nodes.moving_targets import MovingTargetsNode
from sar_imaging.nodes.pulse_buffer import PulseBufferNode
from sar_imaging.nodes.range_compression import RangeCompressionNode
from sar_imaging.nodes.sar_pipeline import SarPipelineNode

from .conftest import wait

POLICY = Path(sar_imaging.__file__).parent / 'config' / 'sros2_policy.xml'
ENCLAVES = '/sar_imaging/'
RULES = {('topics', 'publish'), ('topics', 'subscribe'), ('services', 'reply'),
         ('services', 'request')}
# What nodes have without doing anything, and what tf adds where tf2_ros is installed.
TF = {'/tf', '/tf_static'}
# Settings that together make every topic.
SMALL = {'grid.size_x': 4.0, 'grid.size_y': 4.0, 'use_sim_time': True}
POSES = [{'pose.source': 'odometry', 'datum.source': 'fix'}, {'pose.source': 'pose'},
         {'pose.source': 'fix_imu', 'datum.source': 'fix'}]
SUBAPERTURES = {'mode': 'subapertures'}
VOLUME = {'mode': 'volume', 'volume.height': 1.0}
STRIP = {'strip_max_pixels': 1000, 'datum.source': 'fix'}
FOCUS = {'autofocus.time_offset': 1.0, 'autofocus.position_std': 0.1}
NODES = {PulseBufferNode: POSES,
         RangeCompressionNode: [{}],
         BackprojectionNode: [SUBAPERTURES, VOLUME, *(FOCUS | poses for poses in POSES)],
         FusionNode: [STRIP],
         MovingTargetsNode: [{'datum.source': 'fix'}],
         LocalizationNode: [{'map.folder': 'place', 'pose.source': source}
                            for source in ('odometry', 'pose')],
         SarPipelineNode: [POSES[0] | FOCUS, POSES[1] | SUBAPERTURES | STRIP, POSES[2], VOLUME]}


def rules(profile):
    """Names by kind and verb of a profile, in full."""
    node, namespace = profile.get('node'), profile.get('ns').rstrip('/')

    def full(name):
        if name.startswith('~/'):
            return f'{namespace}/{node}{name[1:]}'
        return name if name.startswith('/') else f'{namespace}/{name}'

    allowed = {}
    for part in profile:
        for verb, qualifier in part.attrib.items():
            assert (part.tag, verb) in RULES and qualifier == 'ALLOW'
            names = [full(e.text) for e in part]
            assert len(set(names)) == len(names), 'nothing twice'
            assert not any(c in name for name in names for c in '*?[ '), 'no wildcards'
            allowed[verb] = set(names)
    return allowed


@pytest.fixture(scope='module')
def policy():
    """Rules by the last part of the enclave's path."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    [enclaves] = root
    found = {}
    for enclave in enclaves:
        assert enclave.tag == 'enclave' and enclave.get('path').startswith(ENCLAVES)
        [profile] = enclave.findall('profiles/profile')
        name = enclave.get('path').removeprefix(ENCLAVES)
        assert profile.get('node') == name and name not in found
        found[name] = rules(profile)
    return found


def in_graph(node):
    """Names by verb that the graph knows of a node, without its namespace."""
    get = {'publish': node.get_publisher_names_and_types_by_node,
           'subscribe': node.get_subscriber_names_and_types_by_node,
           'reply': node.get_service_names_and_types_by_node}
    return {verb: {name.removeprefix(node.get_namespace())
                   for name, _ in names_of(node.get_name(), node.get_namespace())}
            for verb, names_of in get.items()}


@pytest.fixture(scope='module')
def graph(ros_environment):
    """The same of the nodes, from the graph of nodes that run in this process."""
    found, number = {}, 0
    for kind, variants in NODES.items():
        for values in variants:
            words = [word for name, value in (SMALL | values).items()
                     for word in ('-p', f'{name}:={str(value).lower()}')]
            # A namespace of its own: what goes is forgotten by its name, and later than it went.
            number += 1
            rclpy.init(args=['--ros-args', '-r', f'__ns:=/v{number}', *words])
            node = kind()
            try:
                assert node.start()
                made = {'publish': [p.topic_name for p in node.publishers],
                        'subscribe': [s.topic_name for s in node.subscriptions],
                        'reply': [s.service_name for s in node.services]}
                made = {verb: {name.removeprefix(node.get_namespace()) for name in names}
                        for verb, names in made.items()}
                # The graph also knows what the client library adds; it is told of all a bit later.
                wait(lambda n=node, m=made: all(m[verb] <= names
                                                for verb, names in in_graph(n).items()), 'graph')
                for verb, names in in_graph(node).items():
                    found.setdefault(kind.NAME, {}).setdefault(verb, set()).update(names)
                assert not list(node.clients)
            finally:
                node.destroy_node()
                rclpy.try_shutdown()
    return found


@pytest.mark.parametrize('kind', NODES, ids=lambda kind: kind.NAME)
def test_the_policy_names_exactly_what_a_node_has(policy, graph, kind):
    wanted = {verb: set(names) for verb, names in policy[kind.NAME].items()}
    if any('pose.source' in values for values in NODES[kind]):
        assert TF <= wanted['subscribe']  # which only nodes with tf2_ros subscribe to
        wanted['subscribe'] -= TF
        wanted['publish'] -= TF  # where publish_tf is true, by tf2_ros as well
    assert wanted == graph[kind.NAME]


def test_only_those_who_should_may(policy):
    def who(verb, *names):
        return {enclave for enclave, allowed in policy.items()
                if allowed.get(verb, set()) & set(names)}

    assert who('publish', '/pulses') == {'radar_driver'}
    poses = '/odometry', '/pose', '/fix', '/imu', '/tf', '/tf_static'
    assert who('publish', *poses) == {'localisation', 'localization'}
    assert policy['localization']['publish'] & set(poses) == {'/tf'}
    assert all('request' not in allowed for name, allowed in policy.items() if name != 'operator')
    assert policy['viewer']['publish'] == {'/rosout', '/parameter_events'}
    # Between the stages nobody else may put anything in.
    assert who('publish', '/pulse_blocks') == {'pulse_buffer', 'sar_pipeline'}
    assert who('publish', '/range_profiles') == {'range_compression', 'sar_pipeline'}
    assert who('publish', '/subaperture_images') == {'backprojection', 'sar_pipeline'}


def test_the_operator_may_ask_for_every_service_and_the_viewer_see_every_product(policy):
    nodes = [kind.NAME for kind in NODES]
    assert policy['operator']['request'] == set().union(
        *(policy[n]['reply'] for n in [*nodes, 'radar_driver']))
    inner = {'/pulse_blocks', '/range_profiles', '/subaperture_images', '/parameter_events'}
    products = {name for node in nodes for name in policy[node]['publish']
                if not name.startswith(f'/{node}/')} - inner
    assert products <= policy['viewer']['subscribe']


def test_the_page_names_every_enclave(policy, pytestconfig):
    page = (pytestconfig.rootpath / 'docs' / 'security.md').read_text()
    assert all(f'`{ENCLAVES}{name}`' in page for name in policy)


HOSTILE_FILES = ['/dev/zero', '/etc', '/proc/self/mem', 'nowhere', 'a\0b']


@pytest.mark.parametrize('name', HOSTILE_FILES)
@pytest.mark.parametrize(('kind', 'parameter'), [
    (RangeCompressionNode, 'calibration_file'), (BackprojectionNode, 'terrain.file')])
def test_files_that_are_none_are_refused_and_the_node_lives_on(ros_environment, kind, parameter,
                                                               name):
    rclpy.init(args=['--ros-args', '-p', 'grid.size_x:=4.0', '-p', 'grid.size_y:=4.0'])
    node = kind()
    try:
        [result] = node.set_parameters([rclpy.Parameter(parameter, value=name)])
        if result.successful:  # read when the node is configured
            assert not node.start()
            [result] = node.set_parameters([rclpy.Parameter(parameter, value='')])
            assert result.successful
        assert node.start()
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


# What rmw looks for in an enclave before it asks the middleware.
ARTIFACTS = ('identity_ca.cert.pem', 'cert.pem', 'key.pem', 'permissions_ca.cert.pem',
             'governance.p7s', 'permissions.p7s')


def test_security_that_cannot_be_enforced_ends_the_node_with_one_line(ros_environment, tmp_path):
    """The Fast DDS of the wheels has no security; elsewhere the empty keys are wrong."""
    enclave = tmp_path / 'enclaves' / 'sar_imaging' / 'pulse_buffer'
    enclave.mkdir(parents=True)
    for name in ARTIFACTS:
        (enclave / name).write_text('')
    security = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
                'ROS_SECURITY_KEYSTORE': str(tmp_path)}
    result = subprocess.run(
        [sys.executable, '-m', 'sar_imaging.nodes.pulse_buffer', '--ros-args', '--enclave',
         '/sar_imaging/pulse_buffer'], env=ros_environment | security, capture_output=True,
        text=True)
    assert result.returncode == 1
    assert 'Traceback' not in result.stderr
    assert 'the middleware cannot create the node: ' in result.stderr
