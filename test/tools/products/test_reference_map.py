# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`sar-imaging map` and `sar-imaging locate`: a second pass found in the map of the first."""

import json

import numpy as np
import pytest

from sar_imaging.formats.reference_map import read_reference_map


@pytest.fixture(scope='module')
def passes(tmp_path_factory):
    """The recordings of two passes over one scene, and the map of the first."""
    from sar_imaging.tools.command import main

    folder = tmp_path_factory.mktemp('passes')
    for name in ('first_pass', 'second_pass'):
        assert main(['simulate', name, '--output', str(folder / name)]) == 0
    for name, more in (('map', []), ('complex', ['--complex'])):
        assert main(['map', str(folder / 'first_pass'), *more, '--output',
                     str(folder / name)]) == 0
    return folder


def test_the_map_tells_grid_looks_and_floor(passes):
    reference = read_reference_map(passes / 'map')
    assert [one.name for one in reference.passes] == ['first_pass']
    assert reference.passes[0].look.azimuth_deg == pytest.approx(180.0, abs=1.0)
    assert reference.passes[0].look.grazing_deg == pytest.approx(45.0, abs=1.0)
    assert (reference.seen == 1).mean() > 0.99
    assert (passes / 'map' / 'obstacles.yaml').is_file()


def test_a_recording_is_found_in_the_map(run, passes, tmp_path):
    status, said, _ = run('locate', passes / 'second_pass', passes / 'map', '--output', tmp_path)
    assert status == 0 and 'moved by' in said
    told = json.loads((tmp_path / 'location.json').read_text())
    assert told['accepted'] and not told['refusal']
    assert told['translation_m'] == pytest.approx([0.0, 0.0], abs=0.03)
    assert len(told['covariance']) == 3 and told['false_match_probability'] < 1e-3
    assert told['coherence'] is None


def test_a_map_with_complex_images_tells_more_of_a_pass_beside_the_first(run, passes, tmp_path):
    plain, whole = (read_reference_map(passes / name) for name in ('map', 'complex'))
    np.testing.assert_array_equal(whole.image.samples, plain.image.samples)
    [speckle] = whole.speckle
    np.testing.assert_array_equal(np.abs(speckle.image.samples), whole.image.samples)
    assert speckle.phase_centre_m == pytest.approx((-707.0, 0.0, 707.0), abs=0.5)
    status, said, _ = run('locate', passes / 'second_pass', passes / 'complex', '--heights', '0',
                          '--output', tmp_path)
    assert status == 0 and 'by speckle of coherence 0.9' in said
    told = json.loads((tmp_path / 'location.json').read_text())
    assert told['accepted'] and told['coherence'] > 0.9
    # the tracks are exact, 1.4 m apart: a hundredth of a cell, 0.7 m by 0.2 m
    assert told['translation_m'] == pytest.approx([0.0, 0.0], abs=0.004)


def test_what_is_no_map_or_no_ground_is_refused(run, passes, tmp_path):
    status, _, wrong = run('locate', passes / 'second_pass', tmp_path, '--output', tmp_path / 'o')
    assert status != 0 and 'map.json' in wrong
    status, _, wrong = run('map', passes / 'first_pass', '--plane', 'slant', '--output', tmp_path)
    assert status != 0 and 'maps lie on the ground' in wrong
