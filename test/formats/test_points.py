# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Points as GeoJSON and CSV."""

import csv
import json

import numpy as np
import pytest

from sar_imaging.formats.points import write_points
from sar_imaging.geometry.earth import Datum

DATUM = Datum(69.5, 179.9999, 95.0, heading_deg=-35.0)
POINTS = np.array([[120.5, -30.25, 2.0], [-400.0, 900.0, 0.0], [np.nan, np.nan, np.nan]])
PROPERTIES = {'snr': [13.5, 20.25, np.nan], 'number': np.arange(3), 'name': ['a', 'b', 'c']}


def test_geojson_has_longitude_first_and_finds_back(tmp_path):
    path = tmp_path / 'targets.geojson'
    write_points(path, POINTS, DATUM, PROPERTIES)
    assert [f.name for f in tmp_path.iterdir()] == ['targets.geojson']
    collection = json.loads(path.read_text(), parse_constant=pytest.fail)  # NaN
    assert collection['type'] == 'FeatureCollection'
    for feature, point, snr in zip(collection['features'], POINTS, (13.5, 20.25), strict=False):
        assert feature['type'] == 'Feature' and feature['geometry']['type'] == 'Point'
        longitude, latitude, height = feature['geometry']['coordinates']
        assert abs(longitude) > 179 and 69 < latitude < 70
        # nine decimals of a degree are 0.11 mm of latitude, four of a metre 0.05 mm
        np.testing.assert_allclose(DATUM.from_geographic(latitude, longitude, height), point,
                                   rtol=0, atol=1.5e-4)
        assert feature['properties']['snr'] == snr
        assert [feature['properties'][axis] for axis in 'xyz'] == point.tolist()
    last = collection['features'][2]
    assert last['geometry'] is None
    assert last['properties'] == {'x': None, 'y': None, 'z': None, 'snr': None, 'number': 2,
                                  'name': 'c'}


def test_csv_has_the_same_numbers(tmp_path):
    path = tmp_path / 'targets.csv'
    write_points(path, POINTS, DATUM, PROPERTIES)
    with open(path, newline='') as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ['latitude', 'longitude', 'height', 'x', 'y', 'z', 'snr', 'number',
                             'name']
    for row, point in zip(rows[:2], POINTS, strict=False):
        place = [float(row[name]) for name in ('latitude', 'longitude', 'height')]
        np.testing.assert_allclose(DATUM.from_geographic(*place), point, rtol=0, atol=1.5e-4)
        assert [float(row[axis]) for axis in 'xyz'] == point.tolist()
    assert list(rows[2].values()) == ['', '', '', '', '', '', '', '2', 'c']


def test_no_point_is_an_empty_collection(tmp_path):
    write_points(tmp_path / 'a.geojson', np.zeros((0, 3)), DATUM)
    assert json.loads((tmp_path / 'a.geojson').read_text())['features'] == []


def test_mistakes_are_told_and_leave_nothing(tmp_path):
    with pytest.raises(ValueError, match=r'a.kml: expected a name that ends in .geojson or .csv'):
        write_points(tmp_path / 'a.kml', POINTS, DATUM)
    with pytest.raises(ValueError, match=r'snr.shape=\(2,\); expected \(3,\)'):
        write_points(tmp_path / 'a.csv', POINTS, DATUM, {'snr': [1, 2]})
    with pytest.raises(ValueError, match=r'points_m.shape=\(3,\); expected \(n, 3\)'):
        write_points(tmp_path / 'a.csv', POINTS[0], DATUM)
    with pytest.raises(TypeError):
        write_points(tmp_path / 'a.geojson', POINTS, DATUM, {'odd': np.array([object()] * 3)})
    assert list(tmp_path.iterdir()) == []
