# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scale factors of SICD: other readers find the brightness that we compute."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.formats import read_sicd, write_sicd
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.radiometry import (
    QUANTITIES,
    RadarConstant,
    brightness,
    calibrated,
    image_response,
    noise_equivalent,
)

from .checker import failures

sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed: it needs Python 3.11')

CONSTANT = RadarConstant(3.2e8, 2e-4)
ELEMENTS = {'rcs': 'RCSSFPoly', 'sigma0': 'SigmaZeroSFPoly', 'beta0': 'BetaZeroSFPoly',
            'gamma0': 'GammaZeroSFPoly'}
# 0.0003, 0.0012 and 0.12 dB measured: fits, integers, and half a step of codes of 8 bits
PIXELS_DB = {'RE32F_IM32F': 0.002, 'RE16I_IM16I': 0.005, 'AMP8I_PHS8I': 0.15}


def by_sarkit(path):
    """Power of the pixels, and a function that evaluates a polynomial at all of them."""
    with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
        pixels, tree = reader.read_image(), reader.metadata.xmltree
    helper = sksicd.XmlHelper(tree)
    if pixels.dtype.names == ('real', 'imag'):
        power = pixels['real'].astype(float) ** 2 + pixels['imag'].astype(float) ** 2
    elif pixels.dtype.names:
        power = helper.load('{*}ImageData/{*}AmpTable')[pixels['amp']] ** 2
    else:
        power = np.abs(pixels) ** 2
    scp = helper.load('{*}ImageData/{*}SCPPixel')
    spacing = [helper.load(f'{{*}}Grid/{{*}}{name}/{{*}}SS') for name in ('Row', 'Col')]
    places = [(index - middle) * step for index, middle, step in zip(
        np.indices(power.shape), scp, spacing, strict=True)]
    return power, lambda name: np.polynomial.polynomial.polyval2d(
        *places, helper.load(f'{{*}}Radiometric/{{*}}{name}'))


def in_file(path, name):
    with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
        return reader.metadata.xmltree.find(f'{{*}}Radiometric/{{*}}{name}') is not None


def in_sicd_order(values, flown, grid):
    from sar_imaging.formats.sicd.layout import lay_out

    return lay_out(grid, flown.acquisition).ordered(values)


@pytest.fixture(name='flown', scope='module')
def flown_fixture(request):
    return request.getfixturevalue('flight')(heading_deg=37.0)


@pytest.mark.parametrize(('plane', 'quantity', 'pixel_type'), [
    ('ground', None, 'RE32F_IM32F'), ('slant', 'beta0', 'RE32F_IM32F'),
    ('ground', 'sigma0', 'RE16I_IM16I'), ('ground', 'beta0', 'AMP8I_PHS8I')])
def test_other_readers_find_our_brightness(flown, tmp_path, plane, quantity, pixel_type):
    image = flown.sicd_image(plane)
    block = flown.block
    response = image_response(image.grid, block.radar, block.tx_m, block.rx_m)
    written = image if quantity is None else calibrated(image, response, CONSTANT, quantity)
    path = tmp_path / 'image.nitf'
    write_sicd(path, written, flown.datum, flown.acquisition, pixel_type=pixel_type,
               response=response, constant=CONSTANT)
    assert failures(path) == {}
    power, polynomial = by_sarkit(path)
    bright = power > 1e-2 * power.max()  # integers and codes are coarse in what is darker
    names = QUANTITIES if plane == 'ground' else ('rcs', 'beta0')
    assert {name for name in QUANTITIES if in_file(path, ELEMENTS[name])} == set(names)
    for name in names:
        expected = in_sicd_order(brightness(image, response, CONSTANT, name), flown, image.grid)
        found_db = 10 * np.log10((power * polynomial(ELEMENTS[name]) / expected)[bright])
        assert np.abs(found_db).max() < PIXELS_DB[pixel_type], name
    noise = in_sicd_order(noise_equivalent(response, CONSTANT, 'beta0'), flown, image.grid)
    found_db = polynomial('NoiseLevel/{*}NoisePoly') + 10 * np.log10(polynomial('BetaZeroSFPoly'))
    assert found_db == pytest.approx(10 * np.log10(noise), abs=0.02)
    assert read_sicd(path).image.radiometry == written.radiometry


def test_sarpy_finds_our_sigma_nought(flown, tmp_path):
    converter = pytest.importorskip('sarpy.io.complex.converter', reason='sarpy is not installed')
    image = flown.sicd_image()
    block = flown.block
    response = image_response(image.grid, block.radar, block.tx_m, block.rx_m)
    path = tmp_path / 'image.nitf'
    write_sicd(path, image, flown.datum, flown.acquisition, response=response, constant=CONSTANT)
    reader = converter.open_complex(str(path))
    [meta] = reader.get_sicds_as_tuple()
    power = np.abs(reader[:]) ** 2
    row, column = np.indices(power.shape)
    x = (row - meta.ImageData.SCPPixel.Row) * meta.Grid.Row.SS
    y = (column - meta.ImageData.SCPPixel.Col) * meta.Grid.Col.SS
    found = power * meta.Radiometric.SigmaZeroSFPoly(x, y)
    expected = in_sicd_order(brightness(image, response, CONSTANT), flown, image.grid)
    assert found == pytest.approx(expected, rel=5e-4)  # 0.002 dB, as above
    assert meta.Radiometric.NoiseLevel.NoiseLevelType == 'ABSOLUTE'
    assert meta.Radiometric.RCSSFPoly(0, 0) == pytest.approx(
        (CONSTANT.gain * response.amplitude[tuple(n // 2 for n in image.shape)]) ** -2, rel=0.01)


def narrow(flown):
    """An antenna that darkens the edges of the image, and its illumination."""
    block = flown.block
    pattern = AntennaPattern(PatternCut.gaussian(0.0045))
    pointing = Pointing.steered(block.phase_centre_m, (0.0, 0.0, 0.0))
    return Illumination.of_pulses(pattern, pointing, block.tx_m, block.rx_m)


def test_what_a_narrow_antenna_darkens_is_written_calibrated(flown, tmp_path):
    """Factors of an image as formed would rise without bound; those of a calibrated one do not."""
    image, block = flown.sicd_image(), flown.block
    response = image_response(image.grid, block.radar, block.tx_m, block.rx_m,
                              illumination=narrow(flown), weighted=True)
    path = tmp_path / 'image.nitf'
    with pytest.raises(ValueError, match='calibrate the image .* before it is written'):
        write_sicd(path, image, flown.datum, flown.acquisition, response=response,
                   constant=CONSTANT)
    assert not path.exists()
    write_sicd(path, calibrated(image, response, CONSTANT, 'rcs'), flown.datum,
               flown.acquisition, response=response, constant=CONSTANT)
    power, polynomial = by_sarkit(path)
    expected = in_sicd_order(brightness(image, response, CONSTANT), flown, image.grid)
    lit = in_sicd_order(response.amplitude, flown, image.grid) > 0.1 * np.nanmax(
        response.amplitude)
    assert 0.2 < lit.mean() < 0.9
    found_db = 10 * np.log10((power * polynomial('SigmaZeroSFPoly') / expected)[lit])
    assert np.abs(found_db).max() < 0.1


@pytest.mark.parametrize(('change', 'text'), [
    ({'constant': None}, 'belong together'), ({'smaller': True}, 'expected that of the image'),
    ({'other': True}, 'expected the same constant')])
def test_what_does_not_belong_together_is_refused(flown, tmp_path, change, text):
    image, block = flown.sicd_image(size_m=12.0), flown.block
    response = image_response(image.grid, block.radar, block.tx_m, block.rx_m)
    if 'other' in change:
        image = calibrated(image, response, RadarConstant(1.0))
    if 'smaller' in change:
        response = dataclasses.replace(response, amplitude=response.amplitude[1:])
    constant = change.get('constant', CONSTANT)
    with pytest.raises(ValueError, match=text):
        write_sicd(tmp_path / 'image.nitf', image, flown.datum, flown.acquisition,
                   response=response, constant=constant)
