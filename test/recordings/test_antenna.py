# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions with an antenna: pulses come with their pointing, or the mount for the poses."""

import numpy as np
import pytest
import yaml

from sar_imaging.geometry.antenna import Antenna, Mount
from sar_imaging.recordings import DescriptionError, load

DESCRIPTION = {
    'name': 'scan', 'samples': {'file': 'data.npz', 'variable': 'echoes',
                                'axes': ['pulse', 'sample']},
    'radar': {'waveform': 'lfm', 'compressed': True, 'carrier_hz': 10e9, 'bandwidth_hz': 100e6,
              'sample_rate_hz': 120e6, 'range_start_m': 50.0},
    'times': {'interval_s': 0.1},
    'scene': {'centre_m': [0, 80, 0], 'size_m': [10, 10], 'spacing_m': 0.5}}
ARC = {'positions': {'arc': {'radius_m': 2.0, 'first_deg': 0, 'last_deg': 180},
                     'centre_m': [1, 2, 3]}}
LINE = {'positions': {'line': {'first_m': [-5, 0, 2], 'last_m': [5, 0, 2]}}}


def loaded(folder, **parts):
    np.savez(folder / 'data.npz', echoes=np.ones((20, 32), np.complex64),
             pose_s=np.arange(-2.0, 5.0, 0.1), place=np.zeros((70, 3)),
             turn=np.tile([0.0, 0, 0, 1], (70, 1)))
    (folder / 'd.yaml').write_text(yaml.safe_dump(DESCRIPTION | parts))
    return load(folder / 'd.yaml')


def test_an_arm_looks_outward(tmp_path):
    out = loaded(tmp_path, **ARC, antenna={'pattern': 'uniform', 'azimuth_width_deg': 70,
                                           'pointing': 'outward'})
    angle = np.linspace(0, np.pi, 20)
    np.testing.assert_allclose(out.block.pointing.boresight, np.stack(
        [np.cos(angle), np.sin(angle), 0 * angle], axis=1), atol=1e-12)
    assert out.antenna == Antenna('uniform', 70.0) and out.mount is None


def test_a_stripmap_looks_beside_its_line(tmp_path):
    out = loaded(tmp_path, **LINE, antenna={
        'azimuth_deg': [-10, 0, 10], 'azimuth_gain_db': [-12, 0, -12],
        'pointing': {'kind': 'track', 'side': 'left', 'depression_deg': 30}})
    np.testing.assert_allclose(out.block.pointing.boresight, np.broadcast_to(
        [0, np.sqrt(0.75), -0.5], (20, 3)), atol=1e-12)
    assert out.antenna.pattern == 'measured'


def test_nothing_told_is_nothing_lit(tmp_path):
    out = loaded(tmp_path, **LINE)
    assert out.antenna is None and out.block.pointing is None


@pytest.mark.parametrize(('antenna', 'positions', 'text'), [
    ({'pattern': 'sinc', 'azimuth_width_deg': 5}, LINE, 'antenna.pointing is missing'),
    ({'pattern': 'sinc', 'pointing': 'outward'}, ARC, 'antenna: antenna azimuth width 0'),
    ({'pattern': 'sinc', 'azimuth_width_deg': 5, 'pointing': 'outward'}, LINE,
     'outward with positions on an arc alone'),
    ({'pattern': 'sinc', 'azimuth_width_deg': 5, 'pointing': {'kind': 'platform'}}, LINE,
     'antenna.pointing: an antenna that is fixed to the platform needs its attitude'),
    ({'pattern': 'sinc', 'azimuth_width_deg': 5, 'pointing': {'kind': 'up'}}, LINE,
     "'up' is unknown; expected one of platform"),
    ({'widht': 5}, LINE, 'unknown key antenna.widht')])
def test_what_is_no_antenna_is_told(tmp_path, antenna, positions, text):
    with pytest.raises(DescriptionError, match=text):
        loaded(tmp_path, **positions, antenna=antenna)


def test_poses_have_a_mount(tmp_path):
    mount = {'kind': 'platform', 'boresight': [0, 1, -1]}
    out = loaded(tmp_path, poses={'times': 'pose_s', 'positions': 'place',
                                  'quaternions': 'turn'},
                 antenna={'pattern': 'cosine', 'azimuth_width_deg': 40, 'pointing': mount})
    assert out.mount == Mount('platform', boresight=(0, 1, -1))
    assert out.block.pointing is None and not out.block.has_positions
