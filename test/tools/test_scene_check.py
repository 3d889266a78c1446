# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Warnings of `sar-imaging load` on scenes that no image can show."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from sar_imaging.tools.load import main

P = 24
TRACK_M = np.stack([np.linspace(-0.1, 0.1, P), np.zeros(P), np.ones(P)], axis=-1)
TREE = {
    'samples': {'file': 'd.npz', 'variable': 's', 'axes': ['pulse', 'sample']},
    'radar': {'waveform': 'fmcw', 'start_frequency_hz': 77e9, 'slope_hz_per_s': 30e12,
              'sample_rate_hz': 4e6},
    'times': {'first_s': 5.0, 'interval_s': 0.1}, 'poses': {'times': 't', 'positions': 'p'},
    'scene': {'centre_m': [0, 6, 0], 'size_m': [4, 4], 'spacing_m': 0.05}}
BEAM = {'pattern': 'sinc', 'azimuth_width_deg': 30}


def told(tmp_path, capsys, parts, track_m=TRACK_M, positions=False):
    """What the program warns of; of poses at the times of the pulses and between, or positions."""
    time_s = 4.9 + 0.05 * np.arange(2 * P + 4)
    between = np.stack([np.interp(time_s, 5.0 + 0.1 * np.arange(P), axis) for axis in track_m.T],
                       axis=-1)
    np.savez(tmp_path / 'd.npz', s=np.ones((P, 64), np.complex64), t=time_s, p=between, q=track_m)
    tree = {**TREE, **parts}
    if positions:
        tree['positions'] = {'variable': 'q'}
        del tree['poses']
    (tmp_path / 'd.yaml').write_text(yaml.safe_dump(tree))
    assert main([str(tmp_path / 'd.yaml'), '--output', str(tmp_path / 'bag')]) == 0
    lines = capsys.readouterr().err.splitlines()
    return [line.removeprefix('warning: ') for line in lines if line.startswith('warning: ')]


@pytest.mark.parametrize('positions', [False, True])
def test_a_scene_in_reach_that_the_antenna_lights_is_fine(tmp_path, capsys, positions):
    mount = {'kind': 'track', 'side': 'left'}
    parts = {'antenna': {**BEAM, 'pointing': mount}}
    assert told(tmp_path, capsys, parts, 10 * TRACK_M, positions) == []


@pytest.mark.parametrize('positions', [False, True])
def test_positions_in_millimetres_are_out_of_reach(tmp_path, capsys, positions):
    *others, text = told(tmp_path, capsys, {}, 1e3 * TRACK_M, positions)
    assert bool(others) == (not positions)
    assert all('of the poses jumped by' in t for t in others)
    # 64 samples at 4 MHz of 30 MHz/us: 480 MHz, 0.31 m each; the scene 1000 m below.
    assert text.startswith('the scene lies 1000 to 100')
    assert 'whose samples hold ranges from -' in text and 'unit (unit_m)' in text
    assert 'probably in millimetres' in text


@pytest.mark.parametrize('positions', [False, True])
def test_degrees_are_named(tmp_path, capsys, positions):
    degrees = TRACK_M / [111e3, 111e3, 1] + [47.1, 8.2, 0]
    texts = told(tmp_path, capsys, {}, degrees, positions)
    assert any('47.1000 and 8.2000 may be degrees of latitude and longitude' in t for t in texts)


@pytest.mark.parametrize('positions', [False, True])
def test_an_antenna_that_looks_away_is_named(tmp_path, capsys, positions):
    mount = {'kind': 'track', 'side': 'right'}
    [text] = told(tmp_path, capsys, {'antenna': {**BEAM, 'pointing': mount}}, 10 * TRACK_M,
                  positions)
    assert 'the antenna never looks at the scene' in text
    assert 'it looks towards (0.00, -1.00, 0.00)' in text
