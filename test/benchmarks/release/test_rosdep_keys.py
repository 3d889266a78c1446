# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Keys resolved by a small database of its own."""

import pytest

from benchmarks.release.rosdep_keys import by_apt, resolve

DISTRIBUTION = """\
release_platforms: {ubuntu: [noble]}
repositories:
  rclpy: {release: {version: 7.1.0-1}}
  messages: {release: {version: 1.0.0-1, packages: [std_msgs]}}
  only_source: {source: {version: main}}
"""
RULES = """\
python3-numpy: {debian: [python3-numpy], ubuntu: [python3-numpy]}
python3-thing-pip: {ubuntu: {pip: {packages: [thing]}}}
python3-old: {ubuntu: {'*': [python3-old], noble: null}}
"""


def test_keys_are_packages_of_ros_or_of_apt(tmp_path):
    for file, text in (('jazzy/distribution.yaml', DISTRIBUTION), ('rosdep/python.yaml', RULES),
                       ('rosdep/base.yaml', '{}')):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    there = {'rclpy': 'ros-jazzy-rclpy', 'std_msgs': 'ros-jazzy-std-msgs',
             'python3-numpy': 'python3-numpy'}
    not_there = dict.fromkeys(
        ['python3-thing-pip', 'python3-old', 'only_source', 'messages', 'unknown'], '')
    assert resolve([*there, *not_there], tmp_path, 'jazzy') == ('noble', there | not_there)


@pytest.mark.parametrize(('rule', 'packages'), [
    (['a'], ['a']), ({'noble': ['b'], '*': ['a']}, ['b']), ({'*': ['a']}, ['a']),
    ({'jammy': ['a']}, []), ({'apt': {'packages': ['a']}}, ['a']), (None, [])])
def test_rules_for_one_ubuntu(rule, packages):
    assert by_apt(rule, 'noble') == packages
