# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images on terrain by the node backprojection, and which files it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from msg_conversions.images import complex_from_message
from sar_imaging import numpy_files
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.terrain import Terrain
from sar_imaging.nodes.images import image_grid
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.tools.node_processes import parameters_from_truth


def test_pixels_lie_on_the_heights_of_the_file(start_node, make_observer, psf, tmp_path):
    grid = MapGrid.from_size(psf.truth['grid']['centre_m'], 6.0, 20.0, 0.25)
    x, y = grid.x_m[[0, -1]], grid.y_m[[0, 20]]  # the rest of the grid has no height
    path = tmp_path / 'slope.npz'
    Terrain(x, y, [[0.0, 30.0], [10.0, 40.0]]).save(path)
    node = start_node('backprojection', parameters_from_truth(psf.truth)['backprojection'] | {
        'grid.size_x': 6.0, 'grid.size_y': 20.0, 'grid.spacing': 0.25,
        'terrain.file': str(path)})
    observer = make_observer('range_profiles')
    node.wait_for_log('backprojection', 'subscriber on .*image_complex joined')
    observer.wait(lambda: observer.joined, 'a subscriber of the profiles')
    observer.send(psf.raw)
    image = complex_from_message(observer.wait_for('image_complex', 1)[0])
    assert node.stop('backprojection') == 0

    block = psf.pulses
    heights = Terrain.load(path).heights(grid)
    expected = exact_image(grid, block, height_m=heights)
    # The node adds the pulses block by block: another order of float32 sums.
    assert np.linalg.norm(image - expected) < 1e-5 * np.linalg.norm(expected)
    assert image[:21].all() and not image[21:].any()


def test_impossible_terrain_is_refused(start_node, tmp_path):
    Terrain([1e3, 2e3], [0.0, 1.0], np.zeros((2, 2))).save(tmp_path / 'there.npz')
    cases = (('absent', {}, 'does not exist'),
             ('there', {}, 'none of its known heights lies in the grid'),
             ('there', {'mode': 'subapertures'}, 'use mode image on terrain'))
    nodes = [start_node('backprojection', values | {'terrain.file': str(tmp_path / f'{name}.npz')})
             for name, values, _ in cases]
    for node, (_, _, text) in zip(nodes, cases, strict=True):
        assert node.exit_code('backprojection') == 1
        assert text in node.log('backprojection')
        assert 'parameter terrain.file' in node.log('backprojection')


def test_terrain_that_unpacks_to_more_than_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(numpy_files, 'available_bytes', lambda: 10_000_000)
    axis = np.linspace(0.0, 1.0, 1000)
    path = tmp_path / 'flat.npz'
    Terrain(axis, axis, np.zeros((1000, 1000))).save(path)  # 8 MB of zeros
    assert path.stat().st_size < 100_000
    with pytest.raises(ConfigurationError, match='parameter terrain.file: .*height_m of flat.npz '
                       'takes 0.008 GB, and 0.01 GB of memory are free'):
        image_grid.terrain_heights({'terrain.file': str(path)}, MapGrid((0, 0, 0), 2, 2, 0.1))
