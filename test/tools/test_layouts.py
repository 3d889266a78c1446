# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Layouts of RViz and Foxglove that fit a configuration."""

import json

import pytest
import yaml

from sar_imaging.configuration.parameters import default_file, read_configuration
from sar_imaging.tools import layouts

RESOURCE = default_file().parents[1] / 'resource'
# Frame, longer side of the image in metres, distance of the lines of the grid.
PLATFORMS = {'airborne_x_band': ('map', 180.0, 20.0), 'drone_uwb': ('odom', 16.0, 2.0),
             'automotive_77ghz': ('odom', 6.0, 0.5)}


def made(folder, *arguments):
    """Both layouts of a configuration."""
    assert layouts.main([*arguments, '--output', str(folder)]) == 0
    [rviz] = folder.glob('*.rviz')
    [foxglove] = folder.glob('*.foxglove.json')
    return yaml.safe_load(rviz.read_text()), json.loads(foxglove.read_text())


def displays(rviz):
    return {d['Class'].rsplit('/', 1)[-1]: d for d in rviz['Visualization Manager']['Displays']}


@pytest.mark.parametrize('name', PLATFORMS)
def test_each_platform_fills_the_view_in_its_frame(tmp_path, name):
    frame, extent, cell = PLATFORMS[name]
    centre = read_configuration(default_file().with_name(f'{name}.yaml')).imaging().grid.centre_m
    rviz, foxglove = made(tmp_path, name)
    manager = rviz['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == frame
    view = manager['Views']['Current']
    assert 400 < view['Scale'] * extent < 600  # pixels of a window that is 1000 high
    assert (view['X'], view['Y']) == centre[:2]
    assert displays(rviz)['Grid']['Cell Size'] == cell
    assert displays(rviz)['TF']['Marker Scale'] < 0.1 * extent
    assert displays(rviz)['PointCloud2']['Size (m)'] < 0.02 * extent
    panel = foxglove['configById']['3D!map']
    assert panel['followTf'] == panel['layers']['grid']['frameId'] == frame
    assert extent < panel['cameraState']['distance'] < 2 * extent
    assert panel['cameraState']['targetOffset'] == list(centre)
    assert panel['layers']['grid']['size'] / panel['layers']['grid']['divisions'] == pytest.approx(
        cell, rel=0.05)  # a whole number of cells


def test_what_is_shipped_fits_the_default_configuration(tmp_path):
    rviz, foxglove = made(tmp_path, 'sar_imaging')
    shipped = yaml.safe_load((RESOURCE / 'sar_imaging.rviz').read_text())
    view, expected = (r['Visualization Manager']['Views']['Current'] for r in (rviz, shipped))
    assert view['Scale'] == pytest.approx(expected['Scale'], rel=0.01)  # of 100.25 m of pixels
    assert displays(rviz)['Grid']['Cell Size'] == displays(shipped)['Grid']['Cell Size']
    assert displays(rviz).keys() == displays(shipped).keys()
    shipped = json.loads((RESOURCE / 'sar_imaging.foxglove.json').read_text())
    assert foxglove['layout'] == shipped['layout']
    assert foxglove['configById'].keys() == shipped['configById'].keys()


def test_topics_are_those_of_the_namespace(tmp_path):
    plain = made(tmp_path / 'plain', 'drone_uwb')
    named = made(tmp_path / 'named', 'drone_uwb', '--namespace', '/radar1')

    def topics(rviz, foxglove):
        panels = foxglove['configById']
        shown = [d[key]['Value'] for d in rviz['Visualization Manager']['Displays']
                 for key in ('Topic', 'Update Topic') if key in d]
        return [*shown, *panels['3D!map']['topics'],
                panels['Image!quicklook']['imageMode']['imageTopic']]

    assert '/obstacle_map' in topics(*plain)
    assert topics(*named) == [f'/radar1{topic}' for topic in topics(*plain)]
    # What all radars share stays where it is.
    assert named[1]['configById']['DiagnosticSummary!nodes']['topicToRender'] == '/diagnostics'


def test_a_configuration_that_no_node_would_read_is_refused(tmp_path, capsys):
    path = tmp_path / 'wrong.yaml'
    path.write_text('/**/backprojection:\n  ros__parameters: {grid: {spaceing: 0.1}}\n')
    assert layouts.main([str(path), '--output', str(tmp_path / 'out')]) == 1
    assert 'did you mean grid.spacing?' in capsys.readouterr().err
    assert layouts.main(['nowhere', '--output', str(tmp_path / 'out')]) == 1
    assert 'shipped are airborne_x_band' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(('extent', 'cell'), [
    (0.9, 0.1), (1.6, 0.2), (6.0, 0.5), (16.0, 2.0), (100.25, 10.0), (180.0, 20.0), (400.0, 50.0)])
def test_cells_are_round_numbers(extent, cell):
    assert layouts._cell(extent) == pytest.approx(cell)
