# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The antenna of SICD files, as the standard says it."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.formats import Acquisition, write_sicd
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.image import Image, Report

from .checker import failures

sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed: it needs Python 3.11')

PATTERN = AntennaPattern(PatternCut.gaussian(0.03), PatternCut.cosine(0.2))


def written(flown, tmp_path, pointing, pattern=PATTERN):
    """Tree of a file of an image, by pulses whose antenna looked somewhere."""
    block = dataclasses.replace(flown.block, pointing=pointing)
    grid = flown.sicd_image(size_m=6.0).grid
    image = Image(np.ones(grid.shape, np.complex64), grid, block.radar.carrier_hz,
                  Report('exact', '', -60.0))
    path = tmp_path / 'image.nitf'
    write_sicd(path, image, flown.datum, Acquisition.of(block, antenna=pattern))
    assert failures(path) == {}
    with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
        return reader.metadata.xmltree


@pytest.mark.parametrize('pointing', ['steered', 'beside'])
def test_other_readers_find_the_gain_towards_a_place(flight, tmp_path, pointing):
    flown = flight(heading_deg=37.0)
    block = flown.block
    looks = (Pointing.steered(block.phase_centre_m, (4.0, 5.0, 0.0)) if pointing == 'steered' else
             Pointing.beside_track(block.phase_centre_m, 1, np.arctan(0.5)))
    helper = sksicd.XmlHelper(written(flown, tmp_path, looks))
    gain = helper.load('{*}Antenna/{*}TwoWay/{*}Array/{*}GainPoly')
    axes = [helper.load(f'{{*}}Antenna/{{*}}TwoWay/{{*}}{name}AxisPoly') for name in 'XY']
    start_s = helper.load('{*}ImageFormation/{*}TStartProc')
    lit = Illumination.of_pulses(PATTERN, looks, block.tx_m, block.rx_m)
    for pulse, place in ((0, (0.0, 0.0, 0.0)), (48, (20.0, 30.0, 0.0)), (95, (-20.0, 9.0, 0.0))):
        time_s = start_s + (block.stamp_ns[pulse] - block.stamp_ns[0]) * 1e-9
        x, y = (np.polynomial.polynomial.polyval(time_s, part) for part in axes)
        look = flown.datum.to_ecef(place) - flown.datum.to_ecef(block.tx_m[pulse, 0])
        look /= np.linalg.norm(look)
        found_db = np.polynomial.polynomial.polyval2d(x @ look, y @ look, gain)
        expected_db = 20 * np.log10(lit.amplitude(np.array(place))[pulse])
        # 0.04 dB measured: axes by order 5 of time, too
        assert found_db == pytest.approx(expected_db, abs=0.1)


SKEWED = Antenna('measured', azimuth_deg=(-2, -1, 0, 0.5, 2),
                 azimuth_gain_db=(-20, -4, 0, -1, -30), elevation_deg=(-8, 0, 10),
                 elevation_gain_db=(-12, 0, -9)).amplitudes()
_RISE = np.radians(np.linspace(-12, 12, 49))
# Of a surveillance antenna: the gain falls at once to one side, which no polynomial follows.
SPIKE = AntennaPattern(PatternCut.gaussian(0.03), PatternCut.measured(
    _RISE, np.exp(-np.where(_RISE < 0, -40.0, 6.0) * _RISE)))


@pytest.mark.parametrize(('pattern', 'within_db', 'told'), [
    (PATTERN, 0.06, False), (SKEWED, 0.1, False), (SPIKE, 2.0, True)])
def test_polynomials_follow_the_main_lobe_or_tell_by_how_much_not(
        flight, tmp_path, caplog, pattern, within_db, told):
    """Coefficients as sarkit reads them beside the pattern, where both ways are above -20 dB."""
    flown = flight(heading_deg=37.0)
    looks = Pointing.steered(flown.block.phase_centre_m, (4.0, 5.0, 0.0))
    tree = written(flown, tmp_path, looks, pattern)
    gain = sksicd.XmlHelper(tree).load('{*}Antenna/{*}TwoWay/{*}Array/{*}GainPoly')
    angles = [np.linspace(*cut.cutoff_rad, 201) for cut in (pattern.azimuth, pattern.elevation)]
    azimuth, elevation = np.meshgrid(*angles, indexing='ij')
    wanted_db = 20 * np.log10(np.maximum(
        pattern.azimuth.at(azimuth) * pattern.elevation.at(elevation)
        / (pattern.azimuth.at(0.0) * pattern.elevation.at(0.0)), 1e-9))
    x = np.sin(azimuth)
    y = -np.sin(elevation) * np.cos(azimuth)  # down
    missed_db = np.abs(np.polynomial.polynomial.polyval2d(x, y, gain) - wanted_db)
    worst = missed_db[wanted_db > -20].max()
    # 0.041, 0.068 and 1.2 dB measured; order 6 missed the second one by 1.9 dB
    assert worst < within_db
    residual = float(tree.findtext(
        '{*}CollectionInfo/{*}Parameter[@name="sar_imaging antenna gain residual, dB"]'))
    assert worst == pytest.approx(residual, rel=0.2, abs=0.005)
    assert ('SICD has no tables' in caplog.text) == told


@pytest.mark.parametrize(('pointing', 'pattern'), [
    ('none', PATTERN), ('spinning', PATTERN),
    ('steered', AntennaPattern(PatternCut.measured([0.01, 0.02], [1.0, 0.5])))])
def test_what_polynomials_cannot_tell_is_left_out(flight, tmp_path, pointing, pattern):
    flown = flight(heading_deg=37.0)
    centre = flown.block.phase_centre_m
    looks = {'none': lambda: None, 'steered': lambda: Pointing.steered(centre, (0.0, 0.0, 0.0)),
             'spinning': lambda: Pointing.rotating(np.arange(len(centre)) * 0.015, 20.0)}
    assert written(flown, tmp_path, looks[pointing](), pattern).find('{*}Antenna') is None
