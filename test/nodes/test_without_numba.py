# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes where Numba and rosbags are not installed: slow images by NumPy, and a line for the rest.

Python finds neither package in these processes, as on a robot that lacks them.
"""

import re

import pytest
from nav_msgs.msg import OccupancyGrid

from msg_conversions.images import complex_from_message, map_metadata_from_message

BLOCKED = """\
import sys

for name in ('numba', 'llvmlite', 'rosbags'):
    sys.modules[name] = None  # an import fails as where the package is not installed
"""
SLOWLY = 'without Numba images are formed by NumPy, about a thousand times slower'


@pytest.fixture(scope='module', autouse=True)
def _nodes_are_forked():
    """They are not: the process that others are forked from has loaded Numba."""


@pytest.fixture(autouse=True)
def _blocked(ros_environment, tmp_path, monkeypatch):
    (tmp_path / 'sitecustomize.py').write_text(BLOCKED)
    path = ros_environment.get('PYTHONPATH', '')
    monkeypatch.setitem(ros_environment, 'PYTHONPATH', f'{tmp_path}:{path}'.rstrip(':'))


def test_images_are_right_and_obstacle_maps_refused(make_chain, psf):
    chain = make_chain(psf.truth, backprojection={'grid.size_x': 1.5, 'grid.size_y': 3.0})
    observer = chain.observer
    observer.subscribe(OccupancyGrid, 'obstacle_map')
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
    assert grid.n_x * grid.n_y < 500  # half a second of NumPy
    observer.send(psf.raw)
    [image] = observer.wait_for('image_complex', 1)
    n_pulses = psf.truth['pulses_per_aperture']
    # far better than what compiled code plans for
    assert psf.error_db(complex_from_message(image), grid, range(n_pulses)) < -80.0
    for name in ('range_compression', 'backprojection'):
        assert len(re.findall(SLOWLY, chain.log(name))) >= 1
    chain.wait_for_log('backprojection', 'no obstacle map of this image: .* needs Numba')


@pytest.mark.parametrize(('name', 'parameters', 'line'), [
    ('backprojection', {'backend': 'cpu'}, "parameter backend: backend='cpu' needs Numba"),
    ('backprojection', {'autofocus.track_error': 0.1}, 'autofocus.* needs Numba'),
    ('moving_targets', {}, 'a search for moving targets needs Numba')])
def test_a_node_that_cannot_work_says_so_in_a_line(start_node, name, parameters, line):
    node = start_node(name, parameters)
    assert node.exit_code(name) == 1
    assert re.search(line, node.log(name))
    assert 'docs/install.md' in node.log(name)
    assert 'Traceback' not in node.log(name)
