# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Antennas and mounts in degrees, as files tell them: the same as the patterns in radians."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.antenna import Antenna, Mount
from sar_imaging.geometry.illumination import PatternCut, Pointing

ANGLE = np.radians(np.linspace(-30, 30, 301))


@pytest.mark.parametrize(('values', 'expected'), [
    ({'pattern': 'sinc', 'azimuth_width_deg': 10}, PatternCut.sinc(np.radians(10))),
    ({'pattern': 'cosine', 'azimuth_width_deg': 20}, PatternCut.cosine(np.radians(20))),
    ({'pattern': 'gaussian', 'azimuth_width_deg': 10, 'cutoff_widths': 1.2},
     PatternCut.gaussian(np.radians(10), np.radians(12))),
    ({'pattern': 'uniform', 'azimuth_width_deg': 20, 'cutoff_widths': 0.6},
     PatternCut.uniform(np.radians(20), np.radians(4)))])
def test_patterns_by_width(values, expected):
    antenna = Antenna.from_dict(values)
    pattern = antenna.amplitudes()
    np.testing.assert_allclose(pattern.azimuth.at(ANGLE), expected.at(ANGLE), atol=1e-12)
    assert (pattern.elevation.at(ANGLE) == 1).all()
    assert Antenna.from_dict(antenna.as_dict()) == antenna
    if 'cutoff_widths' in values:
        end = np.degrees(pattern.azimuth.cutoff_rad[1])
        assert end == pytest.approx(values['cutoff_widths'] * values['azimuth_width_deg'])


def test_a_measured_gain_is_that_of_one_way(tmp_path):
    """At -3 dB of the gain the two-way amplitude is one half."""
    file = tmp_path / 'antenna.yaml'
    file.write_text('azimuth_deg: [-20, -10, 0, 10, 20]\n'
                    'azimuth_gain_db: [3.0, 17.0, 20.0, 17.0, 3.0]\n'
                    'elevation_deg: [-30, 30]\nelevation_gain_db: [0, -10]\n')
    pattern = Antenna.load(file).amplitudes()
    # the table has 1025 points, none of them exactly there
    assert float(pattern.azimuth.at(np.radians(10))) == pytest.approx(10 ** -0.3, abs=1e-3)
    assert float(pattern.azimuth.at(0.0)) == pytest.approx(1.0, abs=1e-3)
    assert float(pattern.azimuth.at(np.radians(21))) == 0
    assert float(pattern.elevation.at(np.radians(29.99))) == pytest.approx(0.1, abs=1e-2)
    antenna = Antenna.load(file)
    assert Antenna.from_dict(antenna.as_dict()) == antenna


@pytest.mark.parametrize(('values', 'text'), [
    ({'pattern': 'horn'}, "antenna pattern 'horn' is unknown; expected one of uniform"),
    ({'pattern': 'sinc'}, 'azimuth width 0 degrees; expected more than 0 and at most 180'),
    ({'pattern': 'sinc', 'azimuth_width_deg': 5, 'elevation_width_deg': -1}, 'elevation width'),
    ({'pattern': 'cosine', 'azimuth_width_deg': 5, 'cutoff_widths': 1}, 'expected 0'),
    ({'pattern': 'uniform', 'azimuth_width_deg': 5, 'cutoff_widths': 0.5}, 'more than 0.5 and at'),
    ({'pattern': 'measured'}, '0 angles azimuth_deg and 0 gains'),
    ({'azimuth_deg': [0, -5], 'azimuth_gain_db': [0, 0]}, 'expected ascending ones'),
    ({'pattern': 'sinc', 'azimuth_width_deg': 5, 'azimuth_deg': [1]}, 'has no table'),
    ({'pattern': 'sinc', 'azimuth_width_deg': 'wide'}, "azimuth_width_deg='wide'; expected a nu"),
    ({'width': 3}, 'expected pattern, azimuth_width_deg')])
def test_what_is_no_antenna_is_named(values, text):
    with pytest.raises(ValueError, match=text):
        Antenna.from_dict(values)


def test_files_that_hold_no_antenna_are_named(tmp_path):
    with pytest.raises(ValueError, match='nowhere.yaml cannot be read'):
        Antenna.load(tmp_path / 'nowhere.yaml')
    (tmp_path / 'bad.yaml').write_text('azimuth: 3')
    with pytest.raises(ValueError, match='bad.yaml holds no antenna: an antenna of'):
        Antenna.load(tmp_path / 'bad.yaml')


def test_mounts_are_the_pointing_in_degrees():
    n = 20
    stamp_ns = 1_700_000_000_000_000_000 + np.arange(n) * 10**8
    angle = np.linspace(0.0, 1.0, n)
    centre = np.stack([50 * np.sin(angle), 50 * np.cos(angle), np.full(n, 30.0)], axis=1)
    attitude = Rotation.from_euler('z', -angle[:, None])
    cases = {
        Mount('platform', boresight=(0, -1, -0.5), up=(0, 0, 1)):
            Pointing.fixed(attitude, (0, -1, -0.5)),
        Mount('track', side='right', squint_deg=10, depression_deg=30):
            Pointing.beside_track(centre, -1, np.radians(30), np.radians(10)),
        Mount('point', target_m=(1, 2, 3)): Pointing.steered(centre, (1, 2, 3)),
        Mount('rotation', rate_deg_per_s=9, start_deg=45, start_s=1_700_000_001.0):
            Pointing.rotating(np.arange(n) * 0.1 - 1, np.radians(9), np.radians(45))}
    for mount, expected in cases.items():
        found = mount.pointing(stamp_ns, centre, attitude)
        np.testing.assert_allclose(found.boresight, expected.boresight, atol=1e-12)
        np.testing.assert_allclose(found.up, expected.up, atol=1e-12)
        assert Mount.from_dict(mount.as_dict()) == mount
    with pytest.raises(ValueError, match='needs its attitude'):
        Mount('platform').pointing(stamp_ns, centre)


@pytest.mark.parametrize(('values', 'text'), [
    ({'kind': 'sideways'}, "'sideways' is unknown; expected one of platform, track"),
    ({'kind': 'track', 'side': 'port'}, "side 'port'; expected left or right"),
    ({'kind': 'track', 'squint_deg': 100}, 'expected -90 to 90'),
    ({'kind': 'point', 'target_m': [1, 2]}, 'expected x, y and z'),
    ({'kind': 'platform', 'boresight': [0, 0, 2]}, 'two directions in the body frame'),
    ({'kind': 'rotation', 'rate_deg_per_s': [1]}, 'expected numbers'),
    ({'side': 'left'}, 'expected kind')])
def test_what_is_no_mount_is_named(values, text):
    with pytest.raises(ValueError, match=text):
        Mount.from_dict(values)
