# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`sar-imaging image --height`: a recording of a raster scan as a point cloud."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sar_imaging.geometry import VolumeGrid
from sar_imaging.imaging.correlation import correlate_profiles
from sar_imaging.recordings import open_pulses
from sar_imaging.simulation.scenarios import SCENARIOS

VERTEX = [('x', '<f8'), ('y', '<f8'), ('z', '<f8'), ('intensity', '<f4')]


@pytest.fixture(name='raster', scope='module')
def raster_fixture(tmp_path_factory):
    """Recording of five things at different heights."""
    from sar_imaging.tools.command import main

    path = tmp_path_factory.mktemp('bags') / 'raster'
    assert main(['simulate', 'raster_scan', '--output', str(path)]) == 0
    return path


def test_a_raster_scan_becomes_a_cloud_and_a_picture(raster, run, tmp_path):
    status, out, err = run('image', raster, '--output', tmp_path, '--height', 1.2,
                           '--height-step', 0.04, '--threshold', 30)
    assert status == 0, err
    assert '31 layers from z = 0 m to 1.2 m, 0.04 m apart' in err
    assert {p.name for p in tmp_path.iterdir()} == {'volume.npy', 'volume.png', 'cloud.ply',
                                                    'quality.json'}
    assert (tmp_path / 'volume.png').read_bytes().startswith(b'\x89PNG')
    quality = json.loads((tmp_path / 'quality.json').read_text())
    body = (tmp_path / 'cloud.ply').read_bytes().partition(b'end_header\n')[2]
    cloud = np.frombuffer(body, VERTEX)
    assert len(cloud) == quality['points'] > 100 and quality['warnings'] == []
    points = np.stack([cloud[axis] for axis in 'xyz'], axis=-1)
    for thing in SCENARIOS['raster_scan']().scatterers:
        near = (np.abs(points - thing.position_m) < (0.04, 0.08, 0.05)).all(axis=1)
        power = 10 ** (cloud['intensity'][near] / 10)
        # half a layer, a third of the resolution
        np.testing.assert_allclose(power @ points[near] / power.sum(), thing.position_m,
                                   atol=0.02)
    # Time-domain correlation at random cells, as the file says where they are.
    image = np.load(tmp_path / 'volume.npy')
    grid = VolumeGrid(**{k: v for k, v in quality['grid'].items() if k != 'type'})
    assert image.shape == grid.shape == tuple(quality['shape']) == (31, 41, 41)
    index = [np.random.default_rng(1).integers(0, n, 60) for n in image.shape]
    [profiles] = open_pulses(raster).profiles(1e9)
    reference, inside = correlate_profiles(profiles, grid.positions(*index))
    assert inside.all()
    error = np.sum(np.abs(image[tuple(index)] - reference) ** 2) / np.mean(np.abs(image) ** 2) / 60
    assert 10 * np.log10(error) < quality['predicted_error_db'] < -60.0
    assert quality['measured_error']['error_db'] < quality['predicted_error_db']


def test_things_have_their_cross_sections(raster, run, tmp_path):
    """Closed form: amplitude a of each of N profiles is ``gain sqrt(rcs) / R^2`` on average."""
    gain = 16.0
    (tmp_path / 'radar.yaml').write_text(f'gain_m: {gain}\nnoise_power: 0.01\n')
    status, _, err = run('image', raster, '--output', tmp_path, '--height', 1.2, '--threshold',
                         30, '--brightness', 'rcs', '--radar-constant', tmp_path / 'radar.yaml')
    assert status == 0, err
    head, _, body = (tmp_path / 'cloud.ply').read_bytes().partition(b'end_header\n')
    assert b'intensity: radar cross section, dB relative to 1 m^2' in head
    cloud = np.frombuffer(body, VERTEX)
    points = np.stack([cloud[axis] for axis in 'xyz'], axis=-1)
    source = open_pulses(raster)
    for thing in SCENARIOS['raster_scan']().scatterers:
        distance = np.linalg.norm(source.tx_m[:, 0] - thing.position_m, axis=-1)
        expected = 20 * np.log10(abs(thing.amplitude) / gain / (distance**-2.0).mean())
        near = (np.abs(points - thing.position_m) < (0.04, 0.08, 0.05)).all(axis=1)
        # 0.03 dB measured, and -0.35 dB of the lamp, which lies half a cell off
        assert cloud['intensity'][near].max() == pytest.approx(expected, abs=0.6)
    told = json.loads((tmp_path / 'quality.json').read_text())['brightness']
    assert told['quantity'] == 'rcs' and told['gain_m'] == gain
    noise = 10 * np.log10(0.01 / source.n_pulses * 4.0**4 / gain**2)
    assert told['noise_equivalent_db'] == pytest.approx(noise, abs=0.6)  # at 4 m


def test_nothing_above_the_threshold_is_told(raster, run, tmp_path):
    status, out, _ = run('image', raster, '--output', tmp_path, '--centre', 0, 4, 0.5, '--size',
                         0.2, '--spacing', 0.05, '--height', 0.1, '--threshold', 90)
    assert status == 0 and 'warning: nothing is 90 dB above the median' in out
    assert b'element vertex 0\n' in (tmp_path / 'cloud.ply').read_bytes()


@pytest.mark.parametrize(('words', 'message'), [
    (('--height', 0), '--height 0: expected a positive number of metres'),
    (('--height', 'inf'), '--height inf: expected a positive'),
    (('--height', 1, '--height-step', -0.1), '--height-step -0.1: expected a positive'),
    (('--height', 1, '--threshold', 'nan'), '--threshold nan: expected a number of decibels'),
    (('--height', 1, '--points', 0), '--points 0: expected at least one'),
    (('--height', 1, '--plane', 'slant'), '--plane slant: the layers of a volume are level'),
    (('--height', 1, '--format', 'sicd'), '--format sicd: a volume becomes a point cloud'),
    (('--height', 1, '--brightness', 'sigma0'), 'of a volume have no area of ground; use rcs'),
    (('--height', 1.2, '--height-step', 1e-5, '--memory', 0.5),
     '41 by 41 by 120001 cells take 8.1 GB, 0.25 GB are allowed; ask for a smaller --size')])
def test_impossible_volumes_are_refused(raster, run, tmp_path, words, message):
    status, _, err = run('image', raster, '--output', tmp_path / 'out', *words)
    assert status == 1 and message in err
    assert not (tmp_path / 'out').exists()
