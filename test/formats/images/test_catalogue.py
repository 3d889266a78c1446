# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures with their place, and catalogue items that a validator accepts."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from sar_imaging.formats import write_geotiff, write_quicklook, write_sicd, write_stac_item
from sar_imaging.geometry import MapGrid, PlaneGrid, PointGrid

rasterio = pytest.importorskip('rasterio', reason='rasterio is not installed')
pyproj = pytest.importorskip('pyproj', reason='pyproj is not installed')

MAP = MapGrid((1.0, -2.0, 0.0), 200, 180, 0.15)
GEOD = pyproj.Geod(ellps='WGS84')


def test_picture_with_world_file(flight, peaks, tmp_path):
    flown = flight()
    files = write_quicklook(tmp_path / 'image.png', flown.image(MAP), flown.datum)
    assert sorted(tmp_path.iterdir()) == sorted(files)
    assert [file.suffix for file in files] == ['.png', '.pgw', '.prj', '.kml']
    with rasterio.open(files[0]) as file:
        grey, transform = file.read(1), file.transform
        assert (file.count, file.dtypes) == (1, ('uint8',))
    assert (grey.shape, grey.max(), grey.min()) == (MAP.shape, 255, 1)
    # GDAL takes the transform from the world file
    crs = pyproj.CRS.from_wkt(files[2].read_text())
    to_map = pyproj.Transformer.from_crs(4326, crs, always_xy=True)
    latitude, longitude, _ = flown.datum.to_geographic(flown.points_m)
    column, row = ~transform * np.array(to_map.transform(longitude, latitude))
    # bright reflectors are white over some pixels: their middle, within a pixel
    for r, c in zip(row - 0.5, column - 0.5, strict=True):
        window = np.argwhere(grey > 250)
        near = window[np.abs(window - (r, c)).max(axis=1) < 5]
        np.testing.assert_allclose(near.mean(axis=0), (r, c), atol=0.6)


@pytest.mark.parametrize('datum', [(47.0, 8.0, 400.0, 30.0), (-33.0, -180.0, 50.0, 211.0)])
def test_overlay_has_the_true_corners(flight, tmp_path, datum):
    flown = flight(datum=datum)
    *_, kml = write_quicklook(tmp_path / 'a & b.png', flown.image(MAP), flown.datum)
    tree = ElementTree.parse(kml)
    [told] = tree.iter('{http://www.google.com/kml/ext/2.2}LatLonQuad')
    corners = np.array([list(map(float, part.split(','))) for part in told[0].text.split()])
    [place] = tree.iter('{http://www.opengis.net/kml/2.2}href')
    assert place.text == 'a & b.png'
    west, east = MAP.x_m[0] - 0.075, MAP.x_m[-1] + 0.075
    south, north = MAP.y_m[-1] - 0.075, MAP.y_m[0] + 0.075
    true = flown.datum.to_geographic([(west, south, 0), (east, south, 0), (east, north, 0),
                                      (west, north, 0)])
    missed = GEOD.inv(true[1], true[0], corners[:, 0], corners[:, 1])[2]
    assert missed.max() < 1e-4  # of nine digits of a degree


def test_picture_that_cannot_be(flight, tmp_path):
    flown = flight()
    image = flown.image(MapGrid((0, 0, 0), 9, 9, 0.2))
    with pytest.raises(ValueError, match='image.jpg; expected a name that ends in .png'):
        write_quicklook(tmp_path / 'image.jpg', image, flown.datum)
    image.grid = PlaneGrid.wall((0, 0, 3), (1, 0), 1.6, 1.6, 0.2)
    with pytest.raises(ValueError, match='a map is level'):
        write_quicklook(tmp_path / 'image.png', image, flown.datum)
    assert not list(tmp_path.iterdir())


def schema_errors(item):
    """What the schemas of STAC, which pystac brings, say against an item; without a network."""
    jsonschema = pytest.importorskip('jsonschema', reason='jsonschema is not installed')
    referencing = pytest.importorskip('referencing')
    local = pytest.importorskip('pystac.validation.local_validator')
    schemas = local.get_local_schema_cache()
    registry = referencing.Registry().with_resources(
        [(uri, referencing.Resource.from_contents(text)) for uri, text in schemas.items()])
    [item_schema] = [text for uri, text in schemas.items() if uri.endswith('/item.json')]
    assert f"/v{item['stac_version']}/" in item_schema['$id']
    validator = jsonschema.Draft7Validator(item_schema, registry=registry)
    return [error.message for error in validator.iter_errors(item)]


@pytest.mark.parametrize('plane', ['ground', 'slant'])
@pytest.mark.parametrize('left', [True, False], ids=['left', 'right'])
def test_catalogue_item(flight, tmp_path, left, plane):
    pystac = pytest.importorskip('pystac', reason='pystac is not installed')
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    flown = flight(left=left, heading_deg=40.0)
    image = flown.sicd_image(plane)
    files = {'complex': tmp_path / 'data/image.nitf', 'map': tmp_path / 'data/image.tif'}
    files['map'].parent.mkdir()
    write_sicd(files['complex'], image, flown.datum, flown.acquisition)
    write_geotiff(files['map'], flown.image(MAP), flown.datum)
    path = tmp_path / 'image.json'
    write_stac_item(path, image, flown.datum, flown.acquisition, files)
    told = json.loads(path.read_text())
    assert schema_errors(told) == []
    item = pystac.Item.from_file(path)
    assert item.assets['complex'].get_absolute_href() == str(files['complex'])
    assert item.assets['map'].extra_fields['proj:code'] == 'EPSG:32632'
    assert item.assets['map'].extra_fields['proj:shape'] == list(MAP.shape)
    properties = item.properties
    assert properties['sar:observation_direction'] == ('left' if left else 'right')
    assert (properties['sar:frequency_band'], properties['sar:polarizations']) == ('X', ['VH'])
    assert properties['sar:center_frequency'] == pytest.approx(9.6)
    assert properties['start_datetime'] == '2023-11-14T22:13:20.123456Z'
    # on the ground; of an unweighted band and of 2.4 degrees of aperture
    assert properties['sar:resolution_range'] == pytest.approx(
        0.886 * 299792458.0 / 2 / 400e6 * np.hypot(3000, 1500) / 3000, rel=0.03)
    assert properties['sar:resolution_azimuth'] == pytest.approx(
        0.886 * 299792458.0 / 9.6e9 / 4 * np.hypot(3000, 1500) / 70, rel=0.03)
    west, south, east, north = item.bbox
    assert west < 8.0 < east and south < 47.0 < north
    assert (east - west) * np.cos(np.radians(47)) < 60 / 111e3 and north - south < 60 / 111e3


@pytest.mark.parametrize(('grid', 'problem'), [
    (PointGrid(MAP.points()[:4, :5]), 'lies on a PointGrid; expected a MapGrid, a TerrainGrid'),
    (PlaneGrid.wall((0, 0, 3), (1, 0), 1.6, 1.6, 0.2), 'plane of the image is upright')])
def test_item_that_cannot_be(flight, tmp_path, grid, problem):
    pytest.importorskip('pystac', reason='pystac is not installed')
    flown, file = flight(), tmp_path / 'image.npy'
    file.write_bytes(b'')
    with pytest.raises(ValueError, match=problem):
        write_stac_item(tmp_path / 'image.json', flown.image(grid), flown.datum,
                        flown.acquisition, {'map': file})
    assert list(tmp_path.iterdir()) == [file]


def test_item_across_the_date_line(flight, tmp_path):
    pytest.importorskip('pystac', reason='pystac is not installed')
    flown = flight(datum=(10.0, 179.9999, 0.0, 20.0))
    image = flown.image(MAP)
    path = tmp_path / 'image.tif'
    write_geotiff(path, image, flown.datum)
    item = write_stac_item(tmp_path / 'image.json', image, flown.datum, flown.acquisition,
                           {'map': path})
    assert schema_errors(item.to_dict(include_self_link=False)) == []
    west, _, east, _ = item.bbox
    assert 179.9 < west < 180 and -180 < east < -179.9
    assert item.geometry['type'] == 'MultiPolygon'
    parts = [np.array(ring) for [ring] in item.geometry['coordinates']]
    area = 0.0
    for ring in parts:
        x, y = ring.T
        assert np.abs(x).max() == 180.0 and np.abs(x).min() > 179.9
        assert tuple(ring[0]) == tuple(ring[-1])
        signed = 0.5 * (x[:-1] @ y[1:] - x[1:] @ y[:-1])
        assert signed > 0  # counter-clockwise
        area += signed * 111.2e3**2 * np.cos(np.radians(10))
    assert area == pytest.approx(200 * 180 * 0.15**2, rel=0.01)  # of 111.2 km a degree


def test_item_without_files(flight, tmp_path):
    pytest.importorskip('pystac', reason='pystac is not installed')
    flown = flight()
    image = flown.image(MapGrid((0, 0, 0), 9, 9, 0.2))
    path = tmp_path / 'image.json'
    with pytest.raises(ValueError, match='assets is empty'):
        write_stac_item(path, image, flown.datum, flown.acquisition, {})
    with pytest.raises(FileNotFoundError, match="of asset 'map' does not exist; write it first"):
        write_stac_item(path, image, flown.datum, flown.acquisition, {'map': tmp_path / 'no.tif'})
    assert not path.exists()
