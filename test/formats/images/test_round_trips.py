# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images come back from files as they went, to the bit where the type of the pixels allows it."""

import re

import numpy as np
import pytest

from sar_imaging.formats import read_geotiff, read_sicd, sicd_grid, write_geotiff, write_sicd
from sar_imaging.geometry import MapGrid

pytest.importorskip('rasterio', reason='rasterio is not installed')
MAP = MapGrid((2.0, -3.0, 0.0), 130, 120, 0.3)


def test_complex_geotiff_is_equal_to_the_bit(flight, tmp_path):
    flown = flight()
    image = flown.image(MAP)
    path = tmp_path / 'image.tif'
    write_geotiff(path, image, flown.datum, content='complex')
    back = read_geotiff(path)
    np.testing.assert_array_equal(back.image.samples, image.samples)
    assert (back.image.grid, back.datum, back.image.carrier_hz) == (
        MAP, flown.datum, image.carrier_hz)
    assert (back.image.report, back.image.stamp_ns) == (image.report, image.stamp_ns)
    np.testing.assert_array_equal(back.image.counters, image.counters)


@pytest.mark.parametrize('plane', ['ground', 'slant'])
def test_sicd_is_equal_to_the_bit(flight, tmp_path, plane):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    flown = flight(left=False, heading_deg=123.0, squint_m=400.0)
    grid = sicd_grid(flown.acquisition, (1.0, 2.0, 0.5), 30.0, 24.0, plane=plane)
    image = flown.image(grid)
    path = tmp_path / 'image.nitf'
    write_sicd(path, image, flown.datum, flown.acquisition)
    back = read_sicd(path)
    np.testing.assert_array_equal(back.image.samples, image.samples)
    # ECEF coordinates of 6 million metres hold 1e-9
    np.testing.assert_allclose(back.image.grid.points(), grid.points(), rtol=0, atol=1e-8)
    assert back.datum == flown.datum
    assert back.image.carrier_hz == pytest.approx(image.carrier_hz, rel=1e-15)
    acquisition = back.acquisition
    assert (acquisition.polarisation, acquisition.collector) == ('V:H', 'test radar')
    np.testing.assert_allclose(acquisition.stamp_ns, flown.block.stamp_ns, rtol=0, atol=2)
    np.testing.assert_allclose(acquisition.tx_m, flown.block.tx_m[:, 0], rtol=0, atol=1e-4)


@pytest.mark.parametrize(('pixel_type', 'error'), [
    # half a step of 15 bits in each part; half of 0.284 dB, and half of 1/256 of a turn
    ('RE16I_IM16I', np.sqrt(0.5) / 32767), ('AMP8I_PHS8I', np.hypot(0.0165, np.pi / 256))])
def test_sicd_of_integers(flight, tmp_path, pixel_type, error):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    flown = flight()
    image = flown.sicd_image(size_m=25.0)
    first, second = tmp_path / 'first.nitf', tmp_path / 'second.nitf'
    write_sicd(first, image, flown.datum, flown.acquisition, pixel_type=pixel_type)
    back = read_sicd(first)
    largest = np.abs(image.samples).max()
    if pixel_type == 'AMP8I_PHS8I':
        known = np.abs(image.samples) > 1e-3 * largest  # the table ends 72 dB below the largest
        missed = np.abs(back.image.samples / image.samples - 1)[known]
    else:
        missed = np.abs(back.image.samples - image.samples) / largest
    assert 0.5 * error < missed.max() < 1.001 * error
    # what the type holds survives as it is
    write_sicd(second, back.image, back.datum, back.acquisition, pixel_type=pixel_type)
    np.testing.assert_array_equal(read_sicd(second).image.samples, back.image.samples)


def test_metadata_survives_reading_and_writing(flight, tmp_path):
    sicd = pytest.importorskip('sarkit.sicd',
                               reason='sarkit is not installed: it needs Python 3.11')
    flown = flight(heading_deg=77.0)
    paths = [tmp_path / 'first.nitf', tmp_path / 'second.nitf']
    write_sicd(paths[0], flown.sicd_image(size_m=25.0), flown.datum, flown.acquisition)
    again = read_sicd(paths[0])
    write_sicd(paths[1], again.image, again.datum, again.acquisition)
    first, second = (_leaves(sicd, path) for path in paths)
    assert list(first) == list(second)
    for place, text in first.items():
        if place.endswith(('ImageCreation/DateTime', 'Parameter[2]')):
            continue  # time of writing; residual of the track, which is no longer the flown one
        assert _same(text, second[place]), (place, text, second[place])


def _leaves(sicd, path):
    with open(path, 'rb') as file, sicd.NitfReader(file) as reader:
        tree = reader.metadata.xmltree
    return {re.sub('{[^}]*}', '', tree.getelementpath(element)): element.text
            for element in tree.iter() if not len(element)}


def _same(one, other):
    try:
        # positions are sums of 6 million metres; high powers of the track are rounding
        return float(one) == pytest.approx(float(other), rel=1e-6, abs=1e-4)
    except ValueError:
        return one == other


def test_from_sicd_to_geotiff_and_back(flight, tmp_path):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    flown = flight(heading_deg=20.0)
    image = flown.sicd_image(size_m=25.0)
    sicd, tif, again = (tmp_path / name for name in ('a.nitf', 'a.tif', 'b.nitf'))
    write_sicd(sicd, image, flown.datum, flown.acquisition)
    first = read_sicd(sicd)
    write_geotiff(tif, first.image, first.datum, content='complex')
    second = read_geotiff(tif)
    write_sicd(again, second.image, second.datum, first.acquisition)
    np.testing.assert_array_equal(read_sicd(again).image.samples, image.samples)
