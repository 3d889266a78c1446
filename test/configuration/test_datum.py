# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The datum in a parameter file: one for all nodes, told once."""

import pytest
import yaml

from sar_imaging.configuration.parameters import default_file, interpret, load_tree
from sar_imaging.configuration.positions import check_positions, position_rows
from sar_imaging.geometry.earth import Datum
from sar_imaging.recordings.bag_io import read_truth
from sar_imaging.recordings.recording import read_recording
from sar_imaging.tools import simulate
from sar_imaging.tools.node_processes import parameters_from_truth

PLACE = {'source': 'parameters', 'latitude_deg': 47.25, 'longitude_deg': 8.5, 'height_m': 450.0,
         'heading_deg': 12.5}


def configuration(**sections):
    """A file with these parameters, `all` being the section for all nodes."""
    tree = {f'/**/{name}' if name != 'all' else '/**': {'ros__parameters': values}
            for name, values in sections.items()}
    return interpret(tree, load_tree(default_file()))


def errors(**sections):
    return [f.text for f in check_positions(configuration(**sections).nodes, None)]


def test_a_datum_for_all_nodes_is_fine(acquisition):
    assert errors(all={'datum': PLACE}) == []
    nodes = configuration(all={'datum': PLACE}).nodes
    assert ('datum', '47.250000000, 8.500000000, height 450.000 m, heading 12.5000',
            'origin of frame map, and bearing of its y axis clockwise from north'
            ) in position_rows(nodes, acquisition)
    found = configuration(all={'datum': {'source': 'fix'}, 'pose': {'source': 'odometry'}},
                          pulse_buffer={'datum': {'heading_baseline_m': 50.0}}).nodes
    assert check_positions(found, None) == []
    assert ('datum', 'fix', 'the first good fix tells the origin of frame map; the heading from '
            'places 50 m apart') in position_rows(found, acquisition)


@pytest.mark.parametrize(('sections', 'expected'), [
    ({'backprojection': {'datum': PLACE}}, 'datum is not the same in all nodes: '),
    ({'all': {'datum': {'latitude_deg': 47.25}}}, 'but datum.source is none: set'),
    ({'all': {'datum': PLACE | {'latitude_deg': 147.25}}}, 'latitude_deg=147.25; expected -90'),
    ({'all': {'datum': {'source': 'fix'}}}, 'pose.source=block has none'),
    ({'all': {'pose': {'source': 'fix'}}}, 'pose.source=fix needs to know where the frame is'),
    ({'all': {'datum': PLACE}, 'pulse_buffer': {'datum': {'heading_baseline_m': 5.0}}},
     'but datum.source is parameters: set datum.source to fix'),
    ({'all': {'datum': PLACE, 'pose': {'source': 'fix'}},
      'pulse_buffer': {'antenna': {'tx_frames': 'antenna'}, 'gnss': {'antenna': [0.0, 0.0, 1.0]}}},
     'gnss.antenna, antenna.tx_frames: lever arms turn with the platform')])
def test_what_cannot_work_is_an_error(sections, expected):
    [text] = errors(**sections)
    assert expected in text


def test_a_configured_datum_goes_into_the_recording_and_back_to_the_nodes(tmp_path):
    tree = yaml.safe_load(default_file().with_name('drone_uwb.yaml').read_text())
    tree['/**']['ros__parameters'] |= {'datum': PLACE, 'pulses_per_aperture': 4}
    file = tmp_path / 'here.yaml'
    file.write_text(yaml.safe_dump(tree))
    assert simulate.main(['--config', str(file), '--output', str(tmp_path / 'bag')]) == 0
    assert read_recording(tmp_path / 'bag').datum == Datum(47.25, 8.5, 450.0, 12.5)
    parameters = parameters_from_truth(read_truth(tmp_path / 'bag'))
    told = {f'datum.{name}': value for name, value in PLACE.items()}
    assert all(told.items() <= values.items() for values in parameters.values())
