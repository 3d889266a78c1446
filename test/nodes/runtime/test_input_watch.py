# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Where else an input is published, as its watch tells."""

import types

import pytest

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import QoSProfile

from sar_imaging.nodes.runtime.health import Cause
from sar_imaging.nodes.runtime.input_watch import InputWatch

TYPE = 'std_msgs/msg/Float32MultiArray'
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # as rmw names a node of which DDS has told the outputs only
RCLError = rclpy_implementation.RCLError


class Graph:
    """What a node sees of others: outputs by the name of each node, None of one that ended."""

    def __init__(self, outputs):
        self._outputs = outputs

    def get_name(self):
        return 'watching'

    def get_namespace(self):
        return '/'

    def get_topic_names_and_types(self):
        return [(topic, [TYPE]) for topics in self._outputs.values() for topic in topics]

    def get_publishers_info_by_topic(self, topic):
        return [types.SimpleNamespace(
                    node_name=node, topic_type=TYPE,
                    node_namespace='/' if node != UNKNOWN else '_NODE_NAMESPACE_UNKNOWN_')
                for node, topics in self._outputs.items() if topic in topics]

    def get_publisher_names_and_types_by_node(self, node, namespace):
        if node == 'ended':
            raise NodeNameNonExistentError(node)
        if not namespace.startswith('/'):
            raise RCLError('namespace must be absolute')
        return [(topic, [TYPE]) for topic in self._outputs[node]]


def test_outputs_of_stages_are_no_pulses():
    def told(**outputs):
        watch = InputWatch(Graph(outputs), '/pulses', TYPE, QoSProfile(depth=1),
                           patience_s=lambda: -1.0, advice='remap pulses', sender='the driver')
        cause, text, _ = watch.look()
        assert cause == Cause.NO_PUBLISHER
        return text.split(': ', 1)[1]

    stage = {'range_compression': ['/range_profiles', '/range_compression/progress']}
    assert told(**stage) == f'nobody publishes {TYPE}; is the driver running?'
    assert told(watching=['/pulses_of_mine']) == told(**stage)
    assert told(**stage, driver=['/radar/pulses'], ended=['/old']) == (
        f'nobody publishes there, {TYPE} is on /old, /radar/pulses; remap pulses')
    assert told(**stage, **{UNKNOWN: ['/new']}) == (
        f'nobody publishes there, {TYPE} is on /new; remap pulses')
