# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the team 6 recording from what evaluate leaves behind."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from matplotlib.image import imread

from benchmarks.measured import team6_figures
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import bag_io
from sar_imaging.recordings.truth import make_truth
from sar_imaging.simulation import SCENARIOS

GRID = MapGrid.from_size((2.0, 1.0, 0.0), 4.0, 6.0, 0.05)
PLACE = [2.5, 0.0, 0.0]


@pytest.fixture
def folders(tmp_path):
    block = next(SCENARIOS['psf']().blocks(5))
    truth = make_truth(
        scenario='team6_rail', description='', grid=GRID, pulses_per_aperture=5, n_pulses=5,
        scatterers=[{'name': 'r', 'position_m': PLACE, 'amplitude_db': 0.0}],
        n_channels=block.n_channels, cut_half_width_m=(1.0, 1.0), radar=block.radar,
        compressed=True)
    bag_io.write_bag(tmp_path / 'bag', [block], truth)
    for name in ('team6_nominal', 'team6_fitted'):
        folder = tmp_path / name
        folder.mkdir()
        image = np.full(GRID.shape, 1e-3, np.complex64)
        row, column = (round(float(v)) for v in GRID.to_pixels(*PLACE[:2]))
        image[row - 2:row + 3, column - 2:column + 3] = 1j
        np.save(folder / 'image.npy', image)
        (folder / 'quality.json').write_text(json.dumps({
            'recording': str(tmp_path / 'bag'), 'grid': dataclasses.asdict(GRID)}))
    return [str(tmp_path / name) for name in ('team6_nominal', 'team6_fitted')]


def test_the_reflector_is_in_the_middle_of_its_picture(folders, tmp_path):
    assert team6_figures.main([*folders, '--output', str(tmp_path / 'out')]) == 0
    whole = imread(tmp_path / 'out' / 'team6_rail.png')
    zoomed = imread(tmp_path / 'out' / 'team6_reflectors.png')
    assert whole.shape[1] > whole.shape[0] > 400
    rgb = zoomed[..., :3].astype(float)
    orange = (rgb[..., 0] > 0.9) & (rgb[..., 1] < 0.7) & (rgb[..., 2] < 0.3)
    orange[int(0.7 * len(orange)):] = False  # the legend
    rows, columns = np.nonzero(orange)
    left = columns < zoomed.shape[1] * 0.4
    # The mark of the survey lies on the white square, in either picture.
    for half in (left, ~left):
        row, column = int(rows[half].mean()), int(columns[half].mean())
        around = rgb[row - 9:row + 10:6, column - 9:column + 10:6]
        assert np.median(around) > 0.9


def test_a_folder_without_results_is_told(tmp_path, capsys):
    assert team6_figures.main([str(tmp_path)]) == 1
    assert 'quality.json' in capsys.readouterr().err
