# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files for other programs: values to the bit, places on the Earth, and what made them."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from sar_imaging.archive.catalogue import reduced, write_archive_report
from sar_imaging.archive.pieces import ArchiveDataError, ProductPiece
from sar_imaging.archive.provenance import check_mosaic
from sar_imaging.archive.scans import RecordingScan, ScanLoss, write_scan
from sar_imaging.archive.storage import image_array
from sar_imaging.archive.tiles import stored_looks

rasterio = pytest.importorskip('rasterio', reason='the extra formats is not installed')
pyproj = pytest.importorskip('pyproj', reason='the extra formats is not installed')


@pytest.fixture
def imaged(imaged):
    for piece in [*imaged.mosaic_tiles(), *imaged.strip_tiles('flight-1')]:
        imaged.compute(piece)
    return imaged


def product(archive, name, subject='', scan=None, extent=None):
    return archive.compute(ProductPiece(key=f'{name} {subject}', product=name, subject=subject,
                                        scan=scan, extent=extent))


def missed_m(file, window, job, row, column):
    """Distance of a pixel of a file from where the map's lattice has it."""
    back = pyproj.Transformer.from_crs(file.crs, 4326, always_xy=True)
    longitude, latitude = back.transform(*file.xy(row, column))
    true = window.grid(job.spacing_m).positions(row, column)
    height = job.datum.to_geographic(true)[2]
    return np.linalg.norm(job.datum.from_geographic(latitude, longitude, height) - true)


def test_mosaic_as_geotiff(imaged):
    result = product(imaged, 'mosaic geotiff', extent=imaged.mosaic)
    assert result.files == ('mosaic.tif', 'mosaic_looks.tif')
    arrays = stored_looks(imaged.output, '', imaged.mosaic, imaged.job.tile)
    for name, array in zip(result.files, arrays, strict=True):
        with rasterio.open(imaged.output / name) as file:
            values = array.read(imaged.mosaic)
            np.testing.assert_array_equal(file.read(1), values)
            assert file.dtypes == (values.dtype.name,)
            assert file.tags(ns='IMAGE_STRUCTURE')['LAYOUT'] == 'COG'
            for row, column in ((0, 0), (100, 200)):
                assert missed_m(file, imaged.mosaic, imaged.job, row, column) < 0.005
    assert not list(imaged.output.glob('*.part'))


def test_image_and_strip_as_geotiff(imaged):
    scan = imaged.scans[0]
    product(imaged, 'image geotiff', scan.name, scan, scan.window)
    samples = image_array(imaged.output, scan.name, scan.window, 64).read(scan.window)
    with rasterio.open(imaged.output / 'images' / f'{scan.name}.tif') as file:
        level = file.read(1)
        np.testing.assert_allclose(10 ** (level / 20), np.abs(samples), rtol=1e-5)
        assert missed_m(file, scan.window, imaged.job, 11, 5) < 0.005
    strip = imaged.strip_tiles('flight-1')[0].extent
    assert product(imaged, 'strip geotiff', 'flight-1', extent=strip).files[0] == (
        'strips/flight-1.tif')


def test_a_map_too_large_for_one_transform_is_refused(imaged):
    """A UTM zone 20 degrees away bends by more than a quarter of a pixel."""
    job = dataclasses.replace(imaged.job, crs='EPSG:32636')
    piece = ProductPiece(key='g', product='mosaic geotiff', extent=dataclasses.replace(
        imaged.mosaic, row1=imaged.mosaic.row0 + 64 * 1000))
    with pytest.raises(ArchiveDataError, match='0.25 m are allowed: divide the map'):
        imaged.compute(piece, job)


def test_without_datum_there_is_one_line(imaged):
    job = dataclasses.replace(imaged.job, datum=None)
    piece = ProductPiece(key='g', product='catalogue', extent=imaged.mosaic)
    [text] = imaged.compute(piece, job).warnings
    assert 'where on the Earth the map is; give datum' in text


def test_sicd_of_an_aperture(imaged):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    from sar_imaging.formats import read_sicd

    scan = imaged.scans[2]
    result = product(imaged, 'image sicd', scan.name, scan, scan.window)
    read = read_sicd(imaged.output / result.files[0])
    assert result.predicted_error_db < imaged.job.target_db
    # the same place is as bright on both grids: the brightest pixel is that of the map
    samples = image_array(imaged.output, scan.name, scan.window, 64).read(scan.window)
    at = np.unravel_index(np.abs(samples).argmax(), samples.shape)
    place = scan.window.grid(imaged.job.spacing_m).positions(*at)
    own = np.unravel_index(np.abs(read.image.samples).argmax(), read.image.shape)
    found = imaged.job.datum.from_ecef(read.datum.to_ecef(read.image.grid.positions(*own)))
    assert np.linalg.norm(found - place) < 2.5  # a resolution cell
    job = dataclasses.replace(imaged.job, memory_bytes=4.001e8)
    with pytest.raises(ArchiveDataError, match='allow more memory, or leave sicd out'):
        imaged.compute(ProductPiece(key='s', product='image sicd', scan=scan), job)


def test_catalogue_says_where_everything_came_from(imaged):
    pystac = pytest.importorskip('pystac', reason='pystac is not installed')
    product(imaged, 'mosaic geotiff', extent=imaged.mosaic)
    product(imaged, 'image geotiff', imaged.scans[0].name, imaged.scans[0], imaged.scans[0].window)
    result = product(imaged, 'catalogue')
    assert result.found == {'items': 6}
    catalogue = pystac.Collection.from_file(imaged.output / 'catalog.json')
    items = {item.id: item for item in catalogue.get_items()}
    assert schema_errors('collection', json.loads(
        (imaged.output / 'catalog.json').read_text())) == []
    for name in items:
        told = json.loads((imaged.output / 'items' / f'{name}.json').read_text())
        assert schema_errors('item', told) == []
    scan = imaged.scans[0]
    image = items[f'image-{scan.name}']
    assert image.properties['sar_imaging:pulses'] == 48
    assert image.properties['sar_imaging:recording'] == str(scan.path)
    assert image.properties['sar_imaging:parameters']['target_db'] == -50.0
    assert image.properties['sar_imaging:digest'] == imaged.job.digest()
    assert image.properties['sar_imaging:predicted_error_db'] < -50
    assert image.properties['sar_imaging:measured_error_db'] < -40
    assert image.properties['processing:software']['sar_imaging']
    [source] = image.get_links('derived_from')
    assert source.get_absolute_href() == str(scan.path)
    assert set(image.assets) == {'zarr', 'geotiff'}
    mosaic = items['mosaic']
    assert {link.get_absolute_href() for link in mosaic.get_links('derived_from')} == {
        items[f'image-{s.name}'].get_self_href() for s in imaged.scans}
    assert set(mosaic.assets) == {'zarr', 'power', 'looks', 'overview'}
    for item in items.values():
        for asset in item.assets.values():
            assert (imaged.output / 'items' / asset.href).exists()
        west, south, east, north = item.bbox
        assert west < 8.005 and east > 7.995 and south < 47.002 and north > 46.998
    assert 'strip-flight-1' in items and 'strip-flight-2' not in items


def schema_errors(kind, told):
    """What the schemas of STAC, which pystac brings, say; without a network."""
    jsonschema = pytest.importorskip('jsonschema', reason='jsonschema is not installed')
    referencing = pytest.importorskip('referencing')
    local = pytest.importorskip('pystac.validation.local_validator')
    schemas = local.get_local_schema_cache()
    registry = referencing.Registry().with_resources(
        [(uri, referencing.Resource.from_contents(text)) for uri, text in schemas.items()])
    [schema] = [text for uri, text in schemas.items() if uri.endswith(f'/{kind}.json')]
    validator = jsonschema.Draft7Validator(schema, registry=registry)
    return [error.message for error in validator.iter_errors(told)]


def test_report_shows_what_is_lost(two_strips):
    for scan in two_strips.scans[1:]:
        two_strips.image(scan)
    for piece in two_strips.mosaic_tiles():
        two_strips.compute(piece)
    write_scan(two_strips.output, RecordingScan(
        'flight-3', losses=(ScanLoss('flight-3', None, 'it is empty <b>'),)))
    files = write_archive_report(two_strips.output, two_strips.job)
    assert files == ('mosaic.png', 'report.html')
    text = (two_strips.output / 'report.html').read_text()
    assert 'it is empty &lt;b&gt;' in text and '3 of 4 apertures, 144 pulses' in text
    assert two_strips.scans[0].name in text and 'data:image/png;base64' in text


def test_picture_is_the_mean_of_squares(imaged):
    power = stored_looks(imaged.output, '', imaged.mosaic, 64)[0]
    whole = power.read(imaged.mosaic).astype(float)
    found = reduced(power, power.extent, 50)
    factor = -(-max(whole.shape) // 50)
    assert max(found.shape) <= 50
    for row in range(0, found.shape[0], 7):
        for column in range(0, found.shape[1], 5):
            square = whole[row * factor:(row + 1) * factor, column * factor:(column + 1) * factor]
            known = square[np.isfinite(square)]
            np.testing.assert_allclose(found[row, column],
                                       known.mean() if known.size else np.nan, rtol=1e-9)


def test_random_pixels_of_the_mosaic_are_those_of_correlation(imaged):
    check = check_mosaic(imaged.output, 60)
    assert check.error_db < imaged.job.target_db
    np.testing.assert_array_equal(check.looks, check.reference_looks)
    # a mosaic that is wrong shows
    power = stored_looks(imaged.output, '', imaged.mosaic, 64)[0]
    for tile in power.extent.tiles(64):
        if power.has(tile):
            power.write(tile, power.read(tile) * np.float32(1.02), power.extent)
    # 1 % of amplitude
    assert check_mosaic(imaged.output, 60).error_db == pytest.approx(-40, abs=1)
