# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lever arms from tf: the names of the frames, and what is said where tf2_ros is missing."""

from __future__ import annotations

import importlib.util

import pytest

from sar_imaging.configuration.positions import lever_arms
from sar_imaging.nodes.poses.pose_input import check_frames, import_tf
from sar_imaging.nodes.runtime.parameters import ConfigurationError

needs_no_tf = pytest.mark.skipif(importlib.util.find_spec('tf2_ros') is not None,
                                 reason='tf2_ros is installed here')


def test_frames_are_names_with_commas_between():
    arms = [(0.0, 1.0, 2.0), (3.0, 4.0, 5.0)]
    for names, expected in (('', arms), ('  ', arms), ('antenna', ['antenna']),
                            ('radar/tx_1, radar/tx_2', ['radar/tx_1', 'radar/tx_2'])):
        check_frames(names)
        given = {'antenna.tx_frames': names, 'antenna.tx': [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]}
        assert lever_arms(given, 'antenna.tx') == expected
    for names in (',', 'a,,b', 'a,'):
        with pytest.raises(ValueError, match='has an empty name; expected frames such as'):
            check_frames(names)


@needs_no_tf
def test_what_asks_for_tf_is_said_where_it_is_missing():
    with pytest.raises(ConfigurationError, match='arms named, but tf2_ros is not installed: it '
                       'comes with a ROS installation .* or set antenna.tx'):
        import_tf('arms named', 'set antenna.tx')


@needs_no_tf
def test_antenna_frames_without_tf_end_the_node_with_one_clear_line(start_node):
    nodes = [start_node('pulse_buffer', {'pose.source': 'odometry', 'antenna.rx_frames': frames})
             for frames in ('rx_1, rx_2', 'rx_1,,rx_2')]
    for node, message in zip(nodes, (
            'antenna frames rx_1, rx_2 are named, but tf2_ros is not installed',
            'parameter antenna.rx_frames: '), strict=True):
        assert node.exit_code('pulse_buffer') == 1
        [line] = node.log('pulse_buffer').splitlines()
        assert message in line
